"""Write artifacts, scalars and embeddings as event files of TensorBoard."""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from PIL import Image
from tensorboard.compat.proto.summary_pb2 import Summary
from torch.utils.tensorboard import summary
from torch.utils.tensorboard.writer import FileWriter

from tex_lightning.config.overrides import Setting
from tex_lightning.core.files import write_text
from tex_lightning.report.board import Artifact, Picture, Points, Sound, Words, wav, write_points

make: Any = summary  # whose functions are not typed


def write_events(
    folder: Path,
    part: str,
    artifacts: Sequence[Artifact],
    metrics: Mapping[str, float],
    trial: Mapping[str, Setting] | None,
) -> None:
    """Write one part of a run, in place of what an earlier process has written of it.

    Args:
        folder: Folder of the run's events.
        part: Name of the part, with which its file ends.
        artifacts: What to show.
        metrics: Scalars by tag.
        trial: Hyper-parameters that make it a trial; None if it is none.
    """
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
                writer.add_summary(_summary(artifact), 0)
    finally:
        writer.close()
    if points := [artifact for artifact in artifacts if isinstance(artifact, Points)]:
        _write_projector(folder, points)


def _summary(artifact: Picture | Sound | Words) -> Any:  # noqa: ANN401  (protocol buffers have no types)
    if isinstance(artifact, Words):
        return make.text(artifact.tag, artifact.markdown)
    if isinstance(artifact, Sound):
        audio = Summary.Audio(
            sample_rate=artifact.rate, num_channels=1, length_frames=len(artifact.samples),
            encoded_audio_string=wav(artifact.samples, artifact.rate), content_type="audio/wav",
        )  # fmt: skip
        return Summary(value=[Summary.Value(tag=artifact.tag, audio=audio)])
    with Image.open(io.BytesIO(artifact.content)) as opened:
        width, height = opened.size
    image = Summary.Image(
        width=width, height=height, colorspace=3, encoded_image_string=artifact.content
    )
    return Summary(value=[Summary.Value(tag=artifact.tag, image=image)])


def _write_projector(folder: Path, points: Sequence[Points]) -> None:
    """Write embeddings for TensorBoard's projector, in place of earlier ones."""
    entries = []
    for artifact in points:
        home = folder / "projector" / artifact.tag
        write_points(home, artifact)
        lines = [
            f'tensor_name: "{artifact.tag}"',
            f'tensor_path: "projector/{artifact.tag}/tensors.tsv"',
            f'metadata_path: "projector/{artifact.tag}/metadata.tsv"',
        ]
        if artifact.thumbnails is not None:
            side = artifact.thumbnails.shape[1]
            lines.append(
                f'sprite {{ image_path: "projector/{artifact.tag}/sprite.png" '
                f"single_image_dim: {side} single_image_dim: {side} }}"
            )
        entries.append("embeddings {\n  " + "\n  ".join(lines) + "\n}\n")
    write_text(folder / "projector_config.pbtxt", "".join(entries))
