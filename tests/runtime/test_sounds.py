"""WAV whose size was never written, as programs that are killed leave it, is read whole."""

import struct

import numpy as np
import pytest
import soundfile

from tex_lightning.data.decode import SignalDecoder
from tex_lightning.errors import UserError
from tex_lightning_runtime.runtime import read_trace
from tex_lightning_runtime.sounds import read_sound

SENSE = {"what": "trace", "rate": 10_000.0, "file_rate": 10_000.0, "channels": None}
RNG = np.random.default_rng(0)
NOISE = RNG.uniform(-1, 1, (30_000, 2)).astype(np.float32)
SILENT = np.concatenate([NOISE[:10_000], np.zeros((20_000, 2), np.float32)])
SUBTYPES = ("PCM_16", "PCM_24", "FLOAT")
LARGE = 0xFFFFFFFF


def wav(path, samples, subtype="PCM_16", riff=None, data=None, behind=b""):
    """A WAV file with other sizes in its header: of all, and of the samples (from them)."""
    soundfile.write(path, samples, 10_000, subtype=subtype)
    content = bytearray(path.read_bytes())
    place = content.index(b"data") + 4
    (size,) = struct.unpack_from("<I", content, place)
    del content[place + 4 + size :]
    struct.pack_into("<I", content, place, data(size) if data else size)
    struct.pack_into("<I", content, 4, len(content) - 8 if riff is None else riff)
    path.write_bytes(content + behind)
    return path


@pytest.mark.parametrize("samples", [NOISE, SILENT], ids=["noise", "silence"])
@pytest.mark.parametrize("subtype", SUBTYPES)
@pytest.mark.parametrize(
    ("riff", "data"),
    [
        (0, lambda _: 0), (LARGE, lambda _: LARGE), (LARGE, lambda _: 0), (0, lambda _: LARGE),
        (None, lambda _: 0), (0x7FFFFFFF, lambda _: 0x7FFFF000), (8036, lambda size: size // 3),
        (0, lambda size: size - 12),
    ],
)  # fmt: skip
def test_all_samples_are_read_and_that_is_said(tmp_path, samples, subtype, riff, data):
    whole, *_ = read_sound(wav(tmp_path / "whole.wav", samples, subtype), 1 << 29)
    stale = wav(tmp_path / "stale.wav", samples, subtype, riff, data)
    found, rate, notes = read_sound(stale, 1 << 29)
    np.testing.assert_array_equal(found, whole)
    assert (rate, len(notes)) == (10_000, 1)
    package = SignalDecoder().decode(stale)[0]
    np.testing.assert_array_equal(package, whole.T)
    np.testing.assert_array_equal(read_trace(stale, SENSE, None).samples, package)


@pytest.mark.parametrize(
    "behind",
    [
        b"", b"\0", b"LIST" + struct.pack("<I", 4) + b"INFO",
        b"abcd" + struct.pack("<I", 2) + b"xy",
        b"LIST" + struct.pack("<I", 400) + b"INFOISFT",  # cut off behind the samples
        b"bext" + struct.pack("<I", 3) + b"abc\0" + b"id3 " + struct.pack("<I", 1) + b"a",
    ],
)  # fmt: skip
def test_chunks_behind_the_samples_are_none(tmp_path, behind):
    path = wav(tmp_path / "a.wav", NOISE, behind=behind)
    found, _, notes = read_sound(path, 1 << 29)
    assert (len(found), notes) == (len(NOISE), [])


def test_a_file_that_was_cut_off_or_holds_nothing_is_refused(tmp_path):
    path = wav(tmp_path / "a.wav", NOISE)
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(ValueError, match="truncated: 1000 of 120000 bytes are missing"):
        read_sound(path, 1 << 29)
    empty = wav(tmp_path / "empty.wav", NOISE[:0])
    assert len(read_sound(empty, 1 << 29)[0]) == 0
    with pytest.raises(UserError, match=r"shape .*: give a file of one recording"):
        SignalDecoder().decode(empty)
    stale = wav(tmp_path / "b.wav", NOISE, data=lambda _: 0)
    with pytest.raises(ValueError, match="60,000 samples, and 50,000 are the most"):
        read_sound(stale, 50_000)


def test_large_wav_that_was_cut_off_is_refused(tmp_path):
    path = tmp_path / "a.wav"
    soundfile.write(path, NOISE, 10_000, format="RF64")
    assert len(read_sound(path, 1 << 29)[0]) == len(NOISE)
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(ValueError, match="truncated: 29750 of 30000 samples are there"):
        read_sound(path, 1 << 29)


def test_flac_without_its_length_is_refused_with_the_remedy(tmp_path):
    path = tmp_path / "a.flac"
    soundfile.write(path, NOISE, 10_000)
    content = bytearray(path.read_bytes())
    content[21] &= 0xF0  # four bits of the number of samples, and the others
    content[22:26] = bytes(4)
    path.write_bytes(content)
    with pytest.raises(UserError, match="its header has no length: write it anew"):
        SignalDecoder().decode(path)


def test_the_command_line_says_which_file_has_no_size(cli, bands, surfaces, tmp_path):
    source = surfaces / "alpha" / "haptic" / "alpha_3.wav"
    samples = soundfile.read(source, dtype="float32")[0]
    stale = wav(tmp_path / "stale.wav", samples, "FLOAT", 0, lambda _: 0)
    outcomes = [
        cli("task=predict", f"checkpoint={bands}", f"haptic={file}") for file in (source, stale)
    ]
    labels = [outcome.out.partition('"label"')[2].partition('"latency')[0] for outcome in outcomes]
    assert labels[0] == labels[1] != ""
    assert (
        "stale.wav: its header says 0 bytes of samples, and all 96,000 are read" in outcomes[1].err
    )
    assert "its header says" not in outcomes[0].err
