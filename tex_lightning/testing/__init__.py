"""Check a part of a user's own by the code that checks it before a training.

The part is trained on a few recordings of noise, saved, loaded into another one and compared, by
the code that tries it before every training (:mod:`tex_lightning.classifier.contract_check`).
"""

import pickle
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy.typing as npt
import torch
from torch import Tensor, nn

from tex_lightning.baselines.base import Baseline
from tex_lightning.baselines.classifier import BaselineClassifier, check_is_baseline
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.contract_check import (
    BATCH,
    FITTED,
    UNSAVED,
    check_baseline,
    check_trunk,
)
from tex_lightning.core.contract import breach, calling, check_call
from tex_lightning.data.readers import read_table
from tex_lightning.data.store import load_recording
from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import independent_copy
from tex_lightning.networks.trunks import Trunk
from tex_lightning.networks.visualnet import VisualNet
from tex_lightning.perturbations.table import SEVERITIES, Perturbation, perturb
from tex_lightning.senses.base import Sense, as_tensor
from tex_lightning.senses.making import check_network
from tex_lightning.senses.photo import apply_augmentation
from tex_lightning.senses.signal import SignalSense
from tex_lightning.testing.trial import Example, MeanNet, Trial, parameters_of

__all__ = ["check_part"]

Array = npt.NDArray[Any]
VALUES = (0.1, 0.5, 1.0)  # of a perturbation whose levels nobody has given


def check_part(
    part: Any,  # noqa: ANN401
    *,
    kind: str | None = None,
    classes: int = 3,
    rate: float = 10_000.0,
    example: Any = None,  # noqa: ANN401
    values: Sequence[float] = VALUES,
) -> str:
    """Check that a part keeps its contract, as a training would before it starts.

    A part is a network, features, a trunk, an augmentation, a perturbation, a baseline, a reader or
    a sense. Copies of it are tried, and the part itself stays as it is.

    Args:
        part: The part; or its class, or a function that makes it, which is called twice.
        kind: One of these words; None finds it out by the class, or by what a call accepts.
        classes: Number of classes of a network, baseline or sense.
        rate: Sampling rate of signals in Hz.
        example: A decoded recording, (axes, samples) or (height, width, 3) uint8, like those that
            the part will get; for a network its input (batch, ...). None takes noise, and for a
            network the spectrogram of HapticNet or a photo.
        values: Values that a perturbation is called with, those of its levels.

    Returns:
        The kind of the part.

    Raises:
        UserError: If it does not keep its contract, with the sentence that a training ends with.
        Exception: Any exception of the part, with a note of its contract.

    Example:
        >>> from tex_lightning import HapticNet
        >>> from tex_lightning.testing import check_part
        >>> check_part(HapticNet(classes=3, width=0.1))
        'network'
    """
    trial = Trial(classes, float(rate), None if example is None else as_tensor(example), values)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        maker = trial.maker(part)
        one, other = (_copy(part), _copy(part)) if maker is None else (maker(), maker())
        kind = _check(one, other, trial, kind or _kind_of(one))
        if maker is None:
            _check_constructor(part, trial, kind)
    return kind


def _check(one: Any, other: Any, trial: "Trial", kind: str) -> str:  # noqa: ANN401
    """Check a part and return its kind; ``other`` is the same, made anew.

    Only calls tell whether a module is features or an augmentation.
    """
    if kind not in CHECKS:
        raise UserError(f"kind={kind} is no kind of part; give {', '.join(CHECKS)}.")
    try:
        CHECKS[kind](one, other, trial)
    except Exception as error:
        if kind != "features" or UNSAVED in str(error):
            raise
        with suppress(Exception):  # what it does not keep as features counts
            _check_augmentation(one, other, trial)
            return "augmentation"
        raise
    return kind


def _check_constructor(part: Any, trial: "Trial", kind: str) -> None:  # noqa: ANN401
    """Check that two of a part's class are equal once one has the state of the other.

    This finds what a constructor draws and no checkpoint holds. The arguments of the part itself
    are not known: what is made with those that are offered has to have the same state at least, and
    another error of it says nothing.
    """
    try:
        maker = trial.maker(type(part))
        if maker is not None:
            one, other = maker(), maker()
            if isinstance(part, nn.Module):
                other.load_state_dict(part.state_dict())
            CHECKS[kind](one, other, trial)
    except Exception as error:
        if UNSAVED in str(error):
            raise


def _copy(part: Any) -> Any:  # noqa: ANN401
    return independent_copy(part) if isinstance(part, nn.Module) else deepcopy(part)


def _kind_of(part: Any) -> str:  # noqa: ANN401
    """Return the kind of a part; that of a module without ``features(x, level)`` is tried."""
    bases = {"sense": Sense, "trunk": Trunk, "baseline": Baseline, "perturbation": Perturbation}
    for kind, base in bases.items():
        if isinstance(part, base):
            return kind
    if isinstance(part, nn.Module):
        return "network" if callable(getattr(part, "features", None)) else "features"
    for kind, method in {"reader": "read", "baseline": "logits"}.items():
        if callable(getattr(part, method, None)):
            return kind
    if not callable(part):
        raise UserError(
            f"{type(part).__name__} is no part that is known; give kind: {', '.join(CHECKS)}."
        )
    return "augmentation" if len(parameters_of(part)) == 1 else "perturbation"


def _check_network(one: Any, other: Any, trial: Trial) -> None:  # noqa: ANN401
    check_network("network", type(one).__name__, one)
    if trial.example is not None:
        inputs, noise = partial(Example, trial.example), replace(trial, example=None)
        pair = [noise.classifier("signal", inputs(), network) for network in (one, other)]
        return noise.train(pair[0], pair[1])
    shapes = {"signal": (BATCH, 1, 50, 256), "photo": (BATCH, 3, 224, 224)}
    eager = _copy(one)  # which may keep what it is given
    media = trial.fitting(
        lambda medium: eager.features(torch.randn(shapes[medium]), "fc3"), lambda *_: True
    )
    return trial.train(*(trial.classifier(media[0], None, network) for network in (one, other)))


def _check_features(one: nn.Module, other: nn.Module, trial: Trial) -> None:
    def call(medium: str) -> Any:  # noqa: ANN401
        recording = torch.from_numpy(trial.recording(medium, 0, 0))
        return eager(recording if medium == "signal" else recording.permute(2, 0, 1)[None])

    def suits(medium: str, output: object) -> bool:
        least = 2 if medium == "signal" else 4
        return isinstance(output, Tensor) and output.dim() >= least and len(output) == 1

    eager = _copy(one)
    medium, network = trial.fitting(call, suits)[0], MeanNet(trial.classes)
    trial.train(
        trial.classifier(medium, one, network), trial.classifier(medium, other, _copy(network))
    )


def _check_trunk(one: Trunk, other: Trunk, trial: Trial) -> None:
    images = torch.randn(BATCH, 3, one.patch, one.patch)
    check_trunk(("model.visual.trunk", "trunk", one), one, images)
    head = [] if one.textures else [8, 8]
    networks = (VisualNet(trial.classes, trunk, head=head) for trunk in (one, other))
    trial.train(*(trial.classifier("photo", None, network) for network in networks))


def _check_augmentation(one: Any, _: Any, trial: Trial) -> None:  # noqa: ANN401
    key = "model.visual.fit.augmentation"
    check_call((key, "augmentation", one), getattr(one, "forward", one), "patches")
    network = MeanNet(trial.classes)
    pair = [trial.classifier("photo", None, _copy(network)) for _ in range(2)]
    trial.train(pair[0], pair[1], partial(apply_augmentation, key, one))


def _check_perturbation(one: Any, _: Any, trial: Trial) -> None:  # noqa: ANN401
    if isinstance(one, Perturbation):
        medium = "photo" if one.modality == "image" else "signal"
        for severity in SEVERITIES:
            one.apply(trial.recording(medium, 0, 0), severity, trial.scene(medium))
        return
    part = "stability.severities", "perturbation", one

    def call(medium: str, value: float = trial.values[0]) -> Array:
        recording = trial.recording(medium, 0, 0)
        recording.flags.writeable = False  # as the files of the cache are
        return perturb(part, one, recording, value, trial.scene(medium))

    for medium in trial.fitting(call, lambda *_: True):
        for value in trial.values:
            call(medium, value)


def _check_baseline(one: Any, other: Any, trial: Trial) -> None:  # noqa: ANN401
    check_is_baseline(type(one).__name__, one)
    medium = "signal" if one.kind == "haptic" else "photo"
    card = trial.classifier(medium, None, MeanNet(trial.classes)).card
    named = {"name": type(one).__name__, "node": {}, "budget": 1, "weights": None}
    fitted, rebuilt = (
        BaselineClassifier(replace(card, baseline=named), baseline) for baseline in (one, other)
    )
    (sense,) = fitted.senses.values()
    with trial.recordings(sense, FITTED) as (recordings, store):
        fitted.fit(recordings.rows, store, 0)
        check_baseline(fitted, rebuilt, [load_recording(row, store) for row in recordings][:BATCH])


def _check_reader(one: Any, _: Any, trial: Trial) -> None:  # noqa: ANN401
    table = read_table(one)
    _check_pickle(("data.reader", "reader", one), table)


def _check_sense(one: Sense, other: Sense, trial: Trial) -> None:
    _check_pickle((f"model.{one.name}", "sense", one), one.decoder)
    if one.medium == "signal":
        trial = replace(trial, rate=cast(SignalSense, one).decoder.sampling_rate)
    card = trial.classifier(one.medium, None, MeanNet(trial.classes)).card
    (node,) = card.senses.values()
    card = replace(card, senses={one.name: {**node, "modality": one.modality}})
    trial.train(*(SurfaceClassifier(card, {one.name: sense}) for sense in (one, other)))


def _check_pickle(part: tuple[str, str, object], value: object) -> None:
    """Reject what the processes that load data cannot be given."""
    with calling(*part):
        same = pickle.loads(pickle.dumps(value)) == value
    if not same:
        raise breach(*part, f"gives a {type(value).__name__} that is another one once pickled")


CHECKS: Mapping[str, Callable[[Any, Any, Trial], None]] = {
    "network": _check_network,
    "features": _check_features,
    "trunk": _check_trunk,
    "augmentation": _check_augmentation,
    "perturbation": _check_perturbation,
    "baseline": _check_baseline,
    "reader": _check_reader,
    "sense": _check_sense,
}
