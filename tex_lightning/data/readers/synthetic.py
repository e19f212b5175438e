"""The reader of synthetic surfaces, which are rendered once into the cache."""

import hashlib
import json
import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tex_lightning import __version__
from tex_lightning.config.data import SyntheticConfig
from tex_lightning.core.files import partial_path, unwritable
from tex_lightning.data.readers.folder import read_folder
from tex_lightning.data.recordings import Recordings, plural
from tex_lightning.data.store import cache_root
from tex_lightning.synthetic import write_folder
from tex_lightning.synthetic.dataset import RATE

SOUND = "sound"
CLASSES = 12

log = logging.getLogger(__name__)


@dataclass
class SyntheticReader:
    """Rendered surfaces.

    Sounds take as long to render as all the rest, so they have a folder of the cache to themselves.

    Attributes:
        classes: Number of classes; None means 12.
        surfaces: Recordings to render of each, the section ``data.synthetic``.
        cache_dir: Folder of the cache; None takes the user's.
        senses: Senses in use, or their modalities: sounds are rendered if ``sound`` is one of them,
            and nothing else if it is the only one.
    """

    classes: int | None
    surfaces: dict[str, Any]
    cache_dir: str | None
    senses: list[str]

    def read(self) -> Recordings:
        """Render the surfaces unless the cache has them, and read them."""
        kinds: list[tuple[str, ...]] = [("haptic", "image")] if set(self.senses) != {SOUND} else []
        kinds += [(SOUND,)] if SOUND in self.senses else []
        rows = [row for kind in kinds for row in read_folder(self._folder(kind))]
        return Recordings(
            tuple(  # files of traces do not state their rate
                replace(row, sampling_rate=float(RATE)) if row.modality == "haptic" else row
                for row in rows
            )
        )

    def _folder(self, modalities: tuple[str, ...]) -> Path:
        """Return the folder of the cache with these recordings, rendered there if it is missing."""
        classes = self.classes or CLASSES
        identity = [__version__, classes, self.surfaces, SOUND in modalities]
        digest = hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()[:16]
        target = cache_root(self.cache_dir) / "synthetic" / digest
        if target.is_dir():
            return target
        what = " and ".join(map(plural, modalities))
        log.info("Rendering %s of %d synthetic surfaces, once.", what, classes)
        try:
            with partial_path(target, folder=True) as partial:
                write_folder(classes, SyntheticConfig(**self.surfaces), partial, modalities)
                partial.rename(target)
        except OSError as error:
            if not target.is_dir():  # another process may have been faster
                raise unwritable(target, error) from error
        return target
