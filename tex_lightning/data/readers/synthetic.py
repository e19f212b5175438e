"""Reader of synthetic surfaces: rendered once into the cache, then read as a folder."""

import hashlib
import json
import logging
import shutil
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

from tex_lightning import __version__
from tex_lightning.config.data import SyntheticConfig
from tex_lightning.data.readers.folder import read_folder
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import cache_root
from tex_lightning.synthetic import SyntheticSpec, write_folder

log = logging.getLogger(__name__)


@dataclass
class SyntheticReader:
    """Rendered surfaces.

    Attributes:
        classes: How many; None takes the usual number.
        surfaces: What is rendered of each.
        cache_dir: Folder of the cache; None takes the user's.
    """

    classes: int | None
    surfaces: SyntheticConfig
    cache_dir: str | None

    def read(self) -> Recordings:
        """Render the surfaces unless the cache has them, and read them."""
        spec = spec_of(self.classes, self.surfaces)
        identity = json.dumps({"version": __version__, **asdict(spec)}, sort_keys=True)
        digest = hashlib.sha256(identity.encode()).hexdigest()[:16]
        target = cache_root(self.cache_dir) / "synthetic" / digest
        if not target.is_dir():
            log.info("Rendering %d synthetic surfaces, once.", spec.classes)
            _render(spec, target)
        return read_folder(target)


def spec_of(classes: int | None, surfaces: SyntheticConfig) -> SyntheticSpec:
    """The synthetic data set of so many classes; None takes the usual number."""
    return SyntheticSpec(
        classes=classes or SyntheticSpec.classes,
        recordings=surfaces.recordings,
        seed=surfaces.seed,
        seconds=surfaces.seconds,
        photo_width=surfaces.photo_width,
        photo_height=surfaces.photo_height,
    )


def _render(spec: SyntheticSpec, target: Path) -> None:
    """Write beside the target and move it there whole; another process may have been faster."""
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}."))
    try:
        write_folder(spec, partial)
        partial.rename(target)
    except OSError:
        if not target.is_dir():
            raise
    finally:
        shutil.rmtree(partial, ignore_errors=True)
