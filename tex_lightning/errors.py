"""The exception for errors that the user can fix, and the form of quoted values in it.

They are those of the package that reads files, which stands below this one.
"""

from tex_lightning_runtime.errors import UserError as UserError
from tex_lightning_runtime.errors import listed as listed
from tex_lightning_runtime.errors import reason as reason
from tex_lightning_runtime.errors import shorten as shorten


class InvalidInput(UserError, ValueError):
    """The same, raised by the estimator: scikit-learn expects a ``ValueError``."""
