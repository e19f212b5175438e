"""Classes of every form are built from a node."""

from dataclasses import InitVar, dataclass, field
from functools import partial
from typing import Any

import pytest

from tex_lightning.config.instantiation import build_typed, find_class
from tex_lightning.errors import UserError


@dataclass
class Plain:
    folder: str
    rate: float = 10.0
    inner: Any = None


class Heir(Plain):
    """Inherits fields and takes other arguments."""

    def __init__(self, folder: str, *, tag: str = "x"):
        super().__init__(folder)
        self.tag = tag


@dataclass
class Given:
    folder: InitVar[str]
    kept: dict[str, int] = field(default_factory=dict, init=False)

    def __post_init__(self, folder: str) -> None:
        self.shelf = folder


class Placed:
    def __init__(self, first: str, /, **more: object):
        self.first, self.more = first, more


def node(cls: type, **values: object) -> dict[str, object]:
    return {"_target_": f"{__name__}.{cls.__name__}", **values}


def test_types_of_a_dataclass_hold():
    assert build_typed("data.reader", node(Plain, folder="a", rate=3)).rate == 3
    with pytest.raises(UserError, match=r"data\.reader cannot be made: Value 'fast'"):
        build_typed("data.reader", node(Plain, folder="a", rate="fast"))
    with pytest.raises(UserError, match=r"no key data\.reader\.rat \(did you mean .*rate"):
        build_typed("data.reader", node(Plain, folder="a", rat=3))


def test_a_constructor_of_its_own_counts():
    made = build_typed("data.reader", node(Heir, folder="a", tag="y"))
    assert (made.folder, made.rate, made.tag) == ("a", 10.0, "y")
    assert build_typed("data.reader", node(Given, folder="b")).shelf == "b"
    placed = build_typed("data.reader", node(Placed, _args_=["c"], more=1))
    assert (placed.first, placed.more) == ("c", {"more": 1})


def test_nodes_inside_are_built():
    inner = node(Plain, folder="in", rate=2)
    assert build_typed("data.reader", node(Plain, folder="a", inner=inner)).inner.rate == 2
    listed = build_typed("data.reader", node(Plain, folder="a", inner=[{"x": inner}])).inner
    assert listed[0]["x"].folder == "in"
    call = {"_target_": "builtins.len", "_partial_": True}
    made = build_typed("data.reader", node(Plain, folder="a", inner=call)).inner
    assert isinstance(made, partial)
    assert made("abc") == 3


def test_a_broken_import_in_a_module_is_named_and_no_missing_attribute(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "half_broken").mkdir()
    (tmp_path / "half_broken" / "__init__.py").touch()
    (tmp_path / "half_broken" / "parts.py").write_text("import no_such_library\n")
    with pytest.raises(UserError, match="No module named 'no_such_library'"):
        find_class("model.force.network", {"_target_": "half_broken.parts.Net"})
