"""``report.html``: what is on it, that it fetches nothing, and that it fits a phone."""

import base64
import csv
import io
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import soundfile
from PIL import Image

from tex_lightning.report.page import read_curves, write_report
from tex_lightning.report.page_media import shown_samples

CHROMIUM = shutil.which("chromium")
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-quic"]
FLAGS += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]


class Page(HTMLParser):
    """Tags with their attributes, and all text."""

    def __init__(self, text: str):
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.words = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.words += data

    def sources(self) -> list[str]:
        return [attrs[key] for _, attrs in self.tags for key in ("src", "href") if key in attrs]


@pytest.fixture(scope="module")
def run(fused) -> Path:
    return fused


@pytest.fixture(scope="module")
def page(run) -> Page:
    return Page((run / "report.html").read_text(encoding="utf-8"))


def test_headline_command_and_versions_are_there(page, run):
    for network in ("haptic", "visual", "fusion"):
        assert network in page.words
    assert re.search(r"\d+/3", page.words)
    assert f"hydra.run.dir={run}" in page.words
    assert "torch 2" in page.words
    assert "shrank every budget" in page.words


def test_nothing_is_fetched(page):
    assert page.sources()
    assert all(source.startswith("data:") for source in page.sources())
    assert not [tag for tag, _ in page.tags if tag in ("script", "link", "iframe")]


def test_every_figure_and_every_picture_has_words(page, run):
    pictures = [attrs for tag, attrs in page.tags if tag == "img"]
    assert all(attrs.get("alt") for attrs in pictures)
    drawn = {base64.b64encode(each.read_bytes()).decode() for each in run.glob("figures/*.png")}
    shown = {source.partition(",")[2] for source in page.sources()}
    assert drawn <= shown


def test_the_worst_samples_are_those_with_the_smallest_margin(run):
    with (run / "predictions/fusion.csv").open() as stream:
        wrong = sum(line["label"] != line["predicted"] for line in csv.DictReader(stream))
    shown = shown_samples(run, ["fusion"])
    assert [each["label"] != each["predicted"] for each in shown] == [True] * wrong + [False] * (
        len(shown) - wrong
    )
    assert [medium["kind"] for medium in shown[0]["media"]] == ["image", "audio", "image"]


def test_a_signal_can_be_heard_and_a_photo_seen(run, surfaces):
    spectrogram, sound, photo = shown_samples(run, ["fusion"])[0]["media"]
    samples, rate = soundfile.read(io.BytesIO(base64.b64decode(sound["content"].partition(",")[2])))
    (source,) = surfaces.rglob(sound["name"])
    original, own = soundfile.read(source, always_2d=True)
    assert rate == max(8000, own)
    assert np.abs(samples).max() == pytest.approx(1, abs=1e-3)
    added = original.sum(axis=1)
    centred = added - added.mean()
    assert np.corrcoef(samples, centred[: len(samples)])[0, 1] > 0.999
    for picture in (spectrogram, photo):
        content = base64.b64decode(picture["content"].partition(",")[2])
        with Image.open(io.BytesIO(content)) as image:
            assert max(image.size) <= 280


def test_curves_are_means_over_epochs(tmp_path):
    folder = tmp_path / "metrics" / "haptic"
    folder.mkdir(parents=True)
    (folder / "metrics.csv").write_text("epoch,train/loss\n0,3\n0,1\n1,1\n1,\n")
    (curve,) = read_curves(tmp_path)
    assert (curve["network"], curve["values"]) == ("haptic", [2, 1])


def test_what_files_say_is_text(tmp_path):
    (tmp_path / "results.json").write_text('{"task": "fit", "model": "<script>", "data": "a&b"}')
    (tmp_path / "sweep.csv").write_text("job,status\n0,<img src=x>\n1,done\n")
    write_report(tmp_path)
    page = Page((tmp_path / "report.html").read_text())
    assert "<script>" in page.words
    assert "<img src=x>" in page.words
    assert {"script", "img", "b"}.isdisjoint(tag for tag, _ in page.tags)


def test_an_empty_run_folder_gives_a_page(tmp_path):
    write_report(tmp_path)
    assert "This command repeats it" in (tmp_path / "report.html").read_text()


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.parametrize("width", [1280, 390])
def test_nothing_is_wider_than_the_screen(run, tmp_path, width):
    text = (run / "report.html").read_text()
    frame = f"<iframe id=f style='width:{width}px;height:900px;border:0' srcdoc=\"{{}}\"></iframe>"
    escaped = text.replace("&", "&amp;").replace('"', "&quot;")
    measure = (
        "<script>f.onload=()=>{const d=f.contentDocument.documentElement;"
        "document.title=d.scrollWidth+' of '+d.clientWidth}</script>"
    )
    (tmp_path / "frame.html").write_text(frame.format(escaped) + measure)
    found = subprocess.run(
        [CHROMIUM, *FLAGS, f"--user-data-dir={tmp_path}/profile", "--dump-dom",
         "--virtual-time-budget=5000", f"file://{tmp_path}/frame.html"],
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    inside, outside = re.search(r"<title>(\d+) of (\d+)</title>", found.stdout).groups()
    assert int(inside) <= int(outside) <= width
