"""Augment training spectrograms by the noise and the frequency response of other sensors.

A network that was trained on one sensor mistakes its response and its noise floor for properties of
the material. The overall level is left unchanged, since it tells materials apart
(docs/reports/2026-11-28-sensor-augmentation.md).
"""

import math

import numpy as np
import torch
from torch import Tensor, nn

from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

MIN_SNR, MAX_SNR = 10.0, 50.0  # dB, mean magnitude of a sub-sample over that of the noise
DEVIATION = 0.1  # nepers, of the weight of the first cosine of a response; that of the nth is 1/n
COSINES = 4  # over the bands, of which a response is the sum
NOISE_LENGTH = 4  # sub-samples that the noise is long, from which each piece is cut


def draw_changes(share: float, frames: int, count: int, rng: np.random.Generator) -> Tensor:
    """Draw the random numbers of the augmentation of ``count`` sub-samples of so many frames.

    A share of them in [0, 1] gets noise, and a share another response.

    Returns:
        (count, 2 + COSINES): noise as a factor of the mean magnitude, its first frame, and the
        weights of the cosines of the response in nepers. A row of zeros changes nothing.
    """
    noise = 10 ** (-rng.uniform(MIN_SNR, MAX_SNR, count) / 20)
    first = rng.integers((NOISE_LENGTH - 1) * frames + 1, size=count)
    response = rng.normal(0, DEVIATION / np.arange(1, COSINES + 1), (count, COSINES))
    is_noisy, is_filtered = rng.random((2, count)) < share
    columns = noise * is_noisy, first * is_noisy, *(response * is_filtered[:, None]).T
    return torch.from_numpy(np.stack(columns, axis=1)).float()


class SensorAugmentation(nn.Module):
    """Add noise to spectrograms and change their frequency response.

    Args:
        features: Features that the spectrograms come from.
        frames: Length of a sub-sample.
        axes: Number of axes of the signals, each of which has its own noise.
    """

    noise: Tensor
    cosines: Tensor

    def __init__(self, features: SpectrogramFeatures, frames: int, axes: int) -> None:
        super().__init__()
        samples = features.samples(NOISE_LENGTH * frames)
        white = np.random.default_rng(0).standard_normal((axes, samples), np.float32)
        spectra = features.spectra(torch.from_numpy(white).to(features.window.device))
        self.register_buffer("noise", spectra / spectra.mean(), persistent=False)
        bands = torch.linspace(0, math.pi, features.bands)
        cosines = torch.cos(torch.arange(1, COSINES + 1)[:, None] * bands)
        self.register_buffer("cosines", cosines.to(spectra.device), persistent=False)

    def forward(self, magnitudes: Tensor, changes: Tensor) -> Tensor:
        """Change magnitudes (batch, bands, frames) by what :func:`draw_changes` has drawn."""
        factors, first, response = changes[:, 0], changes[:, 1].long(), changes[:, 2:]
        magnitudes = magnitudes * (response @ self.cosines).exp()[:, :, None]
        frames = first[:, None] + torch.arange(magnitudes.shape[2], device=changes.device)
        noise = self.noise[:, frames].transpose(0, 1) * factors[:, None, None]
        return torch.hypot(magnitudes, noise * magnitudes.mean(dim=(1, 2), keepdim=True))
