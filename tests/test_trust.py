"""A checkpoint is data: nothing that it names or holds is run."""

import copy
import importlib
import pkgutil
from pathlib import Path

import numpy as np
import pytest
import skops.io
import torch
from conftest import configured_classes, make_card
from sklearn.naive_bayes import GaussianNB
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

import tex_lightning as tl
from tex_lightning.baselines.base import dump_estimator, load_estimator
from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.checkpoint import lightning_state
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config.instantiation import own_part, trust

CARD = make_card("haptic", classes=["a", "b"], width=0.1)
PLAN = {"fit": {"head_factor": 1.0}, "seed": 0, "pieces": {"haptic": 200}}


def code(path: Path) -> str:
    return f"open({str(path)!r}, 'w').close()"


def attack(path: Path) -> str:
    """A value that Hydra would have OmegaConf make an object of, by running code."""
    return f'${{oc.create:{{_target_: numpy.testing.measure, code_str: "{code(path)}"}}}}'


def write(folder: Path, changes: dict[str, object], **more: object) -> Path:
    """A checkpoint of a small HapticNet whose card has other values."""
    card = CARD.to_dict()
    for key, value in changes.items():
        *outer, last = key.split(".")
        place = card
        for name in outer:
            place = place[name]
        place[last] = value
    state = lightning_state(SurfaceClassifier(CARD))
    content = {"hyper_parameters": {**PLAN, **more, "card": card}, "state_dict": state}
    torch.save(content, folder / "m.ckpt")
    return folder / "m.ckpt"


@pytest.mark.parametrize(
    ("key", "nested"),
    [
        ("senses.haptic.modality", False),
        ("senses.haptic.decode.channels", False),
        ("senses.haptic.network.dropout", True),
    ],
)
def test_an_interpolation_in_a_card_is_refused_and_runs_nothing(
    cli, surfaces, tmp_path, key, nested
):
    value = attack(tmp_path / "ran")
    path = write(tmp_path, {key: [value] if nested else value})
    trace = next(surfaces.glob("*/haptic/*.wav"))
    outcome = cli("task=predict", f"checkpoint={path}", f"haptic={trace}")
    assert (outcome.status, outcome.out, outcome.err.count("\n")) == (2, "", 1)
    for load in (tl.load, load_classifier):
        with pytest.raises(tl.UserError):
            load(path)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("senses.haptic.anything", "${data.root}", r"holds values without \$\{"),
        ("senses.haptic._partial_", True, "has the key _partial_"),
        ("senses.haptic.network._args_", [1], "has the key _args_"),
        ("senses.haptic.anything", {"_convert_": "all"}, "has the key _convert_"),
        ("senses.haptic.anything", torch.ones(1), "of Tensor, which is no plain value"),
        ("senses.haptic.network.size", 3, "no key model.haptic.network.size"),
        ("senses.haptic._target_", "torch.nn.Linear", "torch is not trusted"),
        ("senses.haptic.network._target_", "os.system", "os is not trusted"),
        ("senses.haptic.anything", [{"_target_": "os.system"}], "os is not trusted"),
        ("senses.haptic.network._target_", 3, "package 3 is not trusted"),
        (
            "senses.haptic.network._target_",
            "tex_lightning.learning.module.SurfaceModule",
            "tex_lightning is not trusted",
        ),
    ],
)
def test_what_is_no_plain_value_or_no_class_of_a_card_is_refused(tmp_path, key, value, said):
    with pytest.raises(tl.UserError, match=said):
        SurfaceClassifier.from_checkpoint(write(tmp_path, {key: value}))


def test_trust_holds_for_the_process(tmp_path, monkeypatch):
    (tmp_path / "theirs.py").write_text(
        "from tex_lightning.networks.hapticnet import HapticNet\nclass Net(HapticNet): pass\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    path = write(tmp_path, {"senses.haptic.network._target_": "theirs.Net"})
    with pytest.raises(tl.UserError, match=r"theirs is not trusted: give trusted=\[theirs\]"):
        tl.load(path)
    with pytest.raises(tl.UserError, match=r"trusted is 'theirs'; give a list, as in \['theirs'\]"):
        tl.load(path, trusted="theirs")
    trust("theirs")
    assert type(tl.load(path).classifier.network).__name__ == "Net"


def test_no_other_class_of_the_package_may_be_named_than_the_configuration_puts_into_a_card():
    """No list names them, and no class is among them by chance."""
    trusted = set()
    for module in pkgutil.walk_packages(tl.__path__, "tex_lightning."):
        if not module.name.endswith("__main__"):
            names = vars(importlib.import_module(module.name))
            trusted |= {f"{module.name}.{name}" for name in names}
    assert {target for target in trusted if own_part(target)} == configured_classes()


@pytest.mark.parametrize(
    "target",
    [
        "tex_lightning.senses.base.Sense",  # a base
        "tex_lightning.networks.HapticNet",  # not where it is defined
        "tex_lightning.networks.trunks.base.Trunk",
        "tex_lightning.baselines.base.EstimatorBaseline",
        "tex_lightning.baselines.classifier.FittedBaseline",
        "tex_lightning.networks.blocks.Head",
        "tex_lightning.networks.hapticnet.HapticNet.features",
        "tex_lightning.networks.hapticnet.nn.Sequential",
        "tex_lightning.networks.weights.Path",
        "tex_lightning.networks.nothing.Net",
        "tex_lightning.networks..hapticnet.HapticNet",
        "tex_lightning.networks.\0.Net",
        "tex_lightning.testing.trial.MeanNet",
        "tex_lightning.tasks.fit.run",
        "tex_lightning",
        "",
    ],
)
def test_what_is_no_part_of_a_card_is_refused_though_it_is_the_packages(tmp_path, target):
    path = write(tmp_path, {"senses.haptic.network._target_": target})
    with pytest.raises(tl.UserError, match="is not trusted: give trusted="):
        tl.load(path)


def forged(run: Path, folder: Path, estimator: object = None, **node: object) -> Path:
    """The checkpoint of a baseline with another estimator or other settings."""
    content = torch.load(run / "checkpoints" / "haptic.ckpt", weights_only=True)
    content = copy.deepcopy(content)
    if estimator is not None:
        dumped = np.frombuffer(skops.io.dumps(estimator), np.uint8).copy()
        content["baseline"]["estimator"] = torch.from_numpy(dumped)
    content["hyper_parameters"]["card"]["baseline"]["node"] |= node
    torch.save(content, folder / "b.ckpt")
    return folder / "b.ckpt"


def test_an_estimator_that_calls_a_function_is_refused_and_runs_nothing(
    cli, naive_bayes, surfaces, tmp_path
):
    choices = ["", "", code(tmp_path / "ran")]  # of the two axes of features the third
    steps = [np.ndim, (np.choose, {"choices": choices}), np.testing.measure]
    pairs = [each if isinstance(each, tuple) else (each, {}) for each in steps]
    calls = [FunctionTransformer(function, kw_args=given) for function, given in pairs]
    fitted = GaussianNB().fit([[0.0], [1.0]], [0, 1])
    path = forged(naive_bayes, tmp_path, make_pipeline(*calls, fitted))
    trace = next(surfaces.glob("*/haptic/*.wav"))
    outcome = cli("task=predict", f"checkpoint={path}", f"haptic={trace}")
    assert (outcome.status, outcome.out, outcome.err.count("\n")) == (2, "", 1)
    assert "numpy.testing" in outcome.err
    with pytest.raises(tl.UserError, match="FunctionTransformer"):
        tl.load(path)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    "estimator",
    [
        np.testing.measure,
        GaussianNB,
        make_pipeline(FunctionTransformer(np.sin), GaussianNB()),
        [GaussianNB().fit],
    ],
    ids=lambda each: type(each).__name__,
)
def test_only_the_listed_types_are_read_and_written(estimator):
    dumped = torch.from_numpy(np.frombuffer(skops.io.dumps(estimator), np.uint8).copy())
    for refused in (lambda: load_estimator(dumped), lambda: dump_estimator(estimator)):
        with pytest.raises(tl.UserError, match="which a checkpoint may not"):
            refused()


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("senses.haptic.decode.sampling_rate", 1e9, r"decode.sampling_rate is 1e\+09"),
        ("decision.pairs", 10**9, "decision.pairs is 1000000000"),
        ("senses.haptic.width", 8.0, "more weights than the file"),
        ("senses.haptic.width", 90.0, "model.haptic.width is 90: give a number in"),
        ("senses.haptic.window_seconds", 1e3, "haptic.window_seconds is 1000: give a number in"),
        ("senses.haptic.window_seconds", 10.0, "takes up too much memory"),
        ("senses.haptic.hop_seconds", 1e-4, "takes up too much memory"),
    ],
)
def test_sizes_that_a_file_asks_for_are_bounded(tmp_path, key, value, said):
    with pytest.raises(tl.UserError, match=said):
        tl.load(write(tmp_path, {key: value}))


def test_sizes_of_a_baseline_are_plain_values_and_bounded(naive_bayes, tmp_path):
    for change, said in (
        ({"filters": attack(tmp_path / "ran")}, "without"),
        ({"_target_": "subprocess.Popen", "args": ["true"]}, "subprocess is not trusted"),
        ({"window_seconds": 1e6}, r"window_seconds is 1e\+06: give a number in \(0, 1\] s"),
    ):
        with pytest.raises(tl.UserError, match=said):
            tl.load(forged(naive_bayes, tmp_path, **change))
    assert not (tmp_path / "ran").exists()
