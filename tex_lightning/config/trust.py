"""Whose classes a checkpoint may name: importing a module runs its code.

Trusted are this package, installed packages with an entry point in ``tex_lightning.plugins``, those
that the caller lists, and those whose classes the run's own configuration trains with.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

from tex_lightning.config import Config
from tex_lightning.config.instantiation import TARGET, find_class
from tex_lightning.config.search import ENTRY_POINTS, installed_packages
from tex_lightning.errors import UserError, shorten

OWN = "tex_lightning"

_LISTED: ContextVar[frozenset[str]] = ContextVar("trusted", default=frozenset())


@contextmanager
def trusting(packages: Sequence[str]) -> Iterator[None]:
    """Trust these packages until the end of the block."""
    before = _LISTED.set(_LISTED.get() | {*packages})
    try:
        yield
    finally:
        _LISTED.reset(before)


def trust(config: Config) -> None:
    """Trust what a configuration lists, and the packages of the classes that it trains with."""
    model = config.model
    named = targets([model.baseline, *(model.branch(name).node for name in model.senses)])
    _LISTED.set(_LISTED.get() | {*config.trusted, *map(_package, named)})


def require_trust(who: str, node: object) -> None:
    """Refuse classes of untrusted packages in the metadata of a checkpoint.

    A trusted package cannot lend its name: the class has to be defined in it, so that a path
    through what a module imported leads nowhere.

    Args:
        who: The checkpoint, for the message.
        node: A part of its card.

    Raises:
        UserError: If a class is not trusted; nothing of its package was imported.
    """
    for target in targets(node):
        package = _package(target)
        listed = package in {OWN, *_LISTED.get()}
        if not listed and package not in installed_packages():  # which reads folders
            raise _refused(who, target, package)
        home = _package(find_class(who, {TARGET: target}).__module__)
        if home != package:
            raise _refused(who, target, home)


def _refused(who: str, target: str, package: str) -> UserError:
    return UserError(
        f"{who} names the class {shorten(target)}, and the package {shorten(package)} is not "
        f"trusted: give trusted=[{shorten(package)}] if its code may run, or install it with an "
        f"entry point in {ENTRY_POINTS}."
    )


def targets(node: object) -> Iterator[str]:
    """All classes that a node of plain values names, at any depth."""
    if isinstance(node, dict):
        for key, value in node.items():
            if key == TARGET:
                yield str(value)
            else:
                yield from targets(value)
    elif isinstance(node, list | tuple):
        for item in node:
            yield from targets(item)


def _package(target: str) -> str:
    return target.partition(".")[0]
