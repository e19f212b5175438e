"""``UserError``, the exception for what a user can mend, and the form of values in messages.

Both are defined in the runtime package, which reads files and which this package depends on.
"""

from tex_lightning_runtime.errors import UserError as UserError
from tex_lightning_runtime.errors import listed as listed
from tex_lightning_runtime.errors import reason as reason
from tex_lightning_runtime.errors import shorten as shorten


class InvalidInput(UserError, ValueError):
    """A :class:`UserError` of the estimator: scikit-learn expects a ``ValueError``."""
