"""Reader of a CSV manifest: the door for data in any other layout."""

from pathlib import Path

from tex_lightning.config import DataConfig
from tex_lightning.data.recordings import Recordings, read_manifest


def read(config: DataConfig) -> Recordings:
    """Read the table from ``data.manifest``."""
    return read_manifest(Path(str(config.manifest)).expanduser())
