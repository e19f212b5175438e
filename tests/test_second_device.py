"""What runs on the CPU runs on another device, with the same result.

The device is CUDA or MPS where the machine has one, else the stand-in of ``second_device.py``,
which refuses what they would: tensors in two places, float64, generators of the CPU.
"""

import csv
import functools
import os
import subprocess
import sys
from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace

import pytest
import second_device as stand_in
import torch
import torchgen
import yaml
from conftest import make_card, make_photo, make_trace, trunk_node
from lightning.fabric.utilities import move_data_to_device

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.statistics import FeatureStatistics
from tex_lightning.config import CONF
from tex_lightning.config.composition import compose_config
from tex_lightning.config.weights import read_config
from tex_lightning.inference.early_stopping import make_inference_model
from tex_lightning.inference.stream_classifier import StreamingClassifier
from tex_lightning.learning.enrolment import add_classes
from tex_lightning.learning.fusion import FusionModule
from tex_lightning.networks.trunks import TRUNKS

PAPER = {"axes": "trace", "scale": "linear", "normalisation": "paper", "norm": "lrn"}
CARDS = {
    "haptic": lambda: make_card("haptic", width=0.1),
    "haptic of the paper": lambda: make_card("haptic", width=0.1, **PAPER),
    "sound": lambda: make_card("sound", width=0.1),
    "proportions of bands": lambda: few_card(),
    **{name: lambda name=name: trunk_card(name) for name in TRUNKS},
    "fusion of features": lambda: make_card("haptic", "visual", width=0.1),
    "fusion of scores": lambda: make_card("haptic", "visual", level="fc3", width=0.1),
    "fusion of three": lambda: make_card("haptic", "visual", "sound", width=0.1),
}
QUICK = ("haptic of the paper", "proportions of bands", "efficientnet_lite0", "fusion of features")
FIT = {
    "optimizer": {"_target_": "torch.optim.AdamW", "_partial_": True},
    "schedule": {"_target_": "torch.optim.lr_scheduler.OneCycleLR", "_partial_": True},
    **{"epochs": 1, "steps_per_epoch": 5, "learning_rate": 1e-3, "head_factor": 2.0},
    **{"label_smoothing": 0.1, "modality_dropout": 0.0},
}


def few_card() -> Card:
    node = read_config(compose_config(CONF, ["experiment=few/haptic"])).model.sense("haptic").node
    return Card(**{**vars(make_card("haptic")), "senses": {"haptic": node}})


def trunk_card(name: str) -> Card:
    norm = "batch" if "batch" in TRUNKS[name].norms else TRUNKS[name].norms[0]
    width = 1.0 if name.startswith("efficientnet") else 0.1
    return make_card("visual", trunk=trunk_node(name), norm=norm, width=width)


def sample(card: Card) -> dict[str, torch.Tensor]:
    trace = torch.from_numpy(make_trace(1, 0))
    given = {
        "haptic": torch.stack([trace, trace.flip(0), trace.roll(99)]),
        "image": torch.from_numpy(make_photo(1, 0, side=260)),
        "sound": torch.from_numpy(make_trace(1, 0, seconds=10.0))[None],
    }
    return {name: given[name] for name in card.modalities}


def make_classifier(card: Card) -> SurfaceClassifier:
    """With random weights and statistics."""
    torch.manual_seed(0)
    classifier = SurfaceClassifier(card).eval()
    for sense in classifier.senses.values():
        if hasattr(sense.features, "learn"):
            sense.features.learn([sample(card)[sense.modality]])
    with torch.no_grad():
        for name, sense in classifier.senses.items():
            own = classifier.embedding(name, sample(card)[sense.modality]).mean(dim=1)
            rows = own + 0.1 * torch.randn(6, len(own))
            labels = torch.arange(6) % len(card.classes)
            classifier.statistics[name] = FeatureStatistics.of(rows, labels, len(card.classes))
    return classifier


@pytest.mark.parametrize(
    "name",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in CARDS],
)
def test_every_network_decides_as_on_the_cpu(second_device, name):
    near = make_classifier(CARDS[name]())
    far = deepcopy(near).to(second_device)
    given = sample(near.card)
    expected, found = near.classify(**given), far.classify(**given)
    assert far.device.type == second_device.type
    torch.testing.assert_close(found.probabilities, expected.probabilities, rtol=1e-3, atol=1e-4)
    assert found.novelty == pytest.approx(expected.novelty, rel=1e-2, abs=1e-4)
    assert found.label == expected.label
    assert (found.fragments == expected.fragments).float().mean() > 0.98  # but for near ties


def test_the_engine_a_stream_and_an_early_stop_decide_as_on_the_cpu(second_device):
    config = read_config(compose_config(CONF, ["decision=sequential", "decision.calibrated=false"]))
    near = make_classifier(make_card("haptic", "visual", width=0.1))
    given, found = sample(near.card), []
    for device in ("cpu", second_device):
        decider = make_inference_model(deepcopy(near).to(device), config.engine, config.decision)
        stream = StreamingClassifier(decider.full.with_senses(["haptic"]))
        votes = [stream.push(chunk) for chunk in given["haptic"].split(5000, dim=1)]
        found.append([decider.classify(**given), decider.full.classify(**given), votes[-1]])
    for expected, vote in zip(*found, strict=True):
        torch.testing.assert_close(vote.probabilities, expected.probabilities, rtol=1e-3, atol=1e-3)


def test_a_network_that_has_classified_there_learns_a_class(second_device):
    classifier = make_classifier(make_card("haptic", width=0.1)).requires_grad_(False)
    given = sample(classifier.card)["haptic"]
    features = deepcopy(classifier).to(second_device).embedding("haptic", given).cpu()
    wider = add_classes(classifier, ["delta"], {"haptic": [[features]]})
    assert wider.to(second_device).classify(haptic=given).label == 3


@pytest.mark.parametrize(
    ("mistake", "error"),
    [
        (lambda far: far + torch.ones(3), stand_in.MixedDevicesError),
        (lambda far: torch.ones(3).add_(far), stand_in.MixedDevicesError),
        (lambda far: torch.stack([far[0], torch.tensor(1.0)]), stand_in.MixedDevicesError),
        (lambda far: far[torch.tensor([0, 1])], stand_in.MixedDevicesError),
        (lambda far: far.random_(generator=torch.Generator()), stand_in.MixedDevicesError),
        (lambda far: far.double(), TypeError),
        (lambda far: far.numpy(), RuntimeError),
    ],
)
def test_the_stand_in_refuses_what_devices_refuse(mistake, error):
    far = torch.zeros(3, device=stand_in.register())
    assert (2 * far + torch.tensor(1.0)).tolist() == [1, 1, 1]  # a number of no axes may join
    with pytest.raises(error):
        mistake(far)


ALONE = "SECOND_DEVICE_ALONE"
alone = pytest.mark.skipif(ALONE not in os.environ, reason="runs in a process of its own, below")


@pytest.mark.slow
def test_training_in_a_process_of_its_own():
    arguments = [__file__, "-n=0", "-m=slow", "-k=test_alone", "-p", "no:cacheprovider"]
    finished = subprocess.run(
        [sys.executable, "-m", "pytest", *arguments],
        env={**os.environ, ALONE: "1"},
        capture_output=True,
        text=True,
    )
    assert finished.returncode == 0, finished.stdout + finished.stderr
    assert "3 passed" in finished.stdout


def make_module(dropout: float) -> FusionModule:
    torch.manual_seed(0)
    card = make_card("haptic", "visual", width=0.1, dropout=dropout).to_dict()
    module = FusionModule(card, FIT, 0, {"haptic": 240, "visual": 224})
    module.log = module.log_dict = lambda *_, **__: None
    groups = [SimpleNamespace(param_groups=[])]
    module._trainer = SimpleNamespace(
        log_every_n_steps=1, global_step=0, optimizers=groups, world_size=1
    )
    return module.train()


def batch() -> dict[str, object]:
    torch.manual_seed(1)
    crops = torch.randint(0, 256, (2, 3, 320, 320), dtype=torch.uint8)
    return {
        "label": torch.arange(2),
        "haptic": {"input": torch.randn(2, 1, 50, 240)},
        "visual": {"crop": crops, "degrees": torch.tensor([-30.0, 110.0])},
    }


@alone
@pytest.mark.slow
def test_alone_a_step_of_training_and_one_of_validation_are_those_on_the_cpu(second_device):
    losses, weights = [], []
    for device in (torch.device("cpu"), second_device):
        module = make_module(dropout=0.0).to(device)
        optimizer = module.configure_optimizers()["optimizer"]
        for _ in range(2):
            loss = module.training_step(move_data_to_device(batch(), device), 0)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
        losses.append(loss.detach().cpu())
        weights.append([each.detach().cpu() for each in module.parameters()])
        whole = {"label": torch.tensor(1), "recordings": sample(module.classifier.card)}
        with torch.inference_mode():
            module.eval().validation_step(move_data_to_device(whole, device), 0)
        assert all(0 <= float(each) <= 1 for each in module.val_metrics.compute().values())
    torch.testing.assert_close(losses[1], losses[0], rtol=1e-3, atol=1e-4)
    for found, expected in zip(weights[1], weights[0], strict=True):
        torch.testing.assert_close(found, expected, rtol=1e-2, atol=3e-3)


@alone
@pytest.mark.slow
def test_alone_dropout_is_drawn_on_the_device(second_device):
    module = make_module(dropout=0.5).to(second_device)
    loss = module.training_step(move_data_to_device(batch(), second_device), 0)
    assert loss.device.type == second_device.type


# Of a checkpoint of the first one; together with it they run whatever computes on a device.
RUNS = [
    ["model=fusion"],
    ["task=evaluate", "checkpoint=RUN", "decision=sequential", "decision.calibrated=false"],
    ["task=evaluate", "checkpoint=RUN", "engine=reference"],
    ["task=stability", "stability.systems=[RUN]"],
    ["task=enroll", "checkpoint=RUN", "enroll.forget=[alpha]", "enroll.only=[alpha]"],
    ["task=predict", "checkpoint=RUN", "haptic=WAV", "image=PNG", "predict.figure=PAGE"],
    ["task=stream", "checkpoint=RUN/checkpoints/haptic.ckpt", "haptic=WAV"],
    ["task=stream", "checkpoint=RUN/checkpoints/haptic.ckpt", "haptic=WAV", "stream.window=2"],
    ["experiment=few/fusion"],
    ["experiment=robust/fusion"],
    ["model=fusion_fc3"],
    ["model=visual_efficientnet", "weights=imagenet"],
    ["model=haptic", "model.haptic.axes=trace", "model.haptic.normalisation=paper"],
    ["model=acnn"],
]


def run_all(cli, surfaces, folder):
    """The runs of ``RUNS``; gives the folder of the first."""
    words = {"RUN": folder / "0", "PAGE": folder / "why.png"}
    words |= {"WAV": surfaces / "beta/haptic/beta_0.wav", "PNG": surfaces / "beta/image/beta_0.png"}
    data = ["data=folder", f"data.root={surfaces}", "data.half_scale=false"]
    for number, run in enumerate(RUNS):
        arguments = [*run, "debug=tiny", f"hydra.run.dir={folder / str(number)}"]
        if not run[0].endswith(("predict", "stream")):
            arguments += data
        for word, path in words.items():
            arguments = [each.replace(word, str(path)) for each in arguments]
        outcome = cli(*arguments)
        assert outcome.status == 0, (run, outcome.err)
    return folder / "0"


def predicted(directory):
    with (directory / "predictions" / "fusion.csv").open() as stream:
        return [(row["haptic"], row["predicted"]) for row in csv.DictReader(stream)]


@alone
@pytest.mark.slow
def test_alone_whole_runs_on_the_device_end_well_and_its_kernels_exist(cli, surfaces, tmp_path):
    stand_in.OPERATIONS.clear()
    with stand_in.chosen() as device:
        far = run_all(cli, surfaces, tmp_path)
    near = tmp_path / "near"
    data = ["data=folder", f"data.root={surfaces}", "data.half_scale=false", "debug=tiny"]
    assert cli("model=fusion", *data, f"hydra.run.dir={near}").status == 0
    if device.type == stand_in.NAME:  # which draws as the CPU does
        assert predicted(far) == predicted(near)
        assert len(stand_in.OPERATIONS) > 120
        assert not {name for name in stand_in.OPERATIONS if not kernels(name) >= {"CUDA", "MPS"}}


def kernels(name: str) -> set[str]:
    """Devices that PyTorch says it has a kernel of an operation for."""
    entry = native_functions()[name.removeprefix("aten.").removesuffix(".default")]
    given = {key for keys in entry.get("dispatch", {}) for key in keys.split(", ")}
    if "ufunc_inner_loop" in entry:
        given |= {"CPU", "CUDA"}
    if any(key.startswith("Composite") for key in given) or not entry.get("dispatch"):
        given |= {"CUDA", "MPS"}  # made of other operations, which are looked up themselves
    if "structured_delegate" in entry:
        given = kernels(entry["structured_delegate"])
    return given


@functools.cache
def native_functions():
    """PyTorch's own table of its operations."""
    path = Path(torchgen.__file__).parent / "packaged/ATen/native/native_functions.yaml"
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    return {each["func"].split("(")[0]: each for each in yaml.load(path.read_text(), loader)}
