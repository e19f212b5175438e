"""Banks: the training recordings of one sense, from which training batches are cut."""

import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from tex_lightning.core.devices import room
from tex_lightning.data.decode import Photo
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import Store
from tex_lightning.perturbations.table import Augmentation

Indices = npt.NDArray[np.int64]
WHOLE = slice(None)
MAX_MAPS = 768  # photos; many systems allow a process 1024 open files, macOS and Windows fewer


class InputBank:
    """Network inputs (..., frames) of unequal length in one tensor, cut in one indexing step.

    The tensor is mapped to a temporary file without a name, so that the system can drop its pages
    from memory. A device other than the CPU may hold a copy (:meth:`hold`); then only the starts of
    sub-samples are sent there.

    Args:
        inputs: Inputs of all recordings in their first version, then in their second, and so on.
        frames: Length of the sub-samples. Shorter inputs are repeated up to it.
        versions: Number of versions of every recording; one is drawn for each cut.
        draw_changes: Function that draws the random numbers (count, ...) of an augmentation of so
            many sub-samples from a generator; None for no augmentation.

    Attributes:
        as_given: Whether no input had to be repeated.
        pieces: Pairs of a recording's number and the input of a short piece of it, for a network
            whose closed-form fit takes ``pieces``.
        disturbed: Pairs of the input of a recording and that of the recording disturbed, for a
            network whose closed-form fit takes ``disturbed``.
    """

    def __init__(
        self,
        inputs: Iterable[Tensor],
        frames: int,
        versions: int = 1,
        draw_changes: Callable[[int, np.random.Generator], Tensor] | None = None,
    ) -> None:
        self.versions, self.frames, self.draw_changes = versions, frames, draw_changes
        lengths: list[int] = []
        self.as_given, self.pieces = True, list[tuple[int, Tensor]]()
        self.disturbed = list[tuple[Tensor, Tensor]]()
        with tempfile.TemporaryFile() as file:
            for item in inputs:
                self.as_given &= item.shape[-1] >= frames
                # frames first: a sub-sample is then one piece of the file
                array = np.ascontiguousarray(_at_least(item.cpu(), frames).movedim(-1, 0))
                lengths.append(len(array))
                file.write(array.data)
            file.flush()
            # copy-on-write: PyTorch has no read-only tensors, and nothing writes to it
            joined = np.memmap(file, array.dtype, "c", shape=(sum(lengths), *array.shape[1:]))
        self.flat = torch.from_numpy(joined)
        self.held: Tensor | None = None  # the same on another device
        self.lengths = np.array(lengths)
        self.starts = np.concatenate(([0], np.cumsum(self.lengths)[:-1]))

    @property
    def inputs(self) -> list[Tensor]:
        """Inputs (..., frames), in the original order."""
        starts = zip(self.starts.tolist(), self.lengths.tolist(), strict=True)
        return [self.flat[start : start + length].movedim(0, -1) for start, length in starts]

    def cut(
        self, indices: Indices, rng: np.random.Generator, share: slice = WHOLE
    ) -> dict[str, Tensor]:
        """Cut ``input``, a sub-sample (batch, ..., frames) of each indexed recording.

        With an augmentation ``changes`` (batch, ...) are the random numbers of it.
        Random numbers are drawn for all of them, but only the ``share`` of this process is cut. If
        a device holds the inputs, ``start`` (batch,) is returned instead, for :meth:`cut_there`.
        """
        if self.versions > 1:
            version = rng.integers(0, self.versions, len(indices))
            indices = indices + version * (len(self.lengths) // self.versions)
        offsets = rng.integers(0, self.lengths[indices] - self.frames + 1)
        start = torch.from_numpy((self.starts[indices] + offsets)[share])
        held = self.held is not None
        pieces = {"start": start} if held else {"input": self._at(self.flat, start)}
        if self.draw_changes is not None:
            pieces["changes"] = self.draw_changes(len(indices), rng)[share]
        return pieces

    def hold(self, device: torch.device) -> None:
        """Copy the inputs to a device, if it has :func:`room` for them."""
        if self.held is None and self.flat.nbytes <= room(device):
            self.held = self.flat.to(device)

    def cut_there(self, pieces: dict[str, Tensor]) -> dict[str, Tensor]:
        """Cut the ``input`` on the device that holds the inputs, where ``start`` has to be too."""
        if self.held is None:
            return pieces
        start = pieces.pop("start")
        return {"input": self._at(self.held, start), **pieces}

    def _at(self, flat: Tensor, start: Tensor) -> Tensor:
        """Return sub-samples (batch, ..., frames) that begin at rows (batch,)."""
        rows = start[:, None] + torch.arange(self.frames, device=start.device)
        return flat[rows].movedim(1, -1).contiguous()


@dataclass
class PhotoBank:
    """Square crops of stored photos.

    A crop is copied row by row out of a memory map, in a loop over the samples: for photos of any
    size that was faster than one indexing step over all of them, which needs an index per pixel.
    A device that holds the photos (:meth:`hold`) cuts them in one such step.

    Attributes:
        recordings: Recordings of photos.
        store: Decoded files.
        side: Side of a crop in pixels.
        rotation: Largest angle in degrees that a crop is to be turned by.
        augmentation: Transform of a crop after it is cut; None leaves it.
    """

    recordings: Sequence[Recording]
    store: Store
    side: int
    rotation: float
    augmentation: Augmentation | None = None
    # opened on first use, each loader process its own
    maps: dict[int, Photo] = field(default_factory=dict, init=False)
    shapes: list[tuple[int, int]] = field(default_factory=list, init=False)  # if they were held
    held: Tensor | None = field(default=None, init=False)  # pixels (all, 3) of all photos

    def photo(self, index: int) -> Photo:
        """Return the memory map of a photo; finding it again costs more than copying a crop.

        Only so many stay open: each is an open file, and what was read of it stays in memory.
        """
        if index not in self.maps:
            if len(self.maps) >= MAX_MAPS:
                self.maps.clear()
            self.maps[index] = self.store.load(self.recordings[index])
        return self.maps[index]

    def cut(
        self, indices: Indices, rng: np.random.Generator, share: slice = WHOLE
    ) -> dict[str, Tensor]:
        """Cut ``crop`` (batch, 3, side, side) uint8, and draw ``degrees`` (batch,) to rotate it by.

        Photos smaller than a crop are mirrored outwards. Random numbers are drawn for all
        recordings, but only the ``share`` of this process is cut. If a device holds the photos,
        ``place`` (batch, 5) is returned instead, for :meth:`cut_there`: the photo's first pixel,
        height and width, and the crop's row and column.
        """
        places = [
            (index, *random_corner(self._shape(index), self.side, rng))
            for index in indices.tolist()
        ][share]
        seeds: list[int | None] = [None] * len(indices)
        if self.augmentation is not None:
            seeds = rng.integers(1 << 63, size=len(indices)).tolist()  # of all, whoever cuts which
        angles = rng.uniform(-self.rotation, self.rotation, len(indices))[share]
        degrees = torch.from_numpy(angles).float()
        if self.held is not None:
            rows = [(self.starts[index], *self.shapes[index], *corner) for index, *corner in places]
            return {"place": torch.tensor(rows), "degrees": degrees}
        crops = np.empty((len(places), 3, self.side, self.side), np.uint8)
        for planes, place, seed in zip(crops, places, seeds[share], strict=True):
            cv2.split(self._crop(*place, seed), list(planes))  # the fastest way to copy them apart
        return {"crop": torch.from_numpy(crops), "degrees": degrees}

    def hold(self, device: torch.device) -> None:
        """Copy the photos to a device, if it has :func:`room` for them.

        Those that are perturbed are not held, since they are perturbed on the CPU.
        """
        if self.held is not None or self.augmentation is not None:
            return
        self.shapes = [self.photo(index).shape[:2] for index in range(len(self.recordings))]
        pixels = [height * width for height, width in self.shapes]
        if 3 * sum(pixels) <= room(device):
            held = torch.empty(sum(pixels), 3, dtype=torch.uint8, device=device)
            for index, part in enumerate(torch.split(held, pixels)):
                part.copy_(torch.from_numpy(np.array(self.photo(index))).flatten(0, 1))
            self.starts, self.held = np.cumsum([0, *pixels]).tolist(), held
            self.maps.clear()

    def cut_there(self, pieces: dict[str, Tensor]) -> dict[str, Tensor]:
        """Cut the ``crop`` on the device that holds the photos, where ``place`` has to be too."""
        if self.held is None:
            return pieces
        start, height, width, top, left = pieces["place"].T[:, :, None]  # (batch, 1) each
        side = torch.arange(self.side, device=start.device)
        rows, columns = _reflected(top + side, height), _reflected(left + side, width)
        pixels = (start + rows * width)[:, :, None] + columns[:, None]
        return {"crop": self.held[pixels].movedim(-1, 1), "degrees": pieces["degrees"]}

    def _shape(self, index: int) -> tuple[int, ...]:
        """Return height and width of a photo, without opening it if they are known."""
        return self.shapes[index] if self.shapes else self.photo(index).shape[:2]

    def _crop(self, index: int, top: int, left: int, seed: int | None) -> npt.NDArray[np.uint8]:
        """Return one crop (side, side, 3), changed if there is a seed."""
        piece = self.photo(index)[top : top + self.side, left : left + self.side]
        crop = mirrored(piece, self.side)
        if self.augmentation is None or seed is None:
            return crop
        changed = self.augmentation(np.array(crop), np.random.default_rng(seed))
        return mirrored(changed[: self.side, : self.side], self.side)


Bank = InputBank | PhotoBank  # all training recordings of one sense


def _at_least(inputs: Tensor, frames: int) -> Tensor:
    """Repeat an input (..., frames) until it has so many frames."""
    times = -(-frames // inputs.shape[-1])
    return inputs.repeat(*[1] * (inputs.dim() - 1), times)


def random_corner(shape: tuple[int, ...], side: int, rng: np.random.Generator) -> tuple[int, int]:
    """Return row and column where a piece of ``side`` begins; 0 where the photo is smaller.

    Args:
        shape: Height and width of the photo, and perhaps more.
        side: Side of the piece.
        rng: Generator that draws them.
    """
    top, left = (int(rng.integers(0, max(0, length - side) + 1)) for length in shape[:2])
    return top, left


def _reflected(places: Tensor, length: Tensor) -> Tensor:
    """Return the rows or columns of a photo at places of what is :func:`mirrored` outwards."""
    places = places % (2 * length)
    return torch.minimum(places, 2 * length - 1 - places)


def mirrored(piece: npt.NDArray[np.uint8], side: int) -> npt.NDArray[np.uint8]:
    """Mirror a photo (height, width, 3) outwards until it has ``side`` pixels on each side."""
    rows, columns = (max(0, side - length) for length in piece.shape[:2])
    if rows == 0 and columns == 0:
        return piece
    return np.pad(piece, ((0, rows), (0, columns), (0, 0)), mode="symmetric")
