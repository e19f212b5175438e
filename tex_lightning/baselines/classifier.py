"""A fitted baseline as a classifier of raw recordings, saved and loaded like a network."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import torch
from torch import Tensor, nn

from tex_lightning.baselines.registry import make_baseline
from tex_lightning.card import Card, damaged, read_checkpoint
from tex_lightning.classifier import SurfaceClassifier, check_finite, check_side
from tex_lightning.data.datamodule import load_trace
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError
from tex_lightning.features.dft321 import dft321, quick_length
from tex_lightning.features.spectrogram import HapticFeatures, movement_start
from tex_lightning.files import write_atomically

if TYPE_CHECKING:
    from tex_lightning.baselines.base import Array, Baseline


class BaselineClassifier(SurfaceClassifier):
    """Classify raw traces or photos with a baseline, on the CPU.

    Attributes:
        baseline: Fitted, or about to be.
    """

    def __init__(self, card: Card) -> None:
        nn.Module.__init__(self)
        self.card = card
        haptic = card.kind == "haptic"
        self.haptic_features = HapticFeatures(**card.haptic_features) if haptic else None
        self.image_features = None
        self.baseline: Baseline = make_baseline(card.baseline["name"], card.baseline["settings"])
        self.baseline.sampling_rate = card.settings.sampling_rate

    @property
    def device(self) -> torch.device:
        """Always the CPU."""
        return torch.device("cpu")

    @property
    def min_side(self) -> int:
        """Smallest side in pixels of a photo; 0 for traces."""
        return self.baseline.min_side

    def logits(self, trace: Tensor | None = None, photo: Tensor | None = None) -> Tensor:
        """Class scores (classes, fragments) of one decoded recording; see the base class."""
        self._require(trace, photo)
        if self.card.kind == "haptic":
            return self.baseline.logits(movement(cast(Tensor, trace).numpy(), self.card))
        pixels = cast(Tensor, photo)
        check_side(pixels.shape[0], pixels.shape[1], self.min_side)
        return self.baseline.logits(pixels.numpy())

    def count_parameters(self) -> int:
        """How many numbers were fitted."""
        return self.baseline.count_parameters()

    def save(self, path: Path, fit_seconds: float) -> None:
        """Write a checkpoint of tensors and plain values."""
        content = {
            "hyper_parameters": {"card": self.card.to_dict()},
            "baseline": self.baseline.state(),
            "fit_seconds": fit_seconds,
        }
        write_atomically(path, lambda partial: torch.save(content, partial))


def load_classifier(path: str | Path) -> SurfaceClassifier:
    """Load a checkpoint of a network or of a baseline.

    Raises:
        UserError: If the file cannot be used, or a library that the baseline needs is missing.
    """
    content = read_checkpoint(path)
    if not isinstance(content, dict) or "baseline" not in content:
        return SurfaceClassifier.from_checkpoint(path)
    try:
        classifier = BaselineClassifier(Card.from_dict(content["hyper_parameters"]["card"]))
        classifier.baseline.load_state(content["baseline"])
    except UserError:
        raise
    except Exception as error:  # damage shows in as many ways as there are formats
        raise damaged(Path(path), error) from error
    return classifier


@dataclass(frozen=True)
class Loaded(Sequence["Array"]):
    """Recordings as a baseline takes them, loaded when they are asked for."""

    rows: Sequence[Recording]
    store: Store
    card: Card

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator["Array"]:
        return (self[index] for index in range(len(self.rows)))

    def __getitem__(self, index: Any) -> Any:  # noqa: ANN401  (a number or a slice)
        if isinstance(index, slice):
            return [self[place] for place in range(*index.indices(len(self.rows)))]
        row = self.rows[index]
        if row.modality == "image":
            return np.array(self.store.image(row))
        return movement(load_trace(row, self.store).numpy(), self.card)


def movement(trace: "Array", card: Card) -> "Array":
    """One axis (samples,) float32 of steady movement without its mean, from (axes, samples).

    The last samples of three axes, fewer than 4 %, are left out where DFT321 of the rest is quick:
    a Fourier transform over a large prime takes many times as long.

    Raises:
        UserError: If there is less than one window of movement.
    """
    settings = card.haptic_features
    axes = torch.from_numpy(np.asarray(trace, dtype=np.float32))
    if settings["skip_impact"]:
        axes = axes[:, movement_start(axes, settings["sampling_rate"]) :]
    if axes.shape[1] < HapticFeatures.window_length:
        raise UserError(
            f"The trace has {axes.shape[1] / settings['sampling_rate']:.2f} s of movement, too "
            "little to classify; record a longer stroke."
        )
    if len(axes) == 3:
        joined = dft321(axes[:, : quick_length(axes.shape[1])])
    else:
        joined = (axes - axes.mean(dim=1, keepdim=True))[0]
    check_finite(joined)
    array: Array = joined.numpy()
    return array
