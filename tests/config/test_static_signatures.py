"""Signatures are read from source as Python has them, and nothing is imported for that."""

import inspect
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import configured_classes

from tex_lightning.config.instantiation import find_class
from tex_lightning.config.keys import Key, without_extras
from tex_lightning.config.signatures import signature_of
from tex_lightning.config.static_signatures import read_signature

DECODERS = [f"tex_lightning.data.decode.{kind}Decoder" for kind in ("Signal", "Photo")]
READERS = [
    f"tex_lightning.data.readers.{name}"
    for name in ("folder.FolderReader", "published.PatternReader", "synthetic.SyntheticReader")
]


@pytest.mark.parametrize("target", sorted(configured_classes()) + DECODERS + READERS)
def test_a_class_of_the_package_has_the_signature_that_python_gives_it(target):
    read = read_signature(target)
    known = signature_of(find_class("x", {"_target_": target}))
    assert [*read.parameters] == [*known.parameters]
    for name, parameter in read.parameters.items():
        other = known.parameters[name]
        assert parameter.kind is other.kind
        assert (parameter.default is parameter.empty) == (other.default is other.empty)
        assert Key.of(parameter.annotation) == Key.of(other.annotation)
        kind = without_extras(parameter.annotation)
        assert kind in (Any, without_extras(other.annotation))


PACKAGE = {
    "__init__.py": "from .inner import Heir as Named\nfrom . import constants\n",
    "constants.py": """
from typing import Literal
MOST = 2 ** 6
Kind = Literal["a", "b"]
Round = Round
""",
    "inner.py": """
import no_such_library
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar, Optional
from .constants import MOST, Kind as Sort, Round
Path(__file__).with_suffix(".ran").touch()

class Base:
    def __init__(self, size: Annotated[int, f"[1, {MOST}] mm", "a size"], sort: Sort = "a", *,
                 path: "str" = "", other: no_such_library.X | None = None, ran: open("x") = 1,
                 round: Round = 0, **more) -> None: ...

class Heir(Base):
    pass

class Handing(Base):
    def __init__(self, *args, sort: int, **more): ...

@dataclass
class First:
    a: int

@dataclass
class Second:
    b: Optional[float] = None
    made: list = field(init=False)
    none: ClassVar[int] = 3

@dataclass
class Both(Second, First):
    c: float = field(default=1.0)

class Circle(Circle):
    pass

class Child(no_such_library.Thing):
    pass

@no_such_library.define
class Defined(Base):
    more: int = 1

class Assigned(Base):
    __init__ = no_such_library.made

@dataclass
class Beyond(no_such_library.Thing):
    a: int = 1

class Wrapped(Base):
    @no_such_library.wrapped
    def __init__(self, a): ...
""",
    "broken.py": "class Broken:\n    def\n",
}


@pytest.fixture
def package(tmp_path, monkeypatch) -> Path:
    folder = tmp_path / f"read_{tmp_path.name.replace('-', '_')}"
    folder.mkdir()
    for name, text in PACKAGE.items():
        (folder / name).write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    return folder


def test_names_are_followed_and_code_is_not_run(package):
    signature = read_signature(f"{package.name}.Named")
    size, sort, path, other, ran, round_, more = signature.parameters.values()
    assert Key.of(size.annotation) == Key("a size", "[1, 64]", "mm")
    assert Key.of(sort.annotation).choices == ("a", "b")
    assert sort.default == "a"
    assert (path.kind, more.kind) == (path.KEYWORD_ONLY, more.VAR_KEYWORD)
    assert {other.annotation, ran.annotation, round_.annotation} == {Any}
    assert not (package / "inner.ran").exists()
    assert package.name not in sys.modules


def test_what_is_handed_on_is_taken_by_the_class_that_a_class_derives_of(package):
    read = read_signature(f"{package.name}.inner.Handing").parameters
    assert [*read] == ["sort", "size", "path", "other", "ran", "round", "more"]
    assert read["sort"].annotation is int
    assert Key.of(read["size"].annotation) == Key("a size", "[1, 64]", "mm")


def test_fields_come_in_the_order_of_dataclasses(package):
    parameters = read_signature(f"{package.name}.inner.Both").parameters
    assert [*parameters] == ["a", "b", "c"]
    assert parameters["b"].annotation == float | None
    assert parameters["a"].default is inspect.Parameter.empty


@pytest.mark.parametrize(
    "name",
    [
        "inner.Circle", "inner.Child", "inner.None", "inner.Defined", "inner.Assigned",
        "inner.Beyond", "inner.Wrapped", "broken.Broken", "no.Module", "Nothing",
    ],
)  # fmt: skip
def test_what_the_source_does_not_say_is_left_to_the_class(package, name):
    assert read_signature(f"{package.name}.{name}") is None
    assert read_signature(name) is None
    assert read_signature("sys.x") is None


NETWORK = """
from pathlib import Path
from typing import Annotated
from torch import nn

Path(__file__).with_suffix(".ran").touch()

class Ranged(nn.Module):
    def __init__(self, classes: int, hidden: Annotated[int, "[1, 64]", "channels"] = 8,
                 width: Annotated[float, "(0, 1]"] = 1.0) -> None:
        super().__init__()
        self.hidden = hidden
"""


WRONG = {
    "+model.haptic.network.hidden=65": "network.hidden is 65: give a number in [1, 64].",
    "model.haptic.width=2": "model.haptic.width is 2: give a number in (0, 1].",
    "+model.haptic.network.hiden=5": "network.hiden (did you mean model.haptic.network.hidden?)",
}


def test_a_class_of_ones_own_with_a_range_is_refused_by_the_same_sentence(tmp_path):
    """Before PyTorch, or the module of that class, is imported."""
    (tmp_path / "ranged_net.py").write_text(NETWORK)
    code = (
        "import sys; from tex_lightning.config.composition import compose_config\n"
        "from tex_lightning.config.check import checked_config\n"
        "for wrong in sys.argv[3:]:\n"
        "    try: checked_config(compose_config([*sys.argv[1:3], wrong]))\n"
        "    except Exception as error: print(error)\n"
        "print('torch' in sys.modules)"
    )
    target = "model.haptic.network._target_=ranged_net.Ranged"
    ran = subprocess.run(
        [sys.executable, "-c", code, "model=haptic", target, *WRONG],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    *sentences, imported = ran.stdout.splitlines()
    assert imported == "False"
    for sentence, said in zip(sentences, WRONG.values(), strict=True):
        assert said in sentence
    assert not (tmp_path / "ranged_net.ran").exists()


def test_a_file_that_changes_is_read_again(package):
    file = package / "changing.py"
    for number, name in enumerate(("one", "other")):
        file.write_text(f"class Net:\n    def __init__(self, {name}): ...\n")
        os.utime(file, (number, number))
        assert [*read_signature(f"{package.name}.changing.Net").parameters] == [name]
