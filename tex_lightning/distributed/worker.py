"""``python -m tex_lightning.distributed.worker``: a process that rank zero started and leads."""

import logging
import os
import signal
import sys
import time
import warnings

from tex_lightning.distributed.launch import live_with
from tex_lightning.distributed.place import started_place
from tex_lightning.distributed.team import Team


def follow(accelerator: str) -> int:
    """Take part in what rank zero trains, in silence; return its exit status.

    Args:
        accelerator: Lightning's name of the devices.
    """
    from tex_lightning.learning.train import take_part
    from tex_lightning.memory import kept_memory
    from tex_lightning.progress import console

    place = started_place()
    assert place is not None
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for rank zero, which then ends all
    logging.disable()
    warnings.simplefilter("ignore")
    console.quiet = True
    team = Team(place, accelerator)
    with kept_memory():
        status = team.follow(take_part)
    team.leave()
    return status


if __name__ == "__main__":
    live_with(os.getppid())
    try:
        sys.exit(follow(sys.argv[1]))
    except Exception:
        time.sleep(1)  # if it is rank zero that is lost, this process has ended by now
        raise
