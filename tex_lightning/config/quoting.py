"""Keep names as they were typed, where Hydra's grammar would read numbers or booleans.

A class ``1_0`` would be ``10``, a session ``2024_05_01`` would be ``20240501``, a folder ``1e3``
would be ``1000.0``. So the values of keys that hold text are put in quotes before Hydra sees them,
also those that its grammar has no letters for, such as ``~/recordings`` or ``Grün``.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_args, get_origin

from hydra.conf import HydraConf
from hydra.core.override_parser.overrides_parser import create_functions
from hydra.core.override_parser.overrides_visitor import HydraErrorListener, HydraOverrideVisitor
from hydra.core.override_parser.types import Quote, QuotedString
from hydra.errors import HydraException
from hydra.grammar.gen.OverrideLexer import (  # type: ignore[attr-defined]
    CommonTokenStream,
    InputStream,
    OverrideLexer,
)
from hydra.grammar.gen.OverrideParser import OverrideParser

from tex_lightning.config import Config
from tex_lightning.config.keys import Key, hints_of, without_extras
from tex_lightning.config.model import CHECKPOINT

OVERRIDE = re.compile(r"(\+{0,2}([^=~+]+)=)(.+)", re.DOTALL)
# A number or a logical value, as a value or an item; else nothing has to be parsed.
TYPED = re.compile(
    r"(^|[\[{(,:\s])([-+]?(\.?\d[\d._]*(e[-+]?[\d_]+)?|inf|nan)|true|false)(?=$|[\]}),:\s])", re.I
)
# Quoted text and interpolations, which stay, and a sign that the lexer lacks.
FOREIGN = re.compile(
    r"(?<![^\[{(,:=\s])(?:\"(?:\\.|[^\"\\])*\"|'(?:\\.|[^'\\])*')|\$\{[^}]*\}"
    r"|([^A-Za-z0-9_/\\+.$%*@?|:=,()\[\]{} \t-])"
)
MASK = re.compile(r"@u([0-9a-f]+)u@")
VERBATIM = ("pattern",)  # keys whose braces and commas are text
OF_NAMES = ("choice", "sort", "shuffle")  # functions of Hydra whose arguments may be names


def as_typed(overrides: Sequence[str]) -> list[str]:
    """Return overrides in which names are in quotes where Hydra would read something else.

    A path that begins with ``~/`` leads to the user's home, as most shells have it.

    Args:
        overrides: Such as ``record.label=1_0``; what Hydra cannot read stays for it to report.

    Example:
        >>> from tex_lightning.config.quoting import as_typed
        >>> as_typed(["record.label=1_0", "data.hold_out=[oak,1e3]", "seed=1_0"])
        ['record.label="1_0"', 'data.hold_out=[oak,"1e3"]', 'seed=1_0']
    """
    return [_as_typed(override) for override in overrides]


def _as_typed(override: str) -> str:
    match = OVERRIDE.fullmatch(override)
    if match is None or not holds_text(match[2]):
        return override
    if match[2] in VERBATIM and match[3][0] not in "\"'":
        return match[1] + QuotedString(match[3], Quote.double).with_quotes()
    value = FOREIGN.sub(lambda found: f"@u{ord(found[1]):x}u@" if found[1] else found[0], match[3])
    if value == match[3] and not TYPED.search(value):
        return override
    try:
        replaced = [*_names(value)]
    except HydraException:
        return override
    for start, stop, name in reversed(replaced):
        value = value[:start] + QuotedString(name, Quote.double).with_quotes() + value[stop:]
    return match[1] + value


def _names(value: str) -> Iterator[tuple[int, int, str]]:
    """Yield begin, end and text of each name in a value that is to be quoted.

    Raises:
        HydraException: If Hydra's grammar does not have such a value.
    """
    lexer, listener = OverrideLexer(InputStream(value)), HydraErrorListener()
    lexer.mode(OverrideLexer.VALUE_MODE)
    parser = OverrideParser(tokens := CommonTokenStream(lexer))
    for part in (lexer, parser):
        part.removeErrorListeners()
        part.addErrorListener(listener)
    tree: Any = parser.value()  # type: ignore[no-untyped-call]
    if tokens.LA(1) >= 0:
        raise HydraException("there is more behind the value")
    visitor = HydraOverrideVisitor(create_functions())
    for primitive in _primitives(tree):
        read = visitor.visitPrimitive(primitive)
        start, stop = primitive.start.start, primitive.stop.stop + 1
        typed = read if isinstance(read, str) else value[start:stop].strip(" \t")
        text = MASK.sub(lambda found: chr(int(found[1], 16)), typed)
        name = str(Path(text).expanduser()) if text.startswith("~/") else text
        if read is not None and not isinstance(read, QuotedString) and name != str(read):
            yield start, stop, name


def _primitives(tree: Any) -> Iterator[OverrideParser.PrimitiveContext]:  # noqa: ANN401
    """Yield the values of a tree in order, without keys of dictionaries."""
    if isinstance(tree, OverrideParser.PrimitiveContext):
        yield tree
    elif not isinstance(tree, OverrideParser.FunctionContext) or str(tree.ID()) in OF_NAMES:  # type: ignore[no-untyped-call]
        for child in getattr(tree, "children", None) or ():
            yield from _primitives(child)


@cache
def holds_text(name: str) -> bool:
    """Return whether a key of an override holds names, paths or other text.

    Names of options of a group are text, and so is a key that there is not: files of a modality of
    the user's own are given by its name.
    """
    if name.endswith(CHECKPOINT) or name.startswith("data.reader.") or {*name} & {"/", "@"}:
        return True  # the fields of a reader become what their types say
    first, *parts = name.split(".")
    section: Any = HydraConf if first == "hydra" else Config
    for part in parts if first == "hydra" else (first, *parts):
        hint = hints_of(section).get(part)
        if hint is None:
            return not parts
        section = without_extras(hint)
        if not is_dataclass(section):
            return Key.of(hint).text or _takes_text(section)
    return True


def _takes_text(hint: Any) -> bool:  # noqa: ANN401
    """Return whether values of a type, or the items of a list or dictionary, are text."""
    inner = get_args(hint)[1:] if get_origin(hint) is dict else get_args(hint)
    return hint is str or any(map(_takes_text, inner))
