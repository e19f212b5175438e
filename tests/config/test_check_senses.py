"""Keys of a user's senses that nothing would read."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from torch import nn

from tex_lightning.config import CONF
from tex_lightning.config.check import check_config
from tex_lightning.config.composition import compose_config
from tex_lightning.config.weights import read_config
from tex_lightning.errors import UserError

PLUGIN = Path(__file__).parents[1] / "plugin"


class AnyNet(nn.Module):
    """Takes any argument."""

    def __init__(self, classes: int, **options: object) -> None:
        super().__init__()


@pytest.fixture(autouse=True)
def importable() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(PLUGIN))
        patch.syspath_prepend(str(Path(__file__).parent))
        yield


def check(*overrides: str, senses: str = "force") -> None:
    given = ["model=fusion", "+sense@model.force=force", f"model.senses=[{senses}]", *overrides]
    folder = f"file://{PLUGIN}/my_ext/conf"
    check_config(read_config(compose_config(CONF, given, [folder])))


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("+model.force.chanels=1", r"force\.chanels is .* mean model\.force\.network\.channels"),
        ("+model.force.channels=1", r"did you mean model\.force\.network\.channels\?"),  # has it
        ("+model.force.modalty=a", r"did you mean model\.force\.modality\?"),
        ("+model.force.fits=1", r"mean model\.force\.fit\?.*: model\.force has decode"),
        ("+model.force.network.chanels=1", r"did you mean model\.force\.network\.channels\?"),
        ("+model.force.features.sample=1", r"did you mean model\.force\.features\.samples\?"),
        ("+model.force.decode.sample_rate=1", r"mean model\.force\.decode\.sampling_rate\?"),
        ("+model.force.fit.epohcs=1", r"no key model\.force\.fit\.epohcs .*force\.fit\.epochs\?"),
        ("+model.fusion.forc_checkpoint=a", r"did you mean model\.fusion\.force_checkpoint\?"),
    ],
)
def test_a_key_that_nothing_reads_is_refused(override, said):
    with pytest.raises(UserError, match=said):
        check(override)


@pytest.mark.parametrize("key", ["nope", "norm", "frames", "classes"])
def test_a_key_of_another_purpose_is_warned_of(key, caplog):
    """Nodes of the file may interpolate it."""
    check(f"+model.force.{key}=1", "model.force.network.channels=${..%s}" % key)  # noqa: UP031
    assert f"model.force.{key} is read by no class" in caplog.text


def test_what_a_node_takes_over_under_the_same_name_is_read(caplog):
    check("+model.force.channels=4", "model.force.network.channels=${..channels}")
    assert caplog.text == ""


def test_keys_that_a_class_takes_are_offered_to_it():
    check("~model.force.network.channels", "+model.force.channels=4")
    check("+model.force.decode.channel=0")


def test_a_class_that_takes_any_argument_takes_all():
    check("model.force.network={_target_: test_check_senses.AnyNet, x: 1}", "+model.force.y=2")


def test_a_sense_that_begins_with_one_of_the_package_has_its_keys():
    given = ["+sense@model.grip=haptic", "model.grip.modality=grip"]
    own = "model.grip.network={_target_: my_ext.ForceNet, channels: 4}"  # takes no norm
    check(*given, own, senses="grip")
    with pytest.raises(UserError, match=r"did you mean model\.grip\.width\?"):
        check(*given, "+model.grip.widht=1", senses="grip")


def test_a_sense_that_is_not_trained_is_not_looked_at():
    check("model.force.network._target_=no.such.Class", senses="haptic")
