"""Surface material classification from acceleration traces and photos."""

from typing import TYPE_CHECKING

from tex_lightning.errors import UserError

if TYPE_CHECKING:
    from tex_lightning.predictor import load

__version__ = "0.1.0"

__all__ = ["UserError", "load"]


def __getattr__(name: str) -> object:
    """Import what needs PyTorch when it is asked for: a mistyped command is refused before."""
    if name == "load":
        from tex_lightning.predictor import load

        return load
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
