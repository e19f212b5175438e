"""Write a manifest from the names of files."""

from tex_lightning.config import Config, Job
from tex_lightning.core.console import say
from tex_lightning.data.manifest import read_manifest, write_manifest
from tex_lightning.data.readers.path_pattern import read_names
from tex_lightning.errors import UserError, inflected, listed
from tex_lightning_runtime.files import expanded


def run(config: Config, job: Job) -> None:
    """Write ``manifest.csv`` into ``data.root``, a line for each file that fits ``pattern``.

    Raises:
        UserError: If there is such a file already, or it cannot be written or used.
    """
    root = expanded(str(config.data.root))
    out = root / "manifest.csv"
    if config.pattern is None:
        raise UserError("Give the pattern of the names, such as pattern='{label}_{group}.wav'.")
    if out.exists():
        raise UserError(f"{out} exists already; rename or delete it to have it written anew.")
    table, others = read_names(root, config.pattern)
    try:
        write_manifest(table, out)
    except OSError as error:
        raise UserError(f"{out} cannot be written ({error.strerror}).") from error
    try:
        read_manifest(out)  # whatever is wrong in it is said now
    except UserError:
        out.unlink()
        raise
    for note in table.notes:
        say(note)
    say(f"{len(table)} recordings of {len(table.classes)} classes: {listed(table.classes)}.")
    if others:
        files = inflected(len(others), "file has another name", "files have other names")
        say(f"{files}, such as {others[0]}.")
    say(f"Train on them with data=manifest data.manifest={out}")
