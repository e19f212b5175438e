"""Synthetic surfaces: files, materials, physics, and what a linear classifier makes of them."""

import dataclasses
import itertools
from functools import cache

import cv2
import numpy as np
import pytest
import soundfile
from scipy.signal import stft
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from tex_lightning.config.data import SyntheticConfig
from tex_lightning.errors import UserError
from tex_lightning.synthetic import write_folder
from tex_lightning.synthetic.camera import render_photo
from tex_lightning.synthetic.dataset import listen, photograph, record
from tex_lightning.synthetic.materials import BLOCK, FAMILIES, ReliefSpec, make_materials
from tex_lightning.synthetic.microphone import hear_stroke
from tex_lightning.synthetic.specimen import PITCH, TILE, Specimen, make_relief, smooth
from tex_lightning.synthetic.tool import draw_stroke, slide_tool

RATE, SOUND_RATE = 10_000, 44_100
SPEC = SyntheticConfig(recordings=10, seed=0, seconds=2, photo_width=320, photo_height=240)
PLAIN = range(4)  # without a foil


@pytest.fixture(scope="session")
def specimen():
    """Give class 0 to 5 of seed 0, made up once for the whole session."""
    return cache(lambda index: Specimen(make_materials(6, 0)[index]))


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


TINY = SyntheticConfig(recordings=2, seed=0, seconds=1, photo_width=64, photo_height=48)


def contents(root):
    return {str(p.relative_to(root)): p.read_bytes() for p in root.rglob("*") if p.is_file()}


def test_files_are_those_of_data_folder_and_depend_on_class_and_seed_alone(tmp_path, specimen):
    write_folder(2, TINY, tmp_path / "two", ("haptic", "image", "sound"))
    write_folder(3, TINY, tmp_path / "three")
    two, three = contents(tmp_path / "two"), contents(tmp_path / "three")
    names = [material.name for material in make_materials(3, 0)]
    suffixes = {"haptic": "npy", "image": "jpg"}
    assert set(three) == {
        f"{name}/{sense}/{n:02d}.{suffix}"
        for name in names
        for sense, suffix in suffixes.items()
        for n in range(2)
    }
    sounds = {f"{name}/sound/{n:02d}.flac" for name in names[:2] for n in range(2)}
    assert all(three[name] == two[name] for name in {*two} - sounds)
    assert sounds == {name for name in two if "/sound/" in name}
    folder = tmp_path / "two" / names[1]
    trace = np.load(folder / "haptic" / "01.npy")
    assert (trace.dtype, trace.shape) == (np.float32, (3, 10_000))
    sound, rate = soundfile.read(folder / "sound" / "01.flac", dtype="float32")
    assert rate == 44_100
    np.testing.assert_allclose(sound, listen(TINY, specimen(1), 1, 1), atol=1 / 32_000)
    photo = cv2.cvtColor(cv2.imread(str(folder / "image" / "01.jpg")), cv2.COLOR_BGR2RGB)
    mean = photograph(TINY, specimen(1), 1, 1).mean(axis=(0, 1))
    np.testing.assert_allclose(photo.mean(axis=(0, 1)), mean, atol=1)


def test_the_number_of_classes_is_limited(tmp_path):
    with pytest.raises(UserError, match=r"data\.classes is 1000: choose 2 to 999"):
        write_folder(1000, TINY, tmp_path)


def test_surfaces_are_the_same_whatever_number_of_threads_opencv_takes(tmp_path):
    before, spec = cv2.getNumThreads(), dataclasses.replace(TINY, recordings=1)
    for threads in (1, 2):
        cv2.setNumThreads(threads)
        write_folder(4, spec, tmp_path / str(threads))  # two of them porous
    cv2.setNumThreads(before)
    files = sorted(tmp_path.glob("1/*/*/*"))
    assert len(files) == 8
    for file in files:
        assert file.read_bytes() == (tmp_path / "2" / file.relative_to(tmp_path / "1")).read_bytes()


TESTED = np.isin(np.arange(10), [4, 9])


def _haptic_features(trace):
    _, _, spectrum = stft(trace[:, 8000:], 10_000, "hamming", 500, 400)
    return _bands(np.square(np.abs(spectrum[:, 1:50])).sum(axis=0))


def _sound_features(sound):
    _, _, spectrum = stft(sound[35_280:], 44_100, "hamming", 441, 341)
    return _bands(np.square(np.abs(spectrum[1:])), 200)


def _bands(power, last=40):
    bands = np.log(np.add.reduceat(power, np.geomspace(1, last, 12).astype(int), axis=0))
    return np.concatenate([bands.mean(axis=1), bands.std(axis=1)])


def _visual_features(photo):
    grey = cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY).astype(np.float32)
    features = [*np.log(photo.mean(axis=(0, 1))), *np.log(photo.std(axis=(0, 1)))]
    for sigma in (1, 2, 4, 8):
        blurred = cv2.GaussianBlur(grey, (0, 0), sigma)
        for order in ((1, 0), (0, 1)):
            slope = np.abs(cv2.Sobel(blurred, cv2.CV_32F, *order))
            features.append(np.log(slope.mean() / grey.mean()))
    return np.array(features)


def _confusions(features):
    """Train on eight recordings of each class, test on two; give (class, predicted) pairs."""
    classes = len(features)
    labels = np.repeat(np.arange(classes), 10).reshape(classes, 10)
    model = make_pipeline(
        StandardScaler(), LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto")
    )
    model.fit(features[:, ~TESTED].reshape(-1, features.shape[-1]), labels[:, ~TESTED].ravel())
    predicted = model.predict(features[:, TESTED].reshape(-1, features.shape[-1]))
    return list(zip(labels[:, TESTED].ravel(), predicted, strict=True))


@pytest.mark.parametrize(
    ("take", "describe", "twins"),
    [
        (record, _haptic_features, {2, 3}),
        (photograph, _visual_features, {0, 1}),
        (listen, _sound_features, {4, 5}),
    ],
    ids=["haptic", "visual", "sound"],
)
def test_all_but_the_twins_are_told_apart(specimen, take, describe, twins):
    features = np.array(
        [[describe(take(SPEC, specimen(i), i, n)) for n in range(10)] for i in range(6)]
    )
    wrong = [
        (true, seen)
        for true, seen in _confusions(features)
        if true != seen and not {true, seen} <= twins
    ]
    assert not wrong
