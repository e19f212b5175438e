"""Names that come from files, on every way out: terminal, log, figures, documents, tables."""

import csv
import errno
import json
import pickle
import re
from html.parser import HTMLParser
from pathlib import Path
from unittest.mock import Mock

import pytest
import soundfile
from conftest import RATE, make_trace
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt

from tex_lightning.core.console import print_line
from tex_lightning.errors import UserError, listed, reason, shorten
from tex_lightning.text import from_cell, printable, to_cell, to_json, to_markdown
from tex_lightning_runtime.errors import SHOWN

HOSTILE = (
    "$x^{", "[/b]", "a\x1b[31m", "=cmd|' /C calc'!A0", "<img src=http://x>", "![a](http://x)",
    "two\nlines", "\u202egnp.exe", "`_a_` **b** http://x www.x.org &lt; ~~c~~",
)  # fmt: skip
STEERING = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
FORMULA = tuple("=+-@\t\r")


@given(st.text())
def test_cells_and_json_give_the_text_back_and_steer_nothing(text):
    cell, line = to_cell(text), to_json([text])
    assert from_cell(cell) == text
    assert not cell.startswith(FORMULA)
    assert json.loads(line) == [text]
    assert cell.isprintable()
    assert line.isprintable()
    line.encode()


@given(st.one_of(st.sampled_from(HOSTILE), st.text("\\`*_[]<>|!#~$&:(){}+-.a \n")))
def test_markdown_shows_the_text_as_it_is(text):
    html = _rendered(f"| {to_markdown(text)} |\n|---|\n")
    seen = _Words(html)
    assert {*seen.tags} <= {"table", "thead", "tbody", "tr", "th"}
    assert " ".join(seen.words.split()) == " ".join(printable(text).split())


def _rendered(text: str) -> str:
    return MarkdownIt("commonmark").enable(["table", "strikethrough"]).render(text)


class _Words(HTMLParser):
    def __init__(self, html: str):
        super().__init__()
        self.tags, self.links, self.words = [], [], ""
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for key, value in attrs if key in ("src", "href")]

    def handle_data(self, data):
        self.words += data


def test_json_on_standard_output_is_utf8_whatever_the_terminal_is(capfd, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    print_line({"label": "Tür \x9b\udce9"})
    assert capfd.readouterr().out == '{"label": "Tür \\u009b\\udce9"}\n'


def test_json_on_a_full_disk_is_one_sentence(monkeypatch):
    full = Mock(side_effect=OSError(errno.ENOSPC, "No space left on device"))
    monkeypatch.setattr("sys.stdout", Mock(flush=full))
    with pytest.raises(UserError, match=r"^The output cannot be written \(.*No space left"):
        print_line({"label": "a"})


@pytest.fixture(scope="module")
def run(run_once, tmp_path_factory) -> Path:
    """A run on classes, files and conditions with such names."""
    root = tmp_path_factory.mktemp("hostile")
    with (root / "manifest.csv").open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["label", "modality", "path", "group", "tool", HOSTILE[5]])
        for kind, label in enumerate(HOSTILE[:6]):
            for number in range(6):
                path = root / f"{label.replace('/', '')}_{number}.wav"
                soundfile.write(path, make_trace(kind, number), RATE)
                writer.writerow([label, "haptic", path, number, HOSTILE[4 + number % 4], number])
    return run_once(
        "model=haptic", "task=crossval", "data=manifest", f"data.manifest={root / 'manifest.csv'}",
        "data.folds=3", "crossval.only=[0,1]", "debug=tiny",
    )  # fmt: skip


def test_no_file_of_a_run_has_what_steers_a_terminal_or_a_spreadsheet(run):
    paths = [path for path in run.rglob("*") if path.suffix in (".csv", ".md", ".log")]
    assert {path.suffix for path in paths} == {".csv", ".md", ".log"}
    for path in paths:
        text = path.read_text(encoding="utf-8")
        assert not STEERING.search(text), path
        if path.suffix == ".csv":
            cells = [cell for line in csv.reader(text.splitlines()) for cell in line]
            wrong = [cell for cell in cells if cell.startswith(FORMULA) and not _is_number(cell)]
            assert not wrong, path


def _is_number(cell: str) -> bool:
    return re.fullmatch(r"-?[\d.]+(e[+-]?\d+)?|-?(nan|inf)", cell) is not None


def test_the_page_shows_names_as_text_and_fetches_nothing(run):
    html = (run / "report.html").read_text(encoding="utf-8")
    page = _Words(html)
    assert all(link.startswith(("data:", "file:///")) for link in page.links)
    assert [*page.tags].count("script") <= 1  # its own, whose hash alone is allowed
    assert "default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'; " in html
    for name in HOSTILE[4:6]:
        assert name in page.words


def test_terminal_and_card_take_such_names(run, cli, tmp_path):
    one = cli(
        "task=predict", f"checkpoint={run / 'folds' / '0'}", "verbose=0",
        f"haptic={_manifest(run).parent}/*_0.wav",
    )  # fmt: skip
    assert one.status == 0, one.err
    assert not STEERING.search(one.out)
    labels = {json.loads(line)["label"] for line in one.out.splitlines()}
    assert labels <= {*HOSTILE}
    card = cli(
        "task=export", f"checkpoint={run / 'folds' / '0'}", "export.format=card",
        f"export.out={tmp_path}",
    )  # fmt: skip
    assert card.status == 0, card.err
    text = (tmp_path / "MODEL_CARD.md").read_text(encoding="utf-8")
    assert not STEERING.search(text)
    shown = _Words(_rendered(text.partition("---\n")[2]))
    assert not {"img", "a"} & {*shown.tags}
    assert all(printable(name) in shown.words for name in HOSTILE[:6])


def _manifest(run: Path) -> Path:
    text = (run / ".hydra" / "config.yaml").read_text()
    return Path(re.search(r"manifest: (\S+manifest.csv)", text)[1])


def test_names_in_messages_are_short_and_few():
    assert shorten("rough") == "rough"
    assert len(shorten("x" * 100_000)) < SHOWN + 50
    assert listed(["a", "b"]) == "a, b"
    assert listed([str(n) for n in range(25)]).endswith("18, 19 and 5 more")


def test_what_a_library_says_stands_inside_a_sentence():
    assert reason(ValueError("Bad header.\n  No 'data' chunk.")) == "Bad header; No 'data' chunk"
    assert reason(MemoryError()) == "MemoryError"
    assert len(reason("x" * 10_000)) < SHOWN + 50


def test_each_line_of_a_mistake_is_one_whatever_names_hold():
    assert str(UserError("File a\nb.wav is empty; replace it.")) == (
        "File a\\nb.wav is empty; replace it."
    )
    several = UserError("2 files cannot be used:", "- a\nb.wav", "- c\x1b[31m.wav")
    assert str(several).splitlines() == [
        "2 files cannot be used:", "- a\\nb.wav", "- c\\x1b[31m.wav",
    ]  # fmt: skip
    assert str(pickle.loads(pickle.dumps(several))) == str(several)  # from a launcher's process
