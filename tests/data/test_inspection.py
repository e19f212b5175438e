"""Suspicions are raised by what shares something, and by nothing that only looks alike."""

import numpy as np
import pytest
import soundfile
from PIL import Image

from tex_lightning.data.decode import PhotoDecoder, SignalDecoder
from tex_lightning.data.inspection import suspicions
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.data.store import Store

RATE = 10_000


@pytest.fixture
def found(tmp_path):
    """Write recordings by name, of group and class by the letters of it; return what is found."""

    def run(modality="haptic", groups=None, **content):
        rows = []
        for name, array in content.items():
            suffix = ".png" if modality == "image" else ".wav"
            path = tmp_path / f"{name}{suffix}"
            if modality == "image":
                Image.fromarray(array).save(path)
            else:
                samples, rate = array if isinstance(array, tuple) else (array, RATE)
                soundfile.write(path, samples, rate, subtype="FLOAT")
            rows.append(Recording(name[0], modality, path, (groups or {}).get(name, name)))
        decoders = {"haptic": SignalDecoder(float(RATE)), "image": PhotoDecoder(False)}
        store = Store(tmp_path / "cache", decoders)
        table = Recordings(tuple(rows))
        assert store.fill(table) == []
        return {(each.kind, each.files): each.text for each in suspicions(table, store)}

    return run


def noise(seed: int, samples: int = 20_000) -> np.ndarray:
    white = np.random.default_rng(seed).standard_normal(samples)
    return np.convolve(white, np.hanning(7), "same") * 0.05


def test_pieces_of_one_recording_share_a_stretch_whatever_the_gain(found):
    whole = noise(0, 40_000)
    pieces = {"a1": whole[:20_000], "a2": 0.5 * whole[12_000:32_000] + 0.1, "b1": noise(1)}
    (((kind, files), text),) = found(**pieces).items()
    assert (kind, files) == ("shared stretch", "a/a1.wav, a/a2.wav")
    assert "share 0.8 s" in text  # 12,000 to 20,000 at 10 kHz
    assert found(**pieces, groups={"a1": "one", "a2": "one"}) == {}


def test_tones_and_strokes_of_one_material_share_nothing(found):
    time = np.arange(20_000) / RATE
    tones = {f"a{n}": 0.3 * np.sin(2 * np.pi * 53.7 * time + n) for n in range(3)}
    hum = {f"b{n}": noise(n) + 0.3 * np.sin(2 * np.pi * 50 * time) for n in range(3)}
    assert not [kind for kind, _ in found(**tones, **hum) if kind == "shared stretch"]


def test_copies_of_a_file_are_found_and_said_once(found):
    same = noise(3)
    assert found(a1=same, b1=same, a2=noise(4)) == {
        ("copies", "a/a1.wav, b/b1.wav"): "2 files of 2 classes have the same content"
    }


def test_faults_of_a_sensor_and_mixed_recordings(found):
    flat = np.stack([noise(5), np.full(20_000, 0.2)], axis=1)
    signals = {"a1": noise(6), "a2": np.clip(noise(7), -0.05, 0.05), "b1": flat}
    told = found(**signals, b2=(noise(8), 8_000), b3=(noise(9), 10_020), c1=np.zeros(20_000))
    assert {kind for kind, _ in told} == {
        "clipped", "constant axis", "silent", "mixed rates", "mixed axes",
    }  # fmt: skip
    assert told["clipped", "a/a2.wav"].startswith("1 of 6 traces; the first: The trace is clipped")
    assert told["silent", "c/c1.wav"].startswith("1 of 6 traces")
    (rates,) = [text for (kind, _), text in told.items() if kind == "mixed rates"]
    assert rates == "5 with 10,000 Hz, 1 with 8,000 Hz"  # clocks differ by less than a hundredth


def test_photos_of_the_same_are_one_finding_and_others_none(found):
    rng = np.random.default_rng(0)
    one, other = (rng.integers(0, 255, (160, 160, 3), dtype=np.uint8) for _ in range(2))
    brighter = (one * 0.7 + 60).astype(np.uint8)
    light = np.linspace(60, 200, 160)[None, :, None]  # the same light on other surfaces
    lit = [(light + rng.normal(0, 8, (160, 160, 3))).clip(0, 255).astype(np.uint8) for _ in "ab"]
    told = found("image", a1=one, a2=brighter, a3=one[:, :, ::-1], b1=other, b2=lit[0], b3=lit[1])
    assert told == {
        ("same picture", "a/a1.png, a/a2.png, a/a3.png"): "3 photos of 3 groups are alike"
    }


def test_real_photos_that_are_known_to_be_alike(shared, tmp_path):
    files = sorted((shared / "data/dtd10/cobwebbed/image").glob("*.jpg"))
    rows = tuple(Recording("a", "image", file, n) for n, file in enumerate(files))
    store = Store(tmp_path, {"image": PhotoDecoder(False)})
    store.fill(rows)
    pairs = {each.files for each in suspicions(Recordings(rows), store)}
    assert "a/cobwebbed_0064.jpg, a/cobwebbed_0080.jpg" in pairs
    assert len(pairs) < 6
