"""Files are decoded as the package decodes them, or refused in one sentence."""

import sys
import warnings

import numpy as np
import pytest
import soundfile
from conftest import make_photo, make_trace
from PIL import Image

from tex_lightning.data.decode import PhotoDecoder, SignalDecoder
from tex_lightning_runtime import UserError
from tex_lightning_runtime.resampling import to_rate
from tex_lightning_runtime.runtime import decode, read_trace

AXES = np.stack([make_trace(kind, 0, 0.2) for kind in range(3)])
PHOTO = {"what": "photo", "medium": "photo", "least": 1, "half_scale": False, "limits": {}}
SENSE = {"what": "trace", "rate": 10_000.0, "file_rate": 10_000.0, "channels": None}


def read(path, channels=None, rate=None):
    return read_trace(path, {**SENSE, "channels": channels}, rate)


def decoded(path, channels=None, rate=None):
    raw = read(path, channels, rate)
    return to_rate(raw.samples, raw.rate, 10_000, raw.name)


def write(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize("subtype", ["PCM_16", "PCM_24", "FLOAT", "DOUBLE"])
@pytest.mark.parametrize("rate", [10_000, 44_100])
def test_sounds_are_those_of_the_package(tmp_path, subtype, rate):
    path = tmp_path / "a.wav"
    soundfile.write(path, AXES.T, rate, subtype=subtype)
    np.testing.assert_array_equal(decoded(path), SignalDecoder().decode(path)[0])
    one = SignalDecoder(channels=(1,)).decode(path)[0]
    np.testing.assert_array_equal(decoded(path, [1]), one)
    np.save(tmp_path / "a.npy", AXES.T)
    array = SignalDecoder().decode(tmp_path / "a.npy")[0]
    np.testing.assert_array_equal(decoded(tmp_path / "a.npy"), array)


@pytest.mark.parametrize(
    ("mark", "header"),
    [
        (",", "x,y,z\n"),
        (";", "# x;y;z\n\nx;y;z\nm/s2;m/s2;m/s2\n"),
        ("\t", ""),
        (" ", "\ufeff%a\n"),
    ],
)
@pytest.mark.parametrize("axes", [1, 3])
def test_text_is_that_of_the_package(tmp_path, mark, header, axes):
    lines = [mark.join(f"{value:.6g}" for value in row) for row in AXES[:axes].T]
    path = write(tmp_path / "a.csv", (header if axes == 3 else "") + "\n".join(lines) + mark)
    np.testing.assert_array_equal(decoded(path), SignalDecoder().decode(path)[0])
    slow = SignalDecoder(file_rate=4_000.0).decode(path)[0]
    np.testing.assert_array_equal(decoded(path, rate=4_000.0), slow)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,x\n0,1\n1,2\n", "'time', which rises by 1 a sample, has no unit"),
        ("words\n", "holds no numbers"),
        ("1\nnan\n2\n", "no number in the column '1' at sample 1"),
        ("1\n1e12\n", "at sample 1"),
        ("x,y,z\nnan,2,3\n4,5,6\n7,8,9\n", "at sample 0"),
        ("x\n-Inf\n4\n", "at sample 0"),
        ("x,y,z\n4,5,6\n1,2,3a\n1 b,2,3\n4,5,6\n4,5,6\n", "has '1 b' at sample 2 in"),
        ("", "empty"),
    ],
)
def test_text_that_is_unclear_is_refused(tmp_path, text, message):
    with pytest.raises(UserError, match=message):
        read(write(tmp_path / "a.csv", text))


@pytest.mark.parametrize("library", ["pandas", "clevercsv"])
def test_without_the_libraries_tables_alone_are_refused(tmp_path, monkeypatch, library):
    monkeypatch.setitem(sys.modules, library, None)  # not installed
    soundfile.write(tmp_path / "a.wav", AXES.T, 10_000, subtype="FLOAT")
    np.testing.assert_allclose(read(tmp_path / "a.wav")[0], AXES, rtol=1e-6)
    with pytest.raises(UserError, match=rf"a.csv is a table, which takes {library}: pip install '"):
        read(write(tmp_path / "a.csv", "1\n2\n3\n"))


def test_damage_is_refused(tmp_path):
    soundfile.write(tmp_path / "a.wav", AXES[0], 10_000)
    (tmp_path / "b.wav").write_bytes((tmp_path / "a.wav").read_bytes()[:-100])
    (tmp_path / "c.wav").write_bytes(b"RIFF and nothing else")
    np.save(tmp_path / "d.npy", np.array([{}]), allow_pickle=True)
    np.savez(tmp_path / "e", AXES)
    (tmp_path / "e.npz").rename(tmp_path / "e.npy")
    (tmp_path / "f.csv").write_bytes(b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n")
    with pytest.raises(UserError, match=r"f.csv is a pointer of Git LFS; .* git lfs pull"):
        read(tmp_path / "f.csv")
    for name in "bcde":
        with pytest.raises(UserError, match=rf"{name}\..*; correct or replace"):
            read(next(tmp_path.glob(f"{name}.*")))
    with pytest.raises(UserError, match=r"1 channels, and data.channels names 2, counted from 0"):
        read(tmp_path / "a.wav", [2])


def test_infinity_is_refused_without_a_warning_of_numpy(tmp_path):
    np.save(tmp_path / "a.npy", np.where(np.arange(200) == 7, np.inf, AXES[:, :200]))
    told = pytest.raises(UserError, match=r"holds NaN, infinity or .* at sample 7; repair")
    with warnings.catch_warnings(action="error"), told:
        read(tmp_path / "a.npy")


def test_what_takes_all_memory_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("tex_lightning_runtime.traces.MAX_SAMPLES", AXES[0].size)
    monkeypatch.setattr("tex_lightning_runtime.plain_text.MAX_TEXT", 9)
    np.save(tmp_path / "a.npy", AXES)
    soundfile.write(tmp_path / "b.flac", AXES.T, 10_000)
    write(tmp_path / "c.csv", "1\n" * 9)
    for name, message in {"a.npy": "samples", "b.flac": "samples", "c.csv": "more than 9"}.items():
        with pytest.raises(UserError, match=rf"{name} .*{message}"):
            read(tmp_path / name)
    monkeypatch.setattr("tex_lightning_runtime.plain_text.MAX_TEXT", 99)
    monkeypatch.setattr("tex_lightning_runtime.files.MAX_LINE", 9)
    with pytest.raises(UserError, match="a line of more than 1 MiB"):
        read(write(tmp_path / "d.csv", "1,2,3,4,5,6,7\n"))


@pytest.mark.parametrize("mode", ["RGB", "L", "RGBA", "LA", "P", "CMYK", "1"])
@pytest.mark.parametrize("suffix", ["tif", "other"])
def test_photos_are_those_of_the_package(tmp_path, mode, suffix):
    other = "webp" if mode == "RGBA" else "jpg" if mode == "CMYK" else "png"
    path = tmp_path / f"a.{suffix.replace('other', other)}"
    image = Image.fromarray(make_photo(0, 0)[:61, :40]).convert(mode)
    exif = Image.Exif()
    exif[0x0112] = 6  # lies on its side
    image.save(path, exif=exif)
    expected = PhotoDecoder(False).decode(path)[0]
    np.testing.assert_array_equal(decode(path, PHOTO).array, expected)


def test_photos_that_are_none_are_refused(tmp_path):
    (tmp_path / "words.png").write_text("words")
    for name, message in {"words.png": "is in no known format", "no.png": "exist"}.items():
        with pytest.raises(UserError, match=message):
            decode(tmp_path / name, PHOTO)
    with pytest.raises(UserError, match="The photo is too thin to be halved; use a larger one"):
        decode(np.zeros((1, 9), np.uint8), {**PHOTO, "half_scale": True})
    for wrong in (np.zeros((9, 9)), np.zeros((9, 9, 2), np.uint8), np.zeros((0, 9), np.uint8)):
        with pytest.raises(UserError, match="The photo"):
            decode(wrong, PHOTO)
    assert decode(np.zeros((4, 5), np.uint8), PHOTO).array.shape == (4, 5, 3)
