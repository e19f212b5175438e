"""The one exception that is the user's to mend, and names in its messages."""

from collections.abc import Sequence

MAX_NAME, MAX_NAMES = 80, 20  # letters of a name, and names, that a message quotes


class UserError(Exception):
    """Bad input or configuration.

    The message is one plain sentence: what was wrong, where (file or key), and what to do.
    The command line prints it without a traceback and exits with status 2.
    """


def shorten(text: str) -> str:
    """Cut the middle out of a text that is too long to be read in a message."""
    return text if len(text) <= MAX_NAME else f"{text[: MAX_NAME - 20]}…{text[-19:]}"


def listed(names: Sequence[str]) -> str:
    """Names as a message quotes them: shortened, and no more than can be read."""
    more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    return ", ".join(shorten(name) for name in names[:MAX_NAMES]) + more
