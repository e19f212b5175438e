"""The README's commands are the ones that continuous integration runs."""

import re

from documentation import ROOT

import tex_lightning as tl

LINT = "ruff check . && ruff format --check . && mypy && lint-imports"


def commands(name: str) -> list[str]:
    blocks = re.findall(r"```bash\n(.*?)```", (ROOT / name).read_text(), re.DOTALL)
    return [line for block in blocks for line in block.splitlines() if line]


def test_the_commands_are_those_of_ci():
    ci = (ROOT / ".ci" / "run").read_text().splitlines()
    first, second, *_ = commands("README.md")
    assert "pip install -c constraints.txt ." in first
    assert first.endswith("python -m tex_lightning model=fusion")
    assert second == 'pip install -c constraints.txt ".[dev]" && python -m pytest'
    assert {second, LINT} <= {*ci} & {*commands("CONTRIBUTING.md"), second}
    makefile = (ROOT / "Makefile").read_text()
    assert LINT in makefile
    rules = re.findall(r"^(\w+):$", makefile, re.MULTILINE)
    assert rules == ["install", "run", "test", "lint", "docs"]


def test_versions_agree():
    version = tl.__version__
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"\n## {version}" in (ROOT / "CHANGELOG.md").read_text()
