"""The packages and the imports between them, made from the code: ``python docs/house.py``."""

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

from tex_lightning.report.table import markdown

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "tex_lightning"
HEADINGS = ("package", "purpose", "imports")


def layers() -> list[str]:
    """Return the packages from top to bottom, as ``lint-imports`` checks them."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    lines = settings["tool"]["importlinter"]["contracts"][0]["layers"]
    return [name.strip() for line in lines for name in line.split(":")]


def modules(package: str) -> list[Path]:
    """Return the files of a package, or of a single module."""
    folder = PACKAGE / package
    return sorted(folder.rglob("*.py")) if folder.is_dir() else [folder.with_suffix(".py")]


def imports(package: str) -> set[str]:
    """Return the packages that the modules of ``package`` import."""
    trees = (ast.parse(file.read_text("utf-8")) for file in modules(package))
    names = {name for tree in trees for name in _modules(tree)}
    parts = [name.split(".") for name in names if name.startswith("tex_lightning.")]
    return {part[1] for part in parts} - {package}


def _modules(tree: ast.AST) -> Iterator[str]:
    """Yield what a module imports from, except for type checkers alone."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
        yield from _modules(node)


def purpose(file: Path) -> str:
    """Return the first paragraph of a module's docstring."""
    text = ast.get_docstring(ast.parse(file.read_text("utf-8"))) or ""
    first = " ".join(text.partition("\n\n")[0].split()).replace("``", "`")
    return re.sub(r":\w+:(?=`)", "", first)


def house() -> str:
    """Return the table of packages in Markdown, and that of the modules of each."""
    names, rows, tables = layers(), [], []
    for name in names:
        below = ", ".join(f"`{other}`" for other in names if other in imports(name))
        first, *others = sorted(modules(name), key=lambda file: file.name != "__init__.py")
        rows.append([f"`{name}`", purpose(first), below])
        root = PACKAGE / name
        lines = [[f"`{file.relative_to(root)}`", purpose(file)] for file in others]
        if lines:
            tables += ["", f"### {name}", "", *markdown(("module", "purpose"), lines)]
    return "\n".join([*markdown(HEADINGS, rows), *tables])


if __name__ == "__main__":
    print(house())
