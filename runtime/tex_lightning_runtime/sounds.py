"""Sounds out of files: WAV and FLAC, also WAV whose size was never written.

A program that is killed while it records leaves a header that says 0, as many bytes as it had at
the last flush, or as many as fit the field; all samples are there. A file that was cut off has less
than its header says, and is refused.
"""

import re
import struct
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import soundfile

Array = np.ndarray[Any, np.dtype[Any]]
CUT = re.compile(r"data : (\d+) \(should be (\d+)\)")  # libsndfile's note of a truncated file
SHORT = re.compile(r"frame count (\d+) does not match value from 'ds64' chunk of (\d+)")  # RF64
UNKNOWN_LENGTH = 0x7FFF0000  # programs that stream write such a length for want of a better one
UNKNOWN_FRAMES = 1 << 62  # and libsndfile of a FLAC file without one
CHUNKS = (  # that programs write behind samples
    b"list", b"info", b"id3", b"fact", b"cue", b"smpl", b"inst", b"bext", b"ixml", b"junk", b"pad",
    b"fllr", b"peak", b"disp", b"acid", b"plst", b"axml", b"chna", b"cart", b"levl", b"afsp",
)  # fmt: skip
HEADER = 8  # bytes: name and size of a chunk


def read_sound(path: Path, most: int) -> tuple[Array, float, list[str]]:
    """Read samples (samples, channels) float32, their rate in Hz, and what is to be said.

    Args:
        path: A file.
        most: Number of samples of all channels that are read.

    Raises:
        ValueError: If it is no sound, cut off, or claims more samples.
    """
    try:
        return _read(path, most)
    except soundfile.SoundFileError as error:
        raise ValueError(str(error)) from error


def _read(path: Path, most: int) -> tuple[Array, float, list[str]]:
    source, notes = _whole(path)
    with soundfile.SoundFile(source) as sound:  # which reads a truncated file without a word
        if cut := CUT.search(sound.extra_info):
            length, rest = int(cut[1]), int(cut[2])
            if rest < length < UNKNOWN_LENGTH:
                raise ValueError(f"truncated: {length - rest} of {length} bytes are missing")
            notes += [f"its header has no size, and all {sound.frames:,} samples are read"]
        if (short := SHORT.search(sound.extra_info)) and int(short[1]) < int(short[2]):
            raise ValueError(f"truncated: {short[1]} of {short[2]} samples are there")
        if sound.frames > UNKNOWN_FRAMES:
            raise ValueError("its header has no length: write it anew, such as by ffmpeg")
        count = sound.frames * sound.channels  # a small FLAC file may hold hours of silence
        if count > most:
            raise ValueError(f"it claims {count:,} samples, and {most:,} are the most")
        return sound.read(dtype="float32", always_2d=True), float(sound.samplerate), notes


def _whole(path: Path) -> tuple[Path | BytesIO, list[str]]:
    """Return the file, or what it would be with the right size, and what is to be said."""
    with path.open("rb") as stream:
        found = _stale_size(stream, path.stat().st_size)
    if found is None:
        return path, []
    place, size, told = found
    content = bytearray(path.read_bytes())
    struct.pack_into("<I", content, 4, len(content) - HEADER)
    struct.pack_into("<I", content, place, size)
    return BytesIO(content), [
        f"its header says {told:,} bytes of samples, and all {size:,} are read"
    ]


def _stale_size(stream: BinaryIO, total: int) -> tuple[int, int, int] | None:
    """Find the size of a WAV file's samples where more stand behind it than chunks.

    Returns:
        The place of that size in the file, the right one and that which is there; None if it is
        right, larger than the file, or there is none.
    """
    if stream.read(4) != b"RIFF" or stream.read(8)[4:] != b"WAVE":
        return None
    place = 12
    while place + HEADER <= total:
        stream.seek(place)
        name, size = struct.unpack("<4sI", stream.read(HEADER))
        if name == b"data":
            begin = place + HEADER
            if total - begin >= 1 << 32 or _are_chunks(stream, begin + size + size % 2, total):
                return None
            return place + 4, total - begin, size
        place += HEADER + size + size % 2
    return None


def _are_chunks(stream: BinaryIO, place: int, total: int) -> bool:
    """Return whether nothing but chunks stands from a place on: of known names, or whole ones."""
    while place + HEADER <= total:
        stream.seek(place)
        name, size = struct.unpack("<4sI", stream.read(HEADER))
        place += HEADER + size + size % 2
        named = name.isascii() and name.decode().isprintable() and place <= total + 1
        if not named and name.strip().lower() not in CHUNKS:
            return False
    return True
