"""Keys that nothing would read, and values that a class refuses, are told before any work."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tex_lightning.config import CONF
from tex_lightning.config.check import check_config, check_known
from tex_lightning.config.composition import compose_config
from tex_lightning.config.weights import read_config
from tex_lightning.core.devices import count_processes
from tex_lightning.errors import UserError

PLUGIN = Path(__file__).parents[1] / "plugin"


@pytest.fixture(autouse=True)
def importable() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(PLUGIN))
        yield


def check(*overrides: str, senses: str = "force") -> None:
    given = ["model=fusion", "+sense@model.force=force", f"model.senses=[{senses}]", *overrides]
    composed = compose_config(CONF, given, [f"file://{PLUGIN}/my_ext/conf"])
    check_known(composed)
    check_config(read_config(composed))


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("+model.force.modalty=a", r"did you mean model\.force\.modality\?"),
        ("+model.force.fits=1", r"did you mean model\.force\.fit\?"),
        ("+model.force.decode.sample_rate=1", r"mean model\.force\.decode\.sampling_rate\?"),
        ("+model.force.fit.epohcs=1", r"model\.force: .*epohcs"),
        ("+model.fusion.forc_checkpoint=a", r"did you mean force_checkpoint\?"),
        ("+trainer.max_epochs=3", r"trainer\.max_epochs is set by this package"),
    ],
)
def test_a_key_that_nothing_reads_is_refused(override, said):
    with pytest.raises(UserError, match=said):
        check(override)


def test_keys_that_a_class_takes_are_offered_to_it_and_others_may_be_interpolated():
    check("~model.force.network.channels", "+model.force.channels=4")
    check("+model.force.decode.other=0")
    check("+model.force.other=1", "model.force.network.channels=${..other}")


def test_a_sense_that_begins_with_one_of_the_package_has_its_keys():
    own = "model.grip.network={_target_: my_ext.ForceNet, channels: 4}"  # takes no norm
    check("+sense@model.grip=haptic", "model.grip.modality=grip", own, senses="grip")


def test_a_sense_that_is_not_trained_is_not_looked_at():
    check("model.force.network._target_=no.such.Class", senses="haptic")


@pytest.mark.parametrize("devices", ["", "nonesuch", None, [], -5, float("nan"), ["a"]])
def test_devices_that_are_no_number_are_refused(devices):
    config = read_config(compose_config(CONF))
    config.trainer.devices = devices
    with pytest.raises(UserError, match=r"trainer\.devices is"):
        count_processes(config.trainer)


@pytest.mark.parametrize(
    "case",
    [
        "model.haptic.fit.optimizer.betas=[2,2]", "model.haptic.fit.optimizer.weigth_decay=1",
        "model.haptic.fit.schedule.pct_start=7", "trainer.val_check_interval=-3",
        "trainer.gradient_clip=1", "callbacks.progress.foo=1",
    ],
)  # fmt: skip
def test_what_a_constructor_refuses_is_said_before_data_is_read(case, cli, tmp_path):
    for label in ("oak", "felt"):
        (tmp_path / "data" / label / "haptic").mkdir(parents=True)
        for number in range(10):  # which cannot be read
            (tmp_path / "data" / label / "haptic" / f"{number}.wav").write_bytes(b"RIFF")
    data = ["data=folder", f"data.root={tmp_path}/data", "data.sampling_rate=10000"]
    outcome = cli("model=haptic", *data, f"+{case}", f"hydra.run.dir={tmp_path}/run")
    assert (outcome.status, outcome.err.count("\n")) == (2, 1), outcome.err
    named = "trainer says" if "trainer" in case else case.rpartition(".")[0]
    assert named in outcome.err
