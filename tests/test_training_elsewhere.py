"""A training on another device than the CPU: the same weights, and little that crosses over.

The device is the stand-in of ``second_device.py``, or that of the machine, where nothing can be
counted; see ``test_second_device.py``.
"""

import json
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest
import second_device as stand_in
import torch
from conftest import CLASSES, make_photo, make_trace, run_main
from torch import nn
from torch.nn.functional import cross_entropy

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config.check import read_config
from tex_lightning.config.composition import compose_config
from tex_lightning.data.folds import make_samples
from tex_lightning.evaluation.outcomes import WARM_UP, run_test
from tex_lightning.learning.module import mean_loss
from tex_lightning.networks.blocks import ResponseNorm
from tex_lightning.perturbations.table import perturbations
from tex_lightning.senses.features.movement import moving
from tex_lightning.studies.fold import open_training, train_model
from tex_lightning.studies.perturbed import Perturber, SystemFold

RECORDINGS = 4  # of each class
SENSES = {"haptic": ["haptic"], "visual": ["visual"], "fusion": ["haptic", "visual"]}

EPOCHS, STEPS = 2, 3

# What crosses over, by way and place. A signal is copied there once, of its beginning the touch is
# looked for on the CPU, and whether it has rests and is finite decides what happens next.
SIGNAL = Counter({
    ("to", "base.Sense.compute_features"): 1, ("from", "movement.movement_start"): 1,
    ("wait", "movement.moving"): 1, ("wait", "base._is_finite"): 1,
})  # fmt: skip
PHOTO = Counter({("to", "base.Sense.compute_features"): 1})
TUPLES = Counter({("to", "classifier.SurfaceClassifier.fuse"): 1})  # drawn on the CPU
READ = {"haptic": SIGNAL, "visual": PHOTO, "fusion": SIGNAL + PHOTO + TUPLES}
LABEL = Counter({("to", "module.SurfaceModule.validation_step"): 1})
KEPT = Counter({("to", "validation.Validation._input"): 1})  # a validated photo
FIRST = {"haptic": SIGNAL, "visual": KEPT, "fusion": SIGNAL + KEPT + TUPLES}
AGAIN = {"haptic": Counter(), "visual": Counter(), "fusion": TUPLES}  # of the same sample
# All scores of an epoch, to be voted with on the CPU, and what fragments and samples voted for
DECIDED = Counter({
    ("from", "devices.to_cpu"): 1, ("to", "validation.Validation.decide"): 2,
})  # fmt: skip
FIGURES = 20  # that Lightning waits for in an epoch, to log them and to choose the best
FOLDED = ("devices.with_float64",)  # on the CPU, if the device has no float64
VOTED = Counter({("from", "vote.Rule.__call__"): 1, ("wait", "vote.Vote.with_novelty"): 1})
WEIGHTED = Counter({("wait", "statistics.FeatureStatistics.has_reach"): 2})
PIECES = {"haptic": 3, "visual": 3, "fusion": 5}  # tensors of a batch, with the label


class Trained(NamedTuple):
    """A fusion trained on the CPU, the same trained there, and what crossed over in the latter."""

    near: SurfaceClassifier
    far: SurfaceClassifier
    crossings: dict[str, list[tuple[str, Counter]]]
    device: torch.device


@pytest.fixture(scope="module")
def few(surfaces, tmp_path_factory) -> list[str]:
    """Arguments of a training on few surfaces, of few steps."""
    root = tmp_path_factory.mktemp("few")
    for label in CLASSES:
        for modality, suffix in (("haptic", "wav"), ("image", "png")):
            (root / label / modality).mkdir(parents=True)
            for number in range(RECORDINGS):
                name = f"{label}/{modality}/{label}_{number}.{suffix}"
                shutil.copy(surfaces / name, root / name)
    return [
        "data=folder", f"data.root={root}", "data.half_scale=false", "data.sampling_rate=10000",
        f"data.folds={RECORDINGS}", "debug=tiny", "trainer.threads=1",
        *(f"model.{kind}.fit={{epochs: {EPOCHS}, steps_per_epoch: {STEPS}}}" for kind in SENSES),
    ]  # fmt: skip


def trained(folder: Path, *arguments: str) -> SurfaceClassifier:
    """Train a model, with all its networks, by the functions of the command line."""
    config = read_config(compose_config(arguments))
    count = {"count": {"_target_": "second_device.Crossings"}}
    config = replace(config, logger={}, callbacks=count)
    return train_model(config, open_training(config, folder), folder)


@pytest.fixture(scope="module")
def both(few, cache, tmp_path_factory) -> Trained:
    arguments = ["model=fusion", *few, f"data.cache_dir={cache}"]
    near = trained(tmp_path_factory.mktemp("near"), *arguments)
    stand_in.Crossings.made.clear()
    with stand_in.chosen() as device:
        far = trained(tmp_path_factory.mktemp("far"), *arguments)
    found = [each.found for each in stand_in.Crossings.made if each.found]
    return Trained(near, far, dict(zip(SENSES, found, strict=True)), device)


@pytest.fixture
def counted(both) -> Trained:
    if both.device.type != stand_in.NAME:
        pytest.skip("a device of the machine counts nothing")
    return both


def test_it_trains_the_weights_that_the_cpu_trains(both):
    found, expected = both.far.state_dict(), both.near.state_dict()
    names = [name for name in expected if name.startswith(("senses.", "fusion."))]
    assert any(name.startswith("fusion.") for name in names)
    for name in names:
        torch.testing.assert_close(found[name], expected[name], rtol=1e-3, atol=1e-4)
    cards = both.far.card, both.near.card
    for measure in (lambda card: card.temperature, lambda card: card.training["val_loss"]):
        assert measure(cards[0]) == pytest.approx(measure(cards[1]), rel=1e-2)


@pytest.mark.parametrize("kind", SENSES)
def test_nothing_crosses_over_in_a_step_but_its_batch(counted, kind):
    """Of recordings that is where its pieces begin; the device holds the inputs and the photos."""
    steps = [counts for what, counts in counted.crossings[kind] if what == "step"]
    batch = {("to", "datamodule.SurfaceData.transfer_batch_to_device"): PIECES[kind]}
    assert len(steps) == EPOCHS * STEPS
    assert steps[1] == steps[4] == batch  # the first of an epoch begins it, the last is logged
    assert not [place for way, place in steps[2] + steps[5] if way != "to"]


@pytest.mark.parametrize("kind", SENSES)
def test_recordings_of_a_validated_sample_cross_over_once(counted, kind):
    samples = [counts for what, counts in counted.crossings[kind] if what == "sample"]
    assert len(samples) == EPOCHS * len(CLASSES)
    assert samples[1] == samples[2] == LABEL + FIRST[kind]
    assert samples[4] == samples[5] == LABEL + AGAIN[kind]


@pytest.mark.parametrize("kind", SENSES)
def test_an_epoch_waits_for_its_figures_and_for_all_scores_at_once(counted, kind):
    """Whatever its steps and samples: it is all that is left without theirs."""
    found, kinds = counted.crossings[kind], [what for what, _ in counted.crossings[kind]]
    rest = sum((counts for _, counts in found[kinds.index("epoch") + 1 :]), Counter())
    for count, part in ((len(CLASSES), LABEL + AGAIN[kind]), (1, DECIDED)):
        for way, number in part.items():
            rest[way] -= count * number
            assert not rest.pop(way)
    waits = rest.pop(("wait", "trainer.fit_network"))
    assert waits <= FIGURES
    assert {place for way, place in rest if way != "to"} <= {*FOLDED}


@pytest.mark.parametrize("kind", SENSES)
def test_for_a_label_the_recordings_and_the_scores_cross_over(counted, kind):
    part = counted.far.to(counted.device).with_senses(SENSES[kind])
    trace, photo = torch.from_numpy(make_trace(0, 9))[None], torch.from_numpy(make_photo(0, 9))
    given = {"haptic": trace, "image": photo}
    with stand_in.noting() as counts:
        part.classify(**{name: given[name] for name in part.card.modalities})
    assert counts == VOTED + READ[kind] + (WEIGHTED if kind == "fusion" else Counter())


@pytest.mark.parametrize("kind", SENSES)
def test_in_a_test_run_nothing_crosses_over_but_for_its_labels(counted, kind, few, cache, tmp_path):
    """A robustness test waits once for the scores of all samples."""
    config = read_config(compose_config(["model=fusion", *few, f"data.cache_dir={cache}"]))
    dataset = open_training(config, tmp_path)
    part = counted.far.to(counted.device).with_senses(SENSES[kind])
    samples = make_samples(dataset.parts(config.data).test, part.card.modalities)
    read = READ[kind] + (WEIGHTED if kind == "fusion" else Counter())
    with stand_in.noting() as counts:
        run_test(part, samples, dataset.store)
    count = len(samples) + min(len(samples), WARM_UP)
    assert counts == times(count, VOTED + read)
    fold = SystemFold(tmp_path, part, samples, dataset.store, Perturber(seed=0))
    with stand_in.noting() as counts:
        fold.labels(perturbations()["jpeg"], 3)
    assert counts == times(len(samples), read) + Counter({("from", "devices.to_cpu"): 1})


def times(count: int, counts: Counter) -> Counter:
    return Counter({key: count * number for key, number in counts.items()})


@pytest.fixture
def repeatable() -> Iterator[None]:
    """What ``trainer.deterministic=true`` sets."""
    torch.use_deterministic_algorithms(True)
    yield
    torch.use_deterministic_algorithms(False)


def resting_stroke() -> torch.Tensor:
    trace = torch.from_numpy(make_trace(1, 0))
    trace[8_000:16_000] = 0
    return trace[None]


LABELS = torch.tensor([[0, 0], [2, 2], [1, 1]])
SAME: dict[str, tuple[Callable, Callable, Callable]] = {
    "loss": (
        lambda x: mean_loss(x, LABELS.to(x.device), 0.1),
        lambda x: cross_entropy(x, LABELS.to(x.device), label_smoothing=0.1),
        lambda: torch.randn(3, 3, 2),
    ),
    **{
        f"response norm of {size}": (
            ResponseNorm(size, alpha=0.5, beta=0.7, k=2), nn.LocalResponseNorm(size, 0.5, 0.7, 2),
            lambda: torch.randn(2, 7, 4, 3),
        )
        for size in (4, 5)
    },
    "rests": (lambda x: moving(x, 10_000), lambda x: moving(x, 10_000), resting_stroke),
}  # fmt: skip


@pytest.mark.parametrize("name", SAME)
def test_what_has_to_repeat_is_what_pytorch_gives(second_device, name, repeatable):
    """With its gradient; the device refuses what differs from time to time."""
    ours, pytorchs, make = SAME[name]
    torch.manual_seed(0)
    near = make().requires_grad_()
    far = near.detach().to(second_device).requires_grad_()
    expected, found = pytorchs(near), ours(far)
    torch.testing.assert_close(found.cpu(), expected, rtol=1e-5, atol=1e-6)
    assert found.shape[-1:] != near.shape[-1:] or name != "rests"  # something was left out
    for x in (expected, found):
        x.square().sum().backward()
    torch.testing.assert_close(far.grad.cpu(), near.grad, rtol=1e-5, atol=1e-6)


def test_the_stand_in_refuses_what_differs_from_time_to_time(repeatable):
    far = torch.rand(2, 3, 4, device=stand_in.register())
    far.long().cumsum(0)
    for mistake in (
        lambda: far.cumsum(0),
        lambda: cross_entropy(far, torch.zeros(2, 4).long().to(far.device)),
        lambda: far.median(dim=0),
    ):
        with pytest.raises(stand_in.NotDeterministicError):
            mistake()


def own(name: str, **arguments: str) -> list[str]:
    values = {"_target_": f"own_networks.{name}", **arguments}
    node = ", ".join(f"{key}: {value}" for key, value in values.items())
    return ["model=haptic", f"model.haptic.network={{{node}}}"]


FITS = {
    "fusion of scores": ["model=fusion", "model.fusion.level=fc3"],
    "haptic of the paper": ["experiment=paper/haptic"],
    "visual of the paper": ["experiment=paper/visual"],
    "robust": ["experiment=robust/fusion"],
    "best": ["experiment=best/haptic"],
    "closed forms": ["experiment=few/fusion"],
    "vgg_m": ["model=visual", "trunk=vgg_m"],
    "tcnn": ["model=visual", "trunk=tcnn"],
    "efficientnet_lite0": ["model=visual_efficientnet", "weights=null"],
    "sound": ["model=sound"],
    "a block of residuals": own("Residual"),
    "mirrored edges": own("Shape", shape="same_and_reflect"),
    "a spectral norm": own("Shape", shape="spectral_norm"),
    "indices of a pool": own("Shape", shape="pool_indices"),
}  # fmt: skip
REPEATED = ("haptic of the paper", "visual of the paper", "closed forms", "vgg_m", "tcnn", "best")


SOUNDS = ["data.classes=2", "data.synthetic.recordings=3", "data.folds=3", "debug=tiny"]


@pytest.mark.slow
@pytest.mark.parametrize("name", FITS)
def test_every_model_trains_there(second_device, cli, few, tmp_path, name):
    data = SOUNDS if name == "sound" else few
    done = cli(*data, *FITS[name], f"hydra.run.dir={tmp_path}/run")
    assert done.status == 0, done.err
    results = json.loads((tmp_path / "run/results.json").read_text())
    assert results["environment"]["device"] == second_device.type


@pytest.mark.slow
@pytest.mark.parametrize("name", REPEATED)
def test_every_model_trains_there_with_operations_that_repeat(
    second_device, cli, few, tmp_path, name, repeatable
):
    given = ["trainer.deterministic=true", f"hydra.run.dir={tmp_path}/run"]
    done = cli(*few, *FITS[name], *given)
    assert done.status == 0, done.err


@pytest.fixture(scope="module")
def runs(few, cache, tmp_path_factory) -> Path:
    """A fusion, and band proportions that lack a class, both trained there."""
    folder = tmp_path_factory.mktemp("runs")
    models = {"fusion": ["model=fusion"], "two": ["experiment=few/haptic", "data.hold_out=[gamma]"]}
    with stand_in.chosen(), pytest.MonkeyPatch.context() as patch:
        for name, given in models.items():
            places = f"data.cache_dir={cache}", f"hydra.run.dir={folder}/{name}"
            assert run_main(patch, *few, *given, *places) == 0
    return folder


FUSION, TWO = "checkpoint={runs}/fusion", "checkpoint={runs}/two"
HAPTIC = "checkpoint={runs}/fusion/checkpoints/haptic.ckpt"
FILES, FILE = "haptic={root}/alpha/haptic", "haptic={root}/alpha/haptic/alpha_0.wav"
WORK = {
    "crossval": ["task=crossval", "model=haptic", "crossval.only=[0,3]", "{data}"],
    "frontier": ["task=frontier", "crossval.only=[0,1]", "{data}", "data.classes=3",
                 "frontier.only=[hapticnet_w0.5,hapticnet_w0.5_sequential,mfcc_nb]"],
    "evaluate": ["task=evaluate", FUSION, "{data}"],
    "evaluate early": ["task=evaluate", FUSION, "decision=sequential", "{data}"],
    "enroll": ["task=enroll", TWO, "{data}"],
    "adapt": ["task=adapt", TWO, FILES],
    "stability": ["task=stability", "stability.systems=[{runs}/fusion]", "{data}",
                  "stability.only=[white_noise,shorter_trace,jpeg]"],
    "predict": ["task=predict", FUSION, FILES, "image={root}/alpha/image"],
    "predict adapted": ["task=predict", TWO, FILES, "adapt=true"],
    "stream": ["task=stream", HAPTIC, FILE],
    "stream of a closed form": ["task=stream", TWO, FILE],
    "profile": ["task=profile", "model=haptic", "debug=tiny", "profile.rounds=1"],
    "export": ["task=export", HAPTIC, "export.format=onnx", "export.out={out}"],
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", WORK)
def test_every_task_works_there(second_device, cli, few, runs, tmp_path, name):
    root = few[1].partition("=")[2]
    places = {"runs": runs, "root": root, "out": tmp_path / "out"}
    given = []
    for item in WORK[name]:
        given += few if item == "{data}" else [item.format_map(places)]
    done = cli(*given, f"hydra.run.dir={tmp_path}/run")
    assert done.status == 0, done.err
