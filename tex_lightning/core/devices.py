"""Choice and properties of the device."""

import ctypes
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import torch

from tex_lightning.core.ranks import started_processes
from tex_lightning.errors import UserError, shorten

if TYPE_CHECKING:
    from tex_lightning.config import TrainerConfig


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


def use_tf32(allowed: bool) -> None:
    """Let NVIDIA GPUs round the factors of fp32 products to 10 bits, or let none of them.

    PyTorch lets convolutions do so unless it is told otherwise.
    """
    torch.backends.cudnn.allow_tf32 = allowed
    torch.backends.cuda.matmul.allow_tf32 = allowed


def count_processes(trainer: "TrainerConfig") -> int:
    """How many processes train one network together, on all nodes.

    Raises:
        UserError: If there are not so many devices, or another number has been started.
    """
    wanted = _count_devices(trainer.accelerator, trainer.devices) * trainer.num_nodes
    started = started_processes()
    if started is not None and started != wanted:
        raise UserError(
            f"{started} processes were started, but the trainer wants {wanted}; make "
            "trainer.devices times trainer.num_nodes equal to their number, as in trainer=ddp "
            f"trainer.devices={started}."
        )
    if started is None and trainer.num_nodes > 1:
        raise UserError(
            f"trainer.num_nodes is {trainer.num_nodes}, but nothing started a process on every "
            "node; start the command with srun or torchrun."
        )
    return wanted


def _count_devices(accelerator: str, asked: object) -> int:
    """How many devices of this machine are used; on the CPU a device is a process."""
    kind = pick_device(accelerator).type
    there = torch.cuda.device_count() if kind == "cuda" else 1
    if asked in ("auto", -1, "-1"):
        if kind == "cpu":
            raise UserError(
                "trainer.devices is auto, which takes every GPU, but this run has none; give "
                "trainer.devices=2 to train in two processes on the CPU."
            )
        return there
    numbers = asked if isinstance(asked, list) else [asked]
    if not numbers or not all(str(number).isdecimal() for number in numbers):
        raise UserError(
            f"trainer.devices is {shorten(repr(asked))}; give a number, a list or auto."
        )
    count = len(asked) if isinstance(asked, list) else int(str(asked))
    if kind != "cpu" and count > there:
        raise UserError(f"trainer.devices is {count}, but there are {there}; choose fewer.")
    return count


def synchronise(device: torch.device) -> None:
    """Wait for the device, so that a clock read next is right."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    elif device.type == "mps":
        torch.mps.synchronize()


TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3  # what glibc's malloc.h calls M_...
LARGE = 1 << 30  # bytes; hardly a tensor on a CPU comes near
GROWN = 1 << 25  # to which glibc lets its own threshold grow, and many versions no further


def keep_memory() -> None:
    """Keep the freed memory of CPU tensors for the next ones, in this process from now on.

    The allocator of glibc returns large pieces to the system, which has to clear every page when
    it is asked for again: up to a tenth of a step. Other systems are left as they are.
    """
    if platform.libc_ver()[0] == "glibc":
        libc = ctypes.CDLL(None)
        libc.mallopt(MMAP_THRESHOLD, LARGE) or libc.mallopt(MMAP_THRESHOLD, GROWN)
        libc.mallopt(TRIM_THRESHOLD, LARGE)


@contextmanager
def computing_threads(count: int | None = None) -> Iterator[None]:
    """Let PyTorch use so many threads, and as many as before when that is over.

    Args:
        count: For this thread and those that begin meanwhile; None changes nothing itself, and
            undoes what a library changes.
    """
    before = torch.get_num_threads()
    if count is not None:
        torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
