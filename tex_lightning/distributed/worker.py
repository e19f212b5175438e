"""``python -m tex_lightning.distributed.worker``: a process that rank zero started and leads."""

import logging
import os
import sys
import warnings

from tex_lightning.distributed.launch import live_with
from tex_lightning.distributed.place import started_place
from tex_lightning.distributed.team import Team


def follow(accelerator: str) -> int:
    """Take part in what rank zero trains, in silence; return its exit status."""
    from tex_lightning.learning.train import take_part
    from tex_lightning.progress import console

    place = started_place()
    assert place is not None
    logging.disable()
    warnings.simplefilter("ignore")
    console.quiet = True
    team = Team(place, accelerator)
    status = team.follow(take_part)
    team.leave()
    return status


if __name__ == "__main__":
    live_with(os.getppid())
    sys.exit(follow(sys.argv[1]))
