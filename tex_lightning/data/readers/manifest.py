"""Reader of a CSV manifest: the door for data in any other layout."""

from dataclasses import dataclass
from pathlib import Path

from tex_lightning.data.recordings import Recordings, read_manifest


@dataclass
class ManifestReader:
    """A table.

    Attributes:
        manifest: Its file.
    """

    manifest: str

    def read(self) -> Recordings:
        """Read the table."""
        return read_manifest(Path(self.manifest).expanduser())
