"""The pages of the documentation: their blocks, and the commands in these."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from hydra.core.override_parser.overrides_parser import OverridesParser

from tex_lightning.config import CONF

ROOT = CONF.parent
USER_PAGES = sorted((ROOT / "docs").glob("*.md"))
REPORTS = sorted((ROOT / "docs" / "reports").glob("*.md"))
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *USER_PAGES, *REPORTS]
START = "python -m tex_lightning"
MULTIRUN = ("-m", "--multirun")


@dataclass(frozen=True)
class Block:
    """A fenced block of a page.

    Attributes:
        page: Name of the file.
        line: Its first line in there, counted from 1.
        language: What stands behind the fence.
        text: What is inside, without indentation.
    """

    page: str
    line: int
    language: str
    text: str

    @property
    def lines(self) -> list[str]:
        """Lines of a shell block, continued ones joined."""
        return self.text.replace("\\\n", " ").splitlines()


def blocks(page: Path) -> Iterator[Block]:
    """Every block of a page that names its language, in order."""
    text = page.read_text(encoding="utf-8")
    for found in re.finditer(r"^( *)```(\w+)\n(.*?)^ *```$", text, re.DOTALL | re.MULTILINE):
        content = re.sub(f"^{found[1]}", "", found[3], flags=re.MULTILINE)
        yield Block(page.name, text.count("\n", 0, found.start()) + 1, found[2], content)


def commands(page: Path) -> Iterator[tuple[Block, str]]:
    """Commands of the shell blocks of a page, its own variables filled in."""
    variables: dict[str, str] = {}
    for block in blocks(page):
        for line in block.lines if block.language == "bash" else ():
            if assigned := re.fullmatch(r"([A-Z])=\"(.*)\"", line):
                variables[f"${assigned[1]}"] = assigned[2]
                continue
            for name, value in variables.items():
                line = line.replace(name, value)
            yield from ((block, part) for part in line.split(" && "))


def links(page: Path) -> Iterator[str]:
    """Targets of the links of a page, entries of its tables of contents included."""
    text = page.read_text(encoding="utf-8")
    yield from re.findall(r"\]\(([^)\s]+)\)", text)
    for block in re.findall(r"^```\{toctree\}\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        for line in block.splitlines():
            if line and not line.startswith(":"):
                found = sorted(page.parent.glob(f"{line}.md"))
                yield from (str(path.relative_to(page.parent)) for path in found)


def anchors(page: Path) -> set[str]:
    """Anchors of the headings of a page, as GitHub and MyST make them."""
    fences = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    titles = re.findall(r"^#+ (.+)$", fences, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


def package_arguments(command: str) -> list[str] | None:
    """What a command gives to this package; None if it runs something else."""
    _before, start, after = command.partition(f"{START} ")
    return shlex.split(re.split(r" [|;#<>] ", after)[0]) if start else None


def sweep_jobs(arguments: list[str]) -> list[str]:
    """Overrides without a sweep's own; of each choice of a sweep the first."""
    chosen = []
    for override in OverridesParser.create().parse_overrides(arguments):
        if override.is_hydra_override() or override.key_or_group.startswith("hydra"):
            continue
        if override.is_sweep_override():
            key = override.get_key_element()
            if override.is_choice_sweep():
                chosen.append(f"{key}={next(override.sweep_string_iterator())}")
        else:
            chosen.append(override.input_line)
    return chosen
