"""Classify surfaces by a network that tex_lightning exported, without PyTorch."""

from tex_lightning_runtime.files import UserError
from tex_lightning_runtime.runtime import Runtime, Stream

__all__ = ["Runtime", "Stream", "UserError"]
__version__ = "0.1.0"
