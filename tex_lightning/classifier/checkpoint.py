"""Files of checkpoints: read safely, and the names that Lightning gives a classifier's tensors."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from tex_lightning.core.console import suppress_warnings
from tex_lightning.core.contract import fault_of
from tex_lightning.errors import UserError, shorten
from tex_lightning.networks.archives import check_archive
from tex_lightning_runtime.files import expanded

PREFIX = "classifier."  # in the state of a LightningModule


def read_checkpoint(path: str | Path) -> dict[str, Any]:
    """Read the tensors and plain values of a checkpoint.

    Raises:
        UserError: If the file is missing or no checkpoint.
    """
    path = expanded(path)
    if not path.is_file():
        raise UserError(f"Checkpoint {path} does not exist; check the path.")
    with reading(path), suppress_warnings():
        check_archive(path)
        content: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    return content


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn errors while a checkpoint is read into a :class:`UserError` that names the file.

    Raises:
        UserError: If the checkpoint is damaged or a value of it cannot be used.
        Exception: Any exception of a user's class, unchanged.
    """
    try:
        yield
    except UserError as error:
        if str(path) in str(error):
            raise
        raise UserError(f"Checkpoint {path} cannot be used: {error}") from error
    except Exception as error:  # damage shows in as many ways as there are formats
        if fault_of(error) is not None:
            raise
        what = shorten(str(error)) if isinstance(error, ValueError) else type(error).__name__
        raise UserError(
            f"Checkpoint {path} is damaged or was not written by tex_lightning of this version "
            f"({what}); give a file from a run's checkpoints folder, or train anew."
        ) from error


def parts_below(prefix: str, state: Mapping[str, Tensor]) -> dict[str, dict[str, Tensor]]:
    """Return the states of the modules below a prefix by their names."""
    states: dict[str, dict[str, Tensor]] = {}
    for key, value in state.items():
        if key.startswith(prefix):
            name, buffer = key.removeprefix(prefix).rsplit(".", 1)
            states.setdefault(name, {})[buffer] = value
    return states


def lightning_state(classifier: nn.Module) -> dict[str, Tensor]:
    """Return the classifier's state under the names that a Lightning checkpoint has."""
    return {f"{PREFIX}{name}": value for name, value in classifier.state_dict().items()}


def classifier_state(checkpoint: Mapping[str, Any]) -> dict[str, Tensor]:
    """Return the classifier's state of a Lightning checkpoint; undoes :func:`lightning_state`."""
    stored: dict[str, Tensor] = checkpoint["state_dict"]
    return {
        key.removeprefix(PREFIX): value for key, value in stored.items() if key.startswith(PREFIX)
    }
