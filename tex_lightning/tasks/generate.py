"""Write synthetic surfaces to a folder, to look at them or to try another tool on them."""

import logging
from pathlib import Path

from tex_lightning.data.readers.synthetic import spec_of
from tex_lightning.data.synthetic import write_folder, write_tum
from tex_lightning.errors import UserError
from tex_lightning.schema import Config

log = logging.getLogger(__name__)


def run(config: Config, directory: Path) -> None:
    """Write ``data.classes`` surfaces to ``generate.out`` in the layout ``generate.layout``."""
    out = Path(config.generate.out).expanduser()
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UserError(f"generate.out={out} is not empty; name a new folder.")
    out.mkdir(parents=True, exist_ok=True)
    spec = spec_of(config.data)
    write = write_tum if config.generate.layout == "tum" else write_folder
    write(spec, out)
    log.info("%d synthetic classes written to %s.", spec.classes, out)
