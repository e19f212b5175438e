"""Recordings for the check of an exported file against its classifier."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from tex_lightning.branches import Branch
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import DataConfig
from tex_lightning.data.decode import Decoder, PhotoDecoder, to_size
from tex_lightning.data.folds import Sample, make_samples
from tex_lightning.data.loading import load_recording
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.store import Store, cache_root
from tex_lightning.errors import UserError
from tex_lightning.export.tracing import example

MADE_UP = "synthetic"  # data: no files are read
SHORTEST = 0.5  # of the example that is traced


@dataclass(frozen=True)
class Given:
    """A sample in the form of a file's inputs and of the classifier's, by modality.

    Attributes:
        raw: Signals at the rate of their sense, photos as they come out of their files.
        decoded: Photos halved where the card says so.
    """

    raw: dict[str, Tensor]
    decoded: dict[str, Tensor]


def recordings(data: DataConfig, classifier: SurfaceClassifier, count: int) -> list[Given]:
    """Usable samples of the data, evenly from all classes, or noise of as many sizes.

    Args:
        data: ``synthetic`` gives noise; anything else is read.
        classifier: Classifier that decodes.
        count: How many at most.

    Raises:
        UserError: If the data has no usable sample.
    """
    if data.name == MADE_UP:
        return [_decoded(_noise(classifier, seed), classifier) for seed in range(count)]
    rows = read_recordings(data, classifier.card.modalities)
    samples = make_samples(rows, classifier.card.modalities)
    store = Store(cache_root(data.cache_dir), _raw_decoders(data, classifier))
    found: list[Given] = []
    for sample in _spread(samples):
        if len(found) == count:
            break
        given = _loaded(sample, store, classifier)
        found += [] if given is None else [given]
    if count and not found:
        raise UserError(
            f"data={data.name} has no recording that the exported file could classify; give other "
            "data, or none."
        )
    return found


def _raw_decoders(data: DataConfig, classifier: SurfaceClassifier) -> dict[str, Decoder]:
    decoders = {}
    for branch in classifier.branches.values():
        decoder = branch.decoder.assuming(data.file_rate)
        if isinstance(decoder, PhotoDecoder):
            decoder = replace(decoder, half_scale=False)
        decoders[branch.modality] = decoder
    return decoders


def _spread(samples: Sequence[Sample]) -> list[Sample]:
    """Order samples: one of every class, then the next of every class."""
    seen: dict[str, int] = {}
    ranked = []
    for sample in samples:
        seen[sample.label] = seen.get(sample.label, -1) + 1
        ranked.append((seen[sample.label], sample))
    return [sample for _, sample in sorted(ranked, key=lambda each: each[0])]


def _loaded(sample: Sample, store: Store, classifier: SurfaceClassifier) -> Given | None:
    """A sample; None if it is damaged or too small."""
    try:
        given = {name: load_recording(row, store) for name, row in sample.recordings.items()}
        found = _decoded(given, classifier)
        for branch in classifier.branches.values():
            branch.check(found.decoded[branch.modality])
    except UserError:
        return None
    return found


def _noise(classifier: SurfaceClassifier, seed: int) -> dict[str, Tensor]:
    """Recordings of a size of their own; every second signal begins with quiet and a touch."""
    rng, found = np.random.default_rng(seed), {}
    for branch in classifier.branches.values():
        noise = example(branch, seed)
        if branch.medium == "signal":
            axes = 1 if seed % 4 < 2 else 3
            samples = round(noise.shape[1] * rng.uniform(SHORTEST, 2))
            noise = noise.repeat(1, 2)[:axes, :samples]
            if seed % 2:
                noise[:, : noise.shape[1] // 10] *= 1e-3
        else:
            height, width = noise.shape[:2]
            noise = noise.repeat(2, 2, 1)[: height + int(rng.integers(height)), : width + seed]
        found[branch.modality] = noise.contiguous()
    return found


def _decoded(raw: dict[str, Tensor], classifier: SurfaceClassifier) -> Given:
    return Given(
        raw, {b.modality: _as_decoded(b, raw[b.modality]) for b in classifier.branches.values()}
    )


def _as_decoded(branch: Branch, raw: Tensor) -> Tensor:
    decoder = branch.decoder
    if not isinstance(decoder, PhotoDecoder):
        return raw
    return torch.from_numpy(to_size(raw.numpy(), decoder, "The photo"))
