"""Try a part of one's own as a training would, before there are any data.

The part is trained on a few recordings of noise, saved, loaded into another one and compared, by
the code that tries it before every training (:mod:`tex_lightning.classifier.trial`).
"""

import inspect
import pickle
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from tex_lightning.baselines.base import Baseline
from tex_lightning.baselines.classifier import BaselineClassifier, check_is_baseline
from tex_lightning.classifier.card import configured_card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.trial import (
    BATCH,
    FITTED,
    UNSAVED,
    check_baseline,
    check_trunk,
    try_parts,
)
from tex_lightning.config import Config
from tex_lightning.config.composition import compose_config, read_config
from tex_lightning.core.contract import breach, calling, check_call
from tex_lightning.data.readers import read_table
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.data.store import Store, load_recording
from tex_lightning.errors import UserError, listed
from tex_lightning.networks.blocks import Level, independent_copy
from tex_lightning.networks.trunks import TRUNKS, Trunk
from tex_lightning.networks.visualnet import VisualNet
from tex_lightning.perturbations.pixels import Scene
from tex_lightning.perturbations.table import SEVERITIES, Perturbation, perturb
from tex_lightning.senses.base import Change, Sense, as_tensor, check_network, make_sense
from tex_lightning.senses.photo import augment
from tex_lightning.senses.signal import SignalSense
from tex_lightning_runtime.samples import content_seed

__all__ = ["check_part"]

Array = npt.NDArray[Any]
SENSES = {"signal": "haptic", "photo": "visual"}  # whose settings a part of a medium gets
VALUES = (0.1, 0.5, 1.0)  # of a perturbation whose levels nobody has given
SECONDS, SIDE = 4.0, 256  # of the recordings
WIDTH = 0.25  # of a trunk that is made here


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
    trial = _Trial(classes, float(rate), None if example is None else as_tensor(example), values)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        maker = trial.maker(part)
        one, other = (_copy(part), _copy(part)) if maker is None else (maker(), maker())
        kind = _check(one, other, trial, kind or _kind_of(one))
        if maker is None:
            _check_constructor(part, trial, kind)
    return kind


def _check(one: Any, other: Any, trial: "_Trial", kind: str) -> str:  # noqa: ANN401
    """Check a part and return its kind; ``other`` is the same, made anew.

    Only calls tell whether a module is features or an augmentation.
    """
    if kind not in CHECKS:
        raise UserError(f"kind={kind} is no kind of part; give {', '.join(CHECKS)}.")
    try:
        CHECKS[kind](one, other, trial)
    except Exception:
        if kind != "features":
            raise
        with suppress(Exception):  # what it does not keep as features counts
            _check_augmentation(one, other, trial)
            return "augmentation"
        raise
    return kind


def _check_constructor(part: Any, trial: "_Trial", kind: str) -> None:  # noqa: ANN401
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
    return "augmentation" if len(_parameters(part)) == 1 else "perturbation"


def _parameters(called: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """Return the parameters by name, without ``*args`` and ``**kwargs``."""
    try:
        parameters = inspect.signature(called).parameters
    except ValueError:  # of a class in C
        return {}
    collects = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD
    return {name: item for name, item in parameters.items() if item.kind not in collects}


@dataclass(frozen=True)
class _Trial:
    """What a part is tried with; the fields are arguments of :func:`check_part`."""

    classes: int
    rate: float
    example: Tensor | None
    values: Sequence[float]

    @property
    def media(self) -> tuple[str, ...]:
        """Media of the recordings that a part may take."""
        if self.example is None:
            return "signal", "photo"
        return ("photo",) if self.example.dtype == torch.uint8 else ("signal",)

    def maker(self, part: Any) -> Callable[[], Any] | None:  # noqa: ANN401
        """Return what makes a part, if it is a class or a function that makes one.

        Raises:
            UserError: If a class needs arguments that are not known here.
        """
        is_class = isinstance(getattr(part, "func", part), type)
        if not is_class and not inspect.isroutine(part):
            return None
        if isinstance(part, type) and issubclass(part, Sense):
            return partial(self.sense, part)
        takes, given = _parameters(part), getattr(part, "keywords", {})
        offered = {**self.offered(getattr(part, "func", part)), **given}
        needs = {name for name, item in takes.items() if item.default is item.empty}
        if not needs <= offered.keys():
            if not is_class:  # a perturbation or an augmentation
                return None
            raise UserError(
                f"{getattr(part, '__name__', 'The part')} needs "
                f"{listed(sorted(needs - offered.keys()))}, which check_part does not know; give "
                "an instance, or functools.partial of the class and its arguments."
            )
        return partial(part, **{name: offered[name] for name in takes if name in offered})

    def offered(self, part: Any) -> dict[str, Any]:  # noqa: ANN401
        """Return what a class may take: the keys of a sense by their names."""
        own = {"classes": self.classes, "rate": self.rate, "sampling_rate": self.rate}
        if not isinstance(part, type) or not issubclass(part, nn.Module):
            return own
        if issubclass(part, Trunk):
            return {"width": WIDTH, "norm": part.norms[0]}
        node = _config("haptic", self.rate).model.haptic.node
        keys = {name: value for name, value in node.items() if not isinstance(value, Mapping)}
        if "trunk" in _parameters(part):
            keys["trunk"] = TRUNKS["alexnet_caffe"](width=WIDTH, norm="batch")
        return keys | own

    def sense(self, cls: type[Sense]) -> Sense:
        """Make a sense of a class with the features and network of the package's."""
        (sense,) = self.classifier(cls.medium).senses.values()
        decoder = cls.make_decoder(vars(sense.decoder))
        return cls(sense.name, sense.modality, decoder, sense.features, sense.network)

    def classifier(
        self, medium: str, features: nn.Module | None = None, network: nn.Module | None = None
    ) -> SurfaceClassifier:
        """Return a classifier of the package's sense of a medium, with other parts in it."""
        name = SENSES[medium]
        config = _config(name, self.rate)
        card = configured_card(config, [f"class {number}" for number in range(self.classes)])
        made = make_sense(name, card.senses[name], self.classes)
        parts = features or made.features, network or made.network
        return SurfaceClassifier(
            card, {name: type(made)(name, made.modality, made.decoder, *parts)}
        )

    def recording(self, medium: str, label: int, number: int) -> Array:
        """Return a recording of noise, or the example with noise."""
        rng = np.random.default_rng([label, number])
        given = None if self.example is None or medium not in self.media else self.example.numpy()
        if medium == "photo":
            photo = np.full((SIDE, SIDE, 3), 100) if given is None else given
            noisy = photo + rng.normal(10 * label, 20, photo.shape)
            return noisy.clip(0, 255).astype(np.uint8)
        if given is None:
            samples = rng.standard_normal((1, round(SECONDS * self.rate)))
        else:
            samples = np.atleast_2d(given) * (1 + 0.05 * rng.standard_normal(given.shape))
        return (samples * (1 + label)).astype(np.float32)

    @contextmanager
    def recordings(self, sense: Sense) -> Iterator[tuple[Recordings, Store]]:
        """Write recordings of all classes to files, which are gone afterwards."""
        with tempfile.TemporaryDirectory() as name:
            folder, rows = Path(name), []
            for label, number in np.ndindex(self.classes, FITTED):
                array = self.recording(sense.medium, label, number)
                path = folder / f"{label}_{number}.{'png' if sense.medium == 'photo' else 'npy'}"
                if sense.medium == "photo":
                    cv2.imwrite(str(path), array[..., ::-1])
                else:
                    np.save(path, array)
                rows.append(Recording(f"class {label}", sense.modality, path, path.stem))
            yield Recordings(tuple(rows)), Store(folder, {sense.modality: sense.decoder})

    def scene(self, medium: str) -> Scene:
        """Return the circumstances of a recording."""
        return Scene(np.random.default_rng(0), self.rate if medium == "signal" else 0.0)

    def train(
        self, one: SurfaceClassifier, other: SurfaceClassifier, change: Change | None = None
    ) -> None:
        """Try two classifiers of one sense, which are equal once one has the other's state."""
        (sense,) = one.senses.values()
        model = _config(SENSES[sense.medium], self.rate).model
        fit, piece = model.fit_values(model.kind), model.sense(model.kind).fit.piece
        with self.recordings(sense) as (recordings, store):
            try_parts(one, other, fit, piece, recordings, store, change)

    def fitting(
        self, call: Callable[[str], Any], suits: Callable[[str, Any], bool]
    ) -> Sequence[str]:
        """Return the media of which a part makes what it has to, else one that it accepts."""
        outputs = {}
        for medium in self.media:
            with suppress(Exception), torch.no_grad():
                outputs[medium] = call(medium)
        suited = [medium for medium, output in outputs.items() if suits(medium, output)]
        return suited or [*outputs, *self.media][:1]


@cache
def _config(model: str, rate: float) -> Config:
    """Return the configuration of one of the package's models."""
    keys = f"model={model}", f"data.sampling_rate={rate}", "data.half_scale=false"
    return read_config(compose_config(keys))


class _MeanNet(nn.Module):
    """Score the mean of the features at each position, whatever they are."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.scores = nn.Conv1d(1, classes, 1)

    def features(self, x: Tensor, level: Level) -> Tensor:
        """Map inputs (batch, ..., positions) to scores (batch, classes, positions)."""
        rows = x.flatten(1, -2) if x.dim() > 2 else x[:, None]
        scores: Tensor = self.scores(rows.mean(dim=1, keepdim=True))
        return scores


class _Example(nn.Module):
    """Give an example input of a network for every recording, with noise of the recording's own."""

    def __init__(self, example: Tensor) -> None:
        super().__init__()
        self.register_buffer("example", example[:1].clone())

    def forward(self, signal: Tensor) -> Tensor:
        """Map a signal to the example (1, ...)."""
        generator = torch.Generator().manual_seed(content_seed(0, signal.numpy()))
        example: Any = self.example
        noisy: Tensor = example + 0.1 * example.std() * torch.randn(
            example.shape, generator=generator
        )
        return noisy


def _check_network(one: Any, other: Any, trial: _Trial) -> None:  # noqa: ANN401
    check_network("network", type(one).__name__, one)
    if trial.example is not None:
        inputs, noise = partial(_Example, trial.example), replace(trial, example=None)
        pair = [noise.classifier("signal", inputs(), network) for network in (one, other)]
        return noise.train(pair[0], pair[1])
    shapes = {"signal": (BATCH, 1, 50, 256), "photo": (BATCH, 3, 224, 224)}
    eager = _copy(one)  # which may keep what it is given
    media = trial.fitting(
        lambda medium: eager.features(torch.randn(shapes[medium]), "fc3"), lambda *_: True
    )
    return trial.train(*(trial.classifier(media[0], None, network) for network in (one, other)))


def _check_features(one: nn.Module, other: nn.Module, trial: _Trial) -> None:
    def call(medium: str) -> Any:  # noqa: ANN401
        recording = torch.from_numpy(trial.recording(medium, 0, 0))
        return eager(recording if medium == "signal" else recording.permute(2, 0, 1)[None])

    def suits(medium: str, output: object) -> bool:
        least = 2 if medium == "signal" else 4
        return isinstance(output, Tensor) and output.dim() >= least and len(output) == 1

    eager = _copy(one)
    medium, network = trial.fitting(call, suits)[0], _MeanNet(trial.classes)
    trial.train(
        trial.classifier(medium, one, network), trial.classifier(medium, other, _copy(network))
    )


def _check_trunk(one: Trunk, other: Trunk, trial: _Trial) -> None:
    images = torch.randn(BATCH, 3, one.patch, one.patch)
    check_trunk(("model.visual.trunk", "trunk", one), one, images)
    head = [] if one.textures else [8, 8]
    networks = (VisualNet(trial.classes, trunk, head=head) for trunk in (one, other))
    trial.train(*(trial.classifier("photo", None, network) for network in networks))


def _check_augmentation(one: Any, _: Any, trial: _Trial) -> None:  # noqa: ANN401
    key = "model.visual.fit.augmentation"
    check_call((key, "augmentation", one), getattr(one, "forward", one), "patches")
    network = _MeanNet(trial.classes)
    pair = [trial.classifier("photo", None, _copy(network)) for _ in range(2)]
    trial.train(pair[0], pair[1], partial(augment, key, one))


def _check_perturbation(one: Any, _: Any, trial: _Trial) -> None:  # noqa: ANN401
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


def _check_baseline(one: Any, other: Any, trial: _Trial) -> None:  # noqa: ANN401
    check_is_baseline(type(one).__name__, one)
    medium = "signal" if one.kind == "haptic" else "photo"
    card = trial.classifier(medium, None, _MeanNet(trial.classes)).card
    named = {"name": type(one).__name__, "node": {}, "budget": 1, "weights": None}
    fitted, rebuilt = (
        BaselineClassifier(replace(card, baseline=named), baseline) for baseline in (one, other)
    )
    (sense,) = fitted.senses.values()
    with trial.recordings(sense) as (recordings, store):
        fitted.fit(recordings.rows, store, 0)
        check_baseline(fitted, rebuilt, [load_recording(row, store) for row in recordings][:BATCH])


def _check_reader(one: Any, _: Any, trial: _Trial) -> None:  # noqa: ANN401
    table = read_table(one)
    _check_pickle(("data.reader", "reader", one), table)


def _check_sense(one: Sense, other: Sense, trial: _Trial) -> None:
    _check_pickle((f"model.{one.name}", "sense", one), one.decoder)
    if one.medium == "signal":
        trial = replace(trial, rate=cast(SignalSense, one).decoder.sampling_rate)
    card = trial.classifier(one.medium, None, _MeanNet(trial.classes)).card
    (node,) = card.senses.values()
    card = replace(card, senses={one.name: {**node, "modality": one.modality}})
    trial.train(*(SurfaceClassifier(card, {one.name: sense}) for sense in (one, other)))


def _check_pickle(part: tuple[str, str, object], value: object) -> None:
    """Reject what the processes that load data cannot be given."""
    with calling(*part):
        same = pickle.loads(pickle.dumps(value)) == value
    if not same:
        raise breach(*part, f"gives a {type(value).__name__} that is another one once pickled")


CHECKS: Mapping[str, Callable[[Any, Any, _Trial], None]] = {
    "network": _check_network,
    "features": _check_features,
    "trunk": _check_trunk,
    "augmentation": _check_augmentation,
    "perturbation": _check_perturbation,
    "baseline": _check_baseline,
    "reader": _check_reader,
    "sense": _check_sense,
}
