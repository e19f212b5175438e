"""Choice and properties of the device, and work in threads."""

import ctypes
import os
import platform
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from functools import cache
from typing import TypeVar

import cv2
import numpy as np
import torch

from tex_lightning.core.progress import Item, track
from tex_lightning.core.ranks import Process, started_processes
from tex_lightning.errors import UserError

Result = TypeVar("Result")
TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3  # what glibc's malloc.h calls M_...
MAX_HEAP_PIECE, MAX_UNTRIMMED = 1 << 25, 1 << 30  # bytes: of a piece, in many versions, and in all


def pick_device(accelerator: str) -> torch.device:
    """Return the device of an accelerator of Lightning; ``auto`` takes the first one.

    Of several processes that train together each has its own GPU, already before Lightning says so.

    Raises:
        UserError: If the accelerator asked for is not there.
    """
    if accelerator in ("auto", "gpu", "cuda") and torch.cuda.is_available():
        return torch.device("cuda", Process.local % torch.cuda.device_count())
    if accelerator in ("auto", "gpu", "mps") and torch.backends.mps.is_available():
        return torch.device("mps")
    if accelerator not in ("auto", "cpu"):
        raise UserError(
            f"trainer.accelerator={accelerator} is not available on this machine; use cpu or auto."
        )
    return torch.device("cpu")


def computing_device(accelerator: str, baselines: Iterable[bool]) -> torch.device:
    """Return the device on which classifiers compute: the CPU where all of them are baselines."""
    return torch.device("cpu") if all(baselines) else pick_device(accelerator)


@contextmanager
def full_precision(device: torch.device) -> Iterator[None]:
    """Compute in float32 where the caller lets PyTorch choose (autocast), as in mixed precision.

    Half precision ends at 65504: squares of samples above 3 sum up to more in a spectrogram.
    """
    kind = device.type
    if torch.amp.is_autocast_available(kind) and torch.is_autocast_enabled(kind):
        with torch.autocast(kind, enabled=False):
            yield
    else:
        yield


@cache
def has_float64(device: torch.device) -> bool:
    """Return whether a device computes in float64; Apple's GPUs do not."""
    try:
        torch.zeros(1, dtype=torch.float64, device=device)
    except (TypeError, RuntimeError):
        return False
    return True


def with_float64(x: torch.Tensor) -> torch.Tensor:
    """Return a tensor where it can be computed with in float64: on its device, else on the CPU."""
    return x if has_float64(x.device) else x.cpu()


def to_cpu(tensors: Sequence[torch.Tensor]) -> list[torch.Tensor]:
    """Copy tensors of one device to the CPU at once, since each copy makes the CPU wait."""
    if not tensors or tensors[0].device.type == "cpu":
        return [*tensors]
    flat = torch.cat([x.flatten() for x in tensors]).cpu()
    pieces = torch.split(flat, [x.numel() for x in tensors])
    return [piece.view(x.shape) for piece, x in zip(pieces, tensors, strict=True)]


def room(device: torch.device) -> int:
    """Return the bytes of training data that a device may hold.

    That is half of what an NVIDIA GPU has free, and a gigabyte on any other device.
    """
    if device.type == "cuda":
        free, _ = torch.cuda.mem_get_info(device)
        return free // 2
    return 1 << 30


def has_to_repeat(x: torch.Tensor) -> bool:
    """Return whether operations on a tensor have to give the same each time, where some do not.

    That is on other devices than the CPU, where PyTorch refuses these once deterministic ones were
    asked for (``trainer.deterministic=true``).
    """
    return x.device.type != "cpu" and torch.are_deterministic_algorithms_enabled()


def is_at_hand(x: torch.Tensor) -> bool:
    """Return whether values can be looked at in passing: on a CPU, and in no export.

    Elsewhere a decision by them would wait for the device.
    """
    return x.device.type == "cpu" and not torch.compiler.is_exporting()


def use_tf32(allowed: bool) -> None:
    """Set whether NVIDIA GPUs round the factors of fp32 products to 10 bits (TF32).

    PyTorch lets convolutions do so unless it is told otherwise.
    """
    torch.backends.cudnn.allow_tf32 = allowed
    torch.backends.cuda.matmul.allow_tf32 = allowed


def count_processes(accelerator: str, devices: int | str, num_nodes: int) -> int:
    """Count the processes that train one network together, on all nodes.

    Whether there are so many devices is Lightning's to say, whose flags these are.

    Raises:
        UserError: If nothing has started the processes of the other nodes.
    """
    if num_nodes > 1 and started_processes() is None:
        raise UserError(
            f"trainer.num_nodes is {num_nodes}, but nothing started a process on every "
            "node; start the command with srun or torchrun."
        )
    if devices == "auto":
        cuda = pick_device(accelerator).type == "cuda"
        devices = torch.cuda.device_count() if cuda else 1
    return num_nodes * int(devices)


def synchronise(device: torch.device) -> None:
    """Wait for the device, so that a clock read next is right."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    elif device.type == "mps":
        torch.mps.synchronize()


def keep_memory() -> None:
    """Keep the freed memory of CPU tensors in this process for the next ones.

    The allocator of glibc returns large pieces to the system, which has to clear every page when
    it is asked for again: up to a tenth of a step. Other systems are left as they are.
    """
    if platform.libc_ver()[0] == "glibc":
        libc = ctypes.CDLL(None)
        libc.mallopt(MMAP_THRESHOLD, MAX_HEAP_PIECE)
        libc.mallopt(TRIM_THRESHOLD, MAX_UNTRIMMED)


@contextmanager
def computing_threads(count: int | None = None) -> Iterator[None]:
    """Set PyTorch's number of threads inside the context, and restore it afterwards.

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


@contextmanager
def torch_defaults() -> Iterator[None]:
    """Work with the defaults that this package counts on, and leave a program's as they were.

    Whatever type and device a program in Python gives new tensors, here they are float32 on the
    CPU. Threads, random generators and what ``trainer.deterministic`` asks for are as before
    afterwards.
    """
    strict = torch.are_deterministic_algorithms_enabled()
    warns = torch.is_deterministic_algorithms_warn_only_enabled()
    dtype, elsewhere = torch.get_default_dtype(), torch.get_default_device().type != "cpu"
    drawn = np.random.get_state()  # noqa: NPY002  (aeon seeds it)
    # what no one has started has drawn nothing, and a label on the CPU must not start it
    started = torch.cuda.is_initialized()  # type: ignore[no-untyped-call]
    generators = [torch.cuda.current_device()] if started else []
    with (
        computing_threads(),
        torch.random.fork_rng(generators),
        torch.device("cpu") if elsewhere else nullcontext(),  # which each call would pass through
    ):
        torch.set_default_dtype(torch.float32)
        try:
            yield
        finally:
            torch.set_default_dtype(dtype)
            if torch.are_deterministic_algorithms_enabled() != strict:  # imports the compiler
                torch.use_deterministic_algorithms(strict, warn_only=warns)
            np.random.set_state(drawn)  # noqa: NPY002


def in_threads(
    work: Callable[[Item], Result], items: Iterable[Item], title: str, threads: int | None = None
) -> list[Result]:
    """Call a function on all items in threads, behind a progress bar.

    PyTorch and OpenCV start none of their own. After Ctrl-C only what has begun is ended.
    """
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    pool = ThreadPoolExecutor(threads or os.cpu_count())
    try:
        with computing_threads(1):
            jobs = [pool.submit(work, item) for item in items]
            return [job.result() for job in track(jobs, title)]
    finally:
        pool.shutdown(cancel_futures=True)
        cv2.setNumThreads(before)
