"""Which rate a trace has."""

import numpy as np
import pytest
import soundfile

from tex_lightning.data.decode import SignalDecoder
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
    decoded = [DECODER.decode(path, rate)[1] for path, rate in rates]
    assert list(map(round, decoded)) == [2200, 2200, 2500, 8000]
    for path in (wav, timed):
        with pytest.raises(UserError, match=r"2,200 Hz by its header or .*, but 10,000 Hz by the"):
            DECODER.decode(path, 10_000)


@pytest.mark.parametrize("rate", [0, 1, 300_000, float("nan"), 1e-310])
def test_other_rates_are_refused(files, rate):
    with pytest.raises(UserError, match="too far from 10000 Hz: rates are 20 Hz to 200 kHz"):
        DECODER.decode(files[2], rate)
