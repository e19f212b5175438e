"""What an exported file says of itself, for whoever runs it without this package."""

from typing import Any

from tex_lightning import __version__
from tex_lightning.branches import Branch
from tex_lightning.card import Card
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.data.decode import PhotoDecoder, SignalDecoder
from tex_lightning.export.tracing import takes_axes
from tex_lightning.features.spectrogram import SpectrogramFeatures
from tex_lightning.networks.tiles import layer_windows, receptive_field

KEY = "tex_lightning"  # of the metadata
FORMAT = 1  # of what stands there


def metadata(classifier: SurfaceClassifier) -> dict[str, Any]:
    """Plain values for JSON: classes, senses, decision, ranges of the training recordings."""
    card, fusion = classifier.card, classifier.fusion
    return {
        "format": FORMAT,
        "version": __version__,
        "kind": card.kind,
        "classes": card.classes,
        "senses": [_sense(branch) for branch in classifier.branches.values()],
        "decision": {
            "rule": card.rule,
            "temperature": card.temperature,
            "reject_below": card.reject_below,
            "pairs": card.decision["pairs"],
            "seed": card.decision["seed"],
        },
        "unknown": _unknown(card),
        "ranges": card.input_ranges,
        "parts": fusion is not None and set(fusion.levels) == {"fc2"},
    }


def _unknown(card: Card) -> dict[str, float] | None:
    """The novelty above which a sample is called unknown; None calls none so."""
    above = card.unknown_above
    return None if above is None else {"threshold": above, "rate": card.unknown}


def _sense(branch: Branch) -> dict[str, Any]:
    decoder, declared = branch.decoder, branch.declares_geometry
    entry: dict[str, Any] = {
        "name": branch.name,
        "modality": branch.modality,
        "what": branch.what,
        "medium": branch.medium,
        "least": _least(branch),
        "receptive_field": receptive_field(layer_windows(branch.network, 1)) if declared else None,
        "stride": branch.stride if declared else None,
    }
    if isinstance(decoder, SignalDecoder):
        entry |= {
            "rate": decoder.sampling_rate,
            "file_rate": decoder.file_rate,
            "channel": decoder.channel,
            "axes": takes_axes(branch),
            **_frames(branch),
        }
    elif isinstance(decoder, PhotoDecoder):
        entry |= {"half_scale": decoder.half_scale, "resize": decoder.resize}
    return entry


def _frames(branch: Branch) -> dict[str, Any]:
    features = branch.features
    if not isinstance(features, SpectrogramFeatures):
        return {"hop_seconds": None, "window_seconds": None, "frequencies": None}
    rate = features.sampling_rate
    return {
        "hop_seconds": features.hop_length / rate,
        "window_seconds": features.window_length / rate,
        "frequencies": features.frequencies.tolist(),
    }


def _least(branch: Branch) -> int | None:
    """Samples of movement, or pixels a side after halving, that one fragment takes."""
    if not branch.knows_min_size:
        return None
    if isinstance(branch.features, SpectrogramFeatures):
        return branch.features.samples(branch.min_size[1])
    return max(branch.min_size)
