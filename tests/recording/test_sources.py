"""Bytes to samples, wherever they are cut."""

import sys
from itertools import pairwise

import numpy as np
import pytest
import soundfile
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.config.data import SourceConfig
from tex_lightning.errors import UserError
from tex_lightning.recording.recorder import Signal
from tex_lightning.recording.sources import Parser, open_source

SAMPLES = np.random.default_rng(0).standard_normal((3, 40)).astype(np.float32)


def parse(parser, content, cuts=()):
    ends = [0, *sorted(cuts), len(content)]
    pieces = [content[start:end] for start, end in pairwise(ends)]
    found = [parser.feed(piece) for piece in pieces]
    parser.end()
    return np.concatenate(found, axis=1)


def lines(samples, mark=","):
    return "".join(mark.join(map(repr, row)) + "\r\n" for row in samples.T.tolist()).encode()


def settings(rate=1000, axes=3, form="float32"):
    return SourceConfig(rate=rate, axes=axes, format=form, baud=115_200)


def parser(form, axes=3, **more):
    return Parser("haptic=-", "record.haptic", settings(axes=axes, form=form), **more)


@given(st.lists(st.integers(0, 900), max_size=6), st.sampled_from(",; \t"))
def test_samples_are_what_was_sent_wherever_it_is_cut(cuts, mark):
    for form, content in (
        ("float32", SAMPLES.T.astype("<f4").tobytes()),
        ("text", lines(SAMPLES, mark)),
    ):
        found = parse(parser(form), content, [cut for cut in cuts if cut < len(content)])
        np.testing.assert_array_equal(found, SAMPLES)


def test_remarks_empty_lines_and_a_line_that_we_came_into_are_passed_over():
    content = b"345\n# ready\n\n1.5\n-2e-3\n"
    assert parse(parser("text", 1, cut=True), content).tolist() == [[1.5, np.float32(-2e-3)]]


@pytest.mark.parametrize(
    ("form", "axes", "content", "said"),
    [
        ("text", 3, b"1,2,3\n1,2\n", "the line '1,2'; send a line of text with 3 numbers"),
        ("text", 1, b"1\nready\n", "the line 'ready'"),
        ("text", 1, b"nan\n", "holds NaN, infinity or a number beyond 1e\\+09 at sample 0"),
        ("text", 1, b"\x01" * 2000, "no lines of text; set record.haptic.format=float32"),
        ("float32", 1, b"0.125\n0.25\n", "sends text, .*; set record.haptic.format=text"),
        ("float32", 3, bytes(20), "ends within a sample; send little-endian float32, 3"),
        ("float32", 1, bytes(4) + b"\xff" * 4, "NaN, infinity .* at sample 1"),
    ],
)
def test_what_cannot_be_meant_is_refused(form, axes, content, said):
    with pytest.raises(UserError, match=said):
        parse(parser(form, axes), content)


SENT = np.random.default_rng(0).standard_normal((3, 2500)).astype(np.float32)


def chunks(given, how, seconds=None, timeout=2.0, modality="haptic"):
    """The source, and its first seconds; None are all."""
    source = open_source(modality, given, how)
    with Signal(modality, f"{modality}={given}", source, timeout) as signal:
        signal.fill(1e6 if seconds is None else seconds)
        return source, signal.take(signal.count / source.rate if seconds is None else seconds)


def test_a_serial_port_with_lines_of_text(pty):
    _, samples = chunks(pty(b"1,-2,3\n" * 100), settings(form="text"), 0.5)
    np.testing.assert_array_equal(samples, np.tile([[1], [-2], [3]], 500))


def test_a_sound_card_at_its_own_rate_and_another(sound_card, monkeypatch):
    source, samples = chunks("soundcard", settings(rate=None, axes=1), 0.3, modality="sound")
    assert source.rate == 44_100
    time = np.arange(3 * 4410) / 44_100
    np.testing.assert_allclose(samples, np.sin(2 * np.pi * 440 * time)[None], atol=1e-6)
    assert open_source("haptic", "soundcard:Line", settings(8000, 1)).rate == 8000
    monkeypatch.setattr(sound_card, "lost", True)
    assert chunks("soundcard:1", settings(axes=1), 0.1)[0].lost


def test_a_file_at_the_rate_of_its_header(tmp_path):
    soundfile.write(tmp_path / "a.wav", SENT.T, 2500, subtype="FLOAT")
    source, samples = chunks(str(tmp_path / "a.wav"), settings(rate=None))
    assert source.rate == 2500
    np.testing.assert_array_equal(samples, SENT)
    with pytest.raises(UserError, match=r"2,500 Hz, .* is 900; leave that out"):
        open_source("haptic", str(tmp_path / "a.wav"), settings(rate=900))


@pytest.mark.parametrize(
    ("given", "how", "said"),
    [
        ("-", settings(rate=None), "does not say its rate; give record.haptic.rate in Hz"),
        ("nowhere", settings(), "there is no such file; give a path, -, serial:PORT"),
        ("soundcard:Nothing", settings(), "No input device matching 'Nothing'.; run python -m"),
        ("soundcard", settings(), "Invalid number of channels"),
        ("serial:/dev/ttyNONE", settings(), "cannot be opened .*check the name of the port"),
    ],
)
def test_sources_that_cannot_be_used(sound_card, given, how, said):
    if given.startswith("serial"):
        pytest.importorskip("serial")
    with pytest.raises(UserError, match=said):
        chunks(given, how)


@pytest.mark.parametrize(
    ("given", "module"), [("soundcard", "sounddevice"), ("serial:/dev/ttyS0", "serial")]
)
def test_missing_libraries(monkeypatch, given, module):
    monkeypatch.setitem(sys.modules, module, None)  # as if not installed
    with pytest.raises(UserError, match=rf"needs {module}, .* run: pip install 'tex_.*\[live\]'"):
        chunks(given, settings(axes=1))
