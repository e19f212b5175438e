"""What runs on the CPU runs on another device, with the same result.

The device is CUDA or MPS where the machine has one, else the stand-in of ``second_device.py``,
which refuses what they would: tensors in two places, float64, generators of the CPU.
"""

import json
from copy import deepcopy
from pathlib import Path

import pytest
import second_device as stand_in
import torch
from conftest import CLASSES, make_card, make_photo, make_trace, trunk_node

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.statistics import FeatureStatistics
from tex_lightning.config.check import read_config
from tex_lightning.config.composition import compose_config
from tex_lightning.core import devices
from tex_lightning.core.devices import computing_device
from tex_lightning.data.recordings import Recording
from tex_lightning.inference.early_stopping import make_inference_model
from tex_lightning.inference.engine import accelerate
from tex_lightning.inference.stream import LiveStream
from tex_lightning.learning.finish import refit_scores
from tex_lightning.networks.trunks import TRUNKS
from tex_lightning.senses.features.array_gain import ArrayGain

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


def few_card() -> Card:
    node = read_config(compose_config(["experiment=few/haptic"])).model.sense("haptic").node
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
    config = read_config(compose_config(["decision=sequential"]))
    near = make_classifier(make_card("haptic", "visual", width=0.1))
    given, found = sample(near.card), []
    for device in ("cpu", second_device):
        decider = make_inference_model(deepcopy(near).to(device), config.engine, config.decision)
        haptic = decider.full.with_senses(["haptic"])
        stream = LiveStream(haptic, {"haptic": None}, {}, config.stream, top_k=3)
        *_, last = (stream.push(chunk) for chunk in given["haptic"].split(5000, dim=1))
        votes = decider.classify(**given), decider.full.classify(**given)
        found.append([vote.probabilities for vote in votes] + [torch.tensor(last.probability)])
    for expected, values in zip(*found, strict=True):
        torch.testing.assert_close(values, expected, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("wide", [False, True])
def test_a_copy_is_accelerated_where_it_is_if_the_device_has_float64(monkeypatch, wide):
    """Else what float64 is needed for crosses over; both give the copy that the CPU makes."""
    engine = read_config(compose_config([])).engine
    near = make_classifier(make_card("haptic", "visual", width=0.1))
    far = deepcopy(near).to(stand_in.register())
    monkeypatch.setattr(stand_in, "WIDE", () if wide else stand_in.WIDE)
    monkeypatch.setattr(devices, "has_float64", lambda device: wide or device.type == "cpu")
    with stand_in.noting() as counts:
        found = accelerate(far, engine)
    assert bool([place for way, place in counts if way != "wait"]) != wide
    expected = accelerate(near, engine).state_dict()
    assert found.state_dict().keys() == expected.keys()
    for name, values in found.state_dict().items():
        assert values.device.type == stand_in.NAME
        assert torch.equal(values.cpu(), expected[name])


def test_fc3_is_refitted_there_though_the_device_has_no_float64():
    layers = []
    for device in (torch.device("cpu"), stand_in.register()):
        torch.manual_seed(0)
        classifier = make_classifier(make_card("haptic", width=0.1)).to(device)
        labels = [label for label in CLASSES for _ in range(5)]
        rows = [Recording(label, "haptic", Path(f"{n}"), n) for n, label in enumerate(labels)]
        features = torch.randn(len(rows), classifier.network.score_layer.in_channels)
        classifier.trained_embeddings["haptic"] = rows, features
        assert refit_scores(classifier, 3.0)
        layers.append([x.detach().cpu() for x in classifier.network.score_layer.parameters()])
    for near, far in zip(*layers, strict=True):
        torch.testing.assert_close(far, near)


def test_what_tells_the_gain_of_an_array_is_fitted_there_though_the_device_has_no_float64():
    means = torch.rand(40, 1) ** torch.tensor([0.6, 1.0, 1.4, 0.8])
    near, far = ArrayGain(4), ArrayGain(4).to(stand_in.register())
    for array, device in ((near, "cpu"), (far, stand_in.register())):
        array.fit(means.to(device), torch.ones(4, dtype=torch.bool, device=device))
    trace = 3 * means[0, :, None].repeat(1, 50)
    assert near.gain(trace) < 0.5
    torch.testing.assert_close(far.gain(trace.to(far.weights.device)).cpu(), near.gain(trace))


class Pooled(torch.nn.Module):
    """A network of somebody else, which says nothing of its windows."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = torch.nn.Sequential(torch.nn.Conv2d(3, 4, 5), torch.nn.MaxPool2d(2))

    def features(self, x: torch.Tensor, level: str) -> torch.Tensor:
        return self.layers(x)


def test_the_geometry_of_another_network_is_found_there(second_device):
    found = []
    for device in ("cpu", second_device):
        sense = SurfaceClassifier(trunk_card("vgg_m")).senses["visual"].eval()
        sense.network = Pooled().eval()
        vars(sense).pop("geometry", None)  # that of its own network
        found.append(sense.to(device).geometry)
    assert found[0].stride == 2
    assert found[0] == found[1]


def test_results_name_the_device_that_computed(second_device, cli, tiny, naive_bayes, tmp_path):
    """Baselines take the CPU."""
    assert computing_device("auto", [True, True]).type == "cpu"
    assert computing_device("auto", [True, False]) == second_device
    fit = cli("model=mfcc_nb", *tiny, f"hydra.run.dir={tmp_path}/fit")
    same = [item for item in tiny if item.startswith("data")]
    test = cli(
        "task=evaluate", f"checkpoint={naive_bayes}", *same, f"hydra.run.dir={tmp_path}/test"
    )
    assert fit.status == test.status == 0, fit.err + test.err
    for run in ("fit", "test"):
        results = json.loads((tmp_path / run / "results.json").read_text())
        assert results["environment"]["device"] == "cpu"


def test_one_sample_is_predicted_from_on_the_cpu(second_device, cli, untrained, surfaces):
    """Unless another device is asked for; several samples take the device."""
    checkpoint = f"checkpoint={untrained}/checkpoints/fusion.ckpt"
    haptic, image = (f"{name}={surfaces}/alpha/{name}" for name in ("haptic", "image"))
    labels, one, photo = [], f"{haptic}/alpha_0.wav", f"{image}/alpha_0.png"
    for *files, there in (
        (one, False),
        (one, "trainer.accelerator=gpu", True),
        (f"haptic=[{one.partition('=')[2]},{surfaces}/beta/haptic/beta_1.wav]", True),
        (one, photo, False),
        (photo, False),
    ):
        with stand_in.noting() as counts:
            done = cli("task=predict", checkpoint, *files)
        assert done.status == 0, done.err
        assert bool(counts) == there or second_device.type != stand_in.NAME
        labels.append(json.loads(done.out.splitlines()[0])["label"])
    assert labels[0] == labels[1] == labels[2]


def test_the_stand_in_refuses_what_devices_refuse():
    far = torch.zeros(3, device=stand_in.register())
    assert (2 * far + torch.tensor(1.0)).tolist() == [1, 1, 1]  # a number of no axes may join
    for mistake in (
        lambda: far + torch.ones(3),
        lambda: torch.stack([far[0], torch.tensor(1.0)]),
        lambda: far.random_(generator=torch.Generator()),
    ):
        with pytest.raises(stand_in.MixedDevicesError):
            mistake()
    with pytest.raises(TypeError):
        far.double()
