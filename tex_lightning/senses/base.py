"""The base class of senses."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from itertools import chain
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor, nn

from tex_lightning.core.contract import breach, calling, describe_value
from tex_lightning.core.devices import full_precision
from tex_lightning.data.banks import Bank
from tex_lightning.data.decode import Array, Decoder
from tex_lightning.data.recordings import Recording, singular
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError, reason, shorten
from tex_lightning.networks.blocks import Level, is_builtin
from tex_lightning.networks.geometry import (
    Geometry,
    affordable,
    declared_size,
    geometry_of,
    in_tiles,
)
from tex_lightning.networks.linear import LinearNet
from tex_lightning_runtime.quality import Quality, Ranges

Augment = Callable[[Tensor], Tensor]


class Sense(nn.Module, ABC):
    """The decoder, the features and the network of one modality.

    Calling it maps a decoded recording to the network's input (:meth:`compute_features`). A test or
    a prediction calls :meth:`positions`: :meth:`dense_input` gives the input, :meth:`dense_grid`
    divides a large one into tiles, and :meth:`score` calls the network.

    Args:
        name: Name of the sense.
        modality: Modality of its recordings in the table.
        decoder: Decoder of its files.
        features: Module that maps a decoded recording to the network's input (1, ...).
        network: Module whose ``features(x, level)`` maps inputs to (batch, D, *positions): class
            scores before softmax at level "fc3", the last hidden layer at level "fc2". A network
            that also has a ``score_layer``, its last layer, can be fused on FC2.

    Attributes:
        tile: Largest number of elements of an input that is computed in one pass; larger inputs
            are divided into tiles, if the geometry of the network is known. A tile is at least
            twice the receptive field each way. None never divides.
        medium: Kind of its recordings: ``signal`` or ``photo``.
        dimensions: Smallest number of dimensions of the network's input.
    """

    medium: ClassVar[str]
    dimensions: ClassVar[int]
    features: nn.Module
    network: nn.Module

    def __init__(
        self, name: str, modality: str, decoder: Decoder, features: nn.Module, network: nn.Module
    ) -> None:
        super().__init__()
        self.name, self.modality, self.decoder = name, modality, decoder
        self.features, self.network = features, network
        self.tile: int | None = None
        if is_builtin(network):  # its layers are counted once, and not for every recording
            _ = self.knows_min_size

    @classmethod
    @abstractmethod
    def make_decoder(cls, decode: Mapping[str, Any]) -> Decoder:
        """Make the decoder from its settings."""

    @property
    def title(self) -> str:
        """Name of the network in messages; for a linear network that of its features."""
        name = type(self.network).__name__
        return getattr(self.features, "title", name) if type(self.network) is LinearNet else name

    @property
    @abstractmethod
    def tells_input_size(self) -> bool:
        """Whether the size of the network's input can be known without computing the features."""

    @abstractmethod
    def check_input(self, height: int, width: int) -> None:
        """Reject a network input that is too small for one fragment, if the smallest is known.

        Raises:
            UserError: Saying which size is needed.
        """

    @abstractmethod
    def input_size(self, recording: Tensor | Array) -> tuple[int, int]:
        """Return height and width of the network input of a decoded recording."""

    @abstractmethod
    def blank(self, height: int, width: int) -> Tensor:
        """Return a network input (1, C, height, width) of zeros."""

    @abstractmethod
    def example(self) -> Tensor:
        """Make a valid input of the network."""

    @abstractmethod
    def bank(
        self,
        rows: Sequence[Recording],
        store: Store,
        fit: Mapping[str, Any],
        *,
        size: int,
        seed: int,
        learn: bool,
    ) -> Bank:
        """Make the bank from which training batches are cut.

        Args:
            rows: The training recordings.
            store: Where they are decoded.
            fit: The recipe.
            size: Length or side of a piece.
            seed: Seed of everything random.
            learn: Whether the features are fitted to the recordings, such as their normalisation;
                False if they are fitted already.
        """

    @abstractmethod
    def training_input(
        self, pieces: Mapping[str, Tensor], size: int, augment: Augment | None = None
    ) -> Tensor:
        """Return the network input (batch, ...) of what the bank has cut.

        Args:
            pieces: Pieces that the bank has cut.
            size: Length or side of a piece.
            augment: Augmentation of photos (batch, 3, side, side) in [0, 1], applied before they
                are normalised; None for none. Signals have none but that of ``pieces``.
        """

    @abstractmethod
    def decode_input(
        self,
        recording: Any,  # noqa: ANN401
        ranges: Ranges,
        **how: Any,  # noqa: ANN401
    ) -> tuple[Tensor, Quality]:
        """Decode a file, or convert an array to the decoded form, and measure its quality.

        Args:
            recording: A path, or an array of samples or pixels.
            ranges: Ranges of the quality measures of the training recordings.
            **how: ``rate`` in Hz, ``channels`` and ``time_unit`` of a signal; ``colour`` order of a
                photo.

        Raises:
            UserError: If it cannot be used.
        """

    @cached_property
    def knows_min_size(self) -> bool:
        """Whether a recording can be checked for its size without computing anything."""
        return self.tells_input_size and self.known_min_size is not None

    def forward(self, recording: Tensor) -> Tensor:
        """Return the network input of a decoded recording, on the device of the sense."""
        return self.compute_features(recording)

    def compute_features(self, x: Tensor) -> Tensor:
        """Return the network input of a recording, or of a batch of photos, computed in float32.

        Raises:
            UserError: If the input of a signal is not finite: NaN would win every vote.
        """
        x = x.to(next(chain(self.buffers(), self.parameters()), x).device)
        part = f"model.{self.name}.features", "features", self.features
        batch = len(x) if x.dim() == 4 else 1
        with calling(*part), full_precision(x.device):
            output: object = self.features(x)
        if (
            not isinstance(output, Tensor)
            or output.is_complex()
            or output.dim() < self.dimensions
            or len(output) != batch
        ):
            raise breach(*part, f"returned {describe_value(output)} for a batch of {batch}")
        if not (output.numel() or is_builtin(self.features)):
            raise self._too_small(self.features, "it gives no frame")
        if x.is_floating_point() and not _is_finite(output):
            custom = "" if is_builtin(self.features) else type(self.features).__name__
            raise UserError(
                f"The {self.noun} holds NaN, infinity or numbers too large to square"
                f"{custom and f', or {custom} makes them'}; repair the recording"
                f"{custom and ' or that class'}."
            )
        return output

    def dense_input(self, recording: Tensor) -> Tensor:
        """Return the input of :meth:`dense_grid` for a decoded recording.

        Raises:
            UserError: If a user's features fail on a recording as short as this.
        """
        try:
            return self.compute_features(recording)
        except RuntimeError as error:
            if self.tells_input_size:
                raise
            raise self._too_small(self.features, reason(error)) from error

    def check(self, recording: Tensor | Array) -> None:
        """Reject a decoded recording that is too small for one fragment.

        Raises:
            UserError: Saying which size is needed, if that is known.
        """
        if self.knows_min_size:
            self.check_input(*self.input_size(recording))
        else:
            with torch.inference_mode():
                self.positions(as_tensor(recording), "fc3")

    def positions(self, recording: Tensor, level: Level) -> Tensor:
        """Return the output (D, positions) of the network for a decoded recording, float32.

        Positions of a photo are in row order.

        Raises:
            UserError: If the recording is too small, or not finite.
        """
        return self.dense_grid(self.dense_input(recording), level).flatten(1)

    def dense_grid(self, x: Tensor, level: Level) -> Tensor:
        """Return the output (D, rows, columns) of the network; a signal has one row.

        A large input is divided into tiles. The output is float32, or float64 with such weights.

        Raises:
            UserError: If the input is too small.
        """
        if self.knows_min_size:
            self.check_input(*x.shape[-2:])
        large = self.tile is not None and x.dim() == 4 and x.shape[2] * x.shape[3] > self.tile
        try:
            if large and self.geometry is not None:
                layers = self.geometry.layers
                run = partial(self.score, level=level)
                features = in_tiles(run, x, layers, affordable(layers, self.tile))
            else:
                features = self.score(x, level)
        except RuntimeError as error:  # of a kernel that is larger than its input
            if self.knows_min_size:
                raise
            raise self._too_small(self.network, reason(error)) from error
        if not features.numel():
            raise self._too_small(self.network, "it gives no position")
        features = features if features.dtype == torch.float64 else features.float()
        return features[0].unsqueeze(1) if features.dim() == 3 else features[0].flatten(1, -2)

    def _too_small(self, part: nn.Module, why: str) -> UserError:
        return UserError(
            f"{type(part).__name__} makes nothing of this {self.noun} ({shorten(why)}); give a "
            "larger one, or correct that class."
        )

    def score(self, x: Tensor, level: Level) -> Tensor:
        """Return features (batch, D, *positions) as the network gives them."""
        network: Any = self.network
        x = x.to(next(network.parameters(), x).dtype)
        part = f"model.{self.name}.network", "network", network
        with calling(*part):
            features: object = network.features(x, level)
        if not isinstance(features, Tensor) or features.dim() < 3 or len(features) != len(x):
            raise breach(*part, f"returned {describe_value(features)} for a batch of {len(x)}")
        return features

    def piece_size(self, size: int) -> int:
        """Return the size of a piece that gives one position, or ``size`` if it is not known."""
        return size if self.geometry is None else self.window_size[1]

    @property
    def is_builtin(self) -> bool:
        """Whether the classes of its features and network are this package's."""
        return is_builtin(self.features) and is_builtin(self.network)

    @cached_property
    def geometry(self) -> Geometry | None:
        """Geometry of the network, or None where it is not known."""

        def example() -> Tensor:
            return self.example().to(next(self.network.parameters(), torch.empty(0)))

        return geometry_of(self.network, example, rows_vary=self.medium == "photo")

    @property
    def known_min_size(self) -> tuple[int, int] | None:
        """Height and width of the smallest input that gives a position, if that is known."""
        geometry = self.geometry
        return declared_size(self.network, "min_size") if geometry is None else geometry.min_size

    @cached_property
    def min_size(self) -> tuple[int, int]:
        """As :attr:`known_min_size`; an error if it is not known."""
        return self.known_min_size or self._known_geometry.min_size

    @property
    def window_size(self) -> tuple[int, int]:
        """Height and width of an input that gives exactly one position."""
        return self._known_geometry.window_size

    @property
    def stride(self) -> int:
        """Elements of the input between neighbouring positions."""
        return self._known_geometry.stride

    @property
    def _known_geometry(self) -> Geometry:
        if self.geometry is None:
            raise UserError(
                "This needs a network whose predictions each see a window of its input, at equal "
                f"distances along two axes, and {self.title} of {self.name} is none; give another "
                "checkpoint."
            )
        return self.geometry

    @property
    def device(self) -> torch.device:
        """Device of its parameters and buffers."""
        return next(chain(self.buffers(), self.parameters()), torch.empty(0)).device

    @property
    def noun(self) -> str:
        """Word for one of its recordings, such as ``trace`` or ``photo``."""
        return singular(self.modality)


def as_tensor(recording: Tensor | Array) -> Tensor:
    """Return a decoded recording as a tensor; an array is copied, as it may be a mapped file."""
    return recording if isinstance(recording, Tensor) else torch.from_numpy(np.array(recording))


def content(recording: Tensor) -> Array:
    """Return a recording as the array from whose content random numbers are seeded."""
    return np.ascontiguousarray(recording.cpu().numpy())


def _is_finite(x: Tensor) -> bool:
    """Return whether all numbers are finite, without a copy: an hour has hundreds of megabytes."""
    x = x if x.is_contiguous() else x.mT  # as band proportions lie
    return not x.numel() or bool(torch.stack(x.aminmax()).isfinite().all())
