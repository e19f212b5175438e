"""From class scores of positions to a label, as tex_lightning votes."""

import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tex_lightning_runtime.resampling import Array


def join(parts: Sequence[Array], contents: Sequence[Array], decision: Mapping[str, Any]) -> Array:
    """Scores (classes, fragments) of parts (classes, ..., positions), one of each sense.

    Several add up at random tuples of positions, seeded by the ``contents`` of the recordings.
    """
    flat, seed = [each.reshape(len(each), -1) for each in parts], decision["seed"]
    if len(flat) == 1:
        return flat[0]
    for content in contents:
        seed = zlib.crc32(content.data, seed)
    generator = np.random.RandomState(seed)  # PyTorch's Mersenne Twister
    words = np.frombuffer(generator.bytes(4 * decision["pairs"] * len(flat)), "<u4")
    rows = words.reshape(len(flat), -1)
    drawn = [each[:, row % each.shape[1]] for each, row in zip(flat, rows, strict=True)]
    return np.asarray(sum(drawn[1:], drawn[0]))


def vote(scores: Array, rule: str, temperature: float) -> tuple[int, Array, Array]:
    """Index of the winner, shares of the votes, and probabilities, by a rule of the card."""
    classes, count = scores.shape
    votes, scores = np.bincount(scores.argmax(axis=0), minlength=classes), scores.astype(np.float64)
    probabilities = _softmax(scores / temperature).mean(axis=1)
    if rule == "score":
        probabilities = _softmax(scores.mean(axis=1) / temperature)
    counted = votes if rule == "vote" else 0 * votes
    best = max(range(classes), key=lambda i: (counted[i], probabilities[i], -i))
    return best, (votes / count).astype(np.float32), probabilities


def _softmax(scores: Array) -> Array:
    powers = np.exp(scores - scores.max(axis=0))
    return np.asarray(powers / powers.sum(axis=0))
