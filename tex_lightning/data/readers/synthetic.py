"""Reader of synthetic surfaces: rendered once into the cache, then read as a folder."""

import hashlib
import json
import logging
import shutil
import tempfile
from dataclasses import asdict
from pathlib import Path

from tex_lightning import __version__
from tex_lightning.config import DataConfig
from tex_lightning.data.readers.folder import read_folder
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import cache_root
from tex_lightning.synthetic import SyntheticSpec, write_folder

log = logging.getLogger(__name__)


def spec_of(config: DataConfig) -> SyntheticSpec:
    """The synthetic data set that a configuration asks for."""
    return SyntheticSpec(
        classes=config.classes or SyntheticSpec.classes,
        recordings=config.synthetic.recordings,
        seed=config.synthetic.seed,
        seconds=config.synthetic.seconds,
        photo_width=config.synthetic.photo_width,
        photo_height=config.synthetic.photo_height,
    )


def read(config: DataConfig) -> Recordings:
    """Render the surfaces unless the cache has them, and read them."""
    spec = spec_of(config)
    identity = json.dumps({"version": __version__, **asdict(spec)}, sort_keys=True)
    digest = hashlib.sha256(identity.encode()).hexdigest()[:16]
    target = cache_root(config.cache_dir) / "synthetic" / digest
    if not target.is_dir():
        log.info("Rendering %d synthetic surfaces, once.", spec.classes)
        _render(spec, target)
    return read_folder(target)


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
