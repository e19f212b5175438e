"""What is asked of ``data``."""

from collections.abc import Iterator

from tex_lightning.config import DataConfig
from tex_lightning.errors import shorten


def check_data(data: DataConfig) -> Iterator[str]:
    """What cannot be meant of ``data``."""
    for key in ("root", "manifest"):
        given = getattr(data, key)
        if given is not None and given not in data.reader.values():
            yield f"data.{key} is given, but data={data.name} does not read it: use data=folder"
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
