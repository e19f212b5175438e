"""The processes of one training, led by rank zero.

Rank zero runs the whole task: it alone reads the command line, tests, prints and writes. Whenever
a network is to be trained it sends the training to the others, which take part in it and then wait
for the next one. So one set of processes trains all networks of a fusion and all folds.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import Any, ClassVar

import torch
import torch.distributed as dist

from tex_lightning.devices import pick_device
from tex_lightning.distributed.place import Place
from tex_lightning.errors import UserError

PATIENCE = timedelta(days=30)  # others wait while rank zero decodes and tests; a loss is noticed


class Team:
    """Connection of this process to the others.

    Args:
        place: Of this process.
        accelerator: Lightning's name of the devices.

    Attributes:
        current: The team that this process belongs to, if it does.
        training: Whether the others may be in the middle of a training.
    """

    current: ClassVar["Team | None"] = None

    def __init__(self, place: Place, accelerator: str) -> None:
        self.place = place
        self.training = False
        cuda = pick_device(accelerator).type == "cuda"
        if cuda:
            torch.cuda.set_device(place.local)
        dist.init_process_group(
            "nccl" if cuda else "gloo",
            init_method=f"tcp://{place.address}:{place.port}",
            rank=place.rank,
            world_size=place.size,
            timeout=PATIENCE,
            device_id=torch.device("cuda", place.local) if cuda else None,
        )
        # messages go between CPUs whatever the gradients do
        self.messages = dist.new_group(backend="gloo", timeout=PATIENCE)
        Team.current = self

    def send(self, message: Any) -> None:  # noqa: ANN401
        """From rank zero to all others."""
        dist.broadcast_object_list([message], src=0, group=self.messages)

    def receive(self) -> Any:  # noqa: ANN401
        """What rank zero sends next."""
        box: list[Any] = [None]
        dist.broadcast_object_list(box, src=0, group=self.messages)
        return box[0]

    def gather(self, message: Any) -> list[Any]:  # noqa: ANN401
        """Everybody's message, by rank."""
        box: list[Any] = [None] * self.place.size
        dist.all_gather_object(box, message, group=self.messages)
        return box

    def follow(self, take_part: Callable[[Any], object]) -> int:
        """Take part in whatever rank zero sends until it is done; return its exit status.

        Mistakes of the user are agreed upon, see :func:`agreed`, and said by rank zero.
        """
        while not isinstance(message := self.receive(), int):
            try:
                take_part(message)
            except UserError:
                self.training = False
        return message

    def leave(self) -> None:
        """Close the connections; of a training on GPUs that was broken off, the system does it.

        NCCL would wait there for operations that the others never join.
        """
        Team.current = None
        if not self.training or dist.get_backend() == "gloo":
            dist.destroy_process_group()


@contextmanager
def shared(message: Any) -> Iterator[None]:  # noqa: ANN401
    """What is done inside, all processes do; rank zero sends them what they need for it."""
    team = Team.current
    if team is not None:
        team.training = True
        if team.place.rank == 0:
            team.send(message)
    yield
    if team is not None:
        team.training = False


@contextmanager
def agreed() -> Iterator[None]:
    """Let a mistake that any process finds inside be found by all, so that none waits for it.

    Raises:
        UserError: On every process, the complaint of the first that has one.
    """
    team, complaint = Team.current, None
    try:
        yield
    except UserError as error:
        if team is None:
            raise
        complaint = str(error)
    if team is None:
        return
    found = [other for other in team.gather(complaint) if other is not None]
    if found:
        team.training = False
        raise UserError(found[0])
