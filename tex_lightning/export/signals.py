"""Features of signals as real products of matrices, without short Fourier transforms."""

from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from tex_lightning.export.dft321 import joined_axes
from tex_lightning.export.fourier import BandPower
from tex_lightning.export.movement import movement, promise, traced_start
from tex_lightning.features.proportions import FLOOR, OVERLAP, BandProportions
from tex_lightning.features.spectrogram import SpectrogramFeatures


class Heard(NamedTuple):
    """The features of a signal.

    Attributes:
        x: Network input (1, ..., frames).
        start: First sample of steady movement, int64 (); None where it is not looked for.
    """

    x: Tensor
    start: Tensor | None


class SpectrogramGraph(nn.Module):
    """:class:`~tex_lightning.features.spectrogram.SpectrogramFeatures` by products of matrices.

    Args:
        features: Trained.
    """

    def __init__(self, features: SpectrogramFeatures) -> None:
        super().__init__()
        self.features = features
        channels = features.window_length // 2 + 1
        linear = features.scale == "linear"
        filters = torch.eye(features.bands, channels) if linear else features.filters.T
        centred = features.axes == "frame"
        self.power = BandPower(features.window, features.hop_length, filters, centred=centred)

    def forward(self, trace: Tensor) -> Heard:
        """Trace (axes, samples) to network input (1, 1, bands, frames)."""
        features, start = self.features, torch.zeros((), dtype=torch.int64)
        if features.skip_impact:
            start = traced_start(trace, features.sampling_rate)
            trace = movement(trace, start, features.window_length)
        trace = trace - trace.mean(dim=-1, keepdim=True)
        if features.axes == "trace":
            trace = joined_axes(trace, features.window_length)
        magnitudes = self.power(trace).sqrt()
        return Heard(features.normalise(magnitudes)[None, None], start)


class ProportionsGraph(nn.Module):
    """:class:`~tex_lightning.features.proportions.BandProportions` likewise.

    Args:
        features: Trained.
    """

    def __init__(self, features: BandProportions) -> None:
        super().__init__()
        self.features = features
        self.powers = nn.ModuleList()
        for index, length in enumerate(features.lengths):
            window = features.get_buffer(f"window{index}")
            filters = features.get_buffer(f"filters{index}").T / window.sum().square()
            hop = max(1, round(length / OVERLAP))
            self.powers.append(BandPower(window, hop, filters, centred=True))

    def forward(self, trace: Tensor) -> Heard:
        """Trace (axes, samples) to proportions (1, 1, bands, fragments)."""
        features, start, samples = self.features, None, trace.shape[-1]
        if features.skip_impact:
            start = traced_start(trace, features.sampling_rate)
            trace = movement(trace, start, max(features.lengths))
        trace = trace - trace.mean(dim=-1, keepdim=True)
        responses = [self._responses(trace, index) for index in range(len(features.lengths))]
        fragments = self._fragments(samples, responses)
        parts = [self._proportions(each, index, fragments) for index, each in enumerate(responses)]
        return Heard(torch.cat(parts)[None, None], start)

    def _responses(self, trace: Tensor, index: int) -> Tensor:
        """(channels, frames) of one window."""
        features = self.features
        bands = (self.powers[index](trace) / features.level + FLOOR).log()
        steps = bands[features.gap :] - bands[: -features.gap]
        return torch.cat((bands - bands.mean(dim=0), steps))

    def _fragments(self, samples: int, responses: list[Tensor]) -> Any:  # noqa: ANN401
        """How many fragments the whole signal is cut into."""
        features = self.features
        seconds = torch.scalar_tensor(samples, dtype=torch.float64) / features.sampling_rate
        count = (seconds / features.fragment_seconds).round().long().clamp(min=1)
        for each in responses:
            count = torch.minimum(count, torch.scalar_tensor(each.shape[1], dtype=torch.int64))
        found: Any = count.item()
        promise(found >= 1)
        return found

    def _proportions(self, responses: Tensor, index: int, fragments: Any) -> Tensor:  # noqa: ANN401
        """(channels * thresholds, fragments)."""
        limits = self.features.get_buffer(f"thresholds{index}")
        above = (responses[:, None] > limits[..., None]).flatten(0, 1).to(responses.dtype)
        frames = above.shape[1]
        place = torch.arange(frames) * fragments // frames
        member = (place[:, None] == torch.arange(fragments)).to(above.dtype)
        found: Tensor = above @ (member / member.sum(dim=0))
        return found


class OwnSignalGraph(nn.Module):
    """A user's features as they are.

    Args:
        features: Map (axes, samples) to the network's input.
    """

    def __init__(self, features: nn.Module) -> None:
        super().__init__()
        self.features = features

    def forward(self, trace: Tensor) -> Heard:
        """Trace (axes, samples) to network input (1, ..., frames)."""
        return Heard(self.features(trace), None)


def signal_graph(features: nn.Module) -> nn.Module:
    """The module that maps a decoded signal to :class:`Heard`."""
    if isinstance(features, SpectrogramFeatures):
        return SpectrogramGraph(features)
    if isinstance(features, BandProportions):
        return ProportionsGraph(features)
    return OwnSignalGraph(features)
