"""Record from sensors into the folder of a class: several signals side by side, and photos."""

from contextlib import nullcontext

from tex_lightning.config import Config, Job
from tex_lightning.data.recordings import normal_form
from tex_lightning.recording.class_folder import ClassFolder
from tex_lightning.recording.recorder import record
from tex_lightning.recording.sources import open_camera
from tex_lightning_runtime.files import expanded


def run(config: Config, job: Job) -> None:
    """Add ``record.count`` recordings to ``record.out/record.label`` and to its manifest.

    A recording is written when it is whole.

    Raises:
        UserError: If a sensor or the folder cannot be used; recordings that were finished stay.
    """
    settings = config.record
    out = expanded(str(settings.out))
    folder = ClassFolder(out, normal_form(str(settings.label)), settings.conditions)
    photos = config.files.get("image")
    with open_camera(str(photos)) if photos else nullcontext() as camera:
        record(config, folder, camera)
