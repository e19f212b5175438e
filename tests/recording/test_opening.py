"""Samples through every kind of source are those that were sent."""

import os
import sys
import threading

import numpy as np
import pytest
import soundfile

from tex_lightning.config.recording import SourceConfig
from tex_lightning.errors import UserError
from tex_lightning.recording.feed import Feed
from tex_lightning.recording.opening import open_source

SAMPLES = np.random.default_rng(0).standard_normal((3, 2500)).astype(np.float32)
CONTENT = SAMPLES.T.astype("<f4").tobytes()
SECONDS = 0.1  # of a chunk


def settings(rate=1000, axes=3, form="float32"):
    return SourceConfig(rate=rate, axes=axes, format=form, baud=115_200)


def chunks(given, how, most=100, timeout=2.0, modality="haptic"):
    source = open_source(modality, given, how, timeout)
    found = []
    with Feed(f"{modality}={given}", source, SECONDS, timeout) as feed:
        while len(found) < most and (chunk := feed.next()) is not None:
            found.append(chunk)
    return source, found


def joined(found):
    assert {chunk.shape[1] for chunk in found[:-1]} <= {100}
    return np.concatenate(found, axis=1)


def test_tcp(tcp):
    _, found = chunks(tcp(CONTENT), settings())
    np.testing.assert_array_equal(joined(found), SAMPLES)


def test_a_fifo(tmp_path):
    path = tmp_path / "fifo"
    os.mkfifo(path)
    writer = threading.Thread(target=path.write_bytes, args=(CONTENT,))
    writer.start()
    _, found = chunks(str(path), settings())
    writer.join()
    np.testing.assert_array_equal(joined(found), SAMPLES)


def test_a_serial_port_with_lines_of_text(pty):
    _, found = chunks(pty(b"1,-2,3\n" * 100), settings(form="text"), most=5)
    np.testing.assert_array_equal(joined(found), np.tile([[1], [-2], [3]], 500))


def test_a_sound_card_at_its_own_rate_and_another(sound_card, monkeypatch):
    source, found = chunks("soundcard", settings(rate=None, axes=1), most=3, modality="sound")
    assert source.rate == 44_100
    assert [chunk.shape for chunk in found] == [(1, 4410)] * 3
    time = np.arange(3 * 4410) / 44_100
    tone = np.sin(2 * np.pi * 440 * time)
    np.testing.assert_allclose(np.concatenate(found, axis=1)[0], tone, atol=1e-6)
    assert open_source("haptic", "soundcard:Line", settings(8000, 1), 1).rate == 8000
    monkeypatch.setattr(sound_card, "lost", True)
    assert chunks("soundcard:1", settings(axes=1), most=1)[0].lost


def test_a_file_at_the_rate_of_its_header(tmp_path):
    soundfile.write(tmp_path / "a.wav", SAMPLES.T, 2500, subtype="FLOAT")
    source, (chunk, *_) = chunks(str(tmp_path / "a.wav"), settings(rate=None))
    assert source.rate == 2500
    np.testing.assert_array_equal(chunk, SAMPLES[:, :250])


@pytest.mark.parametrize(
    ("given", "how", "said"),
    [
        ("-", settings(rate=None), "does not say its rate; give record.haptic.rate in Hz"),
        ("nowhere", settings(), "there is no such file; give a path, -, tcp://"),
        ("tcp://9000", settings(), r"names no host and port; write tcp://HOST:PORT"),
        ("tcp://127.0.0.1:1", settings(), r"cannot be opened \(Connection refused\); check host"),
        ("tcp://127.0.0.1:99999", settings(), "cannot be opened .*; check host and port"),
        ("soundcard:Nothing", settings(), "No input device matching 'Nothing'.; run python -m"),
        ("soundcard", settings(), "Invalid number of channels"),
    ],
)
def test_sources_that_cannot_be_used(sound_card, given, how, said):
    with pytest.raises(UserError, match=said):
        chunks(given, how)


def test_a_serial_port_that_is_not_there():
    pytest.importorskip("serial")
    with pytest.raises(UserError, match=r"cannot be opened .*check the name of the port"):
        chunks("serial:/dev/ttyNONE", settings())


def test_a_sensor_that_falls_silent(tcp):
    with pytest.raises(UserError, match=r"has sent nothing for 0.3 s; check the sensor"):
        chunks(tcp(CONTENT[:4000], silent=2), settings(), timeout=0.3)


@pytest.mark.parametrize(
    ("given", "module", "fault", "said"),
    [
        ("soundcard", "sounddevice", OSError("PortAudio library not found"), "libportaudio2"),
        ("soundcard", "sounddevice", None, r"sounddevice, .* run: pip install 'tex_.*\[live\]'"),
        ("serial:/dev/ttyS0", "serial", None, r"serial, .* run: pip install 'tex_.*\[live\]'"),
    ],
)
def test_missing_libraries(monkeypatch, given, module, fault, said):
    if fault is None:
        monkeypatch.setitem(sys.modules, module, None)  # as if not installed
    else:

        class Finder:
            @staticmethod
            def find_spec(name, path=None, target=None):
                if name == module:
                    raise fault

        monkeypatch.delitem(sys.modules, module, raising=False)
        monkeypatch.setattr(sys, "meta_path", [Finder, *sys.meta_path])
    with pytest.raises(UserError, match=said):
        chunks(given, settings(axes=1))
