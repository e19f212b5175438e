"""Write a trained network to a file that runs without this package, and what was measured."""

import json
import logging
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.core.console import say
from tex_lightning.core.files import read_or_empty, write_bytes, write_text
from tex_lightning.data.store import cache_root
from tex_lightning.errors import UserError
from tex_lightning.export.metadata import metadata, model_card
from tex_lightning.export.onnx_file import (
    compare,
    make_onnx,
    noise_sample,
    onnx_bytes,
    onnx_runner,
    require_agreement,
    without_defaults,
)
from tex_lightning.export.web_page import page_files, runtime_files
from tex_lightning.inference.prediction import check_unknown

RECORD = "export.json"

log = logging.getLogger(__name__)


def export_checkpoint(config: Config, checkpoint: Path, out: Path) -> dict[str, Any]:
    """Write the classifier of a checkpoint to a folder, and what was measured.

    Args:
        config: Format and checks of the export, and the decision.
        checkpoint: The file.
        out: The folder.

    Raises:
        UserError: If it cannot be exported, the file gives other scores than the checkpoint, or
            a file that no export wrote would be written over.
    """
    classifier, card = load_classifier(checkpoint), config.export.format == "card"
    if classifier.card.baseline and not card:
        raise UserError(
            f"Checkpoint {checkpoint} holds {classifier.card.title}, which computes outside of "
            "PyTorch; export one of this package's networks."
        )
    classifier.card = classifier.card.deciding(config.decision)
    check_unknown(classifier.card, bool(classifier.statistics))
    log.info("Exporting the %s as %s.", classifier.card.title, config.export.format)
    page: dict[str, bytes] = {}
    if config.export.format == "web":
        runtime = runtime_files(config.export.web_runtime, cache_root(config.data.cache_dir))
        page = page_files(metadata(classifier), runtime)
    file = out / ("MODEL_CARD.md" if card else f"{classifier.card.kind}.onnx")
    claim = _claimed(out, [RECORD, file.name, *page])
    if card:
        agreement, content = dict[str, Any](), model_card(classifier, checkpoint).encode()
    else:
        agreement, content = _compared(config, classifier, in_page=bool(page))
    write_text(out / RECORD, json.dumps(claim, indent=1))
    for name, part in {file.name: content, **page}.items():
        write_bytes(out / name, part)
    _show(file, agreement, page)
    entry = {"file": file.name, "bytes": len(content), "files": claim["files"]}
    results = {"task": config.task, "format": config.export.format, **agreement, **entry}
    write_text(out / RECORD, json.dumps(results, indent=1))
    return results


def _claimed(out: Path, names: Sequence[str]) -> dict[str, Any]:
    """Return the record of exports to a folder, with the names of files that come now.

    It is written before them, so that an export that is killed does not keep out the next.

    Raises:
        UserError: If one of them is there, and no export wrote it.
    """
    before = read_or_empty(out / RECORD)
    written = before.get("files", [])
    for name in names:
        if os.path.lexists(out / name) and name not in written:
            raise UserError(
                f"{out / name} was not written by an export; move it away or choose another "
                "export.out."
            )
    return {**before, "files": [*dict.fromkeys([RECORD, *written, *names])]}


def _compared(
    config: Config, classifier: SurfaceClassifier, *, in_page: bool
) -> tuple[dict[str, Any], bytes]:
    """Return how what onnxruntime runs agrees with its classifier, and the file."""
    model = make_onnx(classifier)
    samples = [noise_sample(classifier, seed) for seed in range(config.export.check)]
    agreement = compare(onnx_runner(model), classifier, samples)
    require_agreement(agreement, classifier)
    return agreement, onnx_bytes(without_defaults(model) if in_page else model)


def _show(file: Path, agreement: Mapping[str, Any], page: Mapping[str, bytes]) -> None:
    """Print which file was written, how it agrees with its classifier, and how a page is served."""
    if not agreement:
        say(str(file))
        return
    say(
        f"{file}: {file.stat().st_size / 1e6:.1f} MB; {agreement['same_labels']} of "
        f"{agreement['recordings']} labels equal those of the checkpoint, scores within "
        f"{agreement['score_difference']:.1g} of their range."
    )
    if page:
        say(
            f"Serve {file.parent} with python -m http.server --bind 127.0.0.1 -d {file.parent}",
            wraps=False,
        )
