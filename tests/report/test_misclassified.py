"""Every wrong sample of a run is in its page, with its pictures, and can be filtered for."""

import base64
import hashlib
import html
import json
import re
import shutil
import subprocess
from collections import Counter
from html.parser import HTMLParser

import pytest

from tex_lightning.evaluation.outcomes import Outcome, read_outcomes, write_outcomes
from tex_lightning.report.misclassified import class_tables, error_cards
from tex_lightning.report.page import write_report

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
HOSTILE = '<img src=x onerror=alert(1)>"&'


class Page(HTMLParser):
    """Tags with their attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def of(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def wrong_samples(run) -> Counter[tuple[str, str, str]]:
    names = json.loads((run / "results.json").read_text())["networks"]
    return Counter(
        (name, outcome.label, outcome.predicted)
        for name in names
        for outcome in read_outcomes(run / "predictions" / f"{name}.csv")
        if outcome.label != outcome.predicted
    )


def cards_in(text: str) -> Counter[tuple[str, str, str]]:
    inside = text[text.index('id="cards"') :]
    inside = inside[: inside.index("<h2")]
    return Counter(
        (card["data-network"], card["data-label"], card["data-predicted"])
        for card in Page(inside).of("article")
    )


def test_every_wrong_sample_is_a_card_with_pictures_sound_and_file(fused):
    expected = wrong_samples(fused)
    assert expected  # a network of a few steps errs
    text = (fused / "report.html").read_text()
    assert cards_in(text) == expected
    page = Page(text)
    sources = [each["src"] for tag in ("img", "audio") for each in page.of(tag)]
    assert len(sources) > sum(expected.values())
    assert all(re.match(r"data:(image/(png|jpeg)|audio/wav);base64,.{99}", src) for src in sources)
    links = [each["href"] for each in page.of("a")]
    assert links
    assert all(link.startswith("file:///") for link in links)
    (script,) = re.findall("<script>(.*?)</script>", text, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in text


def test_samples_know_which_networks_were_right(fused):
    outcomes = {
        name: {
            file: outcome.label == outcome.predicted
            for outcome in read_outcomes(fused / "predictions" / f"{name}.csv")
            for file in outcome.files.values()
        }
        for name in ("haptic", "visual", "fusion")
    }
    joint = [
        outcome.files.values() for outcome in read_outcomes(fused / "predictions" / "fusion.csv")
    ]
    for card in error_cards(fused)["cards"]:
        files = {*card["files"].values()}
        related = files.union(*(each for each in joint if files & {*each}))
        expected = [
            name
            for name, known in outcomes.items()
            if name != card["network"] and any(known.get(file) for file in related)
        ]
        assert card["right"] == expected


def test_names_are_text_and_never_markup(tmp_path):
    outcomes = [
        Outcome({"haptic": f"{n}.wav"}, HOSTILE, "b" if n else HOSTILE, 1.0, 1, 1, 1.0)
        for n in range(3)
    ]
    write_outcomes(outcomes, tmp_path / "predictions" / "haptic.csv")
    sample = {
        "label": HOSTILE, "predicted": "b", "files": {"haptic": HOSTILE}, "senses": {},
        "facts": {HOSTILE: HOSTILE},
    }  # fmt: skip
    kept = {"errors": 2, "wrong": [1], "pairs": [], "samples": {"1": sample}}
    (tmp_path / "samples").mkdir()
    (tmp_path / "samples" / "haptic.json").write_text(json.dumps(kept))
    results = {"task": "fit", "networks": {"haptic": {}}, "classes": [HOSTILE, "b"]}
    (tmp_path / "results.json").write_text(json.dumps(results))
    write_report(tmp_path)
    text = (tmp_path / "report.html").read_text()
    assert "<img src=x" not in text
    assert html.escape(HOSTILE, quote=False).split(" ")[0] in text
    assert Page(text).of("article")[0]["data-label"] == HOSTILE
    assert "the worst 1 of 2" in text
    (table,) = class_tables(tmp_path)
    assert table.rows[0]["recall"] == "33.3%"
    assert table.rows[0]["precision"] == "100.0%"
    assert table.rows[0]["most confused with"] == "b (2)"


def dump(page) -> str:
    command = [
        CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=5000",
        "--dump-dom", page.as_uri(),
    ]  # fmt: skip
    found = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    return found.stdout


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
def test_a_browser_finds_every_wrong_sample_and_filters(fused, tmp_path):
    expected = wrong_samples(fused)
    count = sum(expected.values())
    assert re.search(rf'id="count">{count}</span>', dump(fused / "report.html"))  # the script ran
    text = (fused / "report.html").read_text()
    network, _, predicted = next(iter(expected))
    asked = {"by-network": network, "by-class": predicted}
    steps = "".join(
        f"{{const s = document.getElementById({json.dumps(name)}); s.value = {json.dumps(value)};"
        "s.dispatchEvent(new Event('change'));}"
        for name, value in asked.items()
    )
    changed = re.sub(r"<meta http-equiv[^>]*>", "", text)  # which allows no further script
    page = tmp_path / "page.html"
    page.write_text(changed.replace("</body>", f"<script>{steps}</script></body>"))
    shown = dump(page)
    inside = shown[shown.index('id="cards"') : shown.index("<h2", shown.index('id="cards"'))]
    visible = [card for card in Page(inside).of("article") if "hidden" not in card]
    fits = sum(
        number
        for (name, true, called), number in expected.items()
        if name == network and predicted in (true, called)
    )
    assert 0 < fits <= count
    assert len(visible) == fits
