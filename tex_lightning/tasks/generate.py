"""Write synthetic surfaces to a folder, to look at them or to try another tool on them."""

from pathlib import Path

from tex_lightning.config import Config, Job
from tex_lightning.core.console import say
from tex_lightning.data.manifest import write_manifest
from tex_lightning.data.readers.folder import read_folder
from tex_lightning.data.readers.synthetic import CLASSES
from tex_lightning.errors import UserError
from tex_lightning.synthetic import write_folder
from tex_lightning_runtime.files import expanded


def run(config: Config, job: Job) -> None:
    """Write ``data.classes`` surfaces to ``generate.out``, as ``data=folder`` reads them.

    A manifest beside them lists every file, as an example of the format.
    """
    out = _new_folder(config.generate.out)
    classes = config.data.classes or CLASSES
    modalities = ("haptic", "image", *(["sound"] if config.generate.sound else []))
    write_folder(classes, config.data.synthetic, out, modalities)
    write_manifest(read_folder(out), out / "manifest.csv")
    say(f"{classes} synthetic classes written to {out}.")


def _new_folder(name: str) -> Path:
    out = expanded(name)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UserError(f"generate.out={out} is not empty; name a new folder.")
    out.mkdir(parents=True, exist_ok=True)
    return out
