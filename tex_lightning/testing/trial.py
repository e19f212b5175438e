"""What a part is tried with: recordings of noise, and classifiers with the part in them."""

import inspect
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from tex_lightning.classifier.card import configured_card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.contract_check import FITTED, check_parts
from tex_lightning.config import Config
from tex_lightning.config.check import read_config
from tex_lightning.config.composition import compose_config
from tex_lightning.config.signatures import NAMED, signature_of
from tex_lightning.data.readers.arrays import write_sample
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError, listed
from tex_lightning.networks.blocks import Level
from tex_lightning.networks.trunks import TRUNKS, Trunk
from tex_lightning.perturbations.pixels import Scene
from tex_lightning.senses.base import Augment, Sense
from tex_lightning.senses.making import make_sense
from tex_lightning_runtime.samples import content_seed

Array = npt.NDArray[Any]
SENSES = {"signal": "haptic", "photo": "visual"}  # whose settings a part of a medium gets
SECONDS, SIDE = 4.0, 256  # of the recordings
WIDTH = 0.25  # of a trunk that is made here


def parameters_of(called: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """Return the parameters by name, without ``*args`` and ``**kwargs``."""
    return {name: it for name, it in signature_of(called).parameters.items() if it.kind in NAMED}


@dataclass(frozen=True)
class Trial:
    """Recordings and classifiers with which a part is tried.

    The fields are arguments of :func:`~tex_lightning.testing.check_part`.
    """

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
        takes, given = parameters_of(part), getattr(part, "keywords", {})
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
        node = config_of("haptic", self.rate).model.haptic.node
        keys = {name: value for name, value in node.items() if not isinstance(value, Mapping)}
        if "trunk" in parameters_of(part):
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
        config = config_of(name, self.rate)
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
    def recordings(self, sense: Sense, count: int) -> Iterator[tuple[Recordings, Store]]:
        """Write so many recordings of each class to files, which are gone afterwards."""
        with tempfile.TemporaryDirectory() as name:
            folder, rows = Path(name), list[Recording]()
            for label, number in np.ndindex(self.classes, count):
                sample = {sense.modality: self.recording(sense.medium, label, number)}
                place = len(rows)
                rows += write_sample(sample, f"class {label}", str(place), folder, place)
            yield Recordings(tuple(rows)), Store(folder, {sense.modality: sense.decoder})

    def scene(self, medium: str) -> Scene:
        """Return the circumstances of a recording."""
        return Scene(np.random.default_rng(0), self.rate if medium == "signal" else 0.0)

    def train(
        self, one: SurfaceClassifier, other: SurfaceClassifier, augment: Augment | None = None
    ) -> None:
        """Try two classifiers of one sense, which are equal once one has the other's state."""
        (sense,) = one.senses.values()
        model = config_of(SENSES[sense.medium], self.rate).model
        fit, piece = model.fit_values(model.kind), model.sense(model.kind).fit.piece
        count = FITTED if hasattr(sense.network, "fit") else 1
        with self.recordings(sense, count) as (recordings, store):
            check_parts(one, other, fit, piece, recordings, store, augment)

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
def config_of(model: str, rate: float) -> Config:
    """Return the configuration of one of the package's models."""
    keys = f"model={model}", f"data.sampling_rate={rate}", "data.half_scale=false"
    return read_config(compose_config(keys))


class MeanNet(nn.Module):
    """Score the mean of the features at each position, whatever they are."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.scores = nn.Conv1d(1, classes, 1)

    def features(self, x: Tensor, level: Level) -> Tensor:
        """Map inputs (batch, ..., positions) to scores (batch, classes, positions)."""
        rows = x.flatten(1, -2) if x.dim() > 2 else x[:, None]
        scores: Tensor = self.scores(rows.mean(dim=1, keepdim=True))
        return scores


class Example(nn.Module):
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
