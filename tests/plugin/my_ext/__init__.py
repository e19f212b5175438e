"""Parts of a user's own, as the package finds them: nothing of it is edited."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor, nn

from tex_lightning.baselines.base import Baseline
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.networks.blocks import Window
from tex_lightning.networks.trunks import Trunk
from tex_lightning.perturbations.pixels import Scene

CONVOLUTION, POOL = Window(8, 8), Window(4, 4)


@dataclass
class FlatReader:
    """Reads FOLDER/CLASS_NUMBER.png, and .npy as what a force sensor measured."""

    folder: str
    suffix: str = ".png"

    def read(self) -> Recordings:
        rows = []
        for suffix, modality in ((self.suffix, "image"), (".npy", "force")):
            for path in sorted(Path(self.folder).glob(f"*{suffix}")):
                label, _, number = path.stem.partition("_")
                rows.append(Recording(label, modality, path, int(number)))
        return Recordings(tuple(rows))


class SmallTrunk(Trunk):
    """One convolution and a pooling."""

    norms = ("batch", "none")
    geometry = (CONVOLUTION, POOL)
    fc1_kernel = 7

    def __init__(self, *, width: float, norm: str, channels: int) -> None:
        self.channels = channels
        super().__init__(width=width, norm=norm)

    def build(self) -> nn.Sequential:
        self.out_channels = self.channels
        layers = nn.Conv2d(3, self.channels, CONVOLUTION.kernel, CONVOLUTION.stride)
        return nn.Sequential(layers, nn.ReLU(), POOL.max_pool())


class Levels(nn.Module):
    """Mean and deviation of every ten samples."""

    def __init__(self, samples: int) -> None:
        super().__init__()
        self.samples = samples

    def forward(self, signal: Tensor) -> Tensor:
        frames = signal[:1].unfold(-1, self.samples, self.samples)
        return torch.stack([frames.mean(dim=-1), frames.std(dim=-1)], dim=1)


class ForceNet(nn.Module):
    """One convolution over time."""

    def __init__(self, classes: int, channels: int) -> None:
        super().__init__()
        self.hidden = nn.Sequential(nn.Conv1d(2, channels, 9), nn.ReLU())
        self.score_layer = nn.Conv1d(channels, classes, 1)

    def features(self, x: Tensor, level: str) -> Tensor:
        hidden = self.hidden(x)
        return hidden if level == "fc2" else self.score_layer(hidden)


@dataclass
class NearestSlope(Baseline):
    """The class whose mean slope of brightness is nearest."""

    power: float

    kind: ClassVar = "visual"

    def fit(self, recordings, labels, seed, groups) -> None:
        assert len(groups) == len(labels)
        slopes = np.array([self._slope(photo) for photo in recordings])
        means = [slopes[labels == label].mean() for label in range(labels.max() + 1)]
        self.means = torch.tensor(means)

    def logits(self, recording) -> Tensor:
        distance = (self.means - self._slope(recording)).abs() ** self.power
        return -distance[:, None]

    def _slope(self, photo: np.ndarray) -> float:
        return sum(float((np.diff(photo * 1.0, axis=axis) ** 2).mean()) for axis in (0, 1)) ** 0.5

    def state(self) -> dict[str, Tensor]:
        return {"means": self.means}

    def load_state(self, state: dict[str, Tensor]) -> None:
        self.means = state["means"]

    def count_parameters(self) -> int:
        return self.means.numel()


def drift(recording: np.ndarray, share: float, scene: Scene) -> np.ndarray:
    """Add a ramp up to a multiple of the deviation."""
    ramp = np.linspace(0, share * recording.std(), recording.shape[1])
    return recording + ramp


def stains(recording: np.ndarray, share: float, scene: Scene) -> np.ndarray:
    """Black out a share of the pixels."""
    stained = recording.copy()
    stained[scene.rng.random(recording.shape[:2]) < share] = 0
    return stained


class Grey(nn.Module):
    """Photos without colour, and what their rotation may not depend on: nothing else."""

    def forward(self, photos: Tensor) -> Tensor:
        return photos.float().mean(dim=1, keepdim=True) / 255


class GreyNet(nn.Module):
    """Scores of pieces of 32 pixels."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(nn.Conv2d(1, 4, 32, 32), nn.ReLU(), nn.Conv2d(4, classes, 1))

    def features(self, x: Tensor, level: str) -> Tensor:
        return self.layers(x)


def shatters(recording: np.ndarray, level: float, scene: Scene) -> np.ndarray:
    """Fail at the severest level alone."""
    if level == 5:
        raise KeyError("boom of a user")
    return recording
