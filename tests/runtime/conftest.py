"""A small FusionNet with random weights, as a checkpoint and as an exported file."""

import dataclasses

import numpy as np
import pytest
import torch
from conftest import make_card, make_once, make_photo, make_trace, save_classifier

import tex_lightning as tl
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.statistics import FeatureStatistics
from tex_lightning.export.onnx_file import make_onnx, write_onnx
from tex_lightning_runtime import Runtime

RANGES = {
    "haptic": {"level": [0.1, 0.3], "rate": [10_000.0, 10_000.0]},
    "image": {"brightness": [100.0, 140.0], "contrast": [30.0, 60.0]},
}


KNOWN = [0.1, 0.2, 0.3]  # novelties of recordings of known classes
RECORDINGS = {"haptic": make_trace, "visual": make_photo}


def add_statistics(classifier):
    """What training would leave behind: features of two recordings of every class."""
    labels = torch.arange(6) % 3
    for name in classifier.senses:
        made = [RECORDINGS[name](kind % 3, kind) for kind in range(6)]
        arrays = [torch.from_numpy(np.atleast_2d(each)) for each in made]
        rows = [classifier.embedding(name, each).mean(dim=1).detach() for each in arrays]
        classifier.statistics[name] = FeatureStatistics.of(torch.stack(rows), labels, 3)


@pytest.fixture(scope="session")
def exported(common):
    """Checkpoint and exported file of one network, which halves photos."""
    folder = make_once(common / "exported", write_exported)
    return folder / "fusion.ckpt", folder / "fusion.onnx"


def write_exported(folder):
    folder.mkdir()
    torch.manual_seed(1)
    card = make_card("haptic", "visual", width=0.1, half_scale=True, pairs=200)
    card = dataclasses.replace(
        card,
        decision={**card.decision, "unknown": 0.3},
        calibration={"temperature": 1.5, "novelties": {"haptic": KNOWN, "visual": KNOWN}},
        input_ranges=RANGES,
    )
    classifier = SurfaceClassifier(card).eval()
    add_statistics(classifier)
    save_classifier(classifier, folder / "fusion.ckpt")
    write_onnx(make_onnx(classifier), folder / "fusion.onnx")


@pytest.fixture(scope="session")
def model(exported):
    return tl.load(exported[0])


@pytest.fixture(scope="session")
def runtime(exported):
    return Runtime(exported[1], threads=1)
