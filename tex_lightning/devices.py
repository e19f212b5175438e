"""Where tensors live."""

import torch

from tex_lightning.errors import UserError


def pick_device(accelerator: str) -> torch.device:
    """The device of a Lightning accelerator name; ``auto`` takes the first accelerator there is.

    Raises:
        UserError: If the accelerator asked for is not there.
    """
    if accelerator in ("auto", "gpu", "cuda") and torch.cuda.is_available():
        return torch.device("cuda")
    if accelerator in ("auto", "gpu", "mps") and torch.backends.mps.is_available():
        return torch.device("mps")
    if accelerator not in ("auto", "cpu"):
        raise UserError(
            f"trainer.accelerator={accelerator} is not available on this machine; use cpu or auto."
        )
    return torch.device("cpu")


def synchronise(device: torch.device) -> None:
    """Wait for the device, so that a clock read next is right."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    elif device.type == "mps":
        torch.mps.synchronize()
