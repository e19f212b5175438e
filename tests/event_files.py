"""Events as TensorBoard's own reader finds them."""

import functools
from pathlib import Path
from typing import Any

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.backend.event_processing.event_file_loader import LegacyEventFileLoader
from tensorboard.plugins.hparams import plugin_data_pb2

KINDS = ("scalars", "images", "audio", "tensors")
START = "_hparams_/session_start_info"


@functools.cache
def _read(folder: str, sizes: tuple[int, ...]) -> EventAccumulator:
    """What is logged in a folder whose files have these sizes; checking sums takes a while."""
    return EventAccumulator(folder, size_guidance=dict.fromkeys(KINDS, 0)).Reload()


def runs(root: Path) -> dict[str, EventAccumulator]:
    """What is logged below a folder, by the name under which TensorBoard shows it."""
    found = {}
    for folder in sorted({file.parent for file in root.rglob("*tfevents*")}):
        sizes = (file.stat().st_size for file in sorted(folder.glob("*tfevents*")))
        found[str(folder.relative_to(root))] = _read(str(folder), tuple(sizes))
    return found


def trials(root: Path) -> dict[str, dict[str, Any]]:
    """The hyper-parameters of each trial below a folder, by the name of its run."""
    found = {}
    for name, events in runs(root).items():
        if metadata := events.summary_metadata.get(START):
            content = plugin_data_pb2.HParamsPluginData()
            content.ParseFromString(metadata.plugin_data.content)
            values = content.session_start_info.hparams.items()
            found[name] = {key: getattr(it, it.WhichOneof("kind")) for key, it in values}
    return found


def count(root: Path, tag: str) -> int:
    """How often a tag was written in all files below a folder."""

    events = (
        event
        for file in root.rglob("*tfevents*")
        for event in LegacyEventFileLoader(str(file)).Load()
    )
    return sum(value.tag == tag for event in events for value in event.summary.value)


def words(events: EventAccumulator, tag: str) -> str:
    """A text."""
    (event,) = events.Tensors(f"{tag}/text_summary")
    return event.tensor_proto.string_val[0].decode()
