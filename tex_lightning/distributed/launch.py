"""Bring the processes of a training together: started here, by torchrun or by SLURM."""

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import tex_lightning
from tex_lightning.devices import count_devices
from tex_lightning.distributed.place import Place, started_place
from tex_lightning.distributed.team import Team
from tex_lightning.errors import UserError
from tex_lightning.schema import TrainerConfig

GRACE_S = 10.0  # for rank zero to fail by itself, with a traceback, when another process is lost
FAULT = 1


def count_processes(trainer: TrainerConfig) -> int:
    """How many processes train together, on all nodes.

    Raises:
        UserError: If there are not so many devices, or another number has been started.
    """
    wanted = count_devices(trainer.accelerator, trainer.devices) * trainer.num_nodes
    place = started_place()
    if place is not None and place.size != wanted:
        raise UserError(
            f"{place.size} processes were started, but the trainer wants {wanted}; make "
            "trainer.devices times trainer.num_nodes equal to their number, as in trainer=ddp "
            f"trainer.devices={place.size}."
        )
    if place is None and trainer.num_nodes > 1:
        raise UserError(
            f"trainer.num_nodes is {trainer.num_nodes}, but nothing started a process on every "
            "node; start the command with srun or torchrun."
        )
    return wanted


@contextmanager
def leading(processes: int, trainer: TrainerConfig) -> Iterator[None]:
    """Be rank zero of ``processes`` while the task inside runs."""
    if processes == 1:
        yield
        return
    place = started_place()
    others: list[subprocess.Popen[bytes]] = []
    if place is None:
        place = Place(0, 0, processes, "127.0.0.1", _free_port())
        others = _start_others(place, trainer)
    over = threading.Event()
    threading.Thread(target=_watch, args=(others, over), daemon=True).start()
    status = FAULT
    try:
        team = Team(place, trainer.accelerator)
        try:
            yield
            status = 0
        except UserError:
            status = 2
            raise
        finally:
            over.set()
            if team.training:
                _kill(others)
            else:
                team.send(status)
            team.leave()
        for other in others:
            other.wait()
    finally:
        over.set()
        _kill(others)


def _kill(others: list[subprocess.Popen[bytes]]) -> None:
    for other in others:
        other.kill()  # one that waits for a lost partner listens to nothing less
        other.wait()


def _free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        port: int = listener.getsockname()[1]
    return port


def _start_others(leader: Place, trainer: TrainerConfig) -> list[subprocess.Popen[bytes]]:
    """Start the other processes of this node, each a Python of its own."""
    home = str(Path(tex_lightning.__file__).parents[1])
    paths = os.pathsep.join(filter(None, (home, os.environ.get("PYTHONPATH"))))
    threads = trainer.threads or max(1, (os.cpu_count() or 1) // leader.size)
    # said here too, or Lightning sets a number of its own in this process
    os.environ.setdefault("OMP_NUM_THREADS", str(threads))
    others = []
    for rank in range(1, leader.size):
        place = Place(rank, rank, leader.size, leader.address, leader.port)
        environment = {**os.environ, **place.variables(), "PYTHONPATH": paths}
        if trainer.threads is not None:
            environment["OMP_NUM_THREADS"] = str(threads)
        command = [sys.executable, "-m", "tex_lightning.distributed.worker", trainer.accelerator]
        others.append(subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL))
    return others


def _watch(others: list[subprocess.Popen[bytes]], over: threading.Event) -> None:
    """End this process, and with it the rest, when one of the others is lost.

    A collective operation on GPUs would wait for it for ever.
    """
    while not over.wait(0.5):
        lost = [other for other in others if other.poll() is not None]
        if lost:
            if over.wait(GRACE_S):
                return
            _kill(others)
            print(
                f"A process of this training ended with status {lost[0].returncode}.",
                file=sys.stderr,
            )
            os._exit(FAULT)


def live_with(parent: int) -> None:
    """End this process when its parent is gone."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(FAULT)

    threading.Thread(target=watch, daemon=True).start()
