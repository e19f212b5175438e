"""Record from sensors into the folder of a class, so that a data set grows by stroking."""

from contextlib import ExitStack
from pathlib import Path

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.recording.class_folder import ClassFolder, open_camera
from tex_lightning.recording.recorder import Recorder, record_photos


def run(config: Config, job: Job) -> None:
    """Add ``record.count`` recordings to ``record.out/record.label`` and to its manifest.

    A recording is written when it is whole; one that is interrupted is kept as far as it went, if
    that is long enough.

    Raises:
        UserError: If a sensor or the folder cannot be used; recordings that were
            finished stay.
    """
    settings = config.record
    out = Path(str(settings.out)).expanduser()
    folder = ClassFolder(out, str(settings.label), settings.conditions)
    photos = config.files.get("image")
    with ExitStack() as stack:
        camera = stack.enter_context(open_camera(str(photos))) if photos else None
        if camera is not None and list(config.files) == ["image"]:
            record_photos(camera, folder, settings.count, settings.seconds)
        else:
            Recorder(config, folder, camera, stack).record()
