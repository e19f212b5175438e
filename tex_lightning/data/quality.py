"""Ranges of training recordings, which the card of a checkpoint keeps.

What lies far outside of them is said of every input (:mod:`tex_lightning_runtime.quality`).
"""

from collections import defaultdict
from collections.abc import Iterable

import numpy as np

from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import Store
from tex_lightning_runtime.quality import photo_measures, trace_measures

QUANTILES = (0.01, 0.99)  # of the recordings, so that a few odd ones do not count


def training_ranges(rows: Iterable[Recording], store: Store) -> dict[str, list[float]]:
    """Measure training recordings of one modality: each measure's ends, by quantiles."""
    values: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        decoder, recording = store.decoders[row.modality], store.load(row)
        if isinstance(decoder, SignalDecoder):
            measures = trace_measures(recording, store.rate(row), decoder.sampling_rate)
        else:
            measures = photo_measures(recording)
        for name, value in measures.items():
            values[name].append(value)
    return {name: np.quantile(numbers, QUANTILES).tolist() for name, numbers in values.items()}
