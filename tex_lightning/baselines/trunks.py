"""A visual trunk that stays as it is, for baselines that classify its features."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import count
from typing import ClassVar

import torch
from torch import Tensor, nn

from tex_lightning.baselines.base import Array, Baseline, State
from tex_lightning.errors import UserError
from tex_lightning.features.image import ImageFeatures
from tex_lightning.networks.trunks import TRUNKS, Trunk, published
from tex_lightning.networks.weights import load_trunk_weights, warn_of_random_weights

PREFIX = "trunk."


@dataclass
class TrunkBaseline(Baseline):
    """A baseline on the features of a trunk of VisualNet, which is never trained.

    The trunk has its published width and normalisation. Its weights come from
    :meth:`load_weights`; without them they are drawn at random when it is fitted.

    Attributes:
        trunk: Its name among the trunks of VisualNet.
        max_side: Photos of more than its square in pixels are made smaller, to bound time and
            memory.

    Raises:
        UserError: If there is no such trunk.
    """

    trunk: str
    max_side: int

    kind: ClassVar = "visual"

    def __post_init__(self) -> None:
        if self.trunk not in TRUNKS:
            raise UserError(
                f"model.baseline.trunk={self.trunk} is unknown; choose one of {', '.join(TRUNKS)}."
            )
        self.frozen: Trunk | None = None
        self.pixels = ImageFeatures()
        self.min_side = _least_side(TRUNKS[self.trunk])

    @property
    def network(self) -> Trunk:
        """The trunk, once it has weights."""
        assert self.frozen is not None, "neither fitted nor loaded"
        return self.frozen

    def load_weights(self, source: str) -> str:
        """Fill the trunk; see :func:`~tex_lightning.networks.weights.load_trunk_weights`."""
        trunk = published(self.trunk)
        message = load_trunk_weights(trunk, source)
        self._freeze(trunk)
        return message

    def require_weights(self, seed: int) -> None:
        """Draw the trunk at random unless it was loaded."""
        if self.frozen is not None:
            return
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self._freeze(published(self.trunk))
        warn_of_random_weights(self.network)

    def _freeze(self, trunk: Trunk) -> None:
        frozen = trunk.eval().requires_grad_(False)
        self.frozen = frozen.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def image(self, photo: Array) -> Tensor:
        """Normalised pixels (1, 3, height, width) of a photo of any size."""
        pixels: Tensor = self.pixels(torch.from_numpy(photo).permute(2, 0, 1)[None])
        return pixels

    def largest_factor(self, image: Tensor) -> float:
        """The factor on an image's sides that brings it to ``max_side``."""
        return self.max_side / math.sqrt(image.shape[-2] * image.shape[-1])

    def maps(self, image: Tensor, layers: Sequence[str]) -> dict[str, Tensor]:
        """Outputs of the trunk's layers of these names; those behind the last are left out."""
        found: dict[str, Tensor] = {}
        for name, layer in self.network.layers.named_children():
            image = layer(image)
            if name in layers:
                found[name] = image
            if len(found) == len(layers):
                break
        return found

    def state(self) -> State:
        """The trunk's tensors."""
        return {PREFIX + name: value for name, value in self.network.state_dict().items()}

    def load_state(self, state: State) -> None:
        """Read the trunk back."""
        trunk = published(self.trunk)
        trunk.load_state_dict(
            {
                name.removeprefix(PREFIX): value
                for name, value in state.items()
                if name.startswith(PREFIX)
            }
        )
        self._freeze(trunk)

    def count_parameters(self) -> int:
        """Weights of the trunk."""
        return sum(parameter.numel() for parameter in self.network.parameters())


def _least_side(trunk: type[Trunk]) -> int:
    """Smallest image side in pixels that the last map before the trunk's pooling is made of."""
    before = trunk.geometry[:-1]
    return next(
        side for side in count(1) if reduce(lambda size, window: window.output(size), before, side)
    )


def resized(image: Tensor, factor: float) -> Tensor:
    """An image (1, 3, height, width) with its sides multiplied, smoothed before it shrinks."""
    size = [max(1, round(side * factor)) for side in image.shape[-2:]]
    return nn.functional.interpolate(image, size, mode="bilinear", antialias=True)
