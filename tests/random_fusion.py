"""A small FusionNet with random weights and what training would leave behind."""

import dataclasses
from pathlib import Path

import numpy as np
import torch
from conftest import make_card, make_photo, make_trace, save_classifier

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.statistics import FeatureStatistics

RANGES = {
    "haptic": {"level": [0.1, 0.3], "rate": [10_000.0, 10_000.0]},
    "image": {"brightness": [100.0, 140.0], "contrast": [30.0, 60.0]},
}
KNOWN = [0.1, 0.2, 0.3]  # novelties of recordings of known classes
PAIRS = 200
RECORDINGS = {"haptic": make_trace, "visual": make_photo}


def write_random_fusion(folder: Path) -> None:
    """Write ``fusion.ckpt``, whose network halves photos."""
    folder.mkdir()
    torch.manual_seed(1)
    card = make_card("haptic", "visual", width=0.1, half_scale=True, pairs=PAIRS)
    card = dataclasses.replace(
        card,
        decision={**card.decision, "unknown": 0.3},
        calibration={"temperature": 1.5, "novelties": {"haptic": KNOWN, "visual": KNOWN}},
        input_ranges=RANGES,
    )
    classifier = SurfaceClassifier(card).eval()
    features = classifier.senses["haptic"].features
    traces = [torch.from_numpy(make_trace(kind, 0))[None] for kind in range(3)]
    features.known_gain.fit([features.magnitudes(trace) for trace in traces])
    add_statistics(classifier)
    save_classifier(classifier, folder / "fusion.ckpt")


def add_statistics(classifier: SurfaceClassifier) -> None:
    """Features of two recordings of every class."""
    labels = torch.arange(6) % 3
    for name in classifier.senses:
        made = [RECORDINGS[name](kind % 3, kind) for kind in range(6)]
        arrays = [torch.from_numpy(np.atleast_2d(each)) for each in made]
        rows = [classifier.embedding(name, each).mean(dim=1).detach() for each in arrays]
        classifier.statistics[name] = FeatureStatistics.of(torch.stack(rows), labels, 3)
