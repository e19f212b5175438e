"""Every network of the package as an ONNX file: does it say what PyTorch says, and how fast?

Networks have random weights, random statistics of batch normalisation, and features that have
learnt from the recordings; those of ``few/*`` are fitted. Labels are compared on real recordings
where a folder ``shared/data`` lies beside the checkout, else on noise of as many sizes.
``python -m benchmarks export`` takes about half an hour; ``BENCHMARK_EXPORT=haptic,lite0``
runs networks of these names only.
"""

import logging
import os
import random
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import nn

from benchmarks._classifiers import configured, make_classifier
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.data.decode import PhotoDecoder
from tex_lightning.data.folds import make_samples
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.store import Store, cache_root, load_sample
from tex_lightning.errors import UserError
from tex_lightning.export.onnx_file import (
    TensorSample,
    compare,
    decoded,
    make_onnx,
    noise_sample,
    onnx_runner,
)

log = logging.getLogger(__name__)

REAL = Path(__file__).resolve().parents[2] / "shared" / "data"
COUNT = 50
CLASSES = 10
LITE = "model=visual_efficientnet"
NETWORKS: dict[str, tuple[str, ...]] = {
    "haptic": ("model=haptic",),
    "haptic_quarter": ("model=haptic", "model.haptic.width=0.25"),
    "haptic_lrn": ("model=haptic", "model.haptic.norm=lrn"),
    "haptic_linear_scale": ("model=haptic", "model.haptic.scale=linear"),
    "haptic_paper": ("experiment=paper/haptic",),
    "sound": ("model=sound",),
    "few_haptic": ("experiment=few/haptic", "weights=null"),
    "few_sound": ("experiment=few/sound", "weights=null"),
    "few_visual": ("experiment=few/visual", "weights=null"),
    "alexnet": ("model=visual",),
    "alexnet_quarter": ("model=visual", "model.visual.width=0.25"),
    "alexnet_lrn": ("model=visual", "model.visual.norm=lrn"),
    "tcnn": ("model=visual_tcnn",),
    "vgg_m": ("model=visual_vgg_m",),
    "lite0": (LITE, "weights=null"),
    "lite0_quarter": (LITE, "weights=null", "model.visual.width=0.25"),
    "lite2": (LITE, "weights=null", "trunk=efficientnet_lite2"),
    "fusion_fc2": ("model=fusion",),
    "fusion_fc3": ("model=fusion_fc3",),
    "fusion_lite0": ("model=fusion_efficientnet", "weights=null"),
}


def measure() -> dict[str, Any]:
    """Labels, largest score difference, size and times of each."""
    chosen = os.environ.get("BENCHMARK_EXPORT", "").split(",")
    names = [name for name in NETWORKS if not any(chosen) or name in chosen]
    figures: dict[str, Any] = {"threads": torch.get_num_threads()}
    for name in names:
        try:
            figures[name] = _measure(NETWORKS[name])
        except UserError as error:
            figures[name] = {"failed": str(error)}
        log.warning("%s: %s", name, figures[name])
    return figures


def _measure(overrides: Sequence[str]) -> dict[str, Any]:
    config = configured(*overrides, *_data(configured(*overrides)))
    classifier = make_classifier(
        *overrides, f"data.half_scale={not REAL.is_dir()}", classes=CLASSES
    )
    samples = _samples(config, classifier)
    _learn(classifier, samples[:CLASSES])
    model = make_onnx(classifier)
    found = compare(onnx_runner(model), classifier, samples)
    return {"megabytes": round(model.ByteSize() / 1e6, 2), **found}


def _data(config: Config) -> list[str]:
    """Real recordings of the senses of a model."""
    senses = config.model.senses
    if not REAL.is_dir():
        return []
    if "sound" in senses:
        return ["data=folder", f"data.root={REAL / 'lmt16_sound'}"]
    if "visual" in senses:
        return ["data=manifest", f"data.manifest={REAL / 'surfaces10.csv'}"]
    return ["data=folder", f"data.root={REAL / 'lmt16'}"]


def _samples(config: Config, classifier: SurfaceClassifier) -> list[TensorSample]:
    """Return real samples drawn at random, photos in full size; noise where there are none."""
    if not REAL.is_dir():
        return [noise_sample(classifier, seed) for seed in range(COUNT)]
    modalities, decoders = classifier.card.modalities, {}
    for sense in classifier.senses.values():
        decoder = sense.decoder.assuming(config.data.file_rate)
        photo = isinstance(decoder, PhotoDecoder)
        decoders[sense.modality] = replace(decoder, half_scale=False) if photo else decoder
    samples = make_samples(read_recordings(config.data, modalities), modalities)
    random.Random(0).shuffle(samples)  # so that the first come from many classes
    store = Store(cache_root(config.data.cache_dir), decoders)
    return [load_sample(sample, store) for sample in samples[:COUNT]]


@torch.no_grad()
def _learn(classifier: SurfaceClassifier, samples: Sequence[TensorSample]) -> None:
    """Let features and fitted networks learn from recordings, and batch statistics vary."""
    generator = torch.Generator().manual_seed(0)
    for sense in classifier.senses.values():
        features: Any = sense.features
        network: Any = sense.network
        given = [decoded(each, classifier)[sense.modality] for each in samples]
        if hasattr(features, "learn"):
            features.learn(given)
        if hasattr(features, "fit"):
            features.fit([features.magnitudes(each) for each in given])
        for layer in network.modules():
            if isinstance(layer, nn.BatchNorm2d):
                layer.running_mean.uniform_(-0.1, 0.1, generator=generator)
                layer.running_var.uniform_(0.5, 2, generator=generator)
        if hasattr(network, "fit"):
            network.fit([features(each)[0] for each in given], torch.arange(len(given)) % CLASSES)
