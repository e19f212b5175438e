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


def count_devices(accelerator: str, wanted: int | None) -> int:
    """How many devices of this machine are used: so many as wanted, every GPU for None.

    On the CPU a device is a process.

    Raises:
        UserError: If there are not so many.
    """
    kind = pick_device(accelerator).type
    if kind == "cpu":
        if wanted is None:
            raise UserError(
                "trainer.devices is null, which takes every GPU, but this run has none; give "
                "trainer.devices=2 to train in two processes on the CPU."
            )
        return wanted
    found = torch.cuda.device_count() if kind == "cuda" else 1
    if wanted is not None and wanted > found:
        raise UserError(f"trainer.devices is {wanted}, but there are {found}; choose fewer.")
    return found if wanted is None else wanted


def synchronise(device: torch.device) -> None:
    """Wait for the device, so that a clock read next is right."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    elif device.type == "mps":
        torch.mps.synchronize()
