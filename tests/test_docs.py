"""Every command of the documentation composes: no key, option or value in it is out of date."""

import functools
import re
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from documentation import (
    MULTIRUN,
    PAGES,
    REPORTS,
    ROOT,
    START,
    USER_PAGES,
    anchors,
    commands,
    links,
    package_arguments,
    sweep_jobs,
)
from omegaconf import OmegaConf
from scipy.stats import binomtest

import tex_lightning as tl
from tex_lightning.config import Config
from tex_lightning.config.check import read_config
from tex_lightning.config.composition import compose_config
from tex_lightning.config.nodes import walk
from tex_lightning.config.quoting import as_typed
from tex_lightning.report.table import paper_tables

FOUND = {
    command: block.page
    for page in PAGES
    for block, command in commands(page)
    if START in command and not re.search(r"--(help|cfg)\b", command)
}
CASES = [(page, command) for command, page in FOUND.items()]


@pytest.mark.parametrize(("page", "command"), CASES)
def test_a_command_of_the_documentation_composes(page, command):
    assert len(CASES) > 60
    arguments = [each for each in package_arguments(command) if each not in MULTIRUN]
    if "--config-dir" in arguments:  # a user's own parts, which tests/plugin runs
        return
    jobs = sweep_jobs(as_typed(arguments))
    read_config(compose_config(jobs))


def test_keys_named_in_sentences_exist():
    keys = {
        name
        for model in ("fusion", "band_proportions", "minirocket", "visual_efficientnet")
        for name, _ in walk(Config, OmegaConf.to_container(compose_config([f"model={model}"])))
    } | {"data.reader.split"}
    flags = ("trainer.KEY", "trainer.max_epochs", "trainer.deterministic")  # of Lightning
    opened = ("data.reader.folders.", "frontier.systems.", *flags)
    sections = "|".join({name.partition(".")[0] for name in keys if "." in name})
    wrong = []
    for page in (ROOT / "README.md", *USER_PAGES):
        text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
        for code in re.findall(r"`([^`\n]+)`", text):
            for name in re.findall(rf"(?:^| )((?:{sections})\.\w[\w.]*)", code):
                whole = any(key == name or key.startswith(f"{name}.") for key in keys)
                inner = name.endswith("._target_") or name.startswith(opened)
                if not (whole or inner or re.search(r"\.(csv|json|png)$", name)):
                    wrong.append(f"{page.name}: {name}")
    assert wrong == []


def test_files_named_in_sentences_exist():
    missing = []
    for page in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *USER_PAGES):
        text = page.read_text("utf-8")
        for name in re.findall(r"`((?:tex_lightning|conf|tests|benchmarks)/[\w./]+)`", text):
            if "NAME" not in name and not (ROOT / name).exists():
                missing.append(f"{page.name}: {name}")
    assert missing == []


def test_the_way_from_a_file_to_a_label_is_that_of_the_code():
    text = (ROOT / "docs" / "extend.md").read_text("utf-8")
    text = text.partition("## From a file to a label\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| [^|]+ \| `([\w/]+\.py)` \| (.+?) \| (.*?) ?\|$", text, re.MULTILINE)
    assert len(rows) > 25
    for file, names, _ in rows:
        module = (ROOT / "tex_lightning" / file).read_text("utf-8")
        for name in re.findall(r"`(\w+)`", names):
            assert re.search(rf"^(def|class) {name}\b|^{name} = ", module, re.MULTILINE), name
    code = "".join(path.read_text("utf-8") for path in (ROOT / "tex_lightning").rglob("*.py"))
    for name in re.findall(r"`([A-Z][a-z]\w+)`", "".join(result for *_, result in rows)):
        assert re.search(rf"^class {name}\b|import .*\b{name}\b", code, re.MULTILINE), name
    for file in re.findall(r"`(\w+/[\w/]+\.py)`", text):
        assert (ROOT / "tex_lightning" / file).is_file(), file


@functools.cache
def script(name: str) -> dict[str, Any]:
    """What a script of the documentation defines."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "docs"))
        return runpy.run_path(str(ROOT / "docs" / f"{name}.py"))


def test_every_script_takes_names_that_there_are():
    for path in (ROOT / "docs").glob("*.py"):
        if path.stem != "conf":  # which needs the extra docs
            assert script(path.stem)


def test_drawings_and_tables_of_layers_are_those_of_the_code():
    made = script("draw_networks")["made_files"]()
    assert {path.name for path in made} == {
        "networks.md", "hapticnet.svg", "visualnet.svg", "fusionnet.svg"
    }  # fmt: skip
    assert [path.name for path, text in made.items() if path.read_text("utf-8") != text] == []


@pytest.mark.slow
def test_no_generated_table_is_empty():
    text = "".join(page.read_text("utf-8") for page in USER_PAGES)
    filled = re.findall(r"<!-- made by .+? -->\n\n(?:\|.+\|\n){4,}\n<!-- end -->", text)
    assert len(filled) == text.count("<!-- made by ") >= 6
    made = script("conf")["MADE"]
    assert {f"<!-- made at build: {name} -->" for name in made} == {
        *re.findall("<!-- made at build: .+? -->", text)
    }
    house = made["house"]()
    packages = {path.name for path in (ROOT / "tex_lightning").iterdir() if path.is_dir()}
    packages -= {"__pycache__", "conf"}
    assert packages <= {*re.findall(r"^\| `(\w+)` \| \w", house, re.MULTILINE)}


COUNTED = re.compile(
    r"([\d.]+) % \((\d+)/(\d+)\)(?:\*\*)?(?: \||,)\s([\d.]+) to ([\d.]+) %"
)  # share, counts and interval


def test_shares_and_intervals_are_those_of_their_counts():
    rows = [row for page in PAGES for row in COUNTED.findall(page.read_text("utf-8"))]
    assert len(rows) > 40
    for row in rows:
        correct, count = int(row[1]), int(row[2])
        interval = binomtest(correct, count).proportion_ci(0.95, "wilson")
        figures = (correct / count, interval.low, interval.high)
        written = (row[0], row[3], row[4])
        assert [f"{100 * each:.1f}" for each in figures] == [f"{float(w):.1f}" for w in written]


def test_figures_of_the_pages_are_those_of_reports_with_a_commit():
    texts = [page.read_text("utf-8") for page in REPORTS]
    for page, text in zip(REPORTS, texts, strict=True):
        assert re.match(r"\d{4}-\d\d-\d\d-", page.name)
        assert {"Date", "Commit", "Machine", "Data"} <= {*re.findall(r"^- \*\*(\w+):", text, re.M)}
        assert re.search(r"\b[0-9a-f]{7,8}\b", text), page.name
        assert "```bash" in text or re.search(r"`benchmarks/\w+.py` of commit \w+", text)
    reported = {row[1:3] for text in texts for row in COUNTED.findall(text)}
    for page in (ROOT / "README.md", *USER_PAGES):
        quoted = {row[1:3] for row in COUNTED.findall(page.read_text("utf-8"))}
        assert quoted <= reported, page.name


QUOTED = re.compile(r"(\d+)(?:/| of (?:the |all )?)(\d\d+)\b")  # correct of tested recordings
SHARE = re.compile(r"\b(\d+(?:\.\d+)?) %(?! interval)|\b(0\.\d{3})\b")  # accuracies, areas
CLAIMS = {"README.md", "benchmarks.md", "calibration.md", "choose.md", "evaluate.md",
          "limitations.md"}  # fmt: skip


def statements(page: Path) -> Iterator[str]:
    """Paragraphs, items and rows of tables, without commands; a row has the sentence below, too."""
    text = re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    parts = re.split(r"\n\n|\n(?=- )", text)
    for part, after in zip(parts, [*parts[1:], ""], strict=True):
        rows = part.splitlines() if part.startswith("|") else [part]
        own = [row if "](" in row or row == part else f"{row} {after}" for row in rows]
        yield from own


def is_reported(figure: str, reports: str) -> bool:
    """Whether some share, area or ratio of counts in reports reads so when it is rounded."""
    digits = len(figure.partition(".")[2])
    found = [float(share or area) for share, area in SHARE.findall(reports)]
    found += [100 * int(correct) / int(tested) for correct, tested in QUOTED.findall(reports)]
    return any(f"{value:.{digits}f}" == figure for value in found)


@pytest.mark.parametrize("name", sorted(CLAIMS))
def test_a_measured_figure_stands_beside_the_report_that_has_it(name):
    page = ROOT / name if name == "README.md" else ROOT / "docs" / name
    claims = 0
    for statement in statements(page):
        counts, shares = QUOTED.findall(statement), SHARE.findall(statement)
        linked = re.findall(r"\]\((?:docs/)?(reports/[\w.-]+)", statement)
        if not linked and not counts and (not shares or name == "benchmarks.md"):
            continue  # settings of what is measured
        assert linked, statement
        texts = "".join((ROOT / "docs" / file).read_text("utf-8") for file in {*linked})
        claims += len(counts) + len(shares)
        assert {*counts} <= {*QUOTED.findall(texts)}, statement
        missing = [x or y for x, y in shares if not is_reported(x or y, texts)]
        assert missing == [], statement
    assert claims > 0


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in links(page):
        if target.startswith("http"):
            continue
        file, _, anchor = target.partition("#")
        found = page.parent / file if file else page
        assert found.exists(), target
        assert not anchor or anchor in anchors(found), target


# What a newcomer asks, and the page or section with the answer.
QUESTIONS = {
    "How do I install it, and what does the first run print?": "start.md",
    "In which folders do my recordings belong?": "data.md#folder-layout",
    "My sensor has another rate and three axes: what do I do?": "data.md#sampling-rate",
    "How do I classify one file?": "predict.md#classify-files",
    "How do I use it in a program?": "predict.md#from-python",
    "Which model should I take for my data?": "choose.md",
    "I have three recordings of each class: does it work?": "choose.md#few-recordings-of-a-class",
    "How do I keep one person out of training and test it?": "evaluate.md#groups",
    "How far can I trust a probability?": "calibration.md#probabilities",
    "What happens with a material that it does not know?": "calibration.md#unknown-materials",
    "How do I add a class later?": "add_class.md",
    "How do I run it on a small computer or in a browser?": "deploy.md#without-pytorch",
    "How do I use several GPUs or a cluster?": "scale.md#clusters-and-several-gpus",
    "How do I add my own network?": "extend.md#classes",
    "How does the code get from a file to a label?": "extend.md#from-a-file-to-a-label",
    "How do I repeat a row of the paper?": "paper.md#one-row",
    "Where does a figure come from?": "benchmarks.md#reports",
    "What does this key mean, and what is its default?": "keys.md",
    "What can it not do?": "limitations.md",
    "May I load a checkpoint of a stranger?": "limitations.md#security",
    "What does this word mean?": "glossary.md",
}


def test_every_question_is_answered_within_two_clicks():
    for start in ("README.md", "docs/index.md"):
        reached = {ROOT / start}
        for _ in range(2):
            targets = {
                (page.parent / target.partition("#")[0]).resolve()
                for page in reached
                for target in links(page)
                if not target.startswith("http")
            }
            reached |= {path for path in targets if path.suffix == ".md"}
        for question, answer in QUESTIONS.items():
            file, _, anchor = answer.partition("#")
            page = ROOT / "docs" / file
            assert page in reached, question
            assert not anchor or anchor in anchors(page), question


def test_at_most_eighteen_pages_are_linked_from_the_first():
    pages = {page.name for page in USER_PAGES} - {"index.md"}
    assert len(pages) <= 18
    assert pages <= {*links(ROOT / "docs" / "index.md")}


def test_the_rows_of_the_paper_are_its_figures_and_presets():
    rows = [row for name in ("haptic", "visual", "fusion") for row in paper_tables()[name]["rows"]]
    published = {
        row["label"]: [f"{row[key]:g} %" if key in row else "" for key in ("fragment", "vote")]
        for row in rows
        if {"fragment", "vote"} & {*row}
    }
    text = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    found = re.findall(r"^\| (.+?) \| (.*?) ?\| (.*?) ?\| `(\w+=.+)` \|$", text, re.MULTILINE)
    assert {label: [fragment, vote] for label, fragment, vote, _ in found} == published
    for label, *_, overrides in found:
        config = read_config(compose_config(overrides.split()))
        (row,) = [row for row in rows if row["label"] == label]
        assert config.model.name == row["model"], label


LINT = "ruff check . && ruff format --check . && mypy && lint-imports"


def shell_lines(name: str) -> list[str]:
    blocks = re.findall(r"```bash\n(.*?)```", (ROOT / name).read_text(), re.DOTALL)
    return [line for block in blocks for line in block.splitlines() if line]


def test_the_commands_are_those_of_ci():
    ci = (ROOT / ".ci" / "run").read_text().splitlines()
    first, second, *_ = shell_lines("README.md")
    assert "pip install -c constraints.txt ." in first
    assert first.endswith("python -m tex_lightning model=fusion")
    assert second == 'pip install -c constraints.txt ".[dev]" && python -m pytest'
    assert {second, LINT} <= {*ci} & {*shell_lines("CONTRIBUTING.md"), second}
    makefile = (ROOT / "Makefile").read_text()
    assert LINT in makefile
    rules = re.findall(r"^(\w+):$", makefile, re.MULTILINE)
    assert rules == ["install", "run", "test", "lint", "docs"]


def test_versions_agree():
    version = tl.__version__
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"\n## {version}" in (ROOT / "CHANGELOG.md").read_text()
