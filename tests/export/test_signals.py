"""Features of signals as graphs, against those of the classifier."""

import pytest
import torch

from tex_lightning.export.signals import ProportionsGraph, SpectrogramGraph
from tex_lightning.features.proportions import BandProportions
from tex_lightning.features.spectrogram import SpectrogramFeatures, movement_start

RATE = 2_000.0


def recording(axes: int, seconds: float = 3.3) -> torch.Tensor:
    """Quiet, then steady movement."""
    trace = torch.randn(axes, int(seconds * RATE), generator=torch.Generator().manual_seed(axes))
    trace[:, : int(0.4 * RATE)] *= 1e-3
    return trace + 9.81


@pytest.mark.parametrize(
    ("axes", "options"),
    [
        (1, {"scale": "mel"}),
        (3, {"scale": "mel", "window_seconds": 0.03}),
        (3, {"scale": "linear"}),
        (1, {"scale": "linear", "axes": "trace", "normalisation": "paper"}),
        (3, {"scale": "linear", "axes": "trace", "normalisation": "paper"}),
        (3, {"scale": "mel", "axes": "trace"}),
        (1, {"scale": "mel", "skip_impact": False}),
    ],
)
def test_spectrogram(axes, options):
    features = SpectrogramFeatures(sampling_rate=RATE, **options)
    trace = recording(axes)
    features.fit([features.magnitudes(trace)])
    found = SpectrogramGraph(features)(trace)
    torch.testing.assert_close(found.x, features(trace), rtol=0, atol=1e-3)
    start = movement_start(trace, RATE) if features.skip_impact else 0
    assert int(found.start) == start


def test_proportions():
    features = BandProportions(
        sampling_rate=RATE, windows=[0.05, 0.3], bands_per_octave=4, thresholds=3,
        fragment_seconds=0.8, skip_impact=True,
    )  # fmt: skip
    trace = recording(3)
    features.learn([recording(1)])  # of its own thresholds every value would be one
    found, expected = ProportionsGraph(features)(trace).x, features(trace)
    assert found.shape == expected.shape
    # a comparison may fall the other way by rounding: one frame of one band in one fragment
    assert ((found - expected).abs() > 1e-5).float().mean() < 0.01
