"""The page's own arithmetic, beside the libraries that it repeats."""

import json
import shutil
import struct
import subprocess
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
from PIL import Image
from scipy.signal import chirp

from tex_lightning.classifier.vote import random_tuples
from tex_lightning.export import web_page
from tex_lightning_runtime.pixels import halve
from tex_lightning_runtime.quality import (
    level,
    limits,
    photo_quality,
    trace_measures,
    trace_quality,
)
from tex_lightning_runtime.resampling import find_spikes, rate_ratio, resample_poly, without_spikes
from tex_lightning_runtime.samples import content_seed
from tex_lightning_runtime.traces import read_samples

SOURCES = Path(web_page.__file__).parent / "web"
BUFFER = """const load = (path) => { const bytes = readFileSync(path);
  return bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length); };"""


@pytest.fixture(scope="session")
def node(tmp_path_factory) -> Callable[..., Any]:
    """Run ``body`` with names of the page's modules and the plain values ``given``; its result."""
    if shutil.which("node") is None:
        pytest.skip("no node on the PATH")
    folder = tmp_path_factory.mktemp("script")
    for source in SOURCES.glob("*.js"):
        shutil.copy(source, folder)
    (folder / "package.json").write_text('{"type": "module"}')

    def run(imports: dict[str, str], body: str, **given: Any) -> Any:
        lines = [f'import {{ {names} }} from "./{module}.js";' for module, names in imports.items()]
        lines += ['import { readFileSync } from "node:fs";', f"const given = {json.dumps(given)};"]
        lines += [f"const result = await (async () => {{ {body} }})();"]
        lines += ["console.log(JSON.stringify(result));"]
        (folder / "run.js").write_text("\n".join(lines))
        done = subprocess.run(["node", "run.js"], cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


def noise(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, shape).astype(np.float32)


def write(path: Path, array: np.ndarray) -> str:
    path.write_bytes(array.tobytes())
    return str(path)


def test_a_truncated_wav_file_is_refused_in_one_sentence(node, tmp_path):
    path = tmp_path / "a.wav"
    soundfile.write(path, noise(100), 8000)
    path.write_bytes(path.read_bytes()[:-50])
    said = node(
        {"decode": "readSignal"},
        BUFFER + "try { readSignal('a.wav', load(given.path), { channels: null }) }"
        "catch (error) { return error.message }",
        path=str(path),
    )
    assert said == "a.wav cannot be read: truncated: 50 of 200 bytes are missing."


RATES = [(44_100, 10_000), (48_000, 10_000), (2_200, 10_000), (10_000, 3_333.3), (9_960, 10_000)]


@pytest.mark.parametrize(("kind", "last"), [(np.float32, 0), (np.float64, 1)])  # units that differ
def test_resampling_is_that_of_the_package(node, tmp_path, kind, last):
    clean = noise(4_321).astype(kind)
    trace = clean.copy()
    trace[500::700] += 40  # spikes, which go first
    found = node(
        {"resample": "resample, rateRatio"},
        BUFFER + f"const samples = new Float{8 * trace.itemsize}Array(load(given.path));"
        "return given.rates.map(([source, target]) =>"
        " [rateRatio(source, target), [...resample(samples, source, target)]]);",
        path=write(tmp_path / "a", trace), rates=RATES,
    )  # fmt: skip
    for (source, target), (ratio, samples) in zip(RATES, found, strict=True):
        up, down = rate_ratio(source, target, "a").as_integer_ratio()
        assert ratio == [up, down]
        mended = without_spikes(trace[None], source, find_spikes(trace[None]))[0]
        expected = resample_poly(mended[None], up, down)[0].astype(np.float32)
        np.testing.assert_array_max_ulp(np.float32(samples), expected, last)


TEXTS = {
    "one column": "1.5\n2.5e-3\n-3\n",
    "semicolons and decimal commas": "X;Y;Z\n1,5;2;3\n4;5,25;-6\n7;8;9\n0;0;1\n",
    "tabs, comments": "# made by hand\n# x\ty\tz\n1\t2\t3\n4\t5\t6\n7\t8\t9\n1\t1\t1\n",
    "a named time in ms": "time_ms,x\n" + "".join(f"{i / 8},{i * i % 7}\n" for i in range(20)),
    "units in a second line": "Time,a,b,c\ns,g,g,g\n"
    + "".join(f"{i / 1000},{i % 3},{i % 5},{-i}\n" for i in range(20)),
    "numbers that rise": "".join(f"{i / 2000:.4f} {i % 4} {-i}\n" for i in range(20)),
    "a position": "position_mm,x,y\n" + "".join(f"{i / 2000},{i % 4},{-i}\n" for i in range(20)),
    "counter, label": "packet,x,label\n" + "".join(f"{i},{i % 7},2\n" for i in range(20)),
    "battery and state": "x,battery_V,state\n"
    + "".join(f"{i % 7},{3.9 - i / 1000:.3f},{i // 10}\n" for i in range(20)),
    "an index": ",x\n" + "".join(f"{i},{i % 7}\n" for i in range(20)),
    "quoted decimal commas": "x,y,z\n" + "".join(f'"0,{i}5","1,5","{i},2"\n' for i in range(9, 30)),
    "milliseconds since 1970": "timestamp,x\n"
    + "".join(f"{1772359200000 + 8 * i},{i % 3}\n" for i in range(50)),
    "lost samples": "t (s),x\n" + "".join(f"{i / 500},{i % 6}\n" for i in range(30) if i != 9),
    "a trailing delimiter": "1,2,3,\n4,5,6,\n7,8,9,\n0,0,1,\n",
}


ARRAYS = {
    "one": noise(50),
    "axes": np.arange(-30, 30, dtype=np.int16).reshape(3, 20),
    "pair": noise(2, 20),
    "six": noise(6, 20),
    "columns": np.asfortranarray(noise(20, 3).astype(np.float64)),
    "big": noise(20, 3).astype(">f4"),
    "whole": np.arange(-30, 30).reshape(3, 20),
    "batch": noise(1, 3, 20),
    "behind": noise(20, 3, 1),
    "natural": np.arange(60, dtype=np.uint64).reshape(20, 3),
}


def test_sounds_arrays_and_tables_are_read_as_by_the_package(node, tmp_path):
    for subtype in ("PCM_U8", "PCM_16", "PCM_24", "PCM_32", "FLOAT", "DOUBLE"):
        for kind in ("WAV", "WAVEX"):
            path = tmp_path / f"{subtype}_{kind}.wav"
            soundfile.write(path, noise(501, 3), 8000, subtype=subtype, format=kind)
    content = bytearray((tmp_path / "PCM_16_WAV.wav").read_bytes())
    for name, size in (
        ("none", 0),
        ("flushed", 600),
        ("unknown", 0xFFFFFFFF),
    ):  # of a killed program
        struct.pack_into("<I", content, content.index(b"data") + 4, size)
        (tmp_path / f"{name}.wav").write_bytes(content)
    soundfile.write(tmp_path / "short.wav", noise(2, 6), 8000)
    for name, array in ARRAYS.items():
        np.save(tmp_path / f"{name}.npy", array)
    for name, text in TEXTS.items():
        (tmp_path / f"{name}.csv").write_text(text)
    paths = sorted(tmp_path.iterdir())
    signals = node(
        {"decode": "readSignal"},
        BUFFER + "return given.paths.map((path) => {"
        " const found = readSignal(path, load(path), { channels: null });"
        " return [found.rate, found.axes.map((each) => [...each])]; });",
        paths=[str(path) for path in paths],
    )
    for path, (rate, axes) in zip(paths, signals, strict=True):
        samples, expected, _ = read_samples(path)
        assert rate == expected, path.name
        axes = np.asarray(axes, samples.dtype)
        np.testing.assert_allclose(axes, samples, rtol=1e-15, err_msg=path.name)


def test_words_and_seeds_are_those_of_zlib_numpy_and_torch(node, tmp_path):
    trace, photo = noise(3, 700), np.arange(3 * 40 * 50, dtype=np.uint8)
    paths = write(tmp_path / "a", trace), write(tmp_path / "b", photo)
    found = node(
        {"seed": "crc32, contentSeed, mersenneTwister, draws"},
        BUFFER + "const trace = new Float32Array(load(given.paths[0]));"
        "const photo = new Uint8Array(load(given.paths[1]));"
        "return { crc: crc32(photo, 7), seed: contentSeed(5, [trace, photo]),"
        " words: [...mersenneTwister(4e9, 2000)], draws: [...draws(4e9, 900, 2)].map(Number) };",
        paths=paths,
    )
    assert found["crc"] == zlib.crc32(photo, 7)
    assert found["seed"] == content_seed(5, trace, photo)
    words = np.frombuffer(np.random.RandomState(4_000_000_000).bytes(8000), "<u4")
    np.testing.assert_array_equal(found["words"], words)
    drawn = np.reshape(found["draws"], (900, 2)) % [37, 143]
    np.testing.assert_array_equal(drawn, random_tuples([37, 143], 900, 4_000_000_000))


SENSE = {
    "name": "haptic", "modality": "haptic", "what": "trace", "medium": "signal", "rate": 1000,
    "file_rate": 1000, "least": 10,
}  # fmt: skip


@pytest.mark.parametrize(("unknown", "label"), [(0, "b"), (1, "unknown")])
def test_what_is_unlike_the_training_is_unknown(node, unknown, label):
    decision = {"rule": "vote", "temperature": 1, "seed": 0}
    card = {"classes": ["a", "b"], "senses": [SENSE], "decision": decision, "ranges": {}}
    found = node(
        {"classify": "classify"},
        "const samples = Float32Array.from({ length: 50 }, (_, i) => Math.sin(i));"
        "const run = async () => ({ label: { data: [1n] }, shares: { data: [0.25, 0.75] },"
        " probabilities: { data: [0.4, 0.6] }, scores: { dims: [2, 4] },"
        " haptic_scores: { data: [0, 1], dims: [2, 1, 1] }, unknown: { data: [given.unknown] } });"
        "const sample = { haptic: { axes: [samples], rate: 1000 } };"
        "const { label, rejected, best, fragments } = await classify(given.card, sample, run);"
        "return { label, rejected, best, fragments };",
        card=card | {"unknown": {"rate": 0.05}}, unknown=unknown,
    )  # fmt: skip
    assert found == {"label": label, "rejected": label != "b", "best": "b", "fragments": 4}


RANGES = {"level": [2.0, 3.0], "rate": [10_000.0, 10_000.0]}
TRACES = {
    "good": 4 * noise(1, 5000),
    "silent": np.zeros((3, 500), np.float32),
    "constant": np.full((1, 500), 2, np.float32),
    "clipped": np.clip(9 * noise(1, 5000), -5, 5),
    "an axis missing, and quiet": noise(3, 5000) * np.float32([[0.1], [0], [0.1]]),
    "an axis of rounding": np.float32([[1], [1e-6]]) * noise(2, 5000) + np.float32([[0], [9.81]]),
}


@pytest.mark.parametrize("faults", [{}, {"constant": [2.0, 2.0], "clipped": [0.1, 0.3]}])
def test_warnings_of_signals_are_those_of_the_package(node, faults):
    ranges = RANGES | faults
    found = node(
        {"quality": "signalQuality"},
        "const about = { rate: 4000, sense: { what: 'trace', rate: 10000 }, ranges: given.ranges };"
        "return given.traces.map((trace) => {"
        " const axes = trace.map((each) => Float32Array.from(each));"
        " return signalQuality(axes, axes, about); });",
        traces=[trace.tolist() for trace in TRACES.values()], ranges=ranges,
    )  # fmt: skip
    for trace, quality in zip(TRACES.values(), found, strict=True):
        expected = trace_quality(
            trace, limits(ranges), "trace", trace_measures(level(trace), 4000.0, 10_000.0)
        )
        assert quality == {"warnings": list(expected.warnings), "empty": expected.empty}


@pytest.mark.parametrize("contrast", [0, 60])
def test_photos_are_halved_and_judged_as_by_the_package(node, tmp_path, contrast):
    photo = (128 + contrast * noise(301, 535, 3)).astype(np.uint8)
    ranges = {"brightness": [1.0, 10.0], "contrast": [10.0, 20.0]}
    found = node(
        {"decode": "halve", "quality": "photoQuality"},
        BUFFER + "const pixels = new Uint8Array(load(given.path));"
        "const photo = halve({ pixels, width: 535, height: 301 });"
        "const quality = photoQuality(photo, { sense: { what: 'photo' }, ranges: given.ranges });"
        "return { quality, pixels: [...photo.pixels], size: [photo.height, photo.width] };",
        path=write(tmp_path / "a", photo), ranges=ranges,
    )  # fmt: skip
    expected = halve(photo)
    assert found["size"] == list(expected.shape[:2])
    np.testing.assert_array_equal(found["pixels"], expected.flatten())
    quality = photo_quality(expected, limits(ranges), "photo")
    assert found["quality"] == {"warnings": list(quality.warnings), "empty": quality.empty}


def test_the_spectrogram_to_look_at_follows_a_sweep(node):
    """The loudest band of each frame is that of the sweep's frequency there."""
    rate, seconds = 2000, 2.0
    times = np.arange(int(rate * seconds)) / rate
    sweep = chirp(times, 80, seconds, 800)
    found = node(
        {"spectrum": "spectrogram"},
        "const found = spectrogram([given.axis], 2000);"
        "return { ...found, data: Array.from(found.data) };",
        axis=sweep.tolist(),
    )
    data = np.reshape(found["data"], (found["bands"], found["frames"]))
    loudest = np.array(found["frequencies"])[data.argmax(axis=0)]
    centres = found["start"] + found["hop"] * np.arange(found["frames"])
    expected = 80 + (800 - 80) * centres / seconds
    assert np.median(np.abs(np.log2(loudest / expected))) < 0.1  # a tenth of an octave
    assert centres[-1] == pytest.approx(seconds - found["start"], abs=0.01)


def test_a_figure_of_any_signal_has_names_of_axes_and_a_few_times(node):
    names, times = node(
        {"draw": "axisName, ticks"},
        "const names = [1, 3, 16].map((count) => axisName(count - 1, count));"
        "return [names, [3, 1e13, given.none / 0, -1].map((seconds) => ticks(seconds, 10))];",
        none=1,
    )
    assert names == ["", "Z", "16"]
    usual, many, endless, negative = times
    assert usual == [0, 0.5, 1, 1.5, 2, 2.5, 3]
    assert len(many) == 10  # they were added up in steps of two minutes, for hours
    assert endless == negative == []  # of a rate of 0 they never ended


def test_signals_that_are_dropped_together_go_to_an_input_each(node):
    found = node(
        {"sense": "placed"},
        "const made = (name, photo, recording = null) =>"
        " ({ name, recording, takes: (file) => photo === file.endsWith('png') });"
        "const names = (files, inputs) =>"
        " placed(files, inputs).map(([, each]) => each?.name ?? null);"
        "const all = [made('haptic', false), made('image', true), made('sound', false)];"
        "const full = [made('haptic', false, 1), made('sound', false, 1)];"
        "const half = [made('haptic', false, 1), made('sound', false)];"
        "return [names(['a.wav', 'b.png', 'c.wav', 'd.wav'], all), names(['a.wav', 'c.wav'], full),"
        " names(['a.wav'], half), names(['b.png'], full)];",
    )
    assert found == [
        ["haptic", "image", "sound", "haptic"], ["haptic", "sound"], ["sound"], [None]
    ]  # fmt: skip


def test_photos_whose_greys_a_browser_darkens_are_known_by_their_beginning(node, tmp_path):
    grey = np.arange(12, dtype=np.uint16).reshape(3, 4)
    photos = {"deep": grey, "plain": grey.astype(np.uint8), "colours": np.zeros((3, 4, 3), "uint8")}
    for name, pixels in photos.items():
        Image.fromarray(pixels).save(tmp_path / f"{name}.png")
    found = node(
        {"decode": "isDeepGrey"},
        BUFFER + "return given.paths.map((path) => isDeepGrey(new Uint8Array(load(path))));",
        paths=[str(tmp_path / f"{name}.png") for name in photos],
    )
    assert found == [True, False, False]


def test_a_network_that_does_not_say_what_it_needs_asks_for_a_longer_stroke(node):
    decision = {"rule": "vote", "temperature": 1, "seed": 0}
    sense = SENSE | {"least": None, "too_short": "Record a longer stroke."}
    said = node(
        {"classify": "classify"},
        "const run = async () => { throw new Error('Invalid input shape: {5}'); };"
        "const sample = { haptic: { axes: [new Float32Array(50).fill(1)], rate: 1000 } };"
        "try { await classify(given.card, sample, run) } catch (error) { return error.message }",
        card={"classes": ["a"], "senses": [sense], "decision": decision, "unknown": None},
    )
    assert said == "Record a longer stroke."
