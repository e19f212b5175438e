"""No value inside a node that the package brings gets past the checks unless it does no harm."""

import pytest
from omegaconf import OmegaConf
from omegaconf.errors import ValidationError

from tex_lightning.config import CONF, flatten, plain_values
from tex_lightning.config.check import check_config, check_known
from tex_lightning.config.composition import compose_config
from tex_lightning.config.weights import read_config
from tex_lightning.core.devices import count_processes
from tex_lightning.errors import UserError

MODELS = [
    ["model=fusion"], ["model=haptic_bands"], ["model=visual", "trunk=efficientnet_lite0"],
    ["model=minirocket"], ["model=mfcc_gmm"], ["model=lbp"], ["model=acnn"], ["model=alexnet_fv"],
]  # fmt: skip
ABSURD = [-5, 1e30, float("nan"), "nonesuch", "", []]
# Keys of which one of these values means something.
MEANT = {"scales": -5}  # exponents of two


def leaves_of_nodes(model):
    """Dotted names and values of what stands inside nodes without a type in the schema."""
    config = read_config(compose_config(CONF, model))
    nodes = {"model.baseline": config.model.baseline} if config.model.baseline else {}
    for sense in [] if config.model.baseline else config.model.senses:
        node = config.model.sense(sense).node
        parts = {key: value for key, value in node.items() if isinstance(value, dict)}
        nodes |= {f"model.{sense}.{key}": value for key, value in parts.items()}
    for kind in [] if config.model.baseline else config.model.trained:
        fit = config.model.fit_values(kind)
        nodes |= {f"model.{kind}.fit.{key}": fit[key] for key in ("optimizer", "schedule")}
    for name, value in flatten(plain_values(nodes)).items():
        if not name.rpartition(".")[2].startswith("_"):
            yield name, value


CASES = [
    pytest.param(model, name, value, id=f"{model[0]}-{name}")
    for model in MODELS
    for name, value in leaves_of_nodes(model)
]


def refusal(model, name, value):
    config = compose(model)
    try:
        OmegaConf.update(config, name, value)
        check_config(read_config(config))
    except (UserError, ValidationError) as error:
        return str(error)
    return None


def compose(model, known={}):  # noqa: B006  (composing is most of the time)
    key = tuple(model)
    if key not in known:
        known[key] = compose_config(CONF, model)
    return known[key].copy()


@pytest.mark.parametrize(("model", "name", "value"), CASES)
def test_absurd_values_are_refused_wherever_a_key_stands(model, name, value):
    several = isinstance(value, list)
    number = isinstance((value or [0])[0] if several else value, int | float)
    for absurd in ABSURD if number and not isinstance(value, bool) else [-5, []]:
        if MEANT.get(name.rpartition(".")[2]) == absurd:
            continue
        given = [absurd] if several and absurd != [] else absurd
        said = refusal(model, name, given)
        if isinstance(value, str | bool):
            continue  # a dataclass makes text or true of numbers; nothing else is raised
        assert said is not None, f"{name}={given} passes"
        assert name in said


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"logger.tensorboard.name": -5}, "logger.tensorboard.name is -5: give text or null"),
        ({"callbacks.progress.foo": 1}, "callbacks.progress.foo is no argument of"),
        ({"model.haptic.fit.optimizer.weigth_decay": 1}, "did you mean model.haptic.fit.optimizer"),
        ({"model.haptic.decode.chanel": 1}, "did you mean model.haptic.decode.channel"),
        ({"model.haptic.decode.channel": -1}, "decode.channel is -1: choose from 0"),
        ({"trainer.gradient_clip_val": "a"}, "trainer.gradient_clip_val is 'a': give a number"),
    ],
)
def test_types_and_arguments_are_those_of_the_classes(given, said):
    config = compose(["model=haptic"])
    for name, value in given.items():
        OmegaConf.update(config, name, value, force_add=True)
    check_known(config)
    with pytest.raises(UserError, match=said):
        check_config(read_config(config))


@pytest.mark.parametrize("devices", ["", "nonesuch", None, [], -5, float("nan"), ["a"]])
def test_devices_that_are_no_number_are_refused(devices):
    config = read_config(compose(["model=haptic"]))
    config.trainer.devices = devices
    with pytest.raises(UserError, match=r"trainer\.devices is"):
        count_processes(config.trainer)


@pytest.mark.parametrize(
    "case",
    [
        "model.haptic.fit.optimizer.betas=[2,2]", "model.haptic.fit.schedule.pct_start=7",
        "trainer.val_check_interval=-3", "trainer.max_time=nonesuch",
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
