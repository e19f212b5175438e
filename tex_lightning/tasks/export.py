"""Write a trained network to a file that runs without this package."""

import json
import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.config.job import Job
from tex_lightning.errors import UserError
from tex_lightning.export.check import compare, refuse
from tex_lightning.export.onnx_file import make_onnx, write_onnx
from tex_lightning.export.onnx_run import onnx_runner
from tex_lightning.export.recordings import recordings
from tex_lightning.export.tracing import trace
from tex_lightning.files import write_atomically, write_text

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Order:
    """What is exported, and whereto.

    Attributes:
        config: The whole configuration.
        checkpoint: The file.
        classifier: As loaded from it.
        out: Folder to write to.
    """

    config: Config
    checkpoint: Path
    classifier: SurfaceClassifier
    out: Path


def run(config: Config, job: Job) -> dict[str, Any]:
    """Write ``checkpoint`` to ``export.out`` as ``export.format``, and what was measured.

    Raises:
        UserError: If it cannot be exported, or the file says something else than the checkpoint.
    """
    checkpoint = Path(str(config.checkpoint)).expanduser()
    classifier = load_classifier(checkpoint)
    if classifier.card.baseline:
        raise UserError(
            f"Checkpoint {checkpoint} holds {classifier.card.title}, which computes outside of "
            "PyTorch; export one of this package's networks."
        )
    out = job.directory if config.export.out is None else Path(config.export.out).expanduser()
    entry = FORMATS[config.export.format](Order(config, checkpoint, classifier, out))
    results = {"task": config.task, "format": config.export.format, **entry}
    write_text(out / "export.json", json.dumps(results, indent=1))
    return results


def _onnx(order: Order) -> dict[str, Any]:
    """``KIND.onnx``, checked by onnxruntime."""
    classifier, config = order.classifier, order.config
    model = make_onnx(classifier, trace(classifier))
    samples = recordings(config.data, classifier, config.export.check)
    found = compare(onnx_runner(model), classifier, samples, config.engine)
    refuse(found)
    path = order.out / f"{classifier.card.kind}.onnx"
    write_atomically(path, lambda partial: write_onnx(model, partial))
    size = path.stat().st_size
    log.info(
        "%s: %.1f MB; %d of %d labels as of the checkpoint, scores within %.1g of their range.",
        path, size / 1e6, found.same_labels, found.recordings, found.score_difference,
    )  # fmt: skip
    return {"file": str(path), "bytes": size, **found.to_dict()}


FORMATS: dict[str, Callable[[Order], dict[str, Any]]] = {"onnx": _onnx}
