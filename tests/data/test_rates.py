"""Which rate a trace has, who says so, and resampling chunk by chunk against the whole."""

import numpy as np
import pytest
import soundfile
from hypothesis import given, settings
from hypothesis import strategies as st

from tex_lightning.data.decode import Resampler, SignalDecoder, to_rate
from tex_lightning.errors import UserError

SAMPLES = np.random.default_rng(0).uniform(-0.9, 0.9, 400)
DECODER = SignalDecoder(file_rate=8000)


@pytest.fixture
def files(tmp_path):
    """The same samples at 2.2 kHz with a header, with times and bare."""
    soundfile.write(tmp_path / "a.wav", SAMPLES, 2200, subtype="DOUBLE")
    times = np.arange(400) / 2200 * 1e6
    np.savetxt(tmp_path / "b.csv", np.stack([times, SAMPLES]).T, header="time_us x", fmt="%.9g")
    np.save(tmp_path / "c.npy", SAMPLES)
    return [tmp_path / name for name in ("a.wav", "b.csv", "c.npy")]


def test_the_file_goes_before_what_is_said_of_it_and_that_before_the_assumption(files):
    wav, timed, bare = files
    rates = ((wav, 2200), (timed, 2210), (bare, 2500), (bare, None))
    found = [DECODER.decode(path, rate)[1] for path, rate in rates]
    assert [(rate.source, round(rate.hz)) for rate in found] == [
        ("header", 2200),
        ("time column", 2200),
        ("stated", 2500),
        ("assumed", 8000),
    ]
    for path, told in ((wav, "header"), (timed, "time column")):
        with pytest.raises(UserError, match=f"2,200 Hz by its {told}, but 10,000 Hz by the"):
            DECODER.decode(path, 10_000)


@pytest.mark.parametrize("rate", [0, 1, 300_000, float("nan"), 1e-310])
def test_other_rates_are_refused(files, rate):
    for use in (lambda: DECODER.decode(files[2], rate), lambda: Resampler(rate, 10_000, "it")):
        with pytest.raises(UserError, match="too far from 10000 Hz: rates are 20 Hz to 200 kHz"):
            use()


TRACE = np.random.default_rng(0).standard_normal((3, 9000)) + 9.8


@settings(max_examples=30)
@given(
    source=st.sampled_from([2_000, 2_200, 3_333.3, 8_000, 9_999, 16_000, 22_050, 44_100, 48_000]),
    chunks=st.lists(st.sampled_from([0, 1, 7, 160, 441, 3000]), max_size=9),
    axes=st.sampled_from([1, 3]),
    precision=st.sampled_from([np.float32, np.float64]),
)
def test_chunks_give_what_the_whole_recording_gives(source, chunks, axes, precision):
    trace = TRACE[:axes].astype(precision)
    whole = to_rate(trace, source, 10_000, "it")
    resampler, place, found = Resampler(source, 10_000, "it"), 0, []
    for chunk in [*chunks, 9000]:
        found.append(resampler.push(trace[:, place : place + chunk]))
        place += chunk
        so_far = sum(part.shape[1] for part in found)
        lag = min(place, 9000) / source * 10_000 - so_far
        assert lag <= 10 * max(1, 10_000 / source) + 1
    found.append(resampler.finish())
    together = np.concatenate(found, axis=1)
    assert together.dtype == np.float32
    assert together.shape == whole.shape
    np.testing.assert_allclose(together, whole, rtol=0, atol=2e-5)


def test_what_is_kept_does_not_grow():
    resampler, kept = Resampler(44_100, 10_000, "it"), []
    for _ in range(50):
        resampler.push(TRACE[:1, :4410])
        kept.append(resampler.kept.base is None and resampler.kept.shape[1])
    assert max(kept) < 441 + 2 * 45
    assert Resampler(44_100, 10_000, "it").finish() is None
