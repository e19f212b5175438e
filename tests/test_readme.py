"""The README's commands are the ones that continuous integration runs."""

import re

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
