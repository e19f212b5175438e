"""Features of signals as products of real matrices, which every runtime can compute.

The transform of N = P Q samples is one of P samples, then one of Q for each of its outcomes (Cooley
and Tukey 1965): for 2,205 samples a fifteenth of the arithmetic of one product, a hundredth of the
constants in the file, and as near to the exact values as a fast Fourier transform.
"""

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import pad

from tex_lightning.errors import UserError
from tex_lightning.senses.features.movement import (
    IMPACT_FACTOR,
    KNOWN_SECONDS,
    MIN_QUIET,
    QUIET_SECONDS,
    SEARCH_SECONDS,
    SETTLING_SECONDS,
    STEADY_FACTOR,
    left_out,
)
from tex_lightning.senses.features.proportions import BandProportions
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures


def traced_start(trace: Tensor, sampling_rate: float) -> Tensor:
    """Compute :func:`.movement_start` as one graph for recordings of any length.

    The beginning is filled up with zeros to the time after which nothing changes the start, and
    a touch that would need the zeros does not count.

    Args:
        trace: (axes, samples).
        sampling_rate: Sampling rate in Hz.

    Returns:
        int64 ().
    """
    quiet, settling, search, known = (
        int(seconds * sampling_rate)
        for seconds in (QUIET_SECONDS, SETTLING_SECONDS, SEARCH_SECONDS, KNOWN_SECONDS)
    )
    if quiet < MIN_QUIET:
        return torch.zeros((), dtype=torch.int64)
    head = pad(trace, (0, known))[:, :known]
    middle = (quiet - 1) // 2  # PyTorch's median is the lower one
    offset = head[:, :quiet].sort(dim=-1).values[:, middle : middle + 1]
    strength = (head - offset).square().sum(dim=0).sqrt()
    level = strength[:quiet].mean()
    after = strength[quiet + settling :].double().cumsum(0)
    steady = after[quiet:] - after[:-quiet] > STEADY_FACTOR * level * quiet
    burst = strength[quiet:search] > IMPACT_FACTOR * level
    count = min(len(steady), len(burst))
    complete = torch.arange(count, device=trace.device) < trace.shape[-1] - 2 * quiet - settling
    touches = burst[:count] & steady[:count] & complete
    first = touches.long().argmax() + quiet + settling
    return torch.where(touches.any(), first, 0)


def promise(condition: Any) -> None:  # noqa: ANN401
    """Assert a fact about sizes for the tracer; the exported program checks it when it runs."""
    torch._check(condition)  # type: ignore[no-untyped-call]


def number_of(value: Tensor, least: int, most: Any = None) -> Any:  # noqa: ANN401
    """Return the integer of a tensor (); the tracer assumes no more of it than these bounds."""
    number: Any = value.item()
    promise(number >= least)
    if most is not None:
        promise(number <= most)
    return number


def movement(trace: Tensor, start: Tensor, least: int) -> Tensor:
    """Return the samples (axes, samples) from ``start`` on; at least ``least`` are promised."""
    return trace[:, number_of(start, 0, trace.shape[-1] - least) :]


def without_rests(trace: Tensor, sampling_rate: float, least: int) -> Tensor:
    """Return the samples (axes, samples) of the movement; at least ``least`` are promised."""
    kept = (~left_out(trace, sampling_rate)).nonzero()[:, 0]
    promise(kept.shape[0] >= least)
    return trace.index_select(1, kept)


def before_last_rest(trace: Tensor, sampling_rate: float, least: int) -> Tensor:
    """Return a signal (axes, samples) without a rest or a knock at its end likewise."""
    moving = ~left_out(trace, sampling_rate)
    last = (moving * torch.arange(1, trace.shape[-1] + 1)).amax(dim=0)
    return trace[:, : number_of(last, least, trace.shape[-1])]


class BandPower(nn.Module):
    """Weighted power of the Fourier channels of every frame, all axes together.

    Args:
        window: (samples,) that frames are multiplied by.
        hop: Samples from one frame to the next.
        filters: (bands, samples // 2 + 1) weights of the channels.
        slope: (samples,) of norm 1, of a trend that every frame loses beside its mean.
    """

    window: Tensor
    slope: Tensor | None
    first: Tensor
    turn: Tensor
    second: Tensor
    weights: Tensor

    def __init__(
        self, window: Tensor, hop: int, filters: Tensor, slope: Tensor | None = None
    ) -> None:
        super().__init__()
        self.hop = hop
        length = len(window)
        self.outer, self.inner = factors(length)
        kept = self.outer // 2 + 1  # the others are their conjugates
        self.register_buffer("window", window.clone())
        self.register_buffer("slope", slope)
        # cosines, then sines of -2 pi p k / P: (outer, 2 * kept)
        first = _angles(torch.arange(self.outer)[:, None] * torch.arange(kept), self.outer)
        self.register_buffer("first", torch.cat((first.cos(), first.sin()), dim=1).float())
        # exp(-2 pi i q k / N), real and imaginary: (2, inner, kept)
        inner = torch.arange(self.inner)[:, None]
        turn = _angles(inner * torch.arange(kept), length)
        self.register_buffer("turn", torch.stack((turn.cos(), turn.sin())).float())
        # products by exp(-2 pi i q l / Q): (2 * inner, 2 * inner)
        angles = _angles(inner * inner.T, self.inner)
        real, imaginary = angles.cos(), angles.sin()
        rows = torch.cat((real, imaginary), dim=1), torch.cat((-imaginary, real), dim=1)
        self.register_buffer("second", torch.cat(rows).float())
        channel = torch.arange(kept)[:, None] + self.outer * inner.T
        mirrored = torch.minimum(channel, length - channel).flatten()
        once = torch.zeros(len(mirrored))
        once[np.unique(mirrored.numpy(), return_index=True)[1]] = 1
        self.register_buffer("weights", filters.float()[:, mirrored].T * once[:, None])

    def forward(self, trace: Tensor) -> Tensor:
        """Map a signal (axes, samples), at least a window long, to power (bands, frames)."""
        length = len(self.window)
        count = (trace.shape[-1] - length) // self.hop + 1
        axes = trace.shape[0]
        frames = self._frames(trace, count)
        frames = frames - frames.mean(dim=-1, keepdim=True)
        if self.slope is not None:
            frames = frames - (frames @ self.slope)[..., None] * self.slope
        grid = (frames * self.window).reshape(axes * count, self.outer, self.inner)
        kept = self.turn.shape[2]
        # of every sample of the inner grid real and imaginary parts, each of the kept channels
        outer = (grid.transpose(1, 2) @ self.first).reshape(axes * count, self.inner, 2, kept)
        (real, imaginary), (cosine, sine) = outer.unbind(dim=2), self.turn
        turned = real * cosine - imaginary * sine, real * sine + imaginary * cosine
        inner = torch.cat(turned, dim=1).permute(2, 0, 1)
        squares = (inner @ self.second).square().reshape(kept, axes, count, 2, self.inner)
        power = squares.sum(dim=(1, 3)).permute(1, 0, 2).reshape(count, kept * self.inner)
        bands: Tensor = (power @ self.weights).T
        return bands

    def _frames(self, trace: Tensor, count: int) -> Tensor:
        """Join frames (axes, count, samples) of blocks: one by one takes much longer."""
        length = len(self.window)
        block = math.gcd(length, self.hop)
        blocks = trace.shape[-1] // block
        cut = trace[:, : blocks * block].reshape(trace.shape[0], blocks, block)
        first = torch.arange(count)[:, None] * (self.hop // block)
        places = (first + torch.arange(length // block)).flatten()
        return cut.index_select(1, places).reshape(trace.shape[0], count, length)


def factors(length: int) -> tuple[int, int]:
    """Return P and Q with P Q = length for which both stages together take the fewest products."""
    pairs = [(outer, length // outer) for outer in range(1, length + 1) if length % outer == 0]
    return min(pairs, key=lambda pair: pair[0] + 2 * pair[1])


def _angles(turns: Tensor, length: int) -> Tensor:
    """Return -2 pi turns / length, float64, after subtracting whole turns."""
    return (turns % length).double() * (-2 * math.pi / length)


class SpectrogramGraph(nn.Module):
    """:class:`.SpectrogramFeatures` by products of matrices.

    Args:
        features: Trained.
    """

    def __init__(self, features: SpectrogramFeatures) -> None:
        super().__init__()
        self.features = features
        channels = features.window_length // 2 + 1
        linear = features.scale == "linear"
        filters = torch.eye(features.bands, channels) if linear else features.filters.T
        self.power = BandPower(features.window, features.hop_length, filters)

    def forward(self, trace: Tensor) -> tuple[Tensor, Tensor]:
        """Map a trace (axes, samples) to network input (1, 1, bands, frames) and its start, ()."""
        features, start = self.features, torch.zeros((), dtype=torch.int64)
        if features.skip_impact:
            start = traced_start(trace, features.sampling_rate)
            trace = movement(trace, start, features.window_length)
            trace = before_last_rest(trace, features.sampling_rate, features.window_length)
        trace = trace - trace.mean(dim=-1, keepdim=True)
        magnitudes = self.power(trace).sqrt()
        return features.normalise(features.known_gain(magnitudes))[None, None], start


class ProportionsGraph(nn.Module):
    """:class:`~tex_lightning.senses.features.proportions.BandProportions` likewise.

    Args:
        features: Trained.
    """

    def __init__(self, features: BandProportions) -> None:
        super().__init__()
        self.features = features
        self.powers = nn.ModuleList()
        for part in features.used:
            slope = part.slope if part.detrends else None
            self.powers.append(BandPower(part.window, part.hop, part.filters.T, slope))

    def forward(self, trace: Tensor) -> Tensor:
        """Map a trace (axes, samples) to proportions (1, 1, bands, fragments)."""
        features = self.features
        trace = features.gravity(trace)
        if features.skip_impact:
            start = traced_start(trace, features.sampling_rate)
            trace = movement(trace, start, features.min_samples)
            trace = without_rests(trace, features.sampling_rate, features.min_samples)
        trace = features.array(trace)
        samples, trace = trace.shape[-1], features.filled(trace)
        centred = trace - trace.mean(dim=-1, keepdim=True)
        responses = []
        for part, power in zip(features.used, self.powers, strict=True):
            axes = centred[:, None] if features.apart else centred[None]
            bands = torch.stack([power(x).T for x in axes])
            responses.append(part.compare(bands, features.level))
        fewest = responses[features.used.index(features.longest)].shape[0]
        fragments = self._fragments(samples, fewest)
        summaries = [
            part.summary([every], every.shape[0], fragments)
            for part, every in zip(features.used, responses, strict=True)
        ]
        return features.join(summaries, trace, fragments)

    def _fragments(self, samples: int, fewest: int) -> Any:  # noqa: ANN401
        """Return how many fragments the whole signal is cut into."""
        features = self.features
        seconds = torch.scalar_tensor(samples, dtype=torch.float64) / features.sampling_rate
        count = (seconds / features.fragment_seconds).round().long().clamp(min=1)
        fewest_frames = torch.scalar_tensor(fewest, dtype=torch.int64)
        return number_of(torch.minimum(count, fewest_frames), 1)


def signal_graph(features: nn.Module) -> nn.Module:
    """Return the module that maps a decoded signal to the network's input.

    That of a spectrogram also gives the first sample of steady movement.

    Raises:
        UserError: If the features join the axes of the whole recording.
    """
    if isinstance(features, SpectrogramFeatures):
        if features.axes == "trace":
            raise UserError(
                "Features with axes=trace join the axes of a whole recording, which no exported "
                "file does; train with axes=frame."
            )
        return SpectrogramGraph(features)
    if isinstance(features, BandProportions):
        return ProportionsGraph(features)
    return features
