"""``report.html``: what is on it; ``test_text.py`` tests that it fetches nothing."""

import base64
import re


def test_headline_command_versions_and_every_figure_are_there(fused):
    page = (fused / "report.html").read_text(encoding="utf-8")
    for words in ("haptic", "visual", "fusion", "model=fusion", "torch 2", "shrank every budget"):
        assert words in page
    assert re.search(r"\d+/3", page)
    pictures = re.findall(r"<img [^>]+>", page)
    assert all(re.search(r'alt="[^"]', picture) for picture in pictures)
    for figure in fused.glob("figures/*.png"):
        assert base64.b64encode(figure.read_bytes()).decode() in page
