"""Read the signature of a class from its source, without importing it.

A command line is checked before PyTorch is imported, which takes seconds, and so are keys of
classes that need it. Annotations may name types, aliases and constants of their module, or of one
that it imports them from. What cannot be told so is checked when the class is built.
"""

import ast
import builtins
import collections.abc
import sys
import typing
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any, ForwardRef, Literal, get_args, get_origin

from tex_lightning.config.keys import without_extras
from tex_lightning.config.signatures import collects, handing_on

TYPES = ("bool", "int", "float", "str", "list", "tuple", "dict")
LIBRARIES = {"typing": typing, "collections.abc": collections.abc}
EVALUATED = (
    ast.Expression, ast.Name, ast.Load, ast.Constant, ast.Subscript, ast.Tuple, ast.List, ast.Dict,
    ast.Attribute, ast.BinOp, ast.operator, ast.UnaryOp, ast.unaryop, ast.JoinedStr,
    ast.FormattedValue,
)  # fmt: skip
INIT = "__init__.py"
NO_PARAMETERS = ("ABC", "Generic", "Protocol", "object")  # classes that give none


class _AnyClass(type):
    """Type of :class:`Other`, which every attribute of it is again."""

    def __getattr__(cls, name: str) -> "type[Other]":
        if name.startswith("__"):
            raise AttributeError(name)
        return Other

    def __getitem__(cls, item: object) -> "type[Other]":
        return Other

    def __format__(cls, spec: str) -> str:
        raise TypeError  # a range with it is none


class Other(metaclass=_AnyClass):
    """A class, or a value, that is not known without importing something."""


class _Module(dict[str, Any]):
    """The names that a module defines, evaluated from its syntax on access."""

    def __init__(self, name: str, path: Path) -> None:
        super().__init__({each: getattr(builtins, each) for each in TYPES})
        self.package = name if path.stem == "__init__" else name.rpartition(".")[0]
        self.assigned: dict[str, ast.expr] = {}
        self.classes: dict[str, ast.ClassDef] = {}
        self.imported: dict[str, tuple[str, str]] = {}  # module and name there
        for node in ast.parse(path.read_bytes()).body:
            if isinstance(node, ast.Assign):
                self.assigned |= dict(_assigned(node.targets[0], node.value))
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                if node.value is not None:
                    self.assigned[node.target.id] = node.value
            elif isinstance(node, ast.ClassDef):
                self.classes[node.name] = node
            elif isinstance(node, ast.ImportFrom):
                source = self._source(node)
                for alias in node.names:
                    self.imported[alias.asname or alias.name] = (source, alias.name)

    def _source(self, node: ast.ImportFrom) -> str:
        parents = self.package.split(".")
        above = parents[: len(parents) + 1 - node.level] if node.level else []
        return ".".join([*above, *filter(None, [node.module])])

    def __missing__(self, name: str) -> Any:  # noqa: ANN401
        if name in self.assigned:
            self[name] = Other  # of what refers to itself
            self[name] = self.evaluate(self.assigned[name])
            return self[name]
        source, name = self.imported.get(name, ("", ""))
        if source in LIBRARIES:
            return getattr(LIBRARIES[source], name, Other)
        module = _module(source)
        return Other if module is None else module[name]

    def find(self, name: str) -> "tuple[_Module, ast.ClassDef] | None":
        """Return a class that a name stands for, and the module that defines it."""
        if name in self.classes:
            return self, self.classes[name]
        source, name = self.imported.get(name, ("", ""))
        module = _module(source)
        return None if module is None else module.find(name)

    def evaluate(self, node: ast.expr) -> Any:  # noqa: ANN401
        """Return the value of an expression, :class:`Other` where it would run code."""
        if not all(isinstance(part, EVALUATED) for part in ast.walk(node)):
            return Other
        try:
            code = compile(ast.Expression(node), "annotation", "eval")
            return eval(code, {"__builtins__": {}}, self)
        except Exception:  # of what is no annotation
            return Other

    def hint(self, annotation: ast.expr | None) -> Any:  # noqa: ANN401
        """Return the value of an annotation, ``Any`` where a part of it is not known."""
        hint: Any = Any if annotation is None else self.evaluate(annotation)
        if get_origin(hint) is Annotated and _mentions_other(hint):
            return Annotated[Any, *hint.__metadata__]
        return Any if _mentions_other(hint) else hint

    def parameter(self, name: str, hint: ast.expr | None, default: ast.expr | None) -> Parameter:
        """Return a parameter with its annotation and default, where there are such."""
        given = Parameter.empty if default is None else self.evaluate(default)
        kind = Parameter.POSITIONAL_OR_KEYWORD
        return Parameter(name, kind, default=given, annotation=self.hint(hint))


def _mentions_other(hint: Any) -> bool:  # noqa: ANN401
    """Return whether a class that is not known, or a name in quotes, is a part of an annotation."""
    hint = without_extras(hint)
    known = get_origin(hint) is Literal or not any(map(_mentions_other, get_args(hint)))
    return hint is Other or isinstance(hint, str | ForwardRef) or not known


def _assigned(target: ast.expr, value: ast.expr) -> Iterator[tuple[str, ast.expr]]:
    """Yield names and what is assigned to them, several at once as well."""
    if isinstance(target, ast.Name):
        yield target.id, value
    elif isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        for pair in zip(target.elts, value.elts, strict=False):
            yield from _assigned(*pair)


def _module(name: str) -> _Module | None:
    """Return what the file of a module holds; None if there is none that can be read."""
    file = _file(name, tuple(sys.path))
    return _parsed(name, file, file.stat().st_mtime_ns) if file and file.is_file() else None


@cache
def _file(name: str, folders: tuple[str, ...]) -> Path | None:
    """Return the file of a module that is found in some folders."""
    top, *inner = name.split(".")
    try:
        spec = find_spec(top) if top else None  # which imports no more than that has been
    except (ImportError, ValueError):
        return None
    files = [Path(spec.origin)] if spec is not None and spec.origin else []
    if inner:
        homes = map(Path, (spec and spec.submodule_search_locations) or ())
        places = [home.joinpath(*inner) for home in homes]
        files = [file for place in places for file in (place.with_suffix(".py"), place / INIT)]
    return next((file for file in files if file.suffix == ".py" and file.is_file()), None)


@cache
def _parsed(name: str, file: Path, changed: int) -> _Module | None:
    """Return the names of a file as it was when it was last changed, in a notebook perhaps."""
    try:
        return _Module(name, file)
    except (OSError, SyntaxError, ValueError):
        return None


def read_signature(target: str) -> Signature | None:
    """Return the signature of the class at a dotted path, without importing its module.

    Returns:
        What :func:`inspect.signature` would give, with annotations that are evaluated, of an
        unknown class ``Any``; None if that cannot be told from the source.
    """
    return _known(target) if target.startswith("tex_lightning.") else _read(target)


def _read(target: str) -> Signature | None:
    source, _, name = target.rpartition(".")
    module = _module(source)
    try:
        found = None if module is None else module.find(name)
        parameters = None if found is None else _parameters(*found)
        return None if parameters is None else Signature(parameters)
    except (RecursionError, ValueError):  # of classes in a circle, of fields in another order
        return None


_known = cache(_read)  # of the package, whose files stay as they are; every command asks often


def _parameters(module: _Module, node: ast.ClassDef) -> list[Parameter] | None:
    """Return what a class takes, by its constructor, its fields or the class that it derives of.

    What a decorator or an assignment makes of the constructor is not known.
    """
    decorators = [ast.unparse(decorator) for decorator in node.decorator_list]
    made = any("dataclass" not in each or "init=False" in each for each in decorators)
    bases = [base for base in map(_bare, node.bases) if base not in NO_PARAMETERS]
    found = [module.find(base) for base in bases]
    for part in node.body:
        if isinstance(part, ast.FunctionDef) and part.name in ("__init__", "__new__"):
            own = [*_arguments(module, part.args)][1:]
            base = next(filter(None, found), None) if collects(own) else None
            handed = _parameters(*base) if base else None
            return None if made or part.decorator_list else handing_on(own, handed or ())
        made |= isinstance(part, ast.Assign) and _bare(part.targets[0]) == "__init__"
    if made or None in found:
        return None
    if not decorators:
        return _parameters(*found[0]) if found and found[0] else None
    apart = any("kw_only=True" in decorator for decorator in decorators)
    kind = Parameter.KEYWORD_ONLY if apart else Parameter.POSITIONAL_OR_KEYWORD
    fields: dict[str, Parameter] = {}
    for each in filter(None, reversed(found)):  # as the fields of the first count
        inherited = _parameters(*each) if each[1].decorator_list else ()
        fields |= {parameter.name: parameter for parameter in inherited or ()}
    fields |= {each.name: each.replace(kind=kind) for each in _fields(module, node)}
    return sorted(fields.values(), key=lambda each: each.kind)


def _bare(base: ast.expr) -> str:
    """Return the name of a base class without what stands in brackets."""
    return ast.unparse(base).partition("[")[0]


def _fields(module: _Module, node: ast.ClassDef) -> Iterator[Parameter]:
    for part in node.body:
        if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name):
            value = part.value
            made = value.keywords if isinstance(value, ast.Call) else []
            left_out = any(ast.unparse(each) == "init=False" for each in made)
            if not (left_out or _bare(part.annotation).endswith("ClassVar")):
                yield module.parameter(part.target.id, part.annotation, part.value)


def _arguments(module: _Module, node: ast.arguments) -> Iterator[Parameter]:
    positional = [*node.posonlyargs, *node.args]
    without = [None] * (len(positional) - len(node.defaults))
    for each, default in zip(positional, [*without, *node.defaults], strict=True):
        yield module.parameter(each.arg, each.annotation, default)
    for each, default in zip(node.kwonlyargs, node.kw_defaults, strict=True):
        parameter = module.parameter(each.arg, each.annotation, default)
        yield parameter.replace(kind=Parameter.KEYWORD_ONLY)
    if node.kwarg is not None:
        yield Parameter(node.kwarg.arg, Parameter.VAR_KEYWORD)
