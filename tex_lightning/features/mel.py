"""Bands that widen with frequency, so that a few of them reach from 0 Hz to half the rate."""

import numpy as np
import torch
from torch import Tensor

CORNER = 700.0  # Hz; bands are about evenly spaced below it and grow in proportion above


def mel_centres(sampling_rate: float, bands: int) -> Tensor:
    """Centres in Hz (bands,), float64, evenly spaced on the mel scale without its ends.

    The scale is O'Shaughnessy's, ``2595 log10(1 + f / 700)``, which HTK and librosa call theirs.

    Args:
        sampling_rate: Sampling rate in Hz; the scale ends at half of it.
        bands: Number of bands.
    """
    top = np.log1p(sampling_rate / 2 / CORNER)
    return torch.from_numpy(CORNER * np.expm1(np.linspace(0, top, bands + 2)[1:-1]))


def mel_filters(sampling_rate: float, samples: int, bands: int) -> Tensor:
    """Triangles that take the mean power of each band from that of the Fourier channels.

    A triangle reaches from the centre of the band below to that of the band above, and at least to
    the neighbouring channels, so that every band has one.

    Args:
        sampling_rate: Sampling rate in Hz.
        samples: Length of the transform.
        bands: Number of bands.

    Returns:
        (bands, samples // 2 + 1), not negative, rows summing to 1.
    """
    channel = sampling_rate / samples
    frequencies = torch.arange(samples // 2 + 1, dtype=torch.float64) * channel
    centres = mel_centres(sampling_rate, bands)
    ends = torch.tensor([0, sampling_rate / 2], dtype=torch.float64)
    below = torch.minimum(torch.cat((ends[:1], centres[:-1])), centres - channel)[:, None]
    above = torch.maximum(torch.cat((centres[1:], ends[1:])), centres + channel)[:, None]
    return mean_filters(triangles(frequencies, below, centres[:, None], above))


def triangles(frequencies: Tensor, below: Tensor, centres: Tensor, above: Tensor) -> Tensor:
    """Heights (bands, channels) of triangles that rise from 0 to 1 and fall to 0 again.

    Args:
        frequencies: (channels,) in Hz.
        below: (bands, 1) where each begins.
        centres: (bands, 1) where it is 1.
        above: (bands, 1) where it ends.
    """
    rising = (frequencies - below) / (centres - below)
    falling = (above - frequencies) / (above - centres)
    return torch.minimum(rising, falling).clamp(min=0)


def mean_filters(heights: Tensor) -> Tensor:
    """Heights (bands, channels) as weights of a mean, float32, rows summing to 1."""
    return (heights / heights.sum(dim=1, keepdim=True)).float()
