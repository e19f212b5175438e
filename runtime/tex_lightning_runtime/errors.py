"""What a caller can mend."""

from typing import Any


class UserError(Exception):
    """Bad input: one plain sentence of what was wrong, where, and what to do."""


def require(condition: Any, message: str) -> None:
    """Raise a :class:`UserError` unless the condition holds."""
    if not condition:
        raise UserError(message)
