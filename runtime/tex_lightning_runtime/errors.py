"""The exception for errors that the user can fix, and the form of quoted values in it."""

from collections.abc import Sequence

SHOWN = 200  # characters of a value that a message repeats
MAX_NAMES = 20  # names that it lists


class UserError(Exception):
    """Bad input or configuration.

    The message is one plain sentence: what was wrong, where (file or key), and what to do.
    The command line prints it without a traceback and exits with status 2.

    Args:
        *lines: The sentence, optionally followed by a list. Each is printed as one line, even if
            file names in it contain line breaks.

    Example:
        >>> import tex_lightning as tl
        >>> try:
        ...     tl.load("/nowhere.ckpt")
        ... except tl.UserError as error:
        ...     print(error)
        Checkpoint /nowhere.ckpt does not exist; check the path.
    """

    def __str__(self) -> str:
        return "\n".join(printable(str(line)) for line in self.args)


def require(condition: object, message: str) -> None:
    """Raise a :class:`UserError` unless the condition holds."""
    if not condition:
        raise UserError(message)


def printable(text: str) -> str:
    """Return one line without control characters, line breaks and marks of writing direction."""
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in text)


def shorten(value: object) -> str:
    """Return a text for a message, in one line: a long value keeps its beginning and end."""
    text = printable(str(value))
    if len(text) <= SHOWN:
        return text
    half = SHOWN // 2
    return f"{text[:half]}[{len(text) - 2 * half} more characters]{text[-half:]}"


def reason(error: object) -> str:
    """Return what a library said to be quoted: one line, shortened, without full stops."""
    said = " ".join(str(error).split()) or type(error).__name__
    return shorten(said).rstrip(". ").replace(". ", "; ")


def inflected(number: int, one: str, several: str) -> str:
    """Return a number with words in its form, such as ``1 file is`` and ``3 files are``."""
    return f"{number} {one if number == 1 else several}"


def listed(names: Sequence[str]) -> str:
    """Return names as a message quotes them: shortened, and no more than can be read."""
    more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    return ", ".join(shorten(name) for name in names[:MAX_NAMES]) + more
