"""Contracts of a user's classes: what each maps to what, and the errors if one breaks it.

:mod:`tex_lightning.classifier.contract_check` tries those of training once before work, and
:mod:`tex_lightning.testing` those of any part.
"""

import importlib
import inspect
import pkgutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from traceback import walk_tb
from typing import Any

from tex_lightning.errors import UserError, nearest, reason

LIBRARIES = ("tex_lightning.", "torch.", "torchvision.", "lightning.", "kornia.")
FAULT = "tex_lightning_fault"  # attribute of an error
KEY = "tex_lightning_key"  # attribute of a part
Component = tuple[str, str, object]  # key in the configuration, kind of CONTRACTS and object

CONTRACTS = {
    "features": "features map a signal (axes, samples) to network input (1, ..., frames), or photos"
    " (batch, 3, height, width) uint8 to (batch, channels, height, width), in finite "
    "floating-point numbers",
    "network": "a network has features(x, level), which maps inputs (batch, ...) to finite class "
    'scores (batch, classes, *positions) at level "fc3", computed from its parameters',
    "trunk": "a trunk maps images (batch, 3, height, width) to finite features (batch, "
    "out_channels, rows, columns)",
    "augmentation": "an augmentation maps patches (batch, 3, side, side) in [0, 1] to as many "
    "finite ones",
    "perturbation": "a perturbation takes a recording, a value and a scene, and returns a finite "
    "photo (height, width, 3) or signal of as many axes (axes, samples)",
    "baseline": "a baseline has fit(recordings, labels, seed), logits(recording), which gives a "
    "tensor of finite scores (classes, fragments), state(), load_state(state) and "
    "count_parameters()",
    "callback": "a callback's methods take what those of Lightning's Callback take",
    "reader": "a reader has read(), which returns tex_lightning.Recordings",
    "sense": "a sense derives from SignalSense or PhotoSense, and its decoder can be pickled for "
    "the processes that load data",
}


@contextmanager
def calling(key: str, kind: str, part: object) -> Iterator[None]:
    """Add the key and the contract of a :data:`Component` to its errors, before the traceback."""
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        _note(error, f"{key} ({_name(part)}) raised {type(error).__name__}; {CONTRACTS[kind]}.")
        raise


@contextmanager
def making(key: str, target: str) -> Iterator[None]:
    """Add the key of a class to the error if it cannot be made.

    What a user's class raises keeps its traceback.

    Raises:
        UserError: If a class of this package or of a library that it builds on fails.
    """
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        cause = _innermost(error)
        if f"{target}.".startswith(LIBRARIES):
            said = reason(str(cause).partition("\n    full_key:")[0] or type(cause).__name__)
            lacks = isinstance(cause, ModuleNotFoundError)
            cure = "install what it needs" if lacks else "correct its _target_ or arguments"
            raise UserError(f"{key} fails: {said}; {cure}.") from error
        _note(cause, f"{key} raised {type(cause).__name__} while it was made.")
        raise cause from cause.__cause__


def _innermost(error: Exception) -> Exception:
    """Return the exception of a class that Hydra wrapped in its own."""
    cause = error.__cause__
    if type(error).__name__ == "InstantiationException" and isinstance(cause, Exception):
        return _innermost(cause)
    return error


def resolve(key: str, target: str) -> Any:  # noqa: ANN401
    """Return the object of a dotted path; exceptions of its module keep their traceback.

    Raises:
        UserError: If there is nothing of this name.
    """
    module = target.rpartition(".")[0]
    try:
        try:
            return pkgutil.resolve_name(target)
        except AttributeError as error:
            if module:
                importlib.import_module(module)  # whose own failure it hides
            raise _not_there(key, error) from error
    except UserError:
        raise
    except Exception as error:
        missing = getattr(error, "name", None) if isinstance(error, ModuleNotFoundError) else None
        absent = missing is not None and f"{target}.".startswith(f"{missing}.")
        if absent or not all(part.isidentifier() for part in target.split(".")):
            raise _not_there(key, error) from error
        _note(error, f"{key} raised {type(error).__name__} while it was imported.")
        raise


def _not_there(key: str, error: Exception) -> UserError:
    lacks = isinstance(error, ModuleNotFoundError)
    other = ", or set PYTHONPATH to the folder of its module" if lacks else " or arguments"
    near = ""
    if isinstance(error, AttributeError):  # of what is not among the names of a module
        near = nearest(str(error.name), dir(error.obj))
    return UserError(f"{key} fails: {reason(error)}{near}; correct its _target_{other}.")


def _note(error: BaseException, said: str) -> None:
    if getattr(error, FAULT, None) is None:
        error.add_note(said)
        setattr(error, FAULT, said)


def keep_key(part: object, key: str) -> None:
    """Keep the key of a part that Lightning calls, for the errors of its methods."""
    with suppress(AttributeError):  # of one with slots
        setattr(part, KEY, key)


def fault_of(error: BaseException) -> str | None:
    """Return what is noted on an error, which is the key of a part that Lightning called, too."""
    for frame, _ in reversed([*walk_tb(error.__traceback__)]):
        part, module = frame.f_locals.get("self"), f"{frame.f_globals.get('__name__')}."
        key = getattr(part, "__dict__", {}).get(KEY)
        if key is not None and not module.startswith(LIBRARIES):
            _note(error, f"{key} ({_name(part)}) raised {type(error).__name__}.")
            break
    said: str | None = getattr(error, FAULT, None)
    return said


def rejected_by_library(error: BaseException) -> str | None:
    """Return a sentence for what Lightning rejects: arguments of a class of its own, or a flag."""
    for frame, _ in reversed([*walk_tb(error.__traceback__)]):
        part, module = frame.f_locals.get("self"), str(frame.f_globals.get("__name__"))
        if not module.startswith(("lightning.", "torch.")):
            break
        if (key := getattr(part, "__dict__", {}).get(KEY)) is not None:
            return (
                f"{key} ({_name(part)}) fails: {reason(error)}; correct its _target_ or arguments."
            )
    if type(error).__name__ == "MisconfigurationException":
        return f"Lightning rejects a flag of trainer: {reason(error)}; correct that flag."
    return None


def check_call(
    part: Component, called: Callable[..., object], *arguments: str, by_name: Sequence[str] = ()
) -> None:
    """Reject a function or method that cannot be called with so many arguments.

    Args:
        part: Component that it belongs to.
        called: The function or bound method.
        arguments: Names of the arguments, as the contract has them.
        by_name: Those that are given by their names.

    Raises:
        UserError: Naming what it takes, and what it gets.
    """
    try:
        inspect.signature(called).bind(*arguments, **dict.fromkeys(by_name))
    except ValueError:  # of a function in C
        return
    except TypeError as error:
        takes = ", ".join(inspect.signature(called).parameters) or "nothing"
        name = getattr(called, "__name__", "it")
        gets = ", ".join([*arguments, *by_name]) or "nothing"
        raise breach(*part, f"has {name}, which takes {takes}, where it gets {gets}") from error


def breach(key: str, kind: str, part: object, why: str) -> UserError:
    """Return the error for a :data:`Component` that "returned a list", or what ``why`` says."""
    return UserError(f"{key} ({_name(part)}) {why}; {CONTRACTS[kind]}.")


def describe_value(value: Any) -> str:  # noqa: ANN401
    """Return what something is, for a message: its type, and of an array the shape and numbers."""
    if not hasattr(value, "shape"):
        return f"a {type(value).__name__}"
    numbers = str(value.dtype).removeprefix("torch.")
    return f"a {type(value).__name__} of {numbers} of shape {tuple(value.shape)}"


def _name(part: object) -> str:
    return getattr(part, "__name__", type(part).__name__)
