"""Classify surfaces by a network that tex_lightning exported, without PyTorch.

What reads recordings here, resamples and judges them, is what tex_lightning trains with.
"""

from typing import TYPE_CHECKING

from tex_lightning_runtime.errors import UserError as UserError

if TYPE_CHECKING:
    from tex_lightning_runtime.runtime import Runtime as Runtime

__version__ = "0.1.0"


def __getattr__(name: str) -> object:
    """Import the runtime, and NumPy with it, when it is asked for."""
    if name != "Runtime":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from tex_lightning_runtime.runtime import Runtime

    return Runtime
