"""Rank of this process in its process group, from the environment.

Lightning's launcher, ``torchrun`` and ``srun`` say so in variables. It is asked before PyTorch is
imported, so that a mistyped command is answered at once.
"""

import logging
import os
import warnings

RANKS = ("RANK", "LOCAL_RANK", "SLURM_PROCID")  # in the order in which Lightning looks at them
STARTERS = ("TORCHELASTIC_RUN_ID", "SLURM_STEP_NUM_TASKS")


def is_rank_zero() -> bool:
    """Return whether this process prints and writes; those that only train do not."""
    return next((int(os.environ[name]) for name in RANKS if name in os.environ), 0) == 0


def started_processes() -> int | None:
    """Return how many processes torchrun or a step of SLURM has started; None without one."""
    if STARTERS[0] in os.environ:
        return int(os.environ["WORLD_SIZE"])
    tasks = int(os.environ.get(STARTERS[1], 1))
    return tasks if tasks > 1 else None


def suppress_output() -> None:
    """Suppress all output of this process."""
    logging.disable()
    warnings.simplefilter("ignore")
