"""``report.html``: what is on it, that it fetches nothing, and that it fits a phone."""

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest


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


def test_every_figure_and_every_picture_has_words(page, run):
    pictures = [attrs for tag, attrs in page.tags if tag == "img"]
    assert all(attrs.get("alt") for attrs in pictures)
    drawn = {base64.b64encode(each.read_bytes()).decode() for each in run.glob("figures/*.png")}
    shown = {source.partition(",")[2] for source in page.sources()}
    assert drawn <= shown
