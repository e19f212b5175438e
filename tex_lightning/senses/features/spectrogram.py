"""Turn a raw signal into the normalised spectrogram that HapticNet reads (paper, section III-B)."""

import math
from collections.abc import Iterable, Sequence
from typing import Annotated, Literal

import numpy as np
import torch
from torch import Tensor, nn

from tex_lightning.data.decode import SLOW_RATE
from tex_lightning.errors import UserError
from tex_lightning.senses.features.dft321 import dft321
from tex_lightning.senses.features.gain import SECONDS, KnownGain
from tex_lightning.senses.features.movement import moving

# Filters or frames of larger ones would take up far more memory than the signal.
MAX_WINDOW = 1 << 16  # samples: 6 s at 10 kHz, a third of a second at 200 kHz
MAX_OVERLAP = 100  # hops in a window
CORNER = 700.0  # Hz; bands are about evenly spaced below it and grow in proportion above


def mel_centres(sampling_rate: float, bands: int) -> Tensor:
    """Return centres in Hz (bands,), float64, evenly spaced on the mel scale without its ends.

    The scale is O'Shaughnessy's, ``2595 log10(1 + f / 700)``, which HTK and librosa call theirs.

    Args:
        sampling_rate: Sampling rate in Hz; the scale ends at half of it.
        bands: Number of bands.
    """
    top = np.log1p(sampling_rate / 2 / CORNER)
    return torch.from_numpy(CORNER * np.expm1(np.linspace(0, top, bands + 2)[1:-1]))


def mel_filters(sampling_rate: float, samples: int, bands: int) -> Tensor:
    """Return triangles that take the mean power of each band from that of the Fourier channels.

    A triangle reaches from the centre of the band below to that of the band above, and at least to
    the neighbouring channels, so that every band has one.

    Args:
        sampling_rate: Sampling rate in Hz.
        samples: Length of the transform.
        bands: Number of bands.

    Returns:
        (bands, samples // 2 + 1), not negative, rows summing to 1.
    """
    centres = mel_centres(sampling_rate, bands)
    ends = torch.tensor([0, sampling_rate / 2], dtype=torch.float64)
    below, above = torch.cat((ends[:1], centres[:-1])), torch.cat((centres[1:], ends[1:]))
    return mean_filters(sampling_rate, samples, below, centres, above)


def mean_filters(
    sampling_rate: float,
    samples: int,
    below: Tensor,
    centres: Tensor,
    above: Tensor,
    *,
    constant: bool = True,
) -> Tensor:
    """Return triangles that take the mean power of each band from that of the Fourier channels.

    A triangle reaches at least to the neighbouring channels, so that every band has one.

    Args:
        sampling_rate: Sampling rate in Hz.
        samples: Length of the transform.
        below: Frequency in Hz (bands,), float64, at which each triangle rises from 0.
        centres: Where it is highest.
        above: Where it has fallen to 0 again.
        constant: Whether the constant part counts.

    Returns:
        (bands, samples // 2 + 1), not negative, float32, rows summing to 1.
    """
    channel = sampling_rate / samples
    frequencies = torch.arange(samples // 2 + 1, dtype=torch.float64) * channel
    below = torch.minimum(below, centres - channel)[:, None]
    above = torch.maximum(above, centres + channel)[:, None]
    centres = centres[:, None]
    rising = (frequencies - below) / (centres - below)
    falling = (above - frequencies) / (above - centres)
    heights = torch.minimum(rising, falling).clamp(min=0)
    if not constant:
        heights[:, 0] = 0
    return (heights / heights.sum(dim=1, keepdim=True)).float()


Axes = Literal["frame", "trace"]
Normalisation = Literal["standard", "paper"]
Scale = Literal["mel", "linear"]
BLOCK = 512  # frames; their spectra take 1 MB, fewer are too few for two threads
FLOOR = 1e-3  # of the training set's mean magnitude; below it the logarithm is flat


class SpectrogramFeatures(nn.Module):
    """Cut out the movement, join the axes, compute 50 bands per frame, and normalise them.

    Convention: band ``k`` of scale ``linear`` is the magnitude at ``k * sampling_rate /
    window_length`` Hz (at 10 kHz 0 to 980 Hz in steps of 20), as in the paper; of scale ``mel`` the
    root of the mean power in band ``k`` of 50 up to half the rate (:func:`mel_filters`). Frame
    ``t`` starts at sample ``t * hop_length`` of the movement and frames that would pass its end are
    left out. ``standard`` takes the logarithm and standardises every channel with the mean and
    deviation of the training set, so that the level and the spectral envelope of a trace count; a
    channel that never varies becomes zero. ``paper`` brings every channel of every trace to [0, 1];
    a constant channel becomes zero.

    ``trace`` removes the mean of the whole movement and joins its axes, however many, by DFT321
    before the frames are cut, as the paper does with three. ``frame`` removes each frame's own mean
    and joins the axes of each frame as the root of their summed squared magnitudes: the magnitudes
    that DFT321 (Landin et al., 2010) gives when it is applied to the windowed frame. The two differ
    by what the phases of the whole trace move from frame to frame. A frame's features then depend
    on its samples alone, so that they can be computed while a recording goes on.

    The paper's frames have 500 samples at 10 kHz, and start every 100.

    Args:
        sampling_rate: Rate of the signals in Hz.
        normalisation: ``standard``, which needs :meth:`fit`, or ``paper``.
        any_gain: Not with ``paper``; see :class:`~tex_lightning.senses.features.gain.KnownGain`.

    Raises:
        UserError: If a window at this rate is too long, or as long as too many hops, or has too few
            samples for 50 bands of scale ``linear``.

    Attributes:
        window_length: Samples of a frame.
        hop_length: Samples between the beginnings of frames.
        fast_spectrogram: Whether magnitudes are computed block by block, so that the spectra stay
            in the CPU's cache, and not by ``torch.stft``. Both are equally accurate.
    """

    window: Tensor
    level: Tensor
    channel_mean: Tensor
    channel_std: Tensor
    filters: Tensor

    bands = 50

    def __init__(
        self,
        *,
        sampling_rate: float = 10_000.0,
        normalisation: Annotated[
            Normalisation, "standardised logarithms, or each trace to [0, 1]"
        ] = "standard",
        skip_impact: Annotated[bool, "leave out the first touch of the tool"] = True,
        axes: Annotated[
            Axes, "join three axes per frame, or over the whole trace as in the paper"
        ] = "frame",
        scale: Annotated[Scale, "50 mel bands, or the paper's 50 channels up to 1 kHz"] = "mel",
        window_seconds: Annotated[
            float, "[0.001, 10] s", "length of a frame of the spectrogram"
        ] = 0.05,
        hop_seconds: Annotated[float, "[0.0001, 10] s", "time from frame to frame"] = 0.01,
        any_gain: Annotated[
            bool | None,
            "bring another gain of the sensor to that of the most similar training recording, and "
            "fill empty highest bands; null: at 500 Hz and more, below which levels tell much",
        ] = None,
    ) -> None:
        super().__init__()
        self.window_length = length = max(2, round(window_seconds * sampling_rate))
        self.hop_length = hop = max(1, round(hop_seconds * sampling_rate))
        if length > MAX_WINDOW or length > MAX_OVERLAP * hop:
            raise UserError(
                f"A window of {length} samples every {hop} at {sampling_rate:g} Hz takes up too "
                f"much memory: it may have {MAX_WINDOW}, and {MAX_OVERLAP} times those of the hop; "
                "choose shorter windows or a lower sampling rate."
            )
        if scale == "linear" and self.window_length // 2 + 1 < self.bands:
            raise UserError(
                f"A window of {window_seconds:g} s at {sampling_rate:g} Hz has "
                f"{self.window_length // 2 + 1} frequencies, and scale=linear takes {self.bands}; "
                "set scale=mel, a higher data.sampling_rate or longer windows."
            )
        self.sampling_rate = sampling_rate
        self.normalisation = normalisation
        self.skip_impact = skip_impact
        self.axes = axes
        self.scale = scale
        self.any_gain = sampling_rate >= SLOW_RATE if any_gain is None else any_gain
        self.fast_spectrogram = False
        # symmetric, as MATLAB's hamming(500)
        window = torch.hamming_window(self.window_length, periodic=False, dtype=torch.float64)
        self.register_buffer("window", window.float(), persistent=False)
        if scale == "mel":
            filters = mel_filters(sampling_rate, self.window_length, self.bands)
            self.register_buffer("filters", filters.T.contiguous(), persistent=False)
        self.register_buffer("level", torch.ones(()))
        self.register_buffer("channel_mean", torch.zeros(self.bands, 1))
        self.register_buffer("channel_std", torch.ones(self.bands, 1))
        frames = math.ceil(SECONDS * sampling_rate / self.hop_length)
        self.known_gain = KnownGain(frames, self.bands)

    def count_frames(self, trace: Tensor) -> int:
        """Count the frames that :meth:`magnitudes` gives for (axes, samples); 0 if too short."""
        return self.frames(self.movement(trace).shape[-1])

    def movement(self, trace: Tensor) -> Tensor:
        """Return the part (axes, samples) of a signal that frames are cut from."""
        return moving(trace, self.sampling_rate, pieces=False) if self.skip_impact else trace

    def frames(self, samples: int) -> int:
        """Return frames that so many samples of movement give; 0 if too few."""
        return max(0, (samples - self.window_length) // self.hop_length + 1)

    def samples(self, frames: int) -> int:
        """Return the samples of movement that so many frames are cut from."""
        return (frames - 1) * self.hop_length + self.window_length

    def magnitudes(self, trace: Tensor) -> Tensor:
        """Return the magnitudes (bands, frames), not negative, of a trace (axes, samples).

        Raises:
            UserError: If the signal is shorter than one window.
        """
        movement = self.movement(trace)
        samples = movement.shape[-1]
        if samples < self.window_length:
            raise UserError(
                f"The signal has {samples / self.sampling_rate:.2f} s of movement, less than one "
                f"window of {self.window_length} samples; record a longer stroke."
            )
        return self.spectra(movement)

    def spectra(self, movement: Tensor) -> Tensor:
        """Return the same of a movement (axes, samples) that was cut out, one window or longer."""
        if self.axes == "trace" and len(movement) > 1:
            movement = dft321(movement)[None]
        else:  # with axes=frame every frame loses its mean anyway: this keeps digits from gravity
            movement = movement - movement.mean(dim=-1, keepdim=True)
        if self.fast_spectrogram:
            return self._in_blocks(movement)
        kept = self.bands if self.scale == "linear" else self.window_length // 2 + 1
        spectrum = torch.stft(
            movement, self.window_length, self.hop_length,
            window=self.window, center=False, return_complex=True,
        )[:, :kept]  # fmt: skip
        if self.axes == "frame":
            means = movement.unfold(-1, self.window_length, self.hop_length).mean(dim=-1)
            spectrum = spectrum - means[:, None] * torch.fft.rfft(self.window)[:kept, None]
        squares = torch.view_as_real(spectrum).square()
        power = (squares[..., 0] + squares[..., 1]).sum(dim=0)  # over two axes at once it is slow
        if self.scale == "mel":
            power = self.filters.T @ power
        return power.sqrt_()

    @property
    def frequencies(self) -> Tensor:
        """Frequency in Hz of every band (bands,), of a triangle its centre."""
        if self.scale == "mel":
            return mel_centres(self.sampling_rate, self.bands)
        return torch.arange(self.bands) * self.sampling_rate / self.window_length

    def _in_blocks(self, movement: Tensor) -> Tensor:
        """Compute the same, a few frames at a time."""
        parts = []
        every = movement.unfold(-1, self.window_length, self.hop_length)
        for frames in torch.split(every, BLOCK, dim=1):
            if self.axes == "frame":
                frames = frames - frames.mean(dim=-1, keepdim=True)
            spectrum = torch.fft.rfft(frames * self.window)
            squares = torch.view_as_real(spectrum).square_()
            power = (squares[..., 0] + squares[..., 1]).sum(dim=0)
            linear = self.scale == "linear"
            parts.append(power[:, : self.bands] if linear else power @ self.filters)
        return torch.cat(parts).T.contiguous().sqrt_()

    def fit(self, magnitudes: Sequence[Tensor]) -> None:
        """Fit level, mean and deviation to the training set's magnitudes (bands, frames)."""
        if self.normalisation == "paper":
            return
        # one recording after another: together they may be more than fits into memory
        count = sum(magnitude.shape[1] for magnitude in magnitudes)
        level = self._mean(count, (magnitude.cpu().double() for magnitude in magnitudes)).mean()
        self.level.copy_(level if level > 0 else torch.ones_like(level))
        mean = self._mean(count, map(self._logs, magnitudes))
        away = ((self._logs(magnitude) - mean).square() for magnitude in magnitudes)
        std = self._mean(count - 1, away).sqrt()
        self.channel_mean.copy_(mean)
        self.channel_std.copy_(torch.where(std > 1e-6, std, torch.ones_like(std)))
        if self.any_gain and self.standardises:
            self.known_gain.fit(magnitudes)

    @property
    def standardises(self) -> bool:
        """Whether inputs are standardised logarithms of magnitudes."""
        own = type(self).normalise is not SpectrogramFeatures.normalise
        return self.normalisation == "standard" and not own

    def _logs(self, magnitudes: Tensor) -> Tensor:
        """Return logarithms, on the CPU since not every device computes in float64."""
        return (magnitudes.to(self.level) / self.level).add_(FLOOR).log_().cpu().double()

    def _mean(self, count: int, parts: Iterable[Tensor]) -> Tensor:
        """Sum (bands, 1) over the frames of all parts (bands, frames), divided by ``count``."""
        total = torch.zeros(self.bands, 1, dtype=torch.float64)
        for part in parts:
            total += part.sum(dim=1, keepdim=True)
        return total / count

    def normalise(self, magnitudes: Tensor) -> Tensor:
        """Normalise magnitudes (bands, frames) to the network's input of the same shape."""
        if self.normalisation == "standard":
            logs = (magnitudes / self.level).add_(FLOOR).log_()
            return logs.sub_(self.channel_mean).div_(self.channel_std)
        low = magnitudes.amin(dim=1, keepdim=True)
        span = magnitudes.amax(dim=1, keepdim=True) - low
        return (magnitudes - low) / torch.where(span > 0, span, torch.ones_like(span))

    def magnitudes_of(self, inputs: Tensor) -> Tensor:
        """Return the magnitudes (..., bands, frames) that ``standard`` made network inputs of."""
        logs = inputs * self.channel_std + self.channel_mean
        return (logs.exp_() - FLOOR).clamp_min_(0).mul_(self.level)

    def forward(self, trace: Tensor) -> Tensor:
        """Convert a trace (axes, samples) to network input (1, 1, bands, frames)."""
        magnitudes = self.magnitudes(trace)
        return self.normalise(self.known_gain(magnitudes))[None, None]
