"""Write a trained network to a file that runs without this package."""

import hashlib
import json
import logging
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.core.console import say
from tex_lightning.core.files import is_file, read_record, write_atomically, write_bytes, write_text
from tex_lightning.data.store import cache_root
from tex_lightning.errors import UserError
from tex_lightning.export.check import Runner, compare, recordings, require_agreement
from tex_lightning.export.metadata import metadata
from tex_lightning.export.model_card import model_card
from tex_lightning.export.onnx_file import make_onnx, onnx_runner, without_defaults, write_onnx
from tex_lightning.export.tracing import trace
from tex_lightning.export.web_page import page_files, runtime_files
from tex_lightning.inference.prediction import check_unknown

RECORD = "export.json"

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Order:
    """The network to export, and the target folder.

    Attributes:
        config: The whole configuration.
        checkpoint: The file.
        classifier: As loaded from it.
        out: Folder to write to.
        written: SHA-256 of the files in it that an export wrote, by name.
        claimed: Names of those that this one writes.
    """

    config: Config
    checkpoint: Path
    classifier: SurfaceClassifier
    out: Path
    written: dict[str, str]
    claimed: list[str] = field(default_factory=list)

    def claim(self, *names: str) -> None:
        """Refuse to write over files that no export wrote, before any work is done.

        Raises:
            UserError: Naming the first of them.
        """
        for name in names:
            path = self.out / name
            if not os.path.lexists(path):
                continue
            if not is_file(path) or _digest(path) != self.written.get(name):
                raise UserError(
                    f"{path} was not written by an export, or was changed since; move it away or "
                    "choose another export.out."
                )
        self.claimed.extend(names)


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
    classifier.card = classifier.card.deciding(config.decision)
    check_unknown(classifier.card, bool(classifier.statistics))
    out = job.directory if config.export.out is None else Path(config.export.out).expanduser()
    log.info("Exporting the %s as %s.", classifier.card.title, config.export.format)
    order = Order(config, checkpoint, classifier, out, _written(out))
    entry = FORMATS[config.export.format](order)
    files = {**order.written, **{name: _digest(out / name) for name in order.claimed}}
    results = {"task": config.task, "format": config.export.format, **entry, "files": files}
    write_text(out / RECORD, json.dumps(results, indent=1))
    return results


def _written(out: Path) -> dict[str, str]:
    """SHA-256 of the files that exports have written to a folder, by name.

    Raises:
        UserError: If its record is of something else.
    """
    path = out / RECORD
    if not os.path.lexists(path):
        return {}
    record = read_record(path)
    if record.get("task") != "export" or not isinstance(files := record.get("files"), dict):
        raise UserError(f"{path} was not written by an export; choose another export.out.")
    return files


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _onnx(order: Order) -> dict[str, Any]:
    """``KIND.onnx``, run by onnxruntime."""
    path = order.out / f"{order.classifier.card.kind}.onnx"
    order.claim(path.name)
    model = make_onnx(order.classifier, trace(order.classifier))
    return _checked(order, onnx_runner(model), path, lambda partial: write_onnx(model, partial))


def _web(order: Order) -> dict[str, Any]:
    """A page for the browser, with the file that it runs."""
    config, classifier = order.config, order.classifier
    cache = cache_root(config.data.cache_dir)
    runtime = runtime_files(config.export.web_runtime, cache)  # before what takes longer
    page = page_files(metadata(classifier), runtime)
    path = order.out / f"{classifier.card.kind}.onnx"
    order.claim(path.name, *page)
    model = make_onnx(classifier, trace(classifier))
    given = without_defaults(model)
    entry = _checked(order, onnx_runner(model), path, lambda partial: write_onnx(given, partial))
    for name, content in page.items():
        write_bytes(order.out / name, content)
    size = entry["bytes"] + sum(map(len, page.values()))
    say(
        f"{order.out}: {size / 1e6:.1f} MB; look at it with "
        f"python -m http.server --bind 127.0.0.1 -d {order.out}",
        wraps=False,
    )
    return {**entry, "page": "index.html", "page_bytes": size}


def _card(order: Order) -> dict[str, Any]:
    """``MODEL_CARD.md``."""
    path = order.out / "MODEL_CARD.md"
    order.claim(path.name)
    write_text(path, model_card(order.classifier, order.checkpoint))
    say(str(path))
    return {"file": path.name, "bytes": _size(path)}


def _checked(
    order: Order, runner: Runner, path: Path, write: Callable[[Path], None]
) -> dict[str, Any]:
    """Compare a file with its classifier, then write it."""
    classifier, config = order.classifier, order.config
    samples = recordings(config.data, classifier, config.export.check)
    found = compare(runner, classifier, samples)
    require_agreement(found, classifier)
    write_atomically(path, write)
    say(
        f"{path}: {_size(path) / 1e6:.1f} MB; {found['same_labels']} of {found['recordings']} "
        f"labels as of the checkpoint, scores within {found['score_difference']:.1g} of their "
        "range."
    )
    return {"file": path.name, "bytes": _size(path), **found}


def _size(path: Path) -> int:
    return path.stat().st_size


FORMATS: dict[str, Callable[[Order], dict[str, Any]]] = {
    "onnx": _onnx,
    "web": _web,
    "card": _card,
}
