"""Decide by one dense pass and keep its scores."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tex_lightning.branches import Branch
from tex_lightning.branches.signal import SignalBranch
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.decision.voting import Vote
from tex_lightning.errors import UserError
from tex_lightning.features.spectrogram import FLOOR, SpectrogramFeatures, movement_start
from tex_lightning.inference.evidence import (
    Evidence,
    Floats,
    PhotoEvidence,
    SignalEvidence,
    equal_parts,
    window_extents,
)


@torch.inference_mode()
def gather(
    classifier: SurfaceClassifier, recordings: Mapping[str, Tensor]
) -> tuple[Vote, dict[str, Evidence]]:
    """Decide on one sample as ``classify`` does, and keep the scores of every position.

    Args:
        classifier: A network, in evaluation mode.
        recordings: Decoded, by modality.

    Returns:
        The decision, and by sense what it is made of.

    Raises:
        UserError: If a recording cannot be used, or it is a baseline, which has no positions.
    """
    card = classifier.card
    refuse_baseline(classifier)
    classifier.require(dict(recordings))
    alone = classifier.fusion is None
    summands, found = [], {}
    for name, branch in classifier.branches.items():
        recording = recordings[branch.modality]
        grid = branch.position_grid(recording, classifier.level(name))
        summand = classifier.project(name, grid.flatten(1))
        summands.append(summand)
        scores = summand.reshape(-1, *grid.shape[1:]).cpu().numpy()
        # a temperature is fitted to the sum of all senses
        found[name] = _evidence(branch, recording, scores, card.temperature if alone else 1.0)
    logits = classifier.join(summands, 0 if alone else classifier.seed(**recordings))
    return classifier.decide(logits, card.temperature), found


def refuse_baseline(classifier: SurfaceClassifier) -> None:
    """Refuse a classifier without dense scores.

    Raises:
        UserError: Naming the baseline.
    """
    if classifier.card.baseline:
        raise UserError(
            f"{classifier.card.title} looks at the whole recording at once, so it has no map to "
            "draw; leave predict.figure out, or give the checkpoint of a network."
        )


def _evidence(branch: Branch, recording: Tensor, scores: Floats, temperature: float) -> Evidence:
    common: dict[str, Any] = {
        "name": branch.name,
        "what": branch.what,
        "scores": scores,
        "temperature": temperature,
    }
    if isinstance(branch, SignalBranch):
        return _of_signal(branch, recording, common)
    height, width = recording.shape[:2]
    counts = scores.shape[1:]
    if branch.declares_geometry:
        rows, columns = (
            window_extents(count, branch.stride, window)
            for count, window in zip(counts, branch.window_size, strict=True)
        )
    else:
        rows, columns = (
            equal_parts(count, 0, size) for count, size in zip(counts, (height, width), strict=True)
        )
    pixels = recording.cpu().numpy()
    declared = branch.declares_geometry
    return PhotoEvidence(**common, rows=rows, columns=columns, declared=declared, pixels=pixels)


def _of_signal(branch: SignalBranch, recording: Tensor, common: dict[str, Any]) -> SignalEvidence:
    rate, features = branch.decoder.sampling_rate, branch.spectrogram
    skips = getattr(branch.features, "skip_impact", False)
    start = movement_start(recording, rate) / rate if skips else 0.0
    count, seconds = common["scores"].shape[2], recording.shape[-1] / rate
    if features is not None and branch.declares_geometry:
        frames = window_extents(count, branch.stride, branch.window_size[1])
        frames[:, 1] -= 1  # the last frame begins there
        columns = start + frames * features.hop_length / rate
        columns[:, 1] += features.window_length / rate
    else:
        columns = equal_parts(count, start, seconds)
    shown = _mel(recording, rate) if features is None else (features, branch(recording)[0, 0])
    values: Floats | None = None
    times: Floats = np.empty(0)
    frequencies: Floats = np.empty(0)
    if shown is not None:
        reader, found = shown
        values, frequencies = found.cpu().numpy(), reader.frequencies.numpy()
        begins = np.arange(found.shape[1]) * reader.hop_length + reader.window_length / 2
        times = (start if features is not None else 0.0) + begins / rate
    return SignalEvidence(
        **common,
        rows=np.array([[0.0, 1.0]]),
        columns=columns,
        declared=features is not None and branch.declares_geometry,
        samples=recording.cpu().numpy(),
        rate=rate,
        start=start,
        input=values,
        frequencies=frequencies,
        times=times,
        is_read=features is not None,
    )


def _mel(recording: Tensor, rate: float) -> tuple[SpectrogramFeatures, Tensor] | None:
    """A spectrogram for the eye, of a signal that the network reads in another way."""
    if recording.shape[-1] < 2:
        return None
    seconds = min(0.05, recording.shape[-1] / rate)
    reader = SpectrogramFeatures(
        sampling_rate=rate, scale="mel", skip_impact=False, window_seconds=seconds
    )
    magnitudes = reader.magnitudes(recording.cpu())
    return reader, (magnitudes / magnitudes.mean().clamp(min=1e-30) + FLOOR).log()
