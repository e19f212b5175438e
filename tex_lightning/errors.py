"""``UserError``, the exception for what a user can mend, and the form of values in messages.

Most is defined in the runtime package, which reads files and which this package depends on.
"""

import difflib
from collections.abc import Iterable

from tex_lightning_runtime.errors import UserError as UserError
from tex_lightning_runtime.errors import inflected as inflected
from tex_lightning_runtime.errors import listed as listed
from tex_lightning_runtime.errors import reason as reason
from tex_lightning_runtime.errors import shorten as shorten


class InvalidInput(UserError, ValueError):
    """A :class:`UserError` of the estimator: scikit-learn expects a ``ValueError``."""


def nearest(name: str, known: Iterable[str], prefix: str = "") -> str:
    """Return the likeliest of the known names in brackets, with a ``prefix``; "" if none is."""
    near = difflib.get_close_matches(name, list(known), n=1)
    return f" (did you mean {prefix}{near[0]}?)" if near else ""
