"""Record from sensors into the folder of a class, so that a data set grows by stroking."""

from contextlib import nullcontext
from pathlib import Path

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.recording.class_folder import ClassFolder, open_camera
from tex_lightning.recording.recorder import record


def run(config: Config, job: Job) -> None:
    """Add ``record.count`` recordings to ``record.out/record.label`` and to its manifest.

    A recording is written when it is whole.

    Raises:
        UserError: If a sensor or the folder cannot be used; recordings that were finished stay.
    """
    settings = config.record
    out = Path(str(settings.out)).expanduser()
    folder = ClassFolder(out, str(settings.label), settings.conditions)
    photos = config.files.get("image")
    with open_camera(str(photos)) if photos else nullcontext() as camera:
        record(config, folder, camera)
