import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import ShortTimeFFT, spectrogram

from tex_lightning.data.decode import SignalDecoder
from tex_lightning.errors import UserError
from tex_lightning.senses.features.movement import moving
from tex_lightning.senses.features.spectrogram import (
    SpectrogramFeatures,
    mel_centres,
    mel_filters,
)


def noise(seconds: float, axes: int = 1, seed: int = 0) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.standard_normal((axes, int(seconds * 10_000))).astype(np.float32))


def scipys(trace: torch.Tensor, length: int = 500, hop: int = 100) -> np.ndarray:
    """Magnitudes (channels, frames) in double precision, every frame without its own mean."""
    window = np.hamming(length)
    _, _, axes = spectrogram(
        trace.double().numpy(),
        window=window,
        nperseg=length,
        noverlap=length - hop,
        detrend="constant",
        scaling="spectrum",
        mode="magnitude",
    )
    return np.sqrt((axes**2).sum(axis=0)) * window.sum()


@pytest.mark.parametrize("axes", [1, 3])
def test_magnitudes_equal_scipys(axes):
    trace = noise(1.5, axes) + torch.tensor([0.1, 9.81, -3.0])[:axes, None]
    features = SpectrogramFeatures(skip_impact=False, scale="linear")
    ours, theirs = features.magnitudes(trace).numpy(), scipys(trace)[:50]
    np.testing.assert_allclose(ours, theirs, atol=1e-5 * theirs.max())


@pytest.mark.parametrize("scale", ["linear", "mel"])
@pytest.mark.parametrize("joined", ["frame", "trace"])
@pytest.mark.parametrize("axes", [1, 3])
@pytest.mark.parametrize("seconds", [0.05, 0.5, 11.3])  # of one frame, and of several blocks
def test_blocks_equal_the_whole(seconds, axes, joined, scale):
    trace = noise(seconds, axes) + torch.tensor([0.1, 9.81, -3.0])[:axes, None]
    features = SpectrogramFeatures(skip_impact=False, axes=joined, scale=scale)
    whole = features.magnitudes(trace)
    features.fast_spectrogram = True
    blocks = features.magnitudes(trace)
    assert blocks.shape == whole.shape
    torch.testing.assert_close(blocks, whole, atol=1e-5 * float(whole.max()), rtol=0)


@pytest.mark.parametrize("fast", [False, True])
@pytest.mark.parametrize("scale", ["linear", "mel"])
@pytest.mark.parametrize(
    ("rate", "seconds", "window", "hop"), [(44_100, 0.04, 1764, 441), (2_200, 0.05, 110, 22)]
)
def test_windows_of_a_microphone_and_of_a_fingertip_equal_scipys(
    scale, fast, rate, seconds, window, hop
):
    sound = noise(2.0) + 0.3
    features = SpectrogramFeatures(
        sampling_rate=rate, skip_impact=False, scale=scale, window_seconds=seconds
    )
    features.fast_spectrogram = fast
    theirs = scipys(sound, window, hop)
    if scale == "mel":
        theirs = np.sqrt(mel_filters(rate, window, 50).double().numpy() @ theirs**2)
    ours = features.magnitudes(sound).numpy()
    assert ours.shape == (50, features.count_frames(sound)) == (50, (20_000 - window) // hop + 1)
    assert features.samples(ours.shape[1]) <= 20_000 < features.samples(ours.shape[1] + 1)
    np.testing.assert_allclose(ours, theirs[:50], atol=1e-5 * theirs.max())
    if scale == "linear":
        torch.testing.assert_close(features.frequencies, torch.arange(50) * rate / window)


def test_a_window_with_too_few_frequencies_for_the_papers_channels_is_refused():
    assert SpectrogramFeatures(sampling_rate=500.0, scale="mel").window_length == 25
    with pytest.raises(UserError, match="set scale=mel"):
        SpectrogramFeatures(sampling_rate=500.0, scale="linear")


def test_magnitudes_of_the_whole_trace_equal_scipys():
    trace = noise(1.5)
    ours = (
        SpectrogramFeatures(skip_impact=False, axes="trace", scale="linear")
        .magnitudes(trace)
        .numpy()
    )
    signal = (trace[0] - trace[0].mean()).numpy().astype(np.float64)
    transform = ShortTimeFFT(np.hamming(500), hop=100, fs=10_000)
    assert transform.f[49] == pytest.approx(980)
    # SciPy numbers slices by their centre, and half a window is no multiple of the hop: without
    # the first half hop its first slice inside the signal is our frame 1.
    first, last = transform.lower_border_end[1], transform.upper_border_begin(len(signal))[1]
    theirs = np.abs(transform.stft(signal[50:], p0=first, p1=last))[:50]
    frames = min(theirs.shape[1], ours.shape[1] - 1)
    assert frames > 140
    np.testing.assert_allclose(ours[:, 1 : frames + 1], theirs[:, :frames], rtol=1e-3, atol=2e-3)


@pytest.mark.parametrize("axes", [2, 3, 6])
@pytest.mark.parametrize("samples", [5003, 5040])  # of a prime number all samples count, too
def test_any_number_of_axes_is_joined_over_the_whole_trace(axes, samples):
    """With three, a prime number of samples was cut to a handy one; two or more went by frame."""
    trace = noise(samples / 10_000, axes) + torch.arange(axes)[:, None]
    spectra = np.fft.rfft(trace.double().numpy())
    spectra[:, 0] = 0
    size = np.sqrt((np.abs(spectra) ** 2).sum(axis=0))
    joined = np.fft.irfft(size * np.exp(1j * np.angle(spectra.sum(axis=0))), samples)
    frames = np.lib.stride_tricks.sliding_window_view(joined, 500)[::100]
    theirs = np.abs(np.fft.rfft(frames * np.hamming(500)))[:, :50].T
    features = SpectrogramFeatures(skip_impact=False, axes="trace", scale="linear")
    ours = features.magnitudes(trace).numpy()
    assert features.count_frames(trace) == ours.shape[1] == theirs.shape[1]
    np.testing.assert_allclose(ours, theirs, atol=1e-4 * theirs.max())


def test_paper_normalisation_spans_zero_to_one_per_channel():
    spectrogram = SpectrogramFeatures(normalisation="paper")(noise(1.0, axes=3))[0, 0]
    assert spectrogram.amin(dim=1).eq(0).all()
    assert spectrogram.amax(dim=1).eq(1).all()


@given(
    samples=st.integers(500, 5000),
    axes=st.sampled_from([1, 3]),
    joined=st.sampled_from(["frame", "trace"]),
    scale=st.sampled_from(["linear", "mel"]),
)
def test_frames_are_counted_before_they_are_computed(samples, axes, joined, scale):
    features, trace = SpectrogramFeatures(axes=joined, scale=scale), noise(samples / 10_000, axes)
    assert features.count_frames(trace) == features.magnitudes(trace).shape[-1]


def assert_near(found: torch.Tensor, expected: torch.Tensor, share: float) -> None:
    """Equal within a share of the range of what is expected."""
    span = float(expected.max() - expected.min())
    torch.testing.assert_close(found, expected, atol=share * max(span, 1), rtol=0)


def test_channels_are_exact_on_real_traces(shared):
    """Channel 0 is what remains of large numbers, and the logarithm shows its rounding."""
    features = SpectrogramFeatures(scale="linear")
    files = sorted((shared / "data" / "lmt16").glob("*/haptic/*.wav"))[::20]
    traces = [torch.from_numpy(SignalDecoder().decode(file)[0]) for file in files]
    features.fit([features.magnitudes(trace) for trace in traces])
    for trace in traces:
        exact = scipys(moving(trace, 10_000, pieces=False))[:50].astype(np.float32)
        expected = features.normalise(torch.from_numpy(exact))
        found = features(trace)[0, 0]
        assert_near(found, expected, 2e-4)
        assert_near(found[1:], expected[1:], 1e-4)


def test_a_trace_below_one_window_is_refused():
    with pytest.raises(UserError, match="longer stroke"):
        SpectrogramFeatures().magnitudes(noise(0.0499))
    assert SpectrogramFeatures().magnitudes(noise(0.05)).shape == (50, 1)


def test_filters_are_triangles_whose_corners_are_even_on_the_mel_scale():
    corners = 700 * (10 ** (np.linspace(0, 2595 * np.log10(1 + 5000 / 700), 52) / 2595) - 1)
    low, centre, high = (corners[start : start + 50, None] for start in range(3))
    hertz = np.arange(251) * 20.0
    rising, falling = (hertz - low) / (centre - low), (high - hertz) / (high - centre)
    theirs = torch.from_numpy(np.minimum(rising, falling).clip(0))
    wide = theirs.sum(dim=1, keepdim=True)
    assert bool((wide > 0).all())
    torch.testing.assert_close(
        mel_filters(10_000, 500, 50), (theirs / wide).float(), atol=1e-4, rtol=1e-3
    )


@pytest.mark.parametrize("rate", [500.0, 2_800.0, 10_000.0, 44_100.0])
def test_every_band_has_power_at_every_rate(rate):
    filters, centres = mel_filters(rate, 500, 50), mel_centres(rate, 50)
    assert filters.min() >= 0
    torch.testing.assert_close(filters.sum(dim=1), torch.ones(50))
    assert bool((centres.diff() > 0).all())
    means = filters.double() @ (torch.arange(251) * rate / 500).double()
    assert float(((means - centres).abs() / (rate / 500)).max()) < 1.0


def test_bands_of_the_training_set_have_mean_0_and_deviation_1():
    features = SpectrogramFeatures(sampling_rate=2000.0)
    generator = torch.Generator().manual_seed(0)
    traces = [scale * torch.randn(1, 8000, generator=generator) for scale in (1, 3, 9)]
    magnitudes = [features.magnitudes(trace) for trace in traces]
    features.fit(magnitudes)
    bands = torch.cat([features.normalise(each) for each in magnitudes], dim=1)
    torch.testing.assert_close(bands.mean(dim=1), torch.zeros(len(bands)), rtol=0, atol=1e-4)
    torch.testing.assert_close(bands.std(dim=1), torch.ones(len(bands)), rtol=0, atol=1e-3)
