"""The base class of senses, for any sensor."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor, nn

from tex_lightning.config.instantiation import TARGET, make, make_value, trusted_class
from tex_lightning.core.contract import calling, check_batch
from tex_lightning.data.banks import Bank
from tex_lightning.data.decode import Array, Decoder
from tex_lightning.data.quality import Quality, Ranges
from tex_lightning.data.recordings import Recording, name_one
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError, reason, shorten
from tex_lightning.networks.blocks import Level, is_builtin
from tex_lightning.networks.geometry import Geometry, affordable, geometry_of, in_tiles

Change = Callable[[Tensor], Tensor]


class Sense(nn.Module, ABC):
    """One sense: how its files are decoded, its features, its network.

    Called with a decoded recording, it gives the network's input.

    Args:
        name: Name of the sense.
        modality: Modality of its recordings in the table.
        decoder: Decoder of its files.
        features: Module that maps a decoded recording to the network's input (1, ...).
        network: Module whose ``features(x, level)`` maps inputs to (batch, D, *positions): class
            scores before softmax at level "fc3", the last hidden layer at level "fc2". A network
            that also has a ``score_layer``, its last layer, can be fused on FC2.

    Attributes:
        tile: Most elements of an input that go through the network at once, or twice its receptive
            field each way if that is more; None never divides. Inputs are divided where the
            geometry of the network is known.
        medium: What its recordings are: ``signal`` or ``photo``.
        windowed: Whether single windows of a recording can be classified.
    """

    medium: ClassVar[str]
    windowed: ClassVar[bool] = False
    features: nn.Module
    network: nn.Module

    def __init__(
        self, name: str, modality: str, decoder: Decoder, features: nn.Module, network: nn.Module
    ) -> None:
        super().__init__()
        self.name, self.modality, self.decoder = name, modality, decoder
        self.features, self.network = features, network
        self.tile: int | None = None

    @classmethod
    @abstractmethod
    def make_decoder(cls, decode: Mapping[str, Any]) -> Decoder:
        """Make the decoder from its settings."""

    @property
    @abstractmethod
    def knows_min_size(self) -> bool:
        """Whether it is known without computing if a recording is large enough."""

    @abstractmethod
    def check_input(self, height: int, width: int) -> None:
        """Refuse a network input that is too small for one fragment, where that is known.

        Raises:
            UserError: Saying what it takes.
        """

    @abstractmethod
    def dense_input(self, recording: Tensor) -> Tensor:
        """Return the input of :meth:`dense` for a decoded recording."""

    @abstractmethod
    def input_size(self, recording: Tensor | Array) -> tuple[int, int]:
        """Return height and width of the network input of a decoded recording."""

    @abstractmethod
    def blank(self, height: int, width: int) -> Tensor:
        """Return a network input (1, C, height, width) of zeros."""

    @abstractmethod
    def example(self) -> Tensor:
        """Make an input of the network, of any content and size."""

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
            learn: Whether the features learn from the recordings what they have to, such as their
                normalisation; else they have.
        """

    @abstractmethod
    def training_input(
        self, pieces: Mapping[str, Tensor], size: int, change: Change | None = None
    ) -> Tensor:
        """Return the network input (batch, ...) of what the bank has cut.

        Args:
            pieces: What the bank has cut.
            size: Length or side of a piece.
            change: What photos (batch, 3, side, side) in [0, 1] become before they are normalised;
                None leaves them, and of signals there is none.
        """

    @abstractmethod
    def decode_input(
        self,
        given: Any,  # noqa: ANN401
        ranges: Ranges,
        **how: Any,  # noqa: ANN401
    ) -> tuple[Tensor, Quality]:
        """Decode a file, or bring an array to what decoding gives; judge its quality.

        Args:
            given: A path, or samples or pixels.
            ranges: Ranges of the measures of the training recordings.
            **how: ``rate`` in Hz, ``colour`` order, ``fast`` decoding, as far as they apply.

        Raises:
            UserError: If it cannot be used.
        """

    def forward(self, recording: Tensor) -> Tensor:
        """Return the network input of a decoded recording, on the device of the sense."""
        return self.read(recording.to(self.device))

    def read(self, x: Tensor) -> Tensor:
        """Return what the features give for a recording, or a batch of photos."""
        part, photos = (f"model.{self.name}.features", "features", self.features), x.dim() == 4
        with calling(*part):
            found = self.features(x)
        return check_batch(found, *part, len(x) if photos else 1, 4 if photos else 2)

    def check(self, recording: Tensor | Array) -> None:
        """Refuse a decoded recording that is too small for one fragment.

        Raises:
            UserError: Saying what it takes, as far as that is known.
        """
        if self.knows_min_size:
            self.check_input(*self.input_size(recording))
        else:
            with torch.inference_mode():
                self.position_grid(as_tensor(recording), "fc3")

    def positions(self, recording: Tensor, level: Level) -> Tensor:
        """Return features (D, positions), float32, of a decoded recording; an image's row by row.

        Raises:
            UserError: If the recording is too small, or not finite.
        """
        return self.position_grid(recording, level).flatten(1)

    def position_grid(self, recording: Tensor, level: Level) -> Tensor:
        """Return features on their grid (D, rows, columns); a signal's have one row.

        Raises:
            UserError: As :meth:`positions`.
        """
        if self.knows_min_size:
            x = self.dense_input(recording)
            self.check_input(*x.shape[-2:])
            return self._dense_grid(x, level)
        try:
            found = self._dense_grid(self.dense_input(recording), level)
            why = "" if found[0].numel() else "it gives no position"
        except RuntimeError as error:  # of a kernel that is larger than its input
            why = reason(error)
        if not why:
            return found
        extent = f"{self.decoder.extent(content(recording)):.3g} {self.decoder.unit}"
        raise UserError(
            f"{type(self.network).__name__} makes nothing of {extent} of a {self.what} "
            f"({shorten(why)}); give a larger one, or correct the network."
        )

    def dense(self, x: Tensor, level: Level) -> Tensor:
        """Return features (D, positions) of a network input, computed by tiles if it is large."""
        return self._dense_grid(x, level).flatten(1)

    def _dense_grid(self, x: Tensor, level: Level) -> Tensor:
        """Return the same (D, rows, columns)."""

        def features(part: Tensor) -> Tensor:
            found = self._features(part, level)
            return found[:, :, None] if found.dim() == 3 else found.flatten(2, -2)

        large = self.tile is not None and x.dim() == 4 and x.shape[2] * x.shape[3] > self.tile
        geometry = self.geometry if large else None
        if geometry is None:
            return features(x)[0]
        return in_tiles(features, x, geometry.layers, affordable(geometry.layers, self.tile))[0]

    def _features(self, x: Tensor, level: Level) -> Tensor:
        """Return features (batch, D, *positions): float32, of float64 weights float64."""
        found = self.score(like_weights(self.network, x), level)
        return found if found.dtype == torch.float64 else found.float()

    def score(self, x: Tensor, level: Level) -> Tensor:
        """Return features (batch, D, *positions) as the network gives them."""
        network: Any = self.network
        part = f"model.{self.name}.network", "network", network
        with calling(*part):
            found = network.features(x, level)
        return check_batch(found, *part, len(x), 3)

    def windows(self, recording: Tensor, corners: Tensor, level: Level) -> Tensor:
        """Return features (D, windows), float32, of single windows of a decoded recording.

        Args:
            recording: As for :meth:`positions`.
            corners: (windows, 2) row and column where each begins in the network's input.
            level: As for :meth:`positions`.
        """
        raise NotImplementedError(f"{self.medium}s are not classified window by window")

    def grid(self, recording: Tensor) -> tuple[int, int]:
        """Return rows and columns of positions that a decoded recording gives."""
        return self._known_geometry.output_size(*self.input_size(recording))

    def piece_size(self, size: int) -> int:
        """Return the size of a piece that gives one position; ``size`` where it is not known."""
        return size if self.geometry is None else self.window_size[1]

    @property
    def is_builtin(self) -> bool:
        """Whether the classes of its features and network are this package's."""
        return is_builtin(self.features) and is_builtin(self.network)

    @property
    def geometry(self) -> Geometry | None:
        """Geometry of the network, or None where it is not known."""
        return geometry_of(self.network, self.example, rows_vary=self.medium == "photo")

    @property
    def known_min_size(self) -> tuple[int, int] | None:
        """Height and width of the smallest input that gives a position, if that is known."""
        geometry = self.geometry
        return getattr(self.network, "min_size", None) if geometry is None else geometry.min_size

    @property
    def min_size(self) -> tuple[int, int]:
        """The same, of a sense that knows it."""
        found = self.known_min_size
        return self._known_geometry.min_size if found is None else found

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
        found = self.geometry
        if found is None:
            raise UserError(
                "This needs a network whose predictions each see a window of its input, at equal "
                f"distances along two axes, and {type(self.network).__name__} of {self.name} is "
                "none; give another checkpoint."
            )
        return found

    @property
    def device(self) -> torch.device:
        """Device of its parameters and buffers."""
        return next(chain(self.buffers(), self.parameters()), torch.empty(0)).device

    @property
    def what(self) -> str:
        """Name of one of its recordings."""
        return name_one(self.modality)


def like_weights(network: nn.Module, x: Tensor) -> Tensor:
    """Return a network input in the precision of the network's weights."""
    return x.to(next(network.parameters(), x).dtype)


def as_tensor(recording: Tensor | Array) -> Tensor:
    """Return a decoded recording in memory; an array may be a read-only map of a file."""
    return recording if isinstance(recording, Tensor) else torch.from_numpy(np.array(recording))


def content(recording: Tensor) -> Array:
    """Return the array whose content seeds what is random about a recording."""
    return np.ascontiguousarray(recording.cpu().numpy())


BUILT = (TARGET, "features", "network")


def make_sense(name: str, node: Mapping[str, Any], classes: int) -> Sense:
    """Make a sense of a card with random weights.

    Args:
        name: Name of the sense.
        node: ``_target_``, a subclass of :class:`Sense`; ``modality``; ``decode``, arguments of
            its decoder; ``features`` and ``network``, each a ``_target_`` with arguments. All
            other values are offered to these two, which take what they have parameters for,
            beside ``classes``, the settings of the decoder and, for the network, the ``bands`` that
            the features say they have; nodes with a ``_target_`` are built
            before.
        classes: Number of materials.

    Raises:
        UserError: If the node cannot be used, or names a class that is not trusted.
    """
    where = f"model.{name}"
    cls = trusted_class(where, node)
    if not issubclass(cls, Sense):
        raise UserError(
            f"{where} names {node[TARGET]}, which is no sense; take "
            "tex_lightning.senses.signal.SignalSense or "
            "tex_lightning.senses.photo.PhotoSense, or derive from one of them."
        )
    rest = {key: value for key, value in node.items() if key not in BUILT}
    nodes = {
        key: each for key, each in rest.items() if isinstance(each, Mapping) and TARGET in each
    }
    values = make_value(where, {key: value for key, value in rest.items() if key not in nodes})
    modality, decode = values.pop("modality"), values.pop("decode")
    offered = {**decode, "classes": classes, **values}
    for key, value in nodes.items():
        offered[key] = make(f"{where}.{key}", value, **offered)
    features = _make_part(f"{where}.features", node["features"], offered)
    if (bands := getattr(features, "bands", None)) is not None:
        offered["bands"] = bands
    network = _make_part(f"{where}.network", node["network"], offered)
    if not callable(getattr(network, "features", None)):
        raise UserError(
            f"{where}.network names {node['network'][TARGET]}, which has no method "
            "features(x, level); add one that gives class scores at level fc3."
        )
    return cls(name, modality, cls.make_decoder(decode), features, network)


def _make_part(where: str, node: Mapping[str, Any], offered: Mapping[str, Any]) -> nn.Module:
    part = make(where, node, **offered)
    if not isinstance(part, nn.Module):
        raise UserError(f"{where} gives {shorten(part)}, which is no nn.Module.")
    return part
