"""Classifiers of other libraries, and the features that are usual, to compare the package with.

A peer of ``accuracy.yaml`` is a classifier as Hydra builds it from ``classifier``, on what
``features`` (a function of this module) makes of a signal. Recordings are cut into pieces of about
``pieces`` seconds, each a row of the training, and scores are summed over those of a recording;
``standardised`` takes away the mean of each axis and the deviation of each piece.
"""

import time
from collections.abc import Callable, Sequence
from inspect import signature
from typing import Any

import numpy as np
import scipy
import torch
from hydra.utils import instantiate
from sklearn.linear_model import RidgeClassifierCV
from sklearn.model_selection import PredefinedSplit
from sklearn.pipeline import Pipeline
from torch import nn

import tex_lightning as tl
from tex_lightning.core.groups import leave_out
from tex_lightning.networks.blocks import MEAN, STD
from tex_lightning.networks.linear import LinearNet
from tex_lightning.networks.trunks import published
from tex_lightning.networks.weights import load_trunk_weights
from tex_lightning.senses.features.spectrogram import mel_filters

WINDOW, BANDS, MELS, FLOOR = 0.1, 24, 40, 1e-10  # s, numbers of bands, power
Array = np.ndarray[Any, Any]
Signal = tuple[Array, float]  # (axes, samples) and rate in Hz, or a photo (H, W, RGB) and 1
Features = Callable[[Array, float], Array]  # of a signal and its rate
Node = dict[str, Any]


class Peer:
    """A classifier of ``accuracy.yaml``: what is said of it there."""

    def __init__(self, told: Node) -> None:
        self.told = told
        self.model = instantiate(told["classifier"], _convert_="all")

    def fit(self, signals: Sequence[Signal], labels: Sequence[str], groups: Sequence[Any]) -> None:
        """Fit features and classifier to recordings."""
        pieces = [self.pieces(signal) for signal in signals]
        counts = [len(parts) for parts in pieces]
        maker = FEATURES[self.told.get("features", "signals")]
        self.features = maker(signals, [x for parts in pieces for x in parts], labels, groups)
        rows = np.stack([self.features(*piece) for parts in pieces for piece in parts])
        facts = {
            "groups": np.repeat(np.array([str(group) for group in groups]), counts),
            "recordings": np.repeat(np.arange(len(counts)), counts),
        }
        targets = np.repeat(np.array(labels), counts)
        leave_groups_out(self.model, targets, **facts)
        taken = signature(self.model.fit).parameters
        self.model.fit(rows, targets, **{key: facts[key] for key in facts if key in taken})

    def predict(self, signal: Signal) -> str:
        """Return the class of a recording: that of its only piece, or of the sum of all scores."""
        rows = np.stack([self.features(*piece) for piece in self.pieces(signal)])
        if len(rows) == 1:
            return str(self.model.predict(rows)[0])
        scorer = getattr(self.model, "decision_function", None) or self.model.predict_proba
        scores = np.asarray(scorer(rows))
        scores = np.stack([-scores, scores], axis=1) if scores.ndim == 1 else scores
        return str(self.model.classes_[scores.sum(axis=0).argmax()])

    def pieces(self, signal: Signal) -> list[Signal]:
        """Return the equal pieces of a recording, or the whole."""
        trace, rate = signal
        if self.told.get("float64"):
            trace = trace.astype(np.float64)
        seconds = self.told.get("pieces", np.inf)
        count = max(1, round(trace.shape[1] / rate / seconds))
        parts = np.array_split(trace, count, axis=1)
        return [(standard(x) if self.told.get("standardised") else x, rate) for x in parts]


def standard(trace: Array) -> Array:
    """Return a signal without the mean of each axis, its deviation made 1 by one factor."""
    centred: Array = trace - trace.mean(axis=1, keepdims=True)
    return centred / (centred.std() or 1)


def leave_groups_out(model: Any, labels: Array, groups: Array, recordings: Array) -> None:  # noqa: ANN401
    """Let ridges that choose their strength leave out whole groups, where there are several."""
    parts = leave_out(labels.tolist(), groups.tolist(), recordings.tolist())
    for step in model if isinstance(model, Pipeline) else [model]:
        if isinstance(step, RidgeClassifierCV):
            step.cv = PredefinedSplit(parts) if max(parts, default=-1) > 0 else None


def train(
    told: Node,
    signals: Sequence[Signal],
    labels: Sequence[str],
    groups: Sequence[Any],
    is_test: Sequence[bool],
) -> tuple[list[tuple[str, str, float]], float]:
    """Train and test a peer, on every n-th recording only if ``every`` is n.

    Returns:
        Of each tested recording the class, the predicted class and ms; and seconds of the fit.
    """
    kept = np.flatnonzero(np.logical_not(is_test))
    peer, begin = Peer(told), time.perf_counter()
    peer.fit([signals[n] for n in kept], [labels[n] for n in kept], [groups[n] for n in kept])
    seconds, tested = time.perf_counter() - begin, []
    for n in np.flatnonzero(is_test)[:: told.get("every", 1)]:
        begin = time.perf_counter()
        predicted = peer.predict(signals[n])
        tested.append((labels[n], predicted, 1000 * (time.perf_counter() - begin)))
    return tested, seconds


def as_signals(_: object, pieces: Sequence[Signal], *__: object) -> Features:
    """Return signals as they are, repeated or cut to the length of the longest of the training."""
    length = max(trace.shape[1] for trace, _ in pieces)
    return lambda trace, _: np.stack([np.resize(axis, length) for axis in trace])


def band_proportions(
    signals: Sequence[Signal], _: object, labels: Sequence[str], groups: Sequence[Any]
) -> Features:
    """Return the features of ``few/haptic``, with thresholds learnt from the training."""
    model = tl.Estimator("few/haptic", rate=signals[0][1])
    model.fit([trace for trace, _ in signals], labels, groups=[str(x) for x in groups])
    return lambda trace, _: model.transform([trace])[0]


def network_means(*_: object) -> Features:
    """Return the means of the last maps of EfficientNet-Lite2, trained on ImageNet, of photos."""
    trunk = published("efficientnet_lite2")
    load_trunk_weights(trunk.eval(), "imagenet")
    mean, deviation = (torch.tensor(x)[:, None, None] for x in (MEAN, STD))

    @torch.inference_mode()
    def means(photo: Array, _: float) -> Array:
        pixels = torch.from_numpy(photo).permute(2, 0, 1) / 255
        maps = (pixels - mean) / deviation
        *layers, _textures = trunk.layers
        found: Array = nn.Sequential(*layers)(maps[None])[0].mean(dim=(1, 2)).numpy()
        return found

    return means


def log_bands(trace: Array, rate: float) -> Array:
    """Return means and deviations of log-band energies, and levels, of (axes, samples)."""
    frequencies, power = spectra(trace, rate)
    edges = np.geomspace(frequencies[1], rate / 2, BANDS, endpoint=False)
    starts = np.unique(np.searchsorted(frequencies, edges))
    bands = np.log(np.add.reduceat(power, starts, axis=1) + FLOOR)
    level = np.log(np.abs(trace.mean(axis=1)) + FLOOR**0.5)
    return np.concatenate((bands.mean(axis=2).ravel(), bands.std(axis=2).ravel(), level))


def log_mel(trace: Array, rate: float) -> Array:
    """Return means and deviations of log-mel energies of (axes, samples)."""
    frequencies, power = spectra(trace, rate)
    size = 2 * (len(frequencies) - 1)
    filters = mel_filters(rate, size, min(MELS, size // 2)).numpy()
    bands = np.log(filters @ power[:, : filters.shape[1]] + FLOOR)
    return np.concatenate((bands.mean(axis=2).ravel(), bands.std(axis=2).ravel()))


def spectra(trace: Array, rate: float) -> tuple[Array, Array]:
    """Return frequencies in Hz and the power (axes, frequencies, frames) of a signal."""
    size = min(trace.shape[1], max(32, round(WINDOW * rate))) // 2 * 2
    found = scipy.signal.spectrogram(trace, rate, nperseg=size, noverlap=size // 2)
    return found[0], found[2]


FEATURES: dict[str, Callable[..., Features]] = {
    "signals": as_signals,
    "log_bands": lambda *_: log_bands,
    "log_mel": lambda *_: log_mel,
    "band_proportions": band_proportions,
    "network_means": network_means,
}


class OwnHead:
    """The linear network of the package on any features."""

    def fit(self, rows: Array, labels: Array, groups: Array, recordings: Array) -> None:
        """Fit to rows (rows, D), of which each recording has one or several."""
        self.classes_, numbers = np.unique(labels, return_inverse=True)
        firsts = [int(np.flatnonzero(recordings == n)[0]) for n in np.unique(recordings)]
        inputs = [rows[recordings == recordings[first]].T[None] for first in firsts]
        self.network = LinearNet(len(self.classes_), bands=rows.shape[1])
        self.network.fit(
            [torch.from_numpy(x).float() for x in inputs],
            torch.from_numpy(numbers[firsts]),
            [str(groups[first]) for first in firsts],
        )

    @torch.no_grad()
    def decision_function(self, rows: Array) -> Array:
        """Return the scores (rows, classes)."""
        scores: Array = self.network(torch.from_numpy(rows.T[None, None]).float())[0].T.numpy()
        return scores

    def predict(self, rows: Array) -> Array:
        """Return the class of each row."""
        classes: Array = self.classes_[self.decision_function(rows).argmax(axis=1)]
        return classes
