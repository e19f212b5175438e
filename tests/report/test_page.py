"""``report.html``: what is on it, that it fetches nothing, and that it fits a phone."""

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tex_lightning.report.page import write_report


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
    assert "model=fusion" in page.words
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


def test_what_files_say_is_text(tmp_path):
    (tmp_path / "results.json").write_text('{"task": "fit", "model": "<script>", "data": "a&b"}')
    (tmp_path / "sweep.csv").write_text("job,status\n0,<img src=x>\n1,done\n")
    write_report(tmp_path)
    page = Page((tmp_path / "report.html").read_text())
    assert "<script>" in page.words
    assert "<img src=x>" in page.words
    assert {"script", "img", "b"}.isdisjoint(tag for tag, _ in page.tags)
