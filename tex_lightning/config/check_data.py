"""What is asked of ``data``."""

from collections.abc import Iterator

from tex_lightning.config import DataConfig
from tex_lightning.config.check_ranges import choice
from tex_lightning.errors import shorten

READ_KEYS = {
    "synthetic": (),
    "folder": ("root",),
    "manifest": ("manifest",),
    "tum": ("root", "manifest"),
    "lmt108": ("root", "split"),
    "kylberg": ("root", "group_by"),
    "kth_tips2b": ("root",),
}
SURFACES = 4  # from which Kylberg's patches of one class are cut


def check_data(data: DataConfig) -> Iterator[str]:
    """What cannot be meant of ``data``."""
    if data.name not in READ_KEYS:
        yield from choice("data.name", data.name, tuple(READ_KEYS))
        return
    for key in ("root", "manifest", "split", "group_by"):
        if getattr(data, key) is not None and key not in READ_KEYS[data.name]:
            readers = [name for name, keys in READ_KEYS.items() if key in keys]
            yield (
                f"data.{key} is given, but data={data.name} does not read it: use data={readers[0]}"
            )
    if data.group_by == "surface" and data.folds != SURFACES:
        yield (
            f"data.group_by=surface makes a fold of each source surface, but data.folds is "
            f"{data.folds}: give data.folds={SURFACES}"
        )
    if data.resize is not None and data.half_scale:
        yield "data.half_scale and data.resize both decide the size of photos: turn one off"
    if data.inverted and data.test_fold is None:
        yield "data.inverted trains on data.test_fold, which is null: give its number"
    for name in ("test_fold", "val_fold"):
        fold = getattr(data, name)
        if fold is not None and not 0 <= fold < data.folds:
            yield f"data.{name} is {shorten(fold)}: choose from 0 to {data.folds - 1}"
    if data.val_fold is not None and data.val_fold == data.test_fold:
        yield f"data.val_fold and data.test_fold are both {data.val_fold}: choose different folds"
