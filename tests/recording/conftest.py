"""Sensors that are not there: a serial line, a sound card."""

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import numpy as np
import pytest


@pytest.fixture
def pty() -> Iterator[Callable[[bytes], str]]:
    """A serial line on which bytes come again and again; gives the source to name."""
    pytest.importorskip("serial")
    stopped, lines = threading.Event(), []

    def send(content: bytes) -> str:
        master, slave = os.openpty()

        def write() -> None:
            while not stopped.is_set():
                os.write(master, content)
                time.sleep(0.01)

        thread = threading.Thread(target=write, daemon=True)
        lines.append((master, slave, thread))
        thread.start()
        return f"serial:{os.ttyname(slave)}"

    yield send
    stopped.set()
    for master, slave, thread in lines:
        while thread.is_alive():
            os.set_blocking(master, False)
            thread.join(0.1)
        os.close(master)
        os.close(slave)


class PortAudioError(Exception):
    pass


class InputStream:
    """A tone on every channel."""

    lost = False

    def __init__(self, *, samplerate, device, channels, dtype):
        if channels > 2:
            raise PortAudioError("Error opening InputStream: Invalid number of channels")
        assert dtype == "float32"
        self.rate, self.channels, self.place = samplerate, channels, 0

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass

    def read(self, frames):
        time = np.arange(self.place, self.place + frames) / self.rate
        self.place += frames
        tone = np.sin(2 * np.pi * 440 * time).astype(np.float32)
        return np.repeat(tone[:, None], self.channels, axis=1), self.lost


def query_devices(device, kind):
    if device not in (None, 1, "Line"):
        raise ValueError(f"No {kind} device matching {device!r}")
    return {"default_samplerate": 44_100.0}


@pytest.fixture
def sound_card(monkeypatch) -> type[InputStream]:
    """What of the module ``sounddevice`` is used."""
    module = SimpleNamespace(
        PortAudioError=PortAudioError, InputStream=InputStream, query_devices=query_devices
    )
    monkeypatch.setitem(sys.modules, "sounddevice", module)
    return InputStream
