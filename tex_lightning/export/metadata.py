"""The metadata of an exported file, for programs that run it, and a model card, for people.

The card follows Mitchell et al., "Model Cards for Model Reporting", 2019.
"""

from pathlib import Path
from typing import Any

from tex_lightning import __version__
from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config.instantiation import PACKAGE, named_classes
from tex_lightning.core.run_folder import read_results, run_of
from tex_lightning.data.decode import PhotoDecoder, SignalDecoder
from tex_lightning.errors import listed
from tex_lightning.senses.base import Sense
from tex_lightning.senses.features.proportions import BandProportions
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures
from tex_lightning.text import printable, render
from tex_lightning_runtime.quality import limits
from tex_lightning_runtime.runtime import FORMAT
from tex_lightning_runtime.samples import MAX_AXES

TEMPLATE = Path(__file__).with_name("model_card.md.jinja")
METADATA_KEY = "tex_lightning"  # of the metadata
FRAMES: dict[str, Any] = {"hop_seconds": None, "window_seconds": None, "frequencies": None}


def metadata(classifier: SurfaceClassifier) -> dict[str, Any]:
    """Return plain values for JSON: classes, senses, decision, ranges of the training."""
    card = classifier.card
    # share of known samples that may be called unknown, and the novelty that follows from it
    unknown = {"rate": card.unknown, "threshold": card.unknown_above}
    return {
        "format": FORMAT,
        "version": __version__,
        "kind": card.kind,
        "classes": card.classes,
        "senses": [_sense(sense, card) for sense in classifier.senses.values()],
        "decision": {
            "rule": card.rule,
            "temperature": card.temperature,
            "pairs": card.decision["pairs"],
            "seed": card.decision["seed"],
        },
        "unknown": None if card.unknown_above is None else unknown,
        "ranges": card.input_ranges,
    }


def _sense(sense: Sense, card: Card) -> dict[str, Any]:
    decoder, geometry = sense.decoder, sense.geometry
    entry: dict[str, Any] = {
        "name": sense.name,
        "modality": sense.modality,
        "what": sense.noun,
        "medium": sense.medium,
        "least": _least(sense),
        "limits": limits(card.input_ranges.get(sense.modality, {})),
        "receptive_field": None if geometry is None else geometry.receptive_field,
        "stride": None if geometry is None else geometry.stride,
    }
    if isinstance(decoder, PhotoDecoder):
        return entry | {"half_scale": decoder.half_scale, "resize": decoder.resize}
    if not isinstance(decoder, SignalDecoder):
        return entry
    least, features, frames = entry["least"], sense.features, FRAMES
    levels: int = getattr(features, "levels", 0)
    needed = "" if least is None else f"the {least / decoder.sampling_rate:.2f} s that "
    if isinstance(features, SpectrogramFeatures):
        frames = {
            "hop_seconds": features.hop_length / features.sampling_rate,
            "window_seconds": features.window_length / features.sampling_rate,
            "frequencies": features.frequencies.tolist(),
        }
    return entry | {
        "rate": decoder.sampling_rate,
        "file_rate": decoder.file_rate,
        "channels": None if decoder.channels is None else list(decoder.channels),
        "time_unit": decoder.time_unit,
        "axes": [levels] if levels else [*range(1, MAX_AXES + 1)],
        "too_short": f"The {sense.noun} has less movement than {needed}one fragment takes; record "
        "a longer stroke.",
        **frames,
    }


def _least(sense: Sense) -> int | None:
    """Return the samples of movement, or pixels a side after halving, that one fragment takes."""
    if isinstance(sense.features, BandProportions):
        return sense.features.min_samples
    if not sense.knows_min_size:
        return None
    if isinstance(sense.features, SpectrogramFeatures):
        return sense.features.samples(sense.min_size[1])
    return max(sense.min_size)


def model_card(classifier: SurfaceClassifier, checkpoint: Path) -> str:
    """Return the card as Markdown.

    Args:
        classifier: Loaded classifier.
        checkpoint: Checkpoint file; accuracies are read from its run folder, if there is one.
    """
    card, results = classifier.card, _results(checkpoint)
    entry = results.get("networks", {}).get(card.kind, {})
    networks = {sense.title: None for sense in classifier.senses.values()}
    packages = {name.partition(".")[0] for name in named_classes([card.senses, card.baseline])}
    context = {
        "card": card,
        "results": results,
        "entry": entry,
        "networks": card.title if card.baseline else listed(list(networks)),
        "fused": f", fused on {card.fusion['level'].upper()}" if classifier.fusion else "",
        "kept": max((len(next(rows.buffers())) for rows in classifier.rows.values()), default=0),
        "parameters": classifier.count_parameters(),
        "version": __version__,
        "sources": card.trained_on.get("trunks") or {},
        "checkpoint": printable(checkpoint.name).replace("`", "'"),  # which would end the block
        "trusted": sorted(packages - {PACKAGE.partition(".")[0]}),
        "inputs": ", ".join(f'{printable(name)}="FILE"' for name in card.modalities),
    }
    return render(TEMPLATE, context)


def _results(checkpoint: Path) -> dict[str, Any]:
    """Read ``results.json`` of the run, or of all folds for the checkpoint of one."""
    file = checkpoint.resolve()
    found = (read_results(folder) for folder in (run_of(file), file.parent.parent))
    return next(filter(None, found), {})
