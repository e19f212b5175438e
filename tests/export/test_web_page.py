"""The page in a real browser, beside ``task=predict``."""

import functools
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import make_trace
from docs_world import write_web_runtime

import tex_lightning as tl
from tex_lightning.data.store import cache_root
from tex_lightning.errors import UserError
from tex_lightning.export import web_page as web_runtime
from tex_lightning.export.web_page import FILES, page_files, runtime_files

from .browser import ENTER, TAB, Browser, browser, missing, served

DONE = """return document.body.dataset.state === "ready" &&
  (document.querySelector("#label").textContent || document.querySelector("#problem").textContent);
"""
SHARES = """return Object.fromEntries([...document.querySelectorAll("#classes tbody tr")].map(
  (row) => [row.querySelector("th").textContent, row.querySelector("progress").value]));"""


@pytest.fixture(scope="session")
def runtime() -> Path:
    """ONNX Runtime Web, kept in the user's own cache from one session to the next."""
    if reason := missing():
        pytest.skip(reason)
    cache = cache_root(None)
    try:
        web_runtime.runtime_files(None, cache)
    except UserError as error:
        pytest.skip(str(error))
    return cache / f"{web_runtime.NAME}-{web_runtime.VERSION}.tgz"


@pytest.fixture(scope="session")
def page(runtime, run_once) -> Callable[[Path], Path]:
    """Write the page of a checkpoint, once for all tests; gives its folder."""

    @functools.cache
    def write(checkpoint: Path) -> Path:
        return run_once(
            "task=export", f"checkpoint={checkpoint}", "export.format=web", "export.check=0",
            f"export.web_runtime={runtime}",
        )  # fmt: skip

    return write


@pytest.fixture
def chromium(tmp_path) -> Iterator[Browser]:
    with browser(tmp_path / "profile") as found:
        yield found


def start(chromium: Browser, address: str) -> None:
    chromium.open(address)
    chromium.wait('return document.body.dataset.state === "ready"')


def give(chromium: Browser, place: int, file: Path) -> None:
    """Choose a file of a sense, counted from 1, and wait for what the page makes of it."""
    chromium.run(
        'for (const id of ["label", "problem"]) document.getElementById(id).textContent = ""'
    )
    chromium.type(f".sense:nth-child({place}) input[type=file]", str(file))
    chromium.wait(DONE)


def expect(chromium: Browser, predicted: tl.Prediction) -> None:
    """The page says what the package says."""
    assert chromium.text("#problem") == ""
    assert chromium.text("#label") == predicted.label
    warnings = chromium.run('return [...document.querySelectorAll("#warnings li")]'
                            '.map((each) => each.textContent)')  # fmt: skip
    assert warnings == list(predicted.warnings)
    shares = {each["label"]: each["share"] for each in predicted.top_k}
    assert chromium.run(SHARES) == pytest.approx(shares, abs=1e-6)
    assert f"{100 * predicted.probability:.1f}\u00a0%" in chromium.text("#how")
    assert chromium.log() == []


TEXTS = [("ink", "back"), ("ink", "card"), ("muted", "back"), ("muted", "card"), ("bad", "card"),
         ("on-accent", "accent"), ("warn-ink", "warn-back")]  # fmt: skip


GRAPH = """
<ir_version: 10, opset_import: ["": 20]>
power (float[A, N] haptic) => (float[3, 2] scores, int64 label, float[3] shares,
                               float[3] probabilities, float[3, 1, 2] haptic_scores)
<float[3] signs = {-10, 0, 10}, int64[2] size = {3, 2},
 int64[1] last = {1}, int64[3] dense = {3, 1, 2}, float[3] level = {-0.9, 0, 0.4}> {
  squares = Mul (haptic, haptic)
  power = ReduceMean <keepdims = 0> (squares)
  scaled = Mul (signs, power)
  sums = Sub (scaled, level)
  scored = Unsqueeze (sums, last)
  scores = Expand (scored, size)
  label = ArgMax <axis = 0, keepdims = 0> (sums)
  probabilities = Softmax (sums)
  hit = Hardmax (sums)
  shares = Identity (hit)
  haptic_scores = Reshape (scores, dense)
}
"""


def test_a_person_at_the_keyboard_gets_a_label(runtime, chromium, tmp_path):
    onnx = pytest.importorskip("onnx")
    sense = {
        "name": "haptic", "modality": "haptic", "what": "trace", "medium": "signal", "axes": [1, 3],
        "rate": 10_000, "file_rate": 10_000, "channels": None, "least": None, "stride": None,
    }  # fmt: skip
    card = {
        "kind": "haptic", "classes": ["soft", "plain", "<b>rough</b>"], "senses": [sense],
        "decision": {"rule": "vote", "temperature": 1, "reject_below": None, "seed": 0},
        "version": "0", "unknown": None, "ranges": {},
    }  # fmt: skip
    page, file = tmp_path / "page", tmp_path / "<img src=x onerror=alert(1)>.csv"
    files = page_files(card, web_runtime.runtime_files(str(runtime), tmp_path))
    for name, content in files.items():
        (page / name).parent.mkdir(parents=True, exist_ok=True)
        (page / name).write_bytes(content)
    (page / "haptic.onnx").write_bytes(onnx.parser.parse_model(GRAPH).SerializeToString())
    times = np.arange(16_000) / 8000
    np.savetxt(file, np.c_[times, np.sin(700 * times)], header="time_s,x", delimiter=",")
    with served(page) as address:
        start(chromium, address)
        chromium.press(TAB)
        assert chromium.run("return document.activeElement.type") == "file"
        give(chromium, 1, file)
        assert chromium.text("#label") == "<b>rough</b>"  # 10 times half, less 0.4, against 0
        assert "99.0\u00a0%" in chromium.text("#how")  # 1 / (1 + exp(-4.6) + exp(-8.7))
        assert chromium.text(".given .name") == file.name
        assert "2.00 s at 8,000 Hz" in chromium.text(".wave figcaption")
        assert chromium.run("return document.querySelectorAll('img, b').length") == 0
        chromium.press(TAB, TAB)
        assert chromium.run("return document.activeElement.className") == "remove"
        chromium.press(ENTER)
        chromium.wait('return document.querySelector("#label").textContent === ""')
        assert chromium.log() == []


@pytest.mark.slow
def test_a_network_of_one_sense_says_what_predict_says(untrained, page, chromium, tmp_path):
    checkpoint, wav = untrained / "checkpoints" / "haptic.ckpt", tmp_path / "a.wav"
    soundfile.write(wav, make_trace(1, 0), 10_000, subtype="FLOAT")
    with served(page(checkpoint)) as address:
        start(chromium, address)
        give(chromium, 1, wav)
        expect(chromium, tl.load(checkpoint).predict(haptic=wav))


@pytest.fixture
def package(tmp_path, monkeypatch) -> Path:
    """A package of the npm registry with small files, trusted for this test."""
    path = tmp_path / "onnxruntime-web" / "-" / f"onnxruntime-web-{web_runtime.VERSION}.tgz"
    path.parent.mkdir(parents=True)
    monkeypatch.setattr(web_runtime, "INTEGRITY", write_web_runtime(path))
    return path


EXPECTED = {kept: name.encode() for name, kept in FILES.items()}


def test_it_is_fetched_once_from_the_registry_of_the_machine(package, tmp_path, monkeypatch):
    cache = tmp_path / "cache"
    with served(tmp_path) as address:
        monkeypatch.setenv("NPM_CONFIG_REGISTRY", address)
        assert runtime_files(None, cache) == EXPECTED
    assert runtime_files(None, cache) == EXPECTED  # the registry is gone
    (cache / package.name).write_bytes(b"half of it")
    with pytest.raises(UserError, match=r"does not give .* export\.web_runtime"):
        runtime_files(None, cache)


def test_a_given_package_is_taken_if_it_is_the_one_that_was_tested(package, tmp_path, monkeypatch):
    assert runtime_files(str(package), tmp_path / "cache") == EXPECTED
    assert not (tmp_path / "cache").exists()
    with pytest.raises(UserError, match=r"none\.tgz"):
        runtime_files(str(tmp_path / "none.tgz"), tmp_path)
    monkeypatch.setattr(web_runtime, "INTEGRITY", "sha512-another")
    with pytest.raises(UserError, match=r"SHA-512 differs\); give that package"):
        runtime_files(str(package), tmp_path)
