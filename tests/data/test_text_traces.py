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
        (lines(AXES, " ", comma=True), "utf-8"),
        ("x;y;z\n" + lines(AXES, ";", comma=True), "utf-8-sig"),
        ("x\ty\tz\r\n" + lines(AXES, "\t", comma=True).replace("\n", "\r\n"), "utf-16"),
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
    trace, source = SAME.decode(write(tmp_path, text, encoding))
    np.testing.assert_allclose(trace, AXES, rtol=1e-5)
    assert source.source == "assumed"


@pytest.mark.parametrize("text", ["%s\n", "e\n%s\n", "\r\n\n%s", "# one axis\n%s", "%s \n"])
def test_one_number_a_line_needs_no_dialect(tmp_path, text):
    numbers = "\n".join(f"{value:.9g}" for value in AXES[0].tolist())
    trace, _ = SAME.decode(write(tmp_path, text % numbers))
    np.testing.assert_array_equal(trace, AXES[:1].astype(np.float32))


@pytest.mark.parametrize("text", ["1\n2\n-\n3\n", "1\n2.3.4\n", "\n\n", "e\n"])
def test_what_only_looks_like_numbers_is_refused(tmp_path, text):
    with pytest.raises(UserError, match="cannot be read"):
        SAME.decode(write(tmp_path, text))


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
        ("time,x,y,z\nms,g,g,g", 1e3),
        ("# lab 3\n# t x y z", 1),
        ("# t,x,y,z", 1),
        ("", 1),
        ("force plate", 1),
        ("time,x,y,z,more names than columns", 1),
    ],
)
def test_a_column_of_time_gives_the_rate_and_is_no_axis(tmp_path, name, scale):
    path = write(tmp_path, timed(TIMES * scale + 40 * scale, name=name))
    trace, source = SignalDecoder(RATE, file_rate=77_000).decode(path)
    assert source.source == "time column"
    assert source.hz == pytest.approx(RATE, rel=1e-9)
    assert not source.interpolated
    np.testing.assert_allclose(trace, AXES, rtol=1e-5)
    assert SignalDecoder(4 * RATE).decode(path)[0].shape == (3, 800)


def test_time_may_stand_behind_a_single_axis_or_before_it(tmp_path):
    for name, columns in (("x,time", [AXES[0], TIMES]), ("", [TIMES, AXES[0]])):
        text = f"{name}\n" + lines(np.stack(columns), form="%.9g")
        trace, source = SAME.decode(write(tmp_path, text))
        np.testing.assert_allclose(trace, AXES[:1], rtol=1e-5)
        assert source.source == "time column"


def test_uneven_times_are_interpolated_to_an_even_rate(tmp_path):
    times = np.arange(5000) / 5000 + RNG.uniform(-0.2, 0.2, 5000) / 5000
    wave = np.sin(2 * np.pi * 100 * times)
    path = write(tmp_path, "t,x\n" + lines(np.stack([times, wave]), form="%.9g"))
    (trace,), source = SignalDecoder(5000).decode(path)
    hz = source.hz
    assert source.interpolated
    assert hz == pytest.approx(5000, rel=1e-3)
    even = np.sin(2 * np.pi * 100 * (times[0] + np.arange(5000) / hz))
    assert np.abs(trace - even).max() < 0.012
    assert np.abs(wave - even).max() > 0.03  # what it would be without


def test_few_lost_samples_are_interpolated(tmp_path):
    kept = np.delete(np.arange(6000), [700, 701, 702, 3000])
    times = kept / 6000 + RNG.uniform(-30e-6, 30e-6, len(kept))  # of a clock that others share
    wave = np.sin(2 * np.pi * 40 * times)
    path = write(tmp_path, "time,X\n" + lines(np.stack([times, wave]), form="%.9g"))
    (trace,), source = SignalDecoder(6000).decode(path)
    assert source.interpolated
    assert source.hz == pytest.approx(6000, rel=2e-3)
    even = np.sin(2 * np.pi * 40 * (times[0] + np.arange(len(trace)) / 6000))
    assert np.abs(trace[:5900] - even[:5900]).max() < 0.01


def test_times_rounded_to_few_decimals_keep_the_mean_rate(tmp_path):
    times = np.arange(5000) / 44_100
    path = write(tmp_path, "t,x\n" + lines(np.stack([times, np.ones(5000)]), form="%.6f"))
    assert SAME.decode(path)[1].hz == pytest.approx(44_100, rel=1e-4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (timed(np.where(TIMES < 0.04, TIMES, TIMES + 0.1)), r"gap .* after sample 99, 251 steps"),
        (timed(np.where(TIMES < 0.04, TIMES, TIMES - 0.03)), "do not rise at sample 100"),
        (timed(np.round(TIMES, 3)), "do not rise"),
        (timed(TIMES * 1000), "2.5 samples a second if .* call it time_ms"),
        (timed(np.arange(200.0), name=""), "1 samples a second .* delete it if it counts"),
        (timed(TIMES, name="time (min),x,y,z"), "unknown unit 'min'"),
        (timed(TIMES, name="time,seconds,y,z"), "2 columns of time"),
        ("t,x,y\n" + lines(np.vstack([TIMES, AXES[:2]])), "2 columns beside its time"),
        (lines(np.vstack([TIMES, AXES[:2]])), "three columns, of which the first rises evenly"),
        (
            "X_Value,a,b\n" + lines(np.vstack([TIMES, AXES[:2]])),
            "three columns, of which the first",
        ),
        (
            "X_Value,a\n" + lines(np.vstack([TIMES, AXES[0]])),
            "column of time .* must be called time",
        ),
        ("time\n" + lines(TIMES), "0 columns beside its time"),
        (lines(AXES, ";") + "\n1,5;2,5;3,5", "both decimal points and commas"),
        ("1.234,5;1\n2,5;1", "both decimal points and commas"),
        ("a\nb\nc\n1\n2", "3 lines of words before the numbers: begin them with #"),
        ("1;2;3\n1;;3\n", "cannot be read"),
        (lines(AXES[:2], ",", form="%.0f"), "one or three axes"),
    ],
)
def test_what_is_in_doubt_is_refused(tmp_path, text, message):
    with pytest.raises(UserError, match=message):
        SAME.decode(write(tmp_path, text))


def test_axes_in_three_files_with_times_must_agree(tmp_path):
    for axis, rate in zip("XYZ", (2500, 2500, 5000), strict=True):
        columns = np.stack([np.arange(50) / rate, AXES[0, :50]])
        (tmp_path / f"a_{axis}_1.txt").write_text("t,x\n" + lines(columns))
    with pytest.raises(UserError, match="have the rates 2,500 Hz, 2,500 Hz, 5,000 Hz"):
        SAME.decode(tmp_path / "a_X_1.txt")
