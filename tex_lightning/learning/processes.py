"""The devices of a run, and the processes that train together."""

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager

from tex_lightning.config import Config, Job
from tex_lightning.config.instantiation import named_classes, trust
from tex_lightning.config.tasks import TRAINING
from tex_lightning.core.ranks import check_started, joining, started_processes
from tex_lightning.errors import UserError


@contextmanager
def prepared(config: Config, job: Job) -> Iterator[None]:
    """Trust the named classes, set the devices, and join the processes that train together.

    Raises:
        UserError: If a task cannot use the devices, or the processes cannot train together.
    """
    trust(*config.trusted, *named_classes(config.model.nodes))
    with joining(processes := set_devices(config)):
        check_processes(config, job, processes)
        yield


def set_devices(config: Config) -> int:
    """Set PyTorch's threads and precision, and reject devices that a task cannot use.

    The layers of a short chunk of a stream are so small that a second thread only costs time. A
    user's ``OMP_NUM_THREADS`` is left as it is.

    Returns:
        The number of processes that train together.
    """
    with quick_import():
        import torch

        from tex_lightning.core.devices import count_processes, keep_memory, use_tf32

    threads = config.trainer.threads
    if threads is None and config.task == "stream" and "OMP_NUM_THREADS" not in os.environ:
        threads = 1
    if threads is not None:
        torch.set_num_threads(threads)
    use_tf32(config.trainer.tf32)
    keep_memory()
    if config.task not in TRAINING:
        return 1
    trainer = config.trainer
    processes = count_processes(trainer.accelerator, trainer.devices, trainer.num_nodes)
    check_started(processes)
    return processes


def check_processes(config: Config, job: Job, processes: int) -> None:
    """Reject settings that several processes cannot train with.

    Raises:
        UserError: If they cannot train together.
    """
    if processes == 1:
        return
    if job.origin == "sweep":
        from tex_lightning.report.sweep import NO_SWEEP

        raise UserError(NO_SWEEP)
    if job.origin == "python" and not started_processes():
        raise UserError(
            "Python trains in this process alone; for several devices run python -m tex_lightning, "
            "or start this program with torchrun."
        )
    sizes = {kind: getattr(config.model, kind).fit.batch_size for kind in config.model.trained}
    complaints = [
        f"model.{kind}.fit.batch_size is {size}, but {processes} processes share every batch: "
        f"choose a multiple of {processes}"
        for kind, size in sizes.items()
        if size % processes
    ]
    if complaints:
        raise UserError("; ".join(complaints) + ".")
    if started_processes() and not job.named:
        raise UserError(
            "Several processes were started, which have to share a run folder; give hydra.run.dir."
        )


@contextmanager
def quick_import() -> Iterator[None]:
    """Import without garbage collection, which takes a sixth of the time and finds nothing."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()
