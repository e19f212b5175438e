"""The trained thing itself: features, network and decision in one module.

A :class:`Card` of plain values rebuilds it, and a checkpoint holds the card and the weights, so
that prediction from raw files does exactly what testing did.
"""

import zlib
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from tex_lightning.card import Card, damaged, read_checkpoint
from tex_lightning.data.folds import NEEDS, Kind
from tex_lightning.decision.voting import RULES, Vote, random_pairs
from tex_lightning.errors import UserError
from tex_lightning.features.image import ImageFeatures
from tex_lightning.features.spectrogram import HapticFeatures
from tex_lightning.networks.blocks import Level
from tex_lightning.networks.fusionnet import FusionNet
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.visualnet import VisualNet
from tex_lightning.networks.windows import window_size


class SurfaceClassifier(nn.Module):
    """Classify raw traces and photos.

    Attributes:
        haptic_features: None for VisualNet.
        image_features: None for HapticNet.
        network: HapticNet, VisualNet or FusionNet.

    Example:
        >>> import tex_lightning as tl, torch
        >>> classifier = tl.load("RUN").classifier
        >>> trace, photo = torch.randn(3, 24_000), torch.zeros(240, 240, 3, dtype=torch.uint8)
        >>> classifier.logits(trace, photo).shape  # of classes and pairs of fragments
        torch.Size([3, 50])
        >>> vote = classifier.classify(trace, photo)
        >>> vote.label in (0, 1, 2)
        True
    """

    def __init__(self, card: Card) -> None:
        super().__init__()
        self.card = card
        needs = NEEDS[card.kind]
        self.haptic_features = HapticFeatures(**card.haptic_features) if "haptic" in needs else None
        self.image_features = ImageFeatures() if "image" in needs else None
        self.network = build_network(card)

    @classmethod
    def from_checkpoint(cls, path: str | Path, kind: Kind | None = None) -> "SurfaceClassifier":
        """Load a checkpoint of this package, ready to classify on the CPU.

        Args:
            path: The file.
            kind: What kind of network it has to be; None takes any.

        Raises:
            UserError: If the file is missing, damaged, from elsewhere, a baseline's or of another
                kind.
        """
        path, content = Path(path).expanduser(), read_checkpoint(path)
        try:
            card = Card.from_dict(content["hyper_parameters"]["card"])
            if card.baseline:
                raise UserError(
                    f"Checkpoint {path} holds {card.title}, and this needs one of this package's "
                    "networks; give another file."
                )
            classifier = cls(card)
            prefix = "classifier."
            state = {
                key.removeprefix(prefix): value
                for key, value in content["state_dict"].items()
                if key.startswith(prefix)
            }
            classifier.load_state_dict(state)
        except UserError:
            raise
        except Exception as error:  # damage shows in as many ways as there are formats
            raise damaged(path, error) from error
        if kind is not None and classifier.card.kind != kind:
            raise UserError(
                f"Checkpoint {path} holds a {classifier.card.kind} network where a {kind} network "
                "is needed; give another file."
            )
        return classifier.eval()

    @property
    def device(self) -> torch.device:
        """Where it computes."""
        return next(self.parameters()).device

    def count_parameters(self) -> int:
        """How many numbers were trained."""
        return sum(parameter.numel() for parameter in self.network.parameters())

    def adopt_haptic_features(self, other: "SurfaceClassifier") -> None:
        """Take over the normalisation that another classifier was fitted with."""
        if self.haptic_features is not None and other.haptic_features is not None:
            self.haptic_features.load_state_dict(other.haptic_features.state_dict())

    @torch.inference_mode()
    def classify(self, trace: Tensor | None = None, photo: Tensor | None = None) -> Vote:
        """Decide on one sample; see :meth:`logits`."""
        return self.decide(self.logits(trace, photo), self.card.temperature)

    def decide(self, logits: Tensor, temperature: float) -> Vote:
        """Decide by class scores (classes, fragments) with the card's rule."""
        return RULES[self.card.rule](logits, temperature)

    def logits(self, trace: Tensor | None = None, photo: Tensor | None = None) -> Tensor:
        """Class scores of every fragment of one sample of decoded recordings.

        Args:
            trace: (axes, samples) float32 at the card's sampling rate.
            photo: (height, width, 3) uint8, already halved if the card says so.

        Returns:
            (classes, fragments); FusionNet's fragments are its random pairs.

        Raises:
            UserError: If a modality the network needs is absent, or a recording is too small.
        """
        self._require(trace, photo)
        if isinstance(self.network, HapticNet):
            return self.haptic_positions(cast(Tensor, trace), "fc3")
        if isinstance(self.network, VisualNet):
            return self.visual_positions(cast(Tensor, photo), "fc3").flatten(1)
        visual = self.visual_positions(cast(Tensor, photo), self.network.level).flatten(1)
        haptic = self.haptic_positions(cast(Tensor, trace), self.network.level)
        halves = self.network.project(haptic[None], visual[None])
        return self.pair_scores(*halves, self.seed(trace, photo))

    def seed(self, *recordings: Tensor | None) -> int:
        """Of the random choices for one sample of decoded recordings."""
        arrays = (each.cpu().contiguous().numpy() for each in recordings if each is not None)
        return content_seed(self.card.decision["seed"], *arrays)

    def pair_scores(
        self, haptic: Tensor, visual: Tensor, seed: int, count: int | None = None
    ) -> Tensor:
        """FusionNet's class scores (classes, pairs) of random pairs of positions of one sample.

        Args:
            haptic: Haptic summands (1, classes, L).
            visual: Visual summands (1, classes, M * N).
            seed: Of the pairs; see :func:`content_seed`.
            count: Number of pairs; None takes the card's.
        """
        pairs = random_pairs(
            haptic.shape[-1],
            visual.shape[-1],
            self.card.decision["pairs"] if count is None else count,
            seed,
        )
        network = cast(FusionNet, self.network)
        return network.join(haptic, visual, pairs.to(visual.device))[0]

    def haptic_positions(self, trace: Tensor, level: Level) -> Tensor:
        """Features (D, L) of a decoded trace at every position of HapticNet."""
        network = self.network.haptic if isinstance(self.network, FusionNet) else self.network
        return cast(HapticNet, network).features(self.haptic_input(trace), level)[0]

    def visual_positions(self, photo: Tensor, level: Level) -> Tensor:
        """Features (D, M, N) of a decoded photo at every position of VisualNet."""
        network = self.network.visual if isinstance(self.network, FusionNet) else self.network
        return cast(VisualNet, network).features(self.visual_input(photo), level)[0]

    def haptic_input(self, trace: Tensor) -> Tensor:
        """Spectrogram (1, 1, 50, frames) of a decoded trace, on the module's device."""
        features = cast(HapticFeatures, self.haptic_features)
        spectrogram = features(trace.to(features.window.device))
        check_frames(spectrogram.shape[-1], features)
        check_finite(spectrogram)
        return cast(Tensor, spectrogram)

    def visual_input(self, photo: Tensor) -> Tensor:
        """Normalised pixels (1, 3, height, width) of a decoded photo, on the module's device."""
        features = cast(ImageFeatures, self.image_features)
        check_side(photo.shape[0], photo.shape[1], self.min_side)
        return cast(Tensor, features(photo.permute(2, 0, 1)[None].to(features.mean.device)))

    def visual_windows(self, photo: Tensor, corners: Tensor, level: Level) -> Tensor:
        """Features (D, windows), float32, of single windows of a decoded photo.

        Args:
            photo: As for :meth:`logits`.
            corners: (windows, 2) row and column of the upper left pixel of each.
            level: As for :meth:`visual_positions`.
        """
        network = self.network.visual if isinstance(self.network, FusionNet) else self.network
        features = cast(ImageFeatures, self.image_features)
        height, width = window_size(cast(VisualNet, network))
        crops = torch.stack(
            [photo[row : row + height, col : col + width] for row, col in corners.tolist()]
        )
        pixels = features(crops.permute(0, 3, 1, 2).to(features.mean.device))
        pixels = pixels.to(next(network.parameters()).dtype)
        return cast(VisualNet, network).features(pixels, level).flatten(1).T.float()

    @property
    def min_side(self) -> int:
        """Smallest side in pixels of a photo; 0 for HapticNet."""
        if isinstance(self.network, HapticNet):
            return 0
        network = self.network.visual if isinstance(self.network, FusionNet) else self.network
        return network.min_side

    def _require(self, trace: Tensor | None, photo: Tensor | None) -> None:
        given = {"haptic": trace is not None, "image": photo is not None}
        absent = [modality for modality in NEEDS[self.card.kind] if not given[modality]]
        if absent:
            raise UserError(
                f"This {self.card.kind} network needs {' and '.join(NEEDS[self.card.kind])}; "
                f"give {' and '.join(f'{key}=FILE' for key in absent)} too."
            )


def content_seed(seed: int, *recordings: npt.NDArray[Any]) -> int:
    """A seed from the content of a sample: its place in a batch or list cannot matter."""
    seed &= 0xFFFFFFFF
    for array in recordings:
        seed = zlib.crc32(np.ascontiguousarray(array).data, seed)
    return seed


def check_frames(frames: int, features: HapticFeatures) -> None:
    """Refuse a spectrogram too short for one fragment."""
    least = HapticNet.min_frames
    if frames < least:
        rate, hop = features.sampling_rate, features.hop_length
        have = max(0, (frames - 1) * hop + features.window_length) / rate
        need = ((least - 1) * hop + features.window_length) / rate
        raise UserError(
            f"The trace has {have:.2f} s of movement, and HapticNet needs {need:.2f} s for one "
            "fragment; record a longer stroke."
        )


def check_finite(signal: Tensor) -> None:
    """Refuse what no class score can be computed from: NaN would win every vote."""
    if not bool(signal.isfinite().all()):
        raise UserError(
            "The trace holds NaN, infinity or numbers too large to square; repair the recording."
        )


def check_side(height: int, width: int, least: int) -> None:
    """Refuse a photo too small for one fragment."""
    if min(height, width) < least:
        raise UserError(
            f"The photo has {width}x{height} pixels after decoding, and this network needs "
            f"{least} on each side; use a larger photo or train with data.half_scale=false."
        )


def build_network(card: Card) -> HapticNet | VisualNet | FusionNet:
    """The network that a card describes, with random weights."""
    classes = len(card.classes)
    if card.kind == "haptic":
        return HapticNet(classes, **card.haptic_network)
    if card.kind == "visual":
        return VisualNet(classes, **card.visual_network)
    return FusionNet(
        HapticNet(classes, **card.haptic_network),
        VisualNet(classes, **card.visual_network),
        classes=classes,
        level=cast(Level, card.fusion["level"]),
    )
