"""Sub-samples as other sensors would give them: with their noise and their frequency response.

A network that knows one sensor takes its quiet bands and its resonances for the material's. A share
of the sub-samples is changed each time one is cut, the level as a whole excepted, which tells
materials apart (docs/reports/2026-11-28-other-sensors.md).
"""

import math

import numpy as np
import torch
from torch import Tensor, nn

from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

LOUDEST, FAINTEST = 10.0, 50.0  # dB that noise is below the mean magnitude of a sub-sample
SPREAD = 0.1  # nepers, deviation of the slowest curve of a response; faster ones have less
CURVES = 4  # half periods of the fastest curve
LONGER = 4  # times as long as a sub-sample is the noise that is cut


def draw(share: float, frames: int, count: int, rng: np.random.Generator) -> Tensor:
    """Draw what other sensors do to sub-samples.

    Args:
        share: Share of them that get noise, and of them that get another response.
        frames: Length of a sub-sample.
        count: Number of sub-samples.
        rng: Generator that draws.

    Returns:
        (count, 2 + CURVES): noise as a factor of the mean magnitude, its first frame, and the
        weights of the curves of the response in nepers. A row of zeros changes nothing.
    """
    noise = 10 ** (-rng.uniform(LOUDEST, FAINTEST, count) / 20)
    first = rng.integers((LONGER - 1) * frames + 1, size=count)
    response = rng.normal(0, SPREAD / np.arange(1, CURVES + 1), (count, CURVES))
    noisy, other = rng.random((2, count)) < share
    columns = noise * noisy, first * noisy, *(response * other[:, None]).T
    return torch.from_numpy(np.stack(columns, axis=1)).float()


class OtherSensors(nn.Module):
    """Does what was drawn.

    Args:
        features: Of the spectrograms.
        frames: Length of a sub-sample.
    """

    noise: Tensor
    curves: Tensor

    def __init__(self, features: SpectrogramFeatures, frames: int) -> None:
        super().__init__()
        samples = features.samples(LONGER * frames)
        white = np.random.default_rng(0).standard_normal((1, samples), np.float32)
        spectra = features.spectra(torch.from_numpy(white).to(features.window.device))
        self.register_buffer("noise", spectra / spectra.mean(), persistent=False)
        bands = torch.linspace(0, math.pi, features.bands)
        curves = torch.cos(torch.arange(1, CURVES + 1)[:, None] * bands)
        self.register_buffer("curves", curves.to(spectra.device), persistent=False)

    def forward(self, magnitudes: Tensor, drawn: Tensor) -> Tensor:
        """Change magnitudes (batch, bands, frames) by what :func:`draw` gave for them."""
        factors, first, response = drawn[:, 0], drawn[:, 1].long(), drawn[:, 2:]
        magnitudes = magnitudes * (response @ self.curves).exp()[:, :, None]
        places = first[:, None] + torch.arange(magnitudes.shape[2], device=drawn.device)
        noise = self.noise[:, places].transpose(0, 1) * factors[:, None, None]
        return torch.hypot(magnitudes, noise * magnitudes.mean(dim=(1, 2), keepdim=True))
