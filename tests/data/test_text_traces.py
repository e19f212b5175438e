"""Text files as datasets write them, against the numbers they were written from."""

import numpy as np
import pytest

from tex_lightning.data.decode import SignalDecoder
from tex_lightning.errors import UserError

RATE = 2500
RNG = np.random.default_rng(0)
AXES = RNG.uniform(-9, 9, (3, 200)).round(5)
TIMES = np.arange(200) / RATE
SAME = SignalDecoder(sampling_rate=RATE, file_rate=RATE)


def lines(columns, mark=",", comma=False, form="%.6g", end=""):
    rows = [mark.join(form % value for value in row) + end for row in np.atleast_2d(columns).T]
    return "\n".join(row.replace(".", ",") if comma else row for row in rows)


def write(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "t.csv"
    path.write_bytes(text.encode(encoding))
    return path


def timed(times, form="%.9g", mark=",", name="time,x,y,z"):
    return f"{name}\n" + lines(np.vstack([times, AXES]), mark, form=form)


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        (lines(AXES, ";", comma=True), "utf-8"),
        (lines(AXES, "\t", comma=True), "utf-8"),
        ("x;y;z\n" + lines(AXES, ";", comma=True), "utf-8-sig"),
        ("x;y;z\nm/s²;m/s²;m/s²\n" + lines(AXES, ";"), "latin-1"),
        ('"x","y","z"\n' + lines(AXES), "utf-8"),
        ("x;y;z;\n" + lines(AXES, ";", end=";"), "utf-8"),
        (lines(AXES, ",", end=", \r"), "utf-8"),
        ("# lab 3\n# 2.5 kHz, tool A\n#\n" + lines(AXES, "\t"), "utf-8"),
        ("% x y z\n" + lines(AXES, "   ", form="%.9e"), "utf-8"),
        ("# a\nx,y,z\n# b\n" + lines(AXES) + "\n# end\n\n", "utf-8"),
    ],
)
def test_dialects_give_the_same_axes(tmp_path, text, encoding):
    trace, source, _ = SAME.decode(write(tmp_path, text, encoding))
    np.testing.assert_allclose(trace, AXES, rtol=1e-5)
    assert source == SAME.file_rate


@pytest.mark.parametrize(
    ("name", "scale"),
    [
        ("time,x,y,z", 1),
        ("T / s,x,y,z", 1),
        ("seconds,x,y,z", 1),
        ("timestamp_us,x,y,z", 1e6),
        ("time (ms),x,y,z", 1e3),
        ("Zeit in ms,x,y,z", 1e3),
        ("time [µs],x,y,z", 1e6),
        ("# lab 3\n# t x y z", 1),
        ("# t,x,y,z", 1),
    ],
)
def test_a_column_of_time_gives_the_rate_and_is_no_axis(tmp_path, name, scale):
    path = write(tmp_path, timed(TIMES * scale + 40 * scale, name=name))
    trace, source, _ = SignalDecoder(RATE, file_rate=77_000).decode(path)
    assert source == pytest.approx(RATE, rel=1e-9)
    np.testing.assert_allclose(trace, AXES, rtol=1e-5)
    assert SignalDecoder(4 * RATE).decode(path)[0].shape == (3, 800)


def test_without_a_name_of_time_what_rises_is_an_axis(tmp_path):
    for name in ("", "force plate", "position,x,y,z", "# mm, N"):
        path = write(tmp_path, timed(TIMES, name=name))
        trace, source, reading = SAME.decode(path)
        np.testing.assert_allclose(trace, [TIMES, *AXES], rtol=1e-5, atol=1e-9)
        assert (source, reading.rate_from) == (RATE, "data.file_rate")
        assert "rises at every sample and is read as an axis; if it is" in reading.notes[0]


@pytest.mark.parametrize("lost", [[], [700, 701, 702, 3000], [*range(1000, 1300)]])
@pytest.mark.parametrize("rate", [20, 200_000])
def test_jitter_and_gaps_are_interpolated_to_the_usual_rate(tmp_path, rate, lost):
    kept = np.delete(np.arange(6000), lost)
    times = (kept + RNG.uniform(-0.2, 0.2, len(kept))) / rate
    wave = np.sin(2 * np.pi * rate / 150 * times)
    path = write(tmp_path, "time,x\n" + lines(np.stack([times, wave]), form="%.9g"))
    (trace,), source, reading = SignalDecoder(rate).decode(path)
    assert source == pytest.approx(rate, rel=1e-3)
    assert len(trace) == pytest.approx(6000, abs=5)
    grid = times[0] + np.arange(len(trace)) / rate
    even = np.sin(2 * np.pi * rate / 150 * grid)
    after = np.searchsorted(times, grid).clip(1, len(times) - 1)
    measured = np.diff(times)[after - 1] < 3 / rate
    assert np.abs(trace - even)[measured].max() < 0.15
    assert np.abs(trace - even)[measured].mean() < 0.02
    assert ("the largest of" in "".join(reading.notes)) == (len(lost) > 10)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (timed(np.where(TIMES < 0.04, TIMES, TIMES + 0.1)), "gaps of up to 251 steps, so that"),
        (timed(np.where(TIMES < 0.04, TIMES, TIMES - 0.03)), "do not rise at sample 100"),
        (timed(TIMES * 1000), "rises by 0.4 a sample, has no unit; give data.time_unit=ms"),
        (timed(TIMES * 1000, name="time_s,x,y,z"), "rate of 2.5 Hz, too far .*data.time_unit"),
        (timed(TIMES, name="time (rev),x,y,z"), "whose unit 'rev' is not known; give data.time"),
        (timed(TIMES, name="time,x,y,z,more names"), "has 5 names and 4 columns; give every"),
        ("time\n" + lines(TIMES), "has no column of measured numbers"),
        ("1;2;3\n1;;3\n1;2;3\n", "no number in the column '2' at sample 1"),
        ("1\n2.3.4\n5\n", "has '2.3.4' at sample 1 in the column '1'"),
        ("\n\n", "no numbers"),
        (lines(np.abs(AXES[:2]), ",", form="%.0f"), "decimal commas or columns of whole numbers"),
    ],
)
def test_what_is_in_doubt_is_refused(tmp_path, text, message):
    with pytest.raises(UserError, match=message):
        SAME.decode(write(tmp_path, text))
