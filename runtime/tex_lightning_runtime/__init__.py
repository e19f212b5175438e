"""Classify surfaces by a network that tex_lightning exported, without PyTorch."""

from tex_lightning_runtime.recordings import UserError as UserError
from tex_lightning_runtime.runtime import Runtime as Runtime

__version__ = "0.1.0"
