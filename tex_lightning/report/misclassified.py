"""Keep the misclassified samples of a test in the run folder, and show them in its report.

``samples/NETWORK.json`` says what became of each, beside pictures and sounds of its recordings.
"""

import base64
import json
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tex_lightning.core.files import read_or_empty, write_bytes, write_text
from tex_lightning.core.run_folder import read_results
from tex_lightning.data.folds import Sample
from tex_lightning.evaluation.confusion import own_pairs
from tex_lightning.evaluation.outcomes import Outcome, read_networks
from tex_lightning.report.artifacts import jpeg, wav
from tex_lightning.report.samples import SampleView, ShownSample, ShownSense, worst
from tex_lightning.report.table import Table
from tex_lightning.text import printable

FOLDER = "samples"
MAX_WRONG = 50  # wrong samples of a network that are kept, the worst of them
HEARD = 2.0  # s of a sound
LOWEST = 11_025  # Hz: faster sounds are kept at half, a quarter, … of their rate down to it
Kept = dict[str, Any]


def keep_samples(directory: Path, network: str, view: SampleView) -> None:
    """Write the worst wrong samples of a network, and both sides of the pairs that it confuses."""
    wrong = [n for n in worst(view.outcomes, MAX_WRONG) if not view.outcomes[n].correct]
    pairs = [{**pair._asdict(), "sides": sides} for pair, sides in view.pairs()]
    numbers = dict.fromkeys([*wrong, *(n for pair in pairs for n in pair["sides"])])
    home = directory / FOLDER
    told = {
        str(number): _kept(home, f"{network}_{number}", view.look(number), view.samples[number])
        for number in numbers
    }
    content = {"errors": view.errors, "wrong": wrong, "pairs": pairs, "samples": told}
    write_text(home / f"{network}.json", json.dumps(content, indent=1))


def _kept(home: Path, name: str, shown: ShownSample, sample: Sample) -> Kept:
    """Write the pictures and sounds of one sample, and return its entry."""
    outcome, known = shown.outcome, shown.outcome.class_probabilities
    conditions = {k: v for row in sample.recordings.values() for k, v in row.conditions}
    facts = {
        "probability of the class": f"{known.get(outcome.label, 0):.1%}",
        "probability of the label": f"{known.get(outcome.predicted, 0):.1%}",
        "votes for the label": f"{outcome.share:.0%} of {outcome.fragments}",
        "novelty": "" if np.isnan(outcome.novelty) else f"{outcome.novelty:.2f}",
        "group": outcome.group,
        "fold": outcome.fold,
        **conditions,
    }
    return {
        "label": outcome.label,
        "predicted": outcome.predicted,
        "files": dict(outcome.files),
        "facts": {key: value for key, value in facts.items() if value},
        "senses": {
            sense: _sense(home, f"{name}_{sense}", seen) for sense, seen in shown.senses.items()
        },
    }


def _sense(home: Path, name: str, shown: ShownSense) -> dict[str, str]:
    """Write pictures and sound of a recording; return their names."""
    files = {what: f"{name}_{what}.jpg" for what in shown.pictures}
    for what, pixels in shown.pictures.items():
        write_bytes(home / files[what], jpeg(pixels))
    if shown.sound is not None:
        samples, rate = shown.sound
        step = max(1, rate // LOWEST)  # means of so many samples: to hear, not to measure
        samples = samples[: int(HEARD * rate) // step * step]
        if len(samples):
            means = samples.reshape(-1, step).mean(axis=1) if step > 1 else samples
            write_bytes(home / f"{name}.wav", wav(means, rate // step))
            files["sound"] = f"{name}.wav"
    return files


def error_cards(directory: Path) -> dict[str, Any]:
    """Return the misclassified samples for the page of a run; empty without any.

    Returns:
        ``cards`` of all wrong samples, each with the other networks that were ``right``; ``pairs``
        with the cards of their sides; ``classes`` and ``networks`` to filter by; ``said``.
    """
    kept = {file.stem: read_or_empty(file) for file in (directory / FOLDER).glob("*.json")}
    outcomes = _outcomes(directory)
    order = [name for name in outcomes if name in kept]
    right = _right(outcomes)
    cards, pairs, said = [], [], []
    for network in order:
        told = kept[network]
        for number in told["wrong"]:
            card = _card(directory, network, told["samples"][str(number)])
            cards.append({**card, "right": right(network, card["files"])})
        if told["errors"] > len(told["wrong"]):
            said.append(f"{network}: the worst {len(told['wrong'])} of {told['errors']}")
        pairs += _pairs(directory, network, told, outcomes)
    if not cards and not pairs:
        return {}
    classes = sorted({card[key] for card in cards for key in ("label", "predicted")})
    return {"cards": cards, "pairs": pairs, "classes": classes, "networks": order, "said": said}


def _outcomes(directory: Path) -> dict[str, list[Outcome]]:
    """Return the outcomes of each network of a run, in the order of ``results.json``."""
    return read_networks(directory, read_results(directory).get("networks", {}))


def _right(
    outcomes: Mapping[str, Sequence[Outcome]],
) -> Callable[[str, Mapping[str, str]], list[str]]:
    """Return a function that names the networks that were right about a sample of another one.

    Samples are the same if they have a file in common, or a fusion's sample has files of both.
    """
    beside: dict[str, set[str]] = defaultdict(set)  # files that some sample has together
    correct: dict[str, dict[str, bool]] = {}
    for network, tested in outcomes.items():
        correct[network] = {}
        for outcome in tested:
            for file in outcome.files.values():
                beside[file].update(outcome.files.values())
                correct[network][file] = outcome.correct

    def named(network: str, files: Mapping[str, str]) -> list[str]:
        related = {other for file in files.values() for other in beside[file]}
        return [
            name
            for name, known in correct.items()
            if name != network and any(known.get(file, False) for file in related)
        ]

    return named


def _pairs(
    directory: Path, network: str, told: Kept, outcomes: Mapping[str, Sequence[Outcome]]
) -> list[Kept]:
    classes = sorted({outcome.label for tested in outcomes.values() for outcome in tested})
    others = {
        (own.pair.label, own.pair.predicted): own.others
        for own in own_pairs(outcomes, classes, most=len(classes) ** 2)
        if own.network == network
    }
    return [
        {
            "network": network,
            **{key: pair[key] for key in ("label", "predicted", "share")},
            "others": others.get((pair["label"], pair["predicted"]), {}),
            "sides": [_card(directory, network, told["samples"][str(n)]) for n in pair["sides"]],
        }
        for pair in told["pairs"]
    ]


def _card(directory: Path, network: str, sample: Kept) -> Kept:
    """Return a kept sample with its files inside."""
    senses = {
        name: {what: embedded(directory / FOLDER / file) for what, file in files.items()}
        for name, files in sample["senses"].items()
    }
    links = {file: _link(file) for file in sample["files"].values()}
    return {**sample, "network": network, "senses": senses, "links": links, "right": []}


def embedded(file: Path) -> str:
    """Return a picture or a sound as a data URI, without content where there is none."""
    kind = {".wav": "audio/wav", ".jpg": "image/jpeg", ".png": "image/png"}[file.suffix]
    content = file.read_bytes() if file.is_file() else b""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _link(source: str) -> str:
    """Return the address of a recording's file; empty where there is none."""
    path = Path(source.partition("#")[0])
    return path.as_uri() if path.is_absolute() and path.is_file() else ""


def class_tables(directory: Path) -> list[Table]:
    """Return for each network a row for each class: how many, recall, precision, most confused."""
    tables = []
    for network, outcomes in _outcomes(directory).items():
        labels = sorted({outcome.label for outcome in outcomes})
        rows = [_class_row(label, outcomes) for label in labels]
        tables.append(Table(f"{network}: classes", rows))
    return tables


def _class_row(label: str, outcomes: Sequence[Outcome]) -> dict[str, str]:
    own = [outcome for outcome in outcomes if outcome.label == label]
    called = sum(outcome.predicted == label for outcome in outcomes)
    correct = sum(outcome.correct for outcome in own)
    taken = Counter(outcome.predicted for outcome in own if not outcome.correct)
    (most, times), *_ = taken.most_common(1) or [("", 0)]
    return {
        "class": printable(label),
        "n": str(len(own)),
        "recall": f"{correct / len(own):.1%}",
        "precision": f"{correct / called:.1%}" if called else "never called",
        "most confused with": f"{printable(most)} ({times})" if most else "",
    }
