"""What docstrings refer to is there."""

import ast
import pkgutil
import re
from pathlib import Path

import pytest

import tex_lightning

ROOT = Path(tex_lightning.__file__).parent
MODULES = sorted(ROOT.rglob("*.py"))
REFERENCE = re.compile(r":(?:mod|class|func):`~?([^`<>]+)`")


def dotted(module: Path) -> str:
    return ".".join(module.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(".__init__")


def names_of(module: Path) -> set[str]:
    """The module, and what it defines or imports at its top."""
    tree, name = ast.parse(module.read_text(encoding="utf-8")), dotted(module)
    defined = (node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef))
    return {name, *(f"{name}.{each}" for each in defined)}


@pytest.fixture(scope="module")
def known() -> set[str]:
    return set().union(*map(names_of, MODULES))


@pytest.mark.parametrize("module", MODULES, ids=dotted)
def test_references_name_what_there_is(module, known):
    text = module.read_text(encoding="utf-8")
    for target in {match.replace("\n", "").replace(" ", "") for match in REFERENCE.findall(text)}:
        if target.startswith("."):
            assert any(name.endswith(target) for name in known), target
        elif "." not in target:
            assert f"{dotted(module)}.{target}" in known or re.search(
                rf"import .*\b{target}\b|^    {target},$", text, re.MULTILINE
            ), target
        else:
            assert target in known or pkgutil.resolve_name(target), target
