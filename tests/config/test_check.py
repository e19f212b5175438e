"""Keys that nothing would read, and values that a class refuses, are told before any work."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tex_lightning.config.check import check_config, read_config
from tex_lightning.config.composition import compose_config
from tex_lightning.errors import UserError

PLUGIN = Path(__file__).parents[1] / "plugin"


@pytest.fixture(autouse=True)
def importable() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(PLUGIN))
        yield


def check(*overrides: str, senses: str = "force") -> None:
    given = ["model=fusion", f"model.senses=[{senses}]", *overrides]
    folder = f"hydra.searchpath=[file://{PLUGIN}/my_ext/conf]"
    check_config(read_config(compose_config([folder, *given])))


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("+model.force.fit.epohcs=1", r"no key .*\(did you mean model\.force\.fit\.epochs\?\)"),
        ("+model.force.netwrk.channels=4", r"\(did you mean model\.force\.network\?\)"),
        ("+model.force.widht=4", "no key model.force.widht"),
        ("model.force.fit.epochs=-1", r"model\.force\.fit\.epochs is -1: give a number in \[0"),
        (
            "model.force.fit.epochs=few",
            r"model\.force\.fit\.epochs cannot be used: give a whole number; c",
        ),
        ("~model.force._target_", "model.force names no class, which is no sense: begin its file"),
        ("~model.force.features", r"model.force.features names no class: give \{_target_: MODULE"),
        ("+model.sense=[force]", r"no key model\.sense \(did you mean model\.senses\?\)"),
        ("+sources=1", "no key sources"),  # names of a method and a property
        ("model.force.network=null", r"network cannot be used: it takes no null.*the command or"),
        ("+model.fusion.forc_checkpoint=a", r"did you mean force_checkpoint\?"),
    ],
)
def test_a_key_or_value_that_nothing_reads_is_refused(override, said):
    with pytest.raises(UserError, match=said):
        check(override)


def test_keys_that_a_class_takes_are_offered_to_it_and_others_may_be_interpolated():
    check("~model.force.network.channels", "+model.force.channels=4")
    check("+model.force.other=1", "model.force.network.channels=${..other}")


def test_a_sense_that_begins_with_one_of_the_package_has_its_keys():
    own = "model.grip.network={_target_: my_ext.ForceNet, channels: 4}"  # takes no norm
    check("+sense@model.grip=haptic", "model.grip.modality=grip", own, senses="grip")


@pytest.mark.parametrize(("given", "meant"), [("image", "visual"), ("forse", "force")])
def test_a_wrong_sense_has_a_near_match(given, meant):
    with pytest.raises(UserError, match=rf"names {given} \(did you mean {meant}\?\), and there"):
        check(senses=given)


def test_a_sense_that_is_not_trained_is_not_looked_at():
    check("model.force.network._target_=no.such.Class", senses="haptic")


def test_keys_of_another_task_are_refused_where_they_are_typed_and_not_in_a_file():
    config = read_config(compose_config(["crossval.only=[0]"]))
    check_config(config)
    check_config(config, lambda _: False)
    frontier = read_config(compose_config(["task=frontier", "crossval.only=[0]"]))
    check_config(frontier, lambda _: True)
    with pytest.raises(UserError, match=r"crossval\.only is read by task=crossval, task=frontier"):
        check_config(config, lambda key: key == "crossval.only")


@pytest.mark.parametrize("devices", ["nonesuch", None, [], -5, float("nan"), ["a"]])
def test_devices_that_are_no_number_are_refused(devices):
    config = read_config(compose_config())
    config.trainer.devices = devices
    with pytest.raises(UserError, match=r"trainer\.devices is"):
        check_config(config)


@pytest.mark.parametrize(
    "case",
    [
        "model.haptic.fit.optimizer.betas=[2,2]", "trainer.gradient_clip=1", "trainer.plugins=3",
        "callbacks.progress.foo=1",
    ],
)  # fmt: skip
def test_what_a_constructor_refuses_is_said_before_data_is_read(case, cli, monkeypatch, tmp_path):
    fail = "tex_lightning.studies.dataset.read_recordings", lambda *_: pytest.fail("data is read")
    monkeypatch.setattr(*fail)
    outcome = cli("model=haptic", f"+{case}", f"hydra.run.dir={tmp_path}/run")
    assert (outcome.status, outcome.err.count("\n")) == (2, 1), outcome.err
    assert ("flag of trainer" if "trainer" in case else case.rpartition(".")[0]) in outcome.err


@pytest.mark.parametrize("key", ["data.hold_out", "trusted", "frontier.only", "stability.systems"])
def test_a_list_in_a_list_of_names_is_refused(key):
    with pytest.raises(UserError, match=rf"{key} is \[\['a'\]\]: give a list, each text"):
        check_config(read_config(compose_config([f"{key}=[[a]]"])))
