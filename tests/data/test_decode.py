import io
import os

import numpy as np
import pytest
import soundfile
from PIL import EpsImagePlugin, Image

from tex_lightning.data.decode import PhotoDecoder, SignalDecoder
from tex_lightning.errors import UserError
from tex_lightning_runtime.pixels import as_pixels
from tex_lightning_runtime.samples import as_trace
from tex_lightning_runtime.traces import axis_files

SIGNAL, PHOTO = SignalDecoder(), PhotoDecoder()
AXES = np.random.default_rng(0).uniform(-0.9, 0.9, (3, 700)).astype(np.float32)


def write_csv(path, array, header=""):
    np.savetxt(path, array, delimiter=",", header=header, comments="", fmt="%.9g")


@pytest.mark.parametrize("axes", [1, 2, 3])
@pytest.mark.parametrize("suffix", ["wav", "npy", "txt", "csv"])
def test_every_format_gives_the_same_trace(tmp_path, axes, suffix):
    path, trace = tmp_path / f"t.{suffix}", AXES[:axes]
    match suffix:
        case "wav":
            soundfile.write(path, trace.T, 10_000, subtype="FLOAT")
        case "npy":
            np.save(path, trace)
        case "txt":
            np.savetxt(path, trace.T, fmt="%.9g")
        case "csv":
            write_csv(path, trace.T, header="x,y,z"[: 2 * axes - 1])
    decoded = SIGNAL.decode(path)[0]
    assert decoded.dtype == np.float32
    np.testing.assert_allclose(decoded, trace, rtol=1e-6)


def test_channels_are_chosen_by_number(tmp_path):
    timed = np.vstack([np.arange(700) / 10_000, AXES])
    soundfile.write(tmp_path / "t.wav", AXES.T, 10_000, subtype="FLOAT")
    np.save(tmp_path / "t.npy", AXES)
    write_csv(tmp_path / "t.csv", timed.T, header="time,x,y,z")
    for path in sorted(tmp_path.iterdir()):
        for channels in ((2,), (2, 0)):
            chosen = SignalDecoder(channels=channels).decode(path).array
            np.testing.assert_allclose(chosen, AXES[list(channels)], rtol=1e-5)
        with pytest.raises(UserError, match=r"has 3 channels, and data.channels names 3, counted"):
            SignalDecoder(channels=(0, 3)).decode(path)
    np.testing.assert_array_equal(as_trace(AXES.T, channels=(1, 2)), AXES[1:])
    for wrong in ((), (-1,), (0.5,), "first", (1, 1), (64,)):
        with pytest.raises(UserError, match="different names of columns, numbers from 0 to 63"):
            SignalDecoder(channels=wrong)


def test_a_sound_without_loss_is_that_of_the_wav(tmp_path):
    counts = (AXES[0] * 32_767).astype(np.int16)
    for suffix in ("wav", "flac"):
        soundfile.write(tmp_path / f"t.{suffix}", counts, 44_100, subtype="PCM_16")
    wav, flac = (SIGNAL.decode(tmp_path / f"t.{suffix}") for suffix in ("wav", "flac"))
    np.testing.assert_array_equal(flac[0], wav[0])
    assert flac[1] == wav[1]


def test_axes_in_three_files_are_one_trace(tmp_path):
    files = [tmp_path / f"G1_X_Mesh_Movement_{axis}_train1.txt" for axis in "XYZ"]
    for path, axis in zip(files, AXES, strict=True):
        np.savetxt(path, axis, fmt="%.9g")
    for path in files:
        assert axis_files(path) == tuple(files)
        np.testing.assert_allclose(SIGNAL.decode(path)[0], AXES, rtol=1e-6)
    np.savetxt(files[1], AXES[1, 1:])
    with pytest.raises(
        UserError, match=r"the shapes \(1, 700\), \(1, 699\), \(1, 700\); each must be"
    ):
        SIGNAL.decode(files[0])
    files[1].unlink()
    with pytest.raises(UserError, match=f"File {files[1]} does not exist"):
        SIGNAL.decode(files[0])
    files[2].unlink()
    assert SIGNAL.decode(files[0])[0].shape == (1, 700)
    for form in ("1_{}.csv", "{}.csv", "{}_2.csv", "acc{}.txt", "1_a{}.csv", "gyro{}_1.csv"):
        named = [tmp_path / form.format(a if form == "acc{}.txt" else a.lower()) for a in "XYZ"]
        np.savetxt(named[0], AXES[0], fmt="%.9g")
        assert axis_files(named[0]) == (named[0],)
        np.savetxt(named[1], AXES[1], fmt="%.9g")
        assert axis_files(named[0]) == (*named[:2],)
        np.savetxt(named[2], AXES[2], fmt="%.9g")
        np.testing.assert_allclose(SIGNAL.decode(named[1])[0], AXES, rtol=1e-6)
    photos = [tmp_path / f"a_{axis}_1.png" for axis in "XYZ"]
    for photo in photos:
        photo.touch()
    assert axis_files(photos[1]) == (photos[1],)


def test_bad_traces_are_refused_with_a_reason(tmp_path):
    def refuse(name, content, message):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(UserError, match=message):
            SIGNAL.decode(path)

    def npy(array):
        stream = io.BytesIO()
        np.save(stream, array)
        return stream.getvalue()

    def wav(array, subtype="PCM_16"):
        stream = io.BytesIO()
        soundfile.write(stream, array, 10_000, format="WAV", subtype=subtype)
        return stream.getvalue()

    refuse("empty.wav", b"", "is empty")
    refuse("text.wav", b"hello", "cannot be read")
    refuse("cut.wav", wav(AXES.T)[:-400], "truncated: 400 of 4200 bytes")
    refuse("float.wav", wav(AXES.T, "FLOAT")[:-400], "truncated: 400 of 8400 bytes")
    refuse("header.csv", b"x,y,z\n", "holds no numbers")
    refuse("blank.txt", b"\n\n", "no numbers")
    refuse("huge.npy", npy(np.array([0.0, 1e300])), "number beyond 1e.09 at sample 1")
    refuse("cut.npy", npy(AXES)[:-4], "cannot be read")
    refuse("words.txt", b"1\nthree\n2\n3\n", "has 'three' at sample 1 in the column '1'")
    refuse("words.npy", npy(np.array(["a", "b"])), "instead of numbers")
    refuse("pickle.npy", npy(np.array([{}])), "cannot be read")
    refuse("nan.txt", b"1\nnan\n3\n", "has no number in the column '1' at sample 1; repair")
    refuse("inf.txt", b"1\ninf\n3\n", "NaN, infinity or a number beyond 1e.09 at sample 1")
    refuse("many.npy", npy(AXES[0, :650].reshape(65, 10).repeat(9, axis=1)), "1 to 64 channels")
    refuse("cube.npy", npy(np.zeros((2, 3, 4))), "1 to 64 channels")
    refuse("none.npy", npy(np.zeros((3, 0))), "1 to 64 channels")
    refuse(
        "trace.mp3",
        b"x",
        "unknown type; use .wav, .flac, .npy, .npz, .mat, .h5, .hdf5, .txt, .csv",
    )
    with pytest.raises(UserError, match="does not exist"):
        SIGNAL.decode(tmp_path / "nowhere.wav")


def test_photos_come_upright_in_rgb(tmp_path):
    photo = np.zeros((20, 40, 3), np.uint8)
    photo[:, :20] = (200, 100, 0)
    image = Image.fromarray(photo)
    image.save(tmp_path / "p.png")
    whole = PhotoDecoder(half_scale=False).decode(tmp_path / "p.png")[0]
    np.testing.assert_array_equal(whole, photo)
    assert PHOTO.decode(tmp_path / "p.png")[0].shape == (10, 20, 3)
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned clockwise
    image.save(tmp_path / "turned.png", exif=exif)
    turned = PhotoDecoder(half_scale=False).decode(tmp_path / "turned.png")[0]
    np.testing.assert_array_equal(turned, np.rot90(photo, -1))
    image.convert("L").save(tmp_path / "grey.png")
    assert PHOTO.decode(tmp_path / "grey.png")[0].shape == (10, 20, 3)


@pytest.mark.parametrize("suffix", ["jpg", "png"])
def test_truncated_photos_are_refused(tmp_path, suffix):
    noise = np.random.default_rng(0).integers(0, 256, (100, 100, 3)).astype(np.uint8)
    whole = tmp_path / f"whole.{suffix}"
    Image.fromarray(noise).save(whole)
    cut = tmp_path / f"cut.{suffix}"
    cut.write_bytes(whole.read_bytes()[:-2000])
    with pytest.raises(UserError, match="damaged"):
        PHOTO.decode(cut)[0]


def test_postscript_in_a_photo_starts_no_program(tmp_path, monkeypatch):
    """Pillow draws EPS by Ghostscript, whatever the file is called."""
    mark, program, photo = (tmp_path / name for name in ("mark", "gs", "a.jpg"))
    program.write_text(f"#!/bin/sh\ntouch {mark}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    monkeypatch.setattr(EpsImagePlugin, "gs_binary", None)  # which it looks for once
    head = "%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\n"
    photo.write_text(f"{head}showpage\n%%EOF\n")
    with pytest.raises(UserError, match=r"is in no known format, .* convert it to JPEG or PNG"):
        PHOTO.decode(photo)
    assert not mark.exists()


@pytest.mark.parametrize(
    ("size", "rows", "columns"), [((61, 41), (18, 43), (8, 33)), ((20, 41), (0, 20), (5, 35))]
)
def test_of_a_large_photo_the_middle_is_kept(tmp_path, monkeypatch, size, rows, columns):
    monkeypatch.setattr("tex_lightning_runtime.pixels.MAX_PIXELS", 600)
    monkeypatch.setattr("tex_lightning_runtime.pixels.MAX_SIDE", 24)
    pixels = np.random.default_rng(0).integers(0, 256, (*size, 3), np.uint8)
    expected, whole = pixels[slice(*rows), slice(*columns)], PhotoDecoder(half_scale=False)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    np.testing.assert_array_equal(whole.decode(tmp_path / "a.png")[0], expected)
    np.testing.assert_array_equal(whole.scale(as_pixels(pixels), "it"), expected)
    assert PhotoDecoder(half_scale=False, resize=30).decode(tmp_path / "a.png")[0].shape[0] == 30


def npy(header: str) -> bytes:
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + bytes(80)


def one_sentence(path, decoder, capfd):
    """What is said of a file, and nothing else."""
    with pytest.raises(UserError) as caught:
        decoder.decode(path)
    text = str(caught.value)
    assert path.name in text
    assert text.isprintable()
    assert text.endswith(".")
    assert ". " not in text
    assert len(text) < 600 + len(str(path))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }\n",
        "{'descr': '<U500000000', 'fortran_order': False, 'shape': (3,), }\n",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }\n",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (3L,), 'shape\n",
        "{'descr': [('a', '<U2')], 'fortran_order': False, 'shape': (3,), }\n",
    ],
)
def test_a_header_that_claims_the_impossible_is_refused(tmp_path, capfd, header):
    (tmp_path / "a.npy").write_bytes(npy(header))
    one_sentence(tmp_path / "a.npy", SIGNAL, capfd)


def test_what_is_no_file_is_refused_and_not_waited_for(tmp_path, capfd):
    os.mkfifo(tmp_path / "pipe.wav")
    (tmp_path / "loop.npy").symlink_to(tmp_path / "loop.npy")
    (tmp_path / "zero.csv").symlink_to("/dev/zero")
    (tmp_path / "folder.png").mkdir()
    for path in tmp_path.iterdir():
        one_sentence(path, PHOTO if path.suffix == ".png" else SIGNAL, capfd)
    one_sentence(tmp_path / ("x" * 300 + ".wav"), SIGNAL, capfd)
    with pytest.raises(UserError, match="is a folder, a device, a pipe or a broken link; give a"):
        SIGNAL.decode(tmp_path / "pipe.wav")


def test_more_than_anyone_records_is_refused(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr("tex_lightning_runtime.traces.MAX_SAMPLES", 699)
    monkeypatch.setattr("tex_lightning_runtime.plain_text.MAX_TEXT", 99)
    monkeypatch.setattr("tex_lightning_runtime.resampling.MAX_SAMPLES", 1400)
    soundfile.write(tmp_path / "a.wav", AXES[0], 10_000)
    np.savetxt(tmp_path / "a.csv", AXES[0])
    np.save(tmp_path / "a.npy", AXES[0])
    one_sentence(tmp_path / "a.wav", SIGNAL, capfd)
    one_sentence(tmp_path / "a.csv", SIGNAL, capfd)
    one_sentence(tmp_path / "a.npy", SIGNAL, capfd)
    monkeypatch.setattr("tex_lightning_runtime.traces.MAX_SAMPLES", 700)
    assert SIGNAL.decode(tmp_path / "a.npy", rate=5000)[0].shape == (1, 1400)
    with pytest.raises(UserError, match="would become 3500 samples at 10000 Hz; correct that rate"):
        SIGNAL.decode(tmp_path / "a.npy", rate=2000)
