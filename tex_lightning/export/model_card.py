"""A model card: what a trained network is, how well it does, and how to load it.

Front matter and headings are those of model hubs (Mitchell et al., "Model Cards for Model
Reporting", 2019).
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from tex_lightning import __version__
from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.core.files import read_record
from tex_lightning.errors import listed
from tex_lightning.text import printable, to_markdown

RESULTS = "results.json"
OFFICIAL = "imagenet"  # the source that stands for a trunk's official weights
LICENCES = {"efficientnet": "Apache-2.0 (EfficientNet-Lite)"}


def model_card(classifier: SurfaceClassifier, checkpoint: Path) -> str:
    """The card as Markdown.

    Args:
        classifier: As loaded.
        checkpoint: Its file; figures are read from the run folder it lies in, if there is one.
    """
    card, results = classifier.card, _results(checkpoint)
    entry = results.get("networks", {}).get(card.kind, {})
    senses = " and ".join(map(to_markdown, card.modalities))
    parts = [
        _front_matter(card, entry, results),
        f"# {to_markdown(card.kind)}: {senses} to one of {len(card.classes)} surfaces",
        _what(classifier),
        "## Data\n\n" + "\n".join(_data(card, results)),
        "## Results\n\n" + "\n".join(_figures(entry)),
        "## Licence of pretrained weights\n\n" + _licence(card),
        _loading(card, checkpoint),
    ]
    return "\n\n".join(parts) + "\n"


def _results(checkpoint: Path) -> dict[str, Any]:
    """``results.json`` of the run; of a fold's checkpoint that of all folds, if they are done."""
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
    return f"---\n{yaml.safe_dump(values, sort_keys=False, allow_unicode=True)}---"


def _what(classifier: SurfaceClassifier) -> str:
    card = classifier.card
    names = {type(sense.network).__name__: None for sense in classifier.senses.values()}
    fused = "" if classifier.fusion is None else f", fused on {card.fusion['level'].upper()}"
    return (
        f"{listed(list(names))}{fused}, {classifier.count_parameters():,} parameters, trained with "
        f"tex_lightning {__version__}. The label is decided by {card.rule} over the positions of a "
        "recording."
    )


def _data(card: Card, results: Mapping[str, Any]) -> Iterator[str]:
    seen = card.trained_on.get("seen")
    if results:
        source = f"data={results['data']} (task={results['task']})"
        yield f"- Source: {to_markdown(source)}"
    yield f"- Recordings behind the weights: {len(seen) if seen else 'not known'}"
    if "test_fold" in card.trained_on:
        tested = f"fold {card.trained_on['test_fold']} of {card.trained_on.get('folds')}"
        yield f"- Left out to test: {to_markdown(tested)}"
    for name, node in card.senses.items():
        rate = node["decode"].get("sampling_rate")
        what = to_markdown(f"{name} reads {node['modality']}")
        yield f"- {what}" + (f" at {rate:g} Hz" if rate else "")
    yield f"- Classes: {', '.join(map(to_markdown, card.classes))}"


def _figures(entry: Mapping[str, Any]) -> Iterator[str]:
    if not entry:
        yield "No finished run lies beside the checkpoint, so nothing is known of its accuracy."
        return
    low, high = entry["vote_ci95"]
    yield "| measure | value |\n|---|---|"
    yield (
        f"| correct labels | {entry['correct']} of {entry['test_samples']}: "
        f"{100 * entry['vote_accuracy']:.1f} % (Wilson 95 %: {100 * low:.1f} to {100 * high:.1f}) |"
    )
    yield f"| correct fragments | {100 * entry['fragment_accuracy']:.1f} % |"
    calibration = entry.get("calibration", {})
    if "ece" in calibration:
        yield f"| expected calibration error | {calibration['ece']:.3f} |"
    if latency := entry.get("latency_ms"):
        yield f"| latency, median | {latency['median']:.1f} ms |"
    if folds := entry.get("folds"):
        yield f"\nPooled over {len(folds)} folds, each tested by the network trained without it."


def _licence(card: Card) -> str:
    trunks = card.trained_on.get("trunks") or {}
    if not trunks:
        return "None were used: all weights began at random."
    said = []
    for sense, source in trunks.items():
        node = json.dumps(card.senses.get(sense, {}))
        known = [text for name, text in LICENCES.items() if name in node and source == OFFICIAL]
        text = known[0] if known else f"as stated by the publisher of {source}"
        said += [to_markdown(f"{sense}: {text}")]
    return "; ".join(said) + "."


def _loading(card: Card, checkpoint: Path) -> str:
    name = printable(checkpoint.name).replace("`", "'")  # which would end the block
    given = ", ".join(f'{printable(each)}="FILE"' for each in card.modalities)
    return f"""## How to load

```python
import tex_lightning as tl

print(tl.load("{name}").predict({given}).label)
```

Without this package: `python -m tex_lightning task=export checkpoint={name}` writes
`{printable(card.kind)}.onnx`, which onnxruntime runs."""
