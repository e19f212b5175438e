"""Classify files with a trained network; one JSON object per sample on standard output."""

import json
import time
from pathlib import Path
from typing import Any, cast

import torch
from torch import Tensor

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.data.decode import DecodeSettings, decode_image, decode_trace
from tex_lightning.data.folds import NEEDS
from tex_lightning.decision.voting import Vote
from tex_lightning.devices import pick_device, synchronise
from tex_lightning.errors import UserError
from tex_lightning.inference.sequential import prepare
from tex_lightning.parts import part_for
from tex_lightning.schema import Config


def run(config: Config, directory: Path) -> None:
    """Load the checkpoint once and print a line for each sample.

    Several traces and photos are paired in the order given. Decoding is part of the latency. Of a
    FusionNet that is given one modality, its part for that modality decides; with a FusionNet each
    line says what was looked at.
    """
    classifier = load_classifier(cast(str, config.checkpoint))
    _refuse_unused(classifier, config)
    samples = _pairs(_files("haptic", config.haptic), _files("image", config.image))
    fused = classifier.card.kind == "fusion"
    if fused and config.image is None:
        classifier = part_for(classifier, "haptic")
    elif fused and config.haptic is None:
        classifier = part_for(classifier, "image")
    said = {"modalities": list(NEEDS[classifier.card.kind])} if fused else {}
    classifier = prepare(classifier.to(pick_device(config.trainer.accelerator)), config)
    for haptic, image in samples:
        line = {**_predict(classifier, config, haptic, image), **said}
        print(json.dumps(line), flush=True)


def _refuse_unused(classifier: SurfaceClassifier, config: Config) -> None:
    needs = NEEDS[classifier.card.kind]
    given = {"haptic": config.haptic, "image": config.image}
    unused = [key for key, value in given.items() if value is not None and key not in needs]
    if unused:
        raise UserError(
            f"This {classifier.card.title} does not look at {unused[0]}; leave {unused[0]}= "
            "out or give another checkpoint."
        )


def _predict(
    classifier: SurfaceClassifier, config: Config, haptic: Path | None, image: Path | None
) -> dict[str, Any]:
    settings = classifier.card.settings_for(config.data.file_rate)
    begin = time.perf_counter()
    try:
        vote = classifier.classify(
            None if haptic is None else torch.from_numpy(decode_trace(haptic, settings)),
            None if image is None else _photo(image, settings, config.predict.fast_decode),
        )
    except UserError as error:
        files = [str(file) for file in (haptic, image) if file is not None]
        named = any(file in str(error) for file in files)
        raise UserError(str(error) if named else f"{' and '.join(files)}: {error}") from error
    synchronise(classifier.device)
    latency = (time.perf_counter() - begin) * 1000
    given = {"haptic": haptic, "image": image}
    return {
        **{key: str(file) for key, file in given.items() if file is not None},
        **_report(vote, classifier.card.classes, config),
        "latency_ms": round(latency, 3),
    }


def _photo(path: Path, settings: DecodeSettings, fast: bool) -> Tensor:
    return torch.from_numpy(decode_image(path, settings, fast=fast))


def _report(vote: Vote, classes: list[str], config: Config) -> dict[str, Any]:
    """Label first whatever the tie; then the others by votes, then by their place."""
    shares = vote.shares.tolist()
    ranked = sorted(range(len(classes)), key=lambda i: (i != vote.label, -shares[i], i))
    return {
        **vote.named(classes, config.decision.reject_below),
        "confidence": shares[vote.label],
        "probability": vote.probability,
        "top_k": [{"label": classes[i], "share": shares[i]} for i in ranked[: config.top_k]],
        "fragments": len(vote.fragments),
        "evidence": round(vote.evidence, 6),
    }


def _files(key: str, value: object) -> list[Path]:
    """A file or a list of files from the configuration."""
    if value is None:
        return []
    values = value if isinstance(value, list) else [value]
    if not values or any(isinstance(item, dict | list) for item in values):
        raise UserError(f"{key}={value} is not a file or a list of files; give {key}=FILE.")
    return [Path(str(item)).expanduser() for item in values]


def _pairs(traces: list[Path], photos: list[Path]) -> list[tuple[Path | None, Path | None]]:
    if not traces and not photos:
        raise UserError("There is nothing to classify; give haptic=FILE, image=FILE or both.")
    if traces and photos and len(traces) != len(photos):
        raise UserError(
            f"There are {len(traces)} traces and {len(photos)} photos; give as many of each."
        )
    count = max(len(traces), len(photos))
    return list(
        zip(traces or [None] * count, photos or [None] * count, strict=True)  # type: ignore[list-item]
    )
