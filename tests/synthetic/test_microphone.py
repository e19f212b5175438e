import dataclasses

import numpy as np
import pytest

from tex_lightning.synthetic.dataset import SyntheticSpec, listen, record
from tex_lightning.synthetic.microphone import hear_stroke
from tex_lightning.synthetic.specimen import Specimen
from tex_lightning.synthetic.tool import draw_stroke

RATE = 44_100
SPEC = SyntheticSpec(seconds=2)
PLAIN = range(4)  # without a foil


def _sound(specimen, recording=0, spec=SPEC):
    return listen(spec, specimen, 0, recording)


def _hear(specimen):
    stroke = draw_stroke(np.random.default_rng(0), 2.0, 10_000).at_rate(RATE)
    return hear_stroke(specimen, stroke, np.random.default_rng(1), np.random.default_rng(2))


def _level(sound, low=0, high=RATE / 2):
    """Level of the movement between two frequencies, in dB of full scale."""
    moving = sound[RATE:].astype(float)
    power = np.abs(np.fft.rfft(moving)) ** 2 / len(moving) ** 2
    hertz = np.fft.rfftfreq(len(moving), 1 / RATE)
    return 10 * np.log10(2 * power[(hertz >= low) & (hertz < high)].sum())


def _voiced(specimen, **changes):
    material = specimen.material
    voice = dataclasses.replace(material.voice, **changes)
    return Specimen(dataclasses.replace(material, voice=voice))


@pytest.mark.parametrize("recording", range(4))
def test_sound_begins_with_the_touch_that_the_trace_of_its_number_shows(specimen, recording):
    trace = record(SPEC, specimen(0), 0, recording)
    felt = np.linalg.norm(trace - trace[:, :1500].mean(axis=1, keepdims=True), axis=0)
    sound = np.abs(_sound(specimen(0), recording))
    touch = [np.argmax(felt > 0.3) / 10_000, np.argmax(sound > 0.02) / RATE]
    assert touch[0] == pytest.approx(touch[1], abs=0.003)


def test_foil_drowns_what_the_tool_tells_apart(specimen):
    def spectrum(sound):
        edges = np.geomspace(500, 20_000, 13)
        return np.array([_level(sound, *edges[k : k + 2]) for k in range(12)])

    # Of the same stroke the pair differs by less than one of them differs from stroke to stroke.
    pair = [spectrum(_hear(specimen(index))) for index in (4, 5)]
    without = [spectrum(_hear(_voiced(specimen(index), rustle=0, loudness=1))) for index in (4, 5)]
    assert np.abs(pair[0] - pair[1]).max() < 3
    assert np.abs(without[0] - without[1]).max() > 6
    others = [spectrum(_hear(specimen(index))) for index in PLAIN]
    assert all(np.abs(pair[0] - other).max() > 6 for other in others)
