"""Artifacts of a run beside its scalars, for TensorBoard and MLflow: pictures, sounds, texts.

Pictures come as PNG, so that a figure of the run folder is written and never drawn again.
"""

import io
import re
import tempfile
import wave
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from lightning.pytorch.loggers import Logger, MLFlowLogger, TensorBoardLogger
from PIL import Image

from tex_lightning.config.model import FUSION
from tex_lightning.config.overrides import Setting
from tex_lightning.core.files import write_bytes, write_text

Pixels = npt.NDArray[np.uint8]
ORDER = ("haptic", "visual", "sound")  # of reading; then senses of the user's, and the fusion last
UNUSUAL = re.compile(r"[^\w.,+=@ -]")  # in the name of a file
MAX_NAME = 80  # characters of it


@dataclass(frozen=True)
class Media:
    """A file to look at, to hear or to read.

    Attributes:
        tag: Its name for loggers.
        content: What is in the file.
        suffix: ``.png`` of a figure, ``.jpg`` of what has photos, ``.wav``, or ``.md``.
    """

    tag: str
    content: bytes
    suffix: str


@dataclass(frozen=True)
class Points:
    """Embeddings of recordings of a sense, (recordings, D), with text of each by heading.

    Thumbnails are (recordings, side, side, 3).
    """

    tag: str
    vectors: npt.NDArray[np.float32]
    columns: Mapping[str, Sequence[str]]
    thumbnails: Pixels


Artifact = Media | Points


def folder_name(network: str) -> str:
    """Return the name of a network's events, such that names sort in the order of reading.

    Example:
        >>> from tex_lightning.report.artifacts import folder_name
        >>> sorted(map(folder_name, ("fusion", "force", "visual", "haptic")))
        ['1-haptic', '2-visual', '4-force', '5-fusion']
    """
    last = len(ORDER) + (2 if network == FUSION else 1)
    return f"{ORDER.index(network) + 1 if network in ORDER else last}-{network}"


def shows(loggers: Iterable[Logger]) -> bool:
    """Return whether one of the loggers shows artifacts."""
    return any(isinstance(logger, TensorBoardLogger | MLFlowLogger) for logger in loggers)


def show(
    logger: Logger,
    part: str,
    artifacts: Iterable[Artifact],
    metrics: Mapping[str, float] | None = None,
    trial: Mapping[str, Setting] | None = None,
) -> None:
    """Add artifacts to TensorBoard or MLflow; other loggers show none.

    Args:
        logger: Logger of a network.
        part: Name of what is shown together; in TensorBoard it replaces what an earlier process has
            shown of this part.
        artifacts: What to show.
        metrics: Scalars for TensorBoard, by tag.
        trial: What makes this a trial among others in TensorBoard's HPARAMS; None if it is none.
    """
    if isinstance(logger, TensorBoardLogger):
        _to_events(Path(logger.log_dir), part, [*artifacts], metrics or {}, trial)
    elif isinstance(logger, MLFlowLogger):
        _to_artifacts(logger, part, artifacts)


def _to_events(
    folder: Path,
    part: str,
    artifacts: Sequence[Artifact],
    metrics: Mapping[str, float],
    trial: Mapping[str, Setting] | None,
) -> None:
    """Write one part of a run in place of what an earlier process has written of it."""
    from torch.utils.tensorboard import summary  # takes TensorBoard's modules
    from torch.utils.tensorboard.writer import FileWriter

    make: Any = summary  # whose functions are not typed
    for earlier in folder.glob(f"events.out.tfevents.*.{part}"):  # of a run that was interrupted
        earlier.unlink()
    writer = FileWriter(str(folder), filename_suffix=f".{part}")
    try:
        for tag, value in metrics.items():
            writer.add_summary(make.scalar(tag, value), 0)
        if trial is not None:  # without a table of columns, which TensorBoard takes from one run
            plain = {
                key: str(value).lower() if isinstance(value, bool) else value
                for key, value in trial.items()
            }
            for told in make.hparams(plain, {})[1:]:
                writer.add_summary(told, 0)
        for artifact in artifacts:
            if not isinstance(artifact, Points):
                writer.add_summary(_summary(artifact, make), 0)
    finally:
        writer.close()
    if points := [artifact for artifact in artifacts if isinstance(artifact, Points)]:
        _write_projector(folder, points)


def _summary(artifact: Media, make: Any) -> Any:  # noqa: ANN401  (no types)
    from tensorboard.compat.proto.summary_pb2 import Summary

    content, stream = artifact.content, io.BytesIO(artifact.content)
    if artifact.suffix == ".md":
        return make.text(artifact.tag, content.decode())
    if artifact.suffix == ".wav":
        with wave.open(stream) as sound:
            rate, length = sound.getframerate(), sound.getnframes()
        audio = Summary.Audio(
            sample_rate=rate, num_channels=1, length_frames=length, encoded_audio_string=content,
            content_type="audio/wav",
        )  # fmt: skip
        return Summary(value=[Summary.Value(tag=artifact.tag, audio=audio)])
    with Image.open(stream) as opened:
        width, height = opened.size
    image = Summary.Image(width=width, height=height, colorspace=3, encoded_image_string=content)
    return Summary(value=[Summary.Value(tag=artifact.tag, image=image)])


def _write_projector(folder: Path, points: Sequence[Points]) -> None:
    """Write embeddings for TensorBoard's projector, in place of earlier ones."""
    from tensorboard.plugins.projector.projector_config_pb2 import ProjectorConfig

    config: Any = ProjectorConfig()  # which is not typed
    for artifact in points:
        home = f"projector/{artifact.tag}"
        write_points(folder / home, artifact)
        entry = config.embeddings.add(
            tensor_name=artifact.tag,
            tensor_path=f"{home}/tensors.tsv",
            metadata_path=f"{home}/metadata.tsv",
        )
        entry.sprite.image_path = f"{home}/sprite.png"
        entry.sprite.single_image_dim.extend(artifact.thumbnails.shape[1:3])
    write_text(folder / "projector_config.pbtxt", str(config))


def wav(samples: npt.NDArray[np.float32], rate: int) -> bytes:
    """Return samples in [-1, 1] as the content of a WAV file of 16 bits."""
    stream = io.BytesIO()
    with wave.open(stream, "wb") as file:
        file.setparams((1, 2, rate, len(samples), "NONE", ""))
        file.writeframes((np.clip(samples, -1, 1) * 32767).astype("<i2").tobytes())
    return stream.getvalue()


def jpeg(pixels: Pixels) -> bytes:
    """Return pixels (height, width, 3) as the content of a JPEG file, a fifth as large."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", quality=88)
    return stream.getvalue()


def png(pixels: Pixels) -> bytes:
    """Return pixels (height, width, 3) as the content of a PNG file."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG", compress_level=4)  # larger by little, much faster
    return stream.getvalue()


def write_points(home: Path, artifact: Points) -> None:
    """Write vectors, text and thumbnails into a folder."""
    rows = ("\t".join(f"{value:.5g}" for value in vector) for vector in artifact.vectors.tolist())
    write_text(home / "tensors.tsv", "\n".join(rows) + "\n")
    cells = zip(*artifact.columns.values(), strict=True)
    lines = ["\t".join(artifact.columns), *("\t".join(row) for row in cells)]
    write_text(home / "metadata.tsv", "\n".join(lines) + "\n")
    write_bytes(home / "sprite.png", png(sprite(artifact.thumbnails)))


def sprite(thumbnails: Pixels) -> Pixels:
    """Join thumbnails (n, side, side, 3), row by row, to a square of as many each way."""
    count, side = thumbnails.shape[:2]
    across = int(np.ceil(np.sqrt(count)))
    grid = np.zeros((across * across, side, side, 3), np.uint8)
    grid[:count] = thumbnails
    rows = grid.reshape(across, across, side, side, 3).swapaxes(1, 2)
    return rows.reshape(across * side, across * side, 3)


def _to_artifacts(logger: MLFlowLogger, part: str, artifacts: Iterable[Artifact]) -> None:
    with tempfile.TemporaryDirectory() as temporary:
        home = Path(temporary)
        for artifact in artifacts:
            if isinstance(artifact, Points):
                write_points(home / "projector" / artifact.tag, artifact)
                continue
            folder, slash, name = artifact.tag.partition("/")
            path = f"{folder}{slash}{UNUSUAL.sub('_', name)[:MAX_NAME]}{artifact.suffix}"
            write_bytes(home / path, artifact.content)
        logger.experiment.log_artifacts(logger.run_id, temporary, part)
