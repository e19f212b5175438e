"""This process among those that train one network together, as its environment has it.

Lightning's launcher, ``torchrun`` and ``srun`` say so in variables. It is asked before PyTorch is
imported, so that a mistyped command is answered at once.
"""

import logging
import os
import threading
import time
import warnings

FAULT = 1

RANKS = ("RANK", "LOCAL_RANK", "SLURM_PROCID")  # in the order in which Lightning looks at them
STARTERS = ("TORCHELASTIC_RUN_ID", "SLURM_STEP_NUM_TASKS")


def is_rank_zero() -> bool:
    """Whether this process prints and writes; every process does but those that only train."""
    return next((int(os.environ[name]) for name in RANKS if name in os.environ), 0) == 0


def started_processes() -> int | None:
    """How many processes torchrun or a step of SLURM has started; None without one."""
    if STARTERS[0] in os.environ:
        return int(os.environ["WORLD_SIZE"])
    tasks = int(os.environ.get(STARTERS[1], 1))
    return tasks if tasks > 1 else None


def suppress_output() -> None:
    """Say nothing in this process, and end it when the one that Lightning started it from is gone.

    An operation on GPUs would wait for that one for ever. Those that torchrun or SLURM have started
    are ended by them.
    """
    logging.disable()
    warnings.simplefilter("ignore")
    if started_processes() is None:
        threading.Thread(target=_live_with, args=(os.getppid(),), daemon=True).start()


def _live_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.2)
    os._exit(FAULT)
