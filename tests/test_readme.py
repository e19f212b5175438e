"""The README's commands are the ones that continuous integration runs; links lead somewhere."""

import re
from pathlib import Path

import pytest

from tex_lightning.config import CONF

ROOT = CONF.parent


def commands() -> list[str]:
    blocks = re.findall(r"```bash\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    return [line for block in blocks for line in block.splitlines() if line]


def test_the_second_command_installs_and_tests_as_ci_does():
    assert commands()[1] == 'pip install -c constraints.txt ".[dev]" && python -m pytest'
    ci = (ROOT / ".ci" / "run").read_text().splitlines()
    assert commands()[1] in ci
    lint = "ruff check . && ruff format --check . && mypy && lint-imports"
    assert lint in ci
    assert lint in commands()


def test_the_first_command_installs_and_runs_the_main_job():
    first = commands()[0]
    assert "pip install -c constraints.txt ." in first
    assert first.endswith("python -m tex_lightning model=fusion")


PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def anchors(page: Path) -> set[str]:
    """Of the headings, as GitHub and MyST make them."""
    fences = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    titles = re.findall(r"^#+ (.+)$", fences, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if target.startswith("http"):
            continue
        file, _, anchor = target.partition("#")
        found = page.parent / file if file else page
        assert found.exists(), target
        assert not anchor or anchor in anchors(found), target


def test_the_readme_is_short_and_names_every_chapter():
    text = PAGES[0].read_text()
    assert len(text.splitlines()) <= 200
    chapters = [page for page in PAGES[1:] if page.name != "index.md"]
    assert [page.name for page in chapters if f"(docs/{page.name})" not in text] == []
