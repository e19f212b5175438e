"""What the package makes of a recording and what the runtime makes of it by its card are one."""

import numpy as np
import pytest
from conftest import make_photo, make_trace

from tex_lightning.export.metadata import metadata
from tex_lightning_runtime import UserError
from tex_lightning_runtime.runtime import decode

AXES = np.stack([make_trace(kind, 0, 0.2) for kind in range(3)])
TRACES = {
    "good": (AXES, []),
    "silent": (0 * AXES, ["is silent"]),
    "constant": (0 * AXES + 2, ["is constant"]),
    "one axis constant": (AXES * [[1], [0], [1]], ["Axis 2 of the trace is constant"]),
    "clipped": (AXES.clip(-0.1, 0.1), ["is clipped"]),
    "coarse": (AXES.round(1), []),
    "loud": (100 * AXES, ["has a level of"]),
    "faint, beside gravity": (1e-3 * AXES + 9.81, ["has a level of"]),
}


@pytest.fixture(scope="module")
def senses(model):
    card = metadata(model.classifier)
    described = {each["name"]: each for each in card["senses"]}
    return {name: (sense, described[name]) for name, sense in model.classifier.senses.items()}


def both(sense, card, given, ranges, rate=None):
    """Decode by the package and by the runtime, and compare all of it."""
    expected, quality = sense.decode_input(given, ranges, rate=rate)
    found = decode(given, card, rate)
    np.testing.assert_array_equal(found.content, expected.numpy())
    assert found.quality == quality
    return quality


@pytest.mark.parametrize("name", TRACES)
@pytest.mark.parametrize("rate", [2_000.0, 10_000.0, 44_100.0])
def test_traces(senses, model, name, rate):
    given, said = TRACES[name]
    quality = both(*senses["haptic"], given, model.classifier.card.input_ranges["haptic"], rate)
    if rate == 10_000:
        assert len(quality.warnings) == len(said)
        assert all(map(str.__contains__, quality.warnings, said))
        assert quality.empty == (name in ("silent", "constant"))


@pytest.mark.parametrize("gain", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("side", [411, 1_300])
def test_photos(senses, model, gain, side):
    photo = (make_photo(1, 0, side)[: side - 8] * gain).astype(np.uint8)
    quality = both(*senses["visual"], photo, model.classifier.card.input_ranges["image"])
    assert quality.empty == (gain == 0)


@pytest.mark.parametrize(
    ("suffix", "options"),
    [
        (".npy", {}),
        (".npz", {"fs": 4_000.0}),
        (".txt", {}),
    ],
)
def test_files(senses, model, tmp_path, suffix, options):
    """Arrays, archives with their rate, and a file for each axis."""
    files = [tmp_path / f"a{suffix}"]
    if suffix == ".npy":
        np.save(files[0], AXES)
    elif suffix == ".npz":
        np.savez(files[0], acc=AXES.T, **options)
    else:
        files = [tmp_path / f"G1_Movement_{axis}_1.txt" for axis in "XYZ"]
        for file, axis in zip(files, AXES, strict=True):
            np.savetxt(file, axis)
    sense, card = senses["haptic"]
    quality = both(sense, card, files[-1], model.classifier.card.input_ranges["haptic"])
    assert any("has a rate of 4000" in each for each in quality.warnings) == bool(options)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (np.zeros((2, 3, 4)), r"^The trace has the shape \(2, 3, 4\); give \(axes, samples\)"),
        (["a", "b"], "^The trace is an array of <U1; give numbers"),
        (AXES * np.nan, "^The trace holds NaN, infinity or a number beyond 1e.09 at sample 0"),
        ("a.mp3", "does not exist"),
    ],
)
def test_both_refuse_in_the_same_words(senses, given, message):
    sense, card = senses["haptic"]
    with pytest.raises(UserError, match=message):
        decode(given, card)
    with pytest.raises(UserError, match=message.removeprefix("^The trace")):
        sense.decode_input(given, {})
