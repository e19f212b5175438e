"""This process among those that train one network together, as its environment has it."""

import os
from collections.abc import Mapping
from dataclasses import dataclass

TORCHRUN = ("RANK", "LOCAL_RANK", "WORLD_SIZE", "MASTER_ADDR", "MASTER_PORT")


@dataclass(frozen=True)
class Place:
    """Where a process stands.

    Attributes:
        rank: Its number among all; rank zero leads.
        local: Its number among those of its node, which is also its GPU's.
        size: How many there are.
        address: Host of rank zero.
        port: Where rank zero listens.
    """

    rank: int
    local: int
    size: int
    address: str
    port: int

    def variables(self) -> dict[str, str]:
        """The environment that tells another process that this is its place."""
        values = (self.rank, self.local, self.size, self.address, self.port)
        return dict(zip(TORCHRUN, map(str, values), strict=True))


def started_place(environment: Mapping[str, str] | None = None) -> Place | None:
    """The place that ``torchrun`` or ``srun`` gave this process; None if nobody gave it one.

    A batch script of SLURM runs outside of any step and has no place; neither has a step of one
    task, such as the jobs of a sweep.
    """
    given = os.environ if environment is None else environment
    if all(name in given for name in TORCHRUN):
        rank, local, size, address, port = (given[name] for name in TORCHRUN)
        return Place(int(rank), int(local), int(size), address, int(port))
    if int(given.get("SLURM_STEP_NUM_TASKS", 1)) > 1:
        from lightning.fabric.plugins.environments.slurm import SLURMEnvironment

        nodes = given.get("SLURM_STEP_NODELIST") or given.get("SLURM_NODELIST", "127.0.0.1")
        return Place(
            rank=int(given["SLURM_PROCID"]),
            local=int(given["SLURM_LOCALID"]),
            size=int(given["SLURM_STEP_NUM_TASKS"]),
            address=given.get("MASTER_ADDR") or SLURMEnvironment.resolve_root_node_address(nodes),
            port=int(given.get("MASTER_PORT") or 15_000 + int(given["SLURM_JOB_ID"][-4:])),
        )
    return None


def follows() -> bool:
    """Whether this process is one that rank zero speaks and writes for."""
    place = started_place()
    return place is not None and place.rank > 0
