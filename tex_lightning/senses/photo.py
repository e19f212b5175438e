"""The sense of photos."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import torch
from torch import Tensor

from tex_lightning.core.contract import breach, calling, describe_value
from tex_lightning.data.banks import PhotoBank
from tex_lightning.data.decode import Array, PhotoDecoder
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import Level, is_builtin
from tex_lightning.perturbations.table import Augmentation
from tex_lightning.senses.base import Augment, Sense
from tex_lightning.senses.features.image import ImageFeatures, crop_side, rotated_photos
from tex_lightning_runtime.files import expanded
from tex_lightning_runtime.pixels import as_pixels
from tex_lightning_runtime.quality import Quality, Ranges, limits, photo_quality

EXAMPLE_SIDE = 64  # pixels


class PhotoSense(Sense):
    """Photos (height, width, 3) uint8; features map (batch, 3, height, width) to inputs as large.

    In training, features get batches of rotated crops (batch, 3, side, side), uint8 as well.
    """

    medium: ClassVar[str] = "photo"
    dimensions: ClassVar[int] = 4
    decoder: PhotoDecoder

    @classmethod
    def make_decoder(cls, decode: Mapping[str, Any]) -> PhotoDecoder:
        """Make the decoder."""
        return PhotoDecoder(**decode)

    @cached_property
    def tells_input_size(self) -> bool:
        """Whether the features are this package's, which keep the size of a photo."""
        return is_builtin(self.features)

    def check_input(self, height: int, width: int) -> None:
        """Reject a photo that is too small for one fragment; see the base class."""
        least = max(self.min_size)
        if min(height, width) < least:
            if self.decoder.resize is not None:
                more = " or train with a larger data.resize"
            else:
                more = " or train with data.half_scale=false" if self.decoder.half_scale else ""
            raise UserError(
                f"The {self.noun} has {width}x{height} pixels after decoding, and this network "
                f"needs {least} on each side; use a larger one{more}."
            )

    def forward(self, recording: Tensor) -> Tensor:
        """Return the network input (1, 3, height, width) of a decoded photo."""
        return super().forward(_planes(recording))

    def dense_input(self, recording: Tensor) -> Tensor:
        """Return pixels (1, 3, height, width), which :meth:`score` normalises tile by tile.

        Features of a user's are computed here, on the whole photo.
        """
        return _planes(recording) if self.tells_input_size else self(recording)

    def score(self, x: Tensor, level: Level) -> Tensor:
        """Return features of pixels (batch, 3, height, width) uint8, or of a network input."""
        return super().score(self.compute_features(x) if x.dtype == torch.uint8 else x, level)

    def input_size(self, recording: Tensor | Array) -> tuple[int, int]:
        """Return height and width in pixels."""
        return recording.shape[0], recording.shape[1]

    def blank(self, height: int, width: int) -> Tensor:
        """Return a black photo, laid out as decoded ones are."""
        return torch.zeros(1, 3, height, width).contiguous(memory_format=torch.channels_last)

    def example(self) -> Tensor:
        """Make the network input of a black photo."""
        photo = torch.zeros(1, 3, EXAMPLE_SIDE, EXAMPLE_SIDE, dtype=torch.uint8)
        return self.compute_features(photo)

    def bank(
        self,
        rows: Sequence[Recording],
        store: Store,
        fit: Mapping[str, Any],
        *,
        size: int,
        seed: int,
        learn: bool,
    ) -> PhotoBank:
        """Cut square crops, large enough to be rotated; see the base class."""
        augmentation = Augmentation.of(fit["perturb"], fit["perturbed_share"])
        rotation = fit["rotation"]
        return PhotoBank(rows, store, crop_side(size, rotation), rotation, augmentation)

    def training_input(
        self, pieces: Mapping[str, Tensor], size: int, augment: Augment | None = None
    ) -> Tensor:
        """Return the network input of rotated crops (batch, 3, size, size); see the base class.

        Features of this package rotate and normalise in one pass; others get rotated photos.
        """
        crops, degrees, features = pieces["crop"], pieces["degrees"], self.features
        if isinstance(features, ImageFeatures) and type(features).forward is ImageFeatures.forward:
            patches = features.rotated(crops, degrees, size)
            if augment is None:
                return patches
            return (augment(patches * features.std + features.mean) - features.mean) / features.std
        photos = rotated_photos(crops, degrees, size)
        if augment is not None:
            photos = (augment(photos / 255) * 255).round().clamp(0, 255).to(torch.uint8)
        return self.compute_features(photos)

    def decode_input(
        self,
        recording: Any,  # noqa: ANN401
        ranges: Ranges,
        *,
        colour: str = "rgb",
        **_: Any,  # noqa: ANN401
    ) -> tuple[Tensor, Quality]:
        """Decode a file or pixels; ``colour`` is the order of an array's colours."""
        if isinstance(recording, str | Path):
            photo = self.decoder.decode(expanded(recording)).array
        else:
            pixels = as_pixels(recording, self.modality, colour)
            photo = self.decoder.scale(pixels, self.modality)
        return torch.from_numpy(photo), photo_quality(photo, limits(ranges), self.noun)


def apply_augmentation(key: str, augmentation: Callable[[Tensor], Any], patches: Tensor) -> Tensor:
    """Apply a recipe's augmentation to photos (batch, 3, side, side) in [0, 1].

    Raises:
        UserError: If it returns no such photos.
    """
    part = key, "augmentation", augmentation
    with calling(*part):
        pixels: object = augmentation(patches)
    if (
        not isinstance(pixels, Tensor)
        or not pixels.is_floating_point()
        or pixels.dim() != 4
        or len(pixels) != len(patches)
    ):
        raise breach(*part, f"returned {describe_value(pixels)} for a batch of {len(patches)}")
    if not bool(pixels.isfinite().all()):
        raise breach(*part, "gave NaN or infinity")
    return pixels


def _planes(recording: Tensor) -> Tensor:
    """Return a photo (height, width, 3) as (1, 3, height, width)."""
    return recording.permute(2, 0, 1)[None]
