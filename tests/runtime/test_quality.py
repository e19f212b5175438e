"""What is wrong with a recording that can be read."""

import numpy as np

from tex_lightning_runtime.quality import level, limits, photo_quality, together, trace_quality

RNG = np.random.default_rng(0)
NOISE = RNG.standard_normal((1, 20_000)).astype(np.float32)


def quality(trace, **ranges):
    measures = {"level": level(trace), "rate": 10_000}
    return trace_quality(trace, limits(ranges), "trace", measures)


def test_dead_and_clipped_sensors_are_told_from_live_ones():
    three = np.concatenate([NOISE, NOISE[:, ::-1] + 9.81, NOISE * 0.1])
    assert quality(three).warnings == ()
    assert "silent" in quality(three * 0).warnings[0]
    assert quality(three * 0).empty
    assert "constant" in quality(three * 0 + 0.3).warnings[0]
    dead = quality(three * [[1], [0], [1]] + 9.81)
    assert dead.warnings == ("Axis 2 of the trace is constant; check the sensor.",)
    assert not dead.empty
    assert "clipped, 12%" in quality(NOISE.clip(-0.7, 0.7)).warnings[0]


def test_a_slow_trace_that_stays_at_its_top_for_some_samples_is_not_clipped():
    slow = 1000 * np.sin(np.arange(143)[None] / 20)
    slow[:, 30:34] = slow.max() + 1
    assert quality(slow).warnings == ()
    slow[:, 60:72] = slow.max()
    assert "clipped, 10%" in quality(slow).warnings[0]


def test_only_what_is_far_outside_of_the_training_is_said():
    assert quality(NOISE, level=[0.4, 2.5]).warnings == ()
    assert quality(NOISE, level=[2.5, 9.0]).warnings == ()  # within a factor of three
    (quiet,) = quality(NOISE / 100, level=[0.4, 2.5]).warnings
    assert "has a level of 0.00996" in quiet
    assert "0.4 to 2.5" in quiet
    assert len(quality(NOISE * 100, level=[0.4, 2.5]).warnings) == 1
    assert quality(NOISE * 100).warnings == ()  # an older checkpoint knows no ranges
    assert len(quality(NOISE, rate=[44_100, 44_100]).warnings) == 1


def test_faults_that_the_training_has_too_are_usual():
    dead, clipped = NOISE.repeat(3, axis=0) * [[1], [0], [1]], NOISE.clip(-0.7, 0.7)
    assert quality(dead, constant=[1.0, 1.0]).warnings == ()
    assert len(quality(dead * [[1], [1], [0]], constant=[1.0, 1.0]).warnings) == 2
    assert quality(dead, constant=[0.0, 0.7]).warnings  # of a few in the training
    assert quality(dead * 0, constant=[3.0, 3.0]).empty
    assert quality(clipped, clipped=[0.0, 0.1]).warnings == ()
    assert quality(clipped, clipped=[0.0, 0.01]).warnings


def test_an_axis_is_constant_but_for_rounding():
    rounded = np.concatenate([NOISE, np.float32(9.81) + np.float32(1e-6) * NOISE.round()])
    assert "Axis 2 of the trace is constant" in quality(rounded).warnings[0]
    assert quality(np.concatenate([NOISE, 9.81 + 1e-3 * NOISE])).warnings == ()


def test_photos_that_show_nothing_or_little():
    photo = RNG.integers(60, 200, (300, 400, 3)).astype(np.uint8)
    usual = limits({"brightness": [90.0, 160.0], "contrast": [20.0, 50.0]})
    assert photo_quality(photo, usual, "photo").warnings == ()
    for grey in (0, 128, 255):
        uniform = photo_quality(np.full_like(photo, grey), {}, "photo")
        assert uniform.empty
        assert "uniform" in uniform.warnings[0]
    said = photo_quality(photo // 20, usual, "photo").warnings
    assert [warning.split()[4] for warning in said] == ["brightness", "contrast"]


def test_a_sample_is_empty_if_all_of_it_is():
    empty, fine = quality(NOISE * 0), quality(NOISE)
    assert together([empty, empty]).empty
    assert not together([empty, fine]).empty
    assert together([empty, fine]).warnings == empty.warnings
