"""Materials, reliefs, strokes, photos and sounds: what physics and the pairs alike promise."""

import dataclasses
import itertools

import numpy as np
import pytest

from tex_lightning.synthetic.camera import render_photo
from tex_lightning.synthetic.dataset import SyntheticSpec, listen, record
from tex_lightning.synthetic.materials import BLOCK, FAMILIES, ReliefSpec, make_materials
from tex_lightning.synthetic.microphone import hear_stroke
from tex_lightning.synthetic.specimen import PITCH, TILE, Specimen, make_relief, smooth
from tex_lightning.synthetic.tool import draw_stroke, slide_tool

RATE, SOUND_RATE = 10_000, 44_100
SPEC = SyntheticSpec(seconds=2)
PLAIN = range(4)  # without a foil


@pytest.mark.parametrize("seed", [0, 7])
def test_a_smaller_set_of_materials_is_the_beginning_of_a_larger_one(seed):
    materials = make_materials(101, seed)
    assert materials[:12] == make_materials(12, seed)
    names = [material.name for material in materials]
    assert names == sorted(set(names))
    assert all(name.replace("_", "").isalnum() and name.isascii() for name in names)


def look_alike(one, other):
    """Whether no photo can tell the two apart."""
    return (one.relief, one.skin) == (other.relief, other.skin)


def feel_alike(one, other):
    """Whether no acceleration trace can tell the two apart."""
    return (one.relief, one.body) == (other.relief, other.body)


def sound_alike(one, other):
    """Whether hardly a sound tells the two apart: a foil that both have drowns them."""
    drowned = one.voice.rustle > 0 or feel_alike(one, other)
    return drowned and one.voice == other.voice


@pytest.mark.parametrize("seed", [0, 1])
def test_every_block_has_one_pair_alike_to_each_sense(seed):
    pairs = list(itertools.combinations(enumerate(make_materials(72, seed)), 2))
    for place, alike in ((0, look_alike), (2, feel_alike), (4, sound_alike)):
        found = [(i, j) for (i, first), (j, second) in pairs if alike(first, second)]
        assert found == [(at, at + 1) for at in range(place, 72, BLOCK)]


def test_pairs_alike_give_the_very_same_photo_or_trace_from_the_same_random_numbers(specimen):
    def photo(index):
        return render_photo(specimen(index), np.random.default_rng(3), "daylight", (160, 120))

    def trace(index):
        return slide_tool(specimen(index), np.random.default_rng(3), 1.5, RATE)

    np.testing.assert_array_equal(photo(0), photo(1))
    assert not np.array_equal(photo(2), photo(3))
    np.testing.assert_array_equal(trace(2), trace(3))
    assert not np.array_equal(trace(0), trace(1))


@pytest.mark.parametrize("family", FAMILIES)
def test_relief_has_the_depth_asked_for_and_wraps_around(family):
    tile = make_relief(ReliefSpec(family, 2.0, 0.08, seed=3))
    assert (tile.shape, tile.dtype) == ((TILE, TILE), np.float32)
    assert tile.mean() == pytest.approx(0, abs=1e-5)
    assert tile.std() == pytest.approx(0.08, rel=1e-3)
    for axis in (0, 1):
        steps = np.abs(np.diff(tile, axis=axis, append=tile.take([0], axis=axis)))
        assert steps.take(-1, axis=axis).mean() < 2 * steps.mean()


def test_smoothing_follows_the_closed_form_of_a_sine():
    wavelength = TILE * PITCH / 20
    wave = np.sin(2 * np.pi * np.arange(TILE) * PITCH / wavelength)
    tile = np.tile(wave, (TILE, 1)).astype(np.float32)
    expected = np.exp(-0.5 * (2 * np.pi * 0.4 / wavelength) ** 2)
    np.testing.assert_allclose(smooth(tile, 0.4), expected * tile, atol=1e-4)


def test_tool_hangs_still_under_gravity_until_the_impact(specimen):
    for seed in range(3):
        trace = slide_tool(specimen(0), np.random.default_rng(seed), 1.5, RATE)
        rest = trace[:, :1900].mean(axis=1, keepdims=True)
        assert np.linalg.norm(rest) == pytest.approx(1.0, abs=0.05)
        assert (trace[:, :1900] - rest).std() < 0.03
        moved = np.linalg.norm(trace - rest, axis=0)
        landing = int(np.argmax(moved > 0.5))
        assert 0.2 * RATE <= landing <= 0.42 * RATE
        assert moved[landing : landing + 300].max() > 2


@pytest.mark.parametrize("recording", range(2))
def test_sound_begins_with_the_touch_that_the_trace_of_its_number_shows(specimen, recording):
    trace = record(SPEC, specimen(0), 0, recording)
    felt = np.linalg.norm(trace - trace[:, :1500].mean(axis=1, keepdims=True), axis=0)
    sound = np.abs(listen(SPEC, specimen(0), 0, recording))
    touch = [np.argmax(felt > 0.3) / RATE, np.argmax(sound > 0.02) / SOUND_RATE]
    assert touch[0] == pytest.approx(touch[1], abs=0.003)


def spectrum(specimen, **changes):
    """Levels of twelve bands, in dB of full scale, of one stroke in a changed voice."""
    voice = dataclasses.replace(specimen.material.voice, **changes)
    voiced = Specimen(dataclasses.replace(specimen.material, voice=voice))
    stroke = draw_stroke(np.random.default_rng(0), 2.0, RATE).at_rate(SOUND_RATE)
    sound = hear_stroke(voiced, stroke, np.random.default_rng(1), np.random.default_rng(2))
    moving = sound[SOUND_RATE:].astype(float)
    power = np.abs(np.fft.rfft(moving)) ** 2 / len(moving) ** 2
    hertz = np.fft.rfftfreq(len(moving), 1 / SOUND_RATE)
    edges = np.searchsorted(hertz, np.geomspace(500, 20_000, 13))
    return 10 * np.log10([2 * power[slice(*pair)].sum() for pair in itertools.pairwise(edges)])


def test_foil_drowns_what_the_tool_tells_apart(specimen):
    # Of the same stroke the pair differs by less than one of them differs from stroke to stroke.
    pair = [spectrum(specimen(index)) for index in (4, 5)]
    without = [spectrum(specimen(index), rustle=0, loudness=1) for index in (4, 5)]
    assert np.abs(pair[0] - pair[1]).max() < 3
    assert np.abs(without[0] - without[1]).max() > 6
    others = [spectrum(specimen(index)) for index in PLAIN]
    assert all(np.abs(pair[0] - other).max() > 6 for other in others)
