"""A model card: what a trained network is, how well it does, and how to load it.

Front matter and headings are those of model hubs (Mitchell et al., "Model Cards for Model
Reporting", 2019); the text is ``model_card.md.jinja``.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from tex_lightning import __version__
from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.core.files import read_record
from tex_lightning.errors import listed
from tex_lightning.text import printable, render

RESULTS = "results.json"
TEMPLATE = Path(__file__).with_name("model_card.md.jinja")


def model_card(classifier: SurfaceClassifier, checkpoint: Path) -> str:
    """Return the card as Markdown.

    Args:
        classifier: As loaded.
        checkpoint: Its file; figures are read from the run folder it lies in, if there is one.
    """
    card, results = classifier.card, _results(checkpoint)
    entry = results.get("networks", {}).get(card.kind, {})
    networks = {type(sense.network).__name__: None for sense in classifier.senses.values()}
    context = {
        "card": card,
        "results": results,
        "entry": entry,
        "front_matter": _front_matter(card, entry, results),
        "networks": listed(list(networks)),
        "fused": f", fused on {card.fusion['level'].upper()}" if classifier.fusion else "",
        "parameters": classifier.count_parameters(),
        "version": __version__,
        "sources": card.trained_on.get("trunks") or {},
        "checkpoint": printable(checkpoint.name).replace("`", "'"),  # which would end the block
        "inputs": ", ".join(f'{printable(name)}="FILE"' for name in card.modalities),
    }
    return render(TEMPLATE, context)


def _results(checkpoint: Path) -> dict[str, Any]:
    """Read ``results.json`` of the run, or of all folds for the checkpoint of one."""
    run = checkpoint.resolve().parent.parent
    for folder in ([run.parent.parent] if run.parent.name == "folds" else []) + [run]:
        if (folder / RESULTS).is_file():
            return read_record(folder / RESULTS)
    return {}


def _front_matter(card: Card, entry: Mapping[str, Any], results: Mapping[str, Any]) -> str:
    values: dict[str, Any] = {
        "library_name": "tex_lightning",
        "pipeline_tag": "image-classification" if card.modalities == ("image",) else "other",
        "tags": ["surface-material-classification", *card.modalities],
    }
    if "vote_accuracy" in entry:
        metric = {"type": "accuracy", "value": round(entry["vote_accuracy"], 4)}
        test = {
            "task": {"type": "surface-material-classification"},
            "dataset": {"name": results.get("data", "own"), "type": results.get("data", "own")},
            "metrics": [metric],
        }
        values["model-index"] = [{"name": card.kind, "results": [test]}]
    return str(yaml.safe_dump(values, sort_keys=False, allow_unicode=True))
