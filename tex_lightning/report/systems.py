"""Read tested systems back from the run folders of their tests."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from tex_lightning.classifier.card import SUFFIX
from tex_lightning.core.files import read_record
from tex_lightning.evaluation.outcomes import RANDOM, Outcome, read_outcomes
from tex_lightning.report.table import run_overrides

FOLD_KEYS = ("data.test_fold", "crossval.only")
SEED_KEYS = ("seed=",)
PER_CLASS = "data.per_class="
SHARED_KEYS = (
    "model=", "data=", "data.", "hydra", "experiment=", "task=", "debug=", "crossval.", "weights=",
    "figures.", "explained_samples=",
)  # fmt: skip


@dataclass(frozen=True)
class System:
    """One system and all its tests.

    Attributes:
        model: Name of its configuration.
        kind: Its sense, or ``fusion``.
        inside: The FusionNet that trained it as its part; empty for a system of its own.
        data: Name of the data set's configuration.
        variant: What else was asked for, where one model was run in several ways.
        classes: Class names in order.
        entries: Its entries of ``results.json``, one for each run.
        outcomes: Outcomes of all runs together.
        directories: Run folders.
    """

    model: str
    kind: str
    inside: str
    data: str
    variant: str
    classes: list[str]
    entries: list[dict[str, Any]]
    outcomes: list[Outcome]
    directories: list[Path]

    @property
    def successes(self) -> dict[str, bool]:
        """Whether each sample's label is correct, by sample."""
        return {outcome.sample: outcome.label == outcome.predicted for outcome in self.outcomes}

    def successes_beside(self, other: "System") -> dict[str, bool]:
        """Whether its labels are correct on the samples of another system, by those samples.

        Where those have recordings of more senses, this one judges its own of them.
        """
        own = self.outcomes[0].files
        if not own.keys() < other.outcomes[0].files.keys():
            return self.successes
        mine = {_files(each, own): each.label == each.predicted for each in self.outcomes}
        theirs = {each.sample: _files(each, own) for each in other.outcomes}
        return {sample: mine[part] for sample, part in theirs.items() if part in mine}


def _files(outcome: Outcome, modalities: Iterable[str]) -> tuple[str, ...]:
    return tuple(outcome.files[modality] for modality in modalities)


def read_systems(runs: Iterable[Path]) -> list[System]:
    """All systems that finished runs have tested, those with several runs pooled.

    Args:
        runs: Run folders of ``fit``, ``crossval`` or ``evaluate``; others are passed over.
    """
    groups: dict[tuple[str, ...], list[tuple[Path, dict[str, Any]]]] = {}
    same = (*SHARED_KEYS, *FOLD_KEYS)  # keys that leave the system what it is
    asked = {
        run: [
            key
            for key in run_overrides(run)
            if key.startswith(PER_CLASS) or not key.startswith(same)
        ]
        for run in runs
    }
    shared = set.intersection(*map(set, asked.values())) if asked else set()
    for run in asked:
        file = run / "results.json"
        results = read_record(file) if file.is_file() else {}
        networks = results.get("networks", {})
        for kind, entry in networks.items():
            if "vote_accuracy" in entry:
                main = kind == list(networks)[-1]
                names = (results["model"], "") if main else (kind, results["model"])
                own = [item for item in asked[run] if item not in shared]
                variant = ", ".join([*own, *_unseen(run), *_start(results, kind)])
                key = (names[0], kind, names[1], results["data"], variant)
                groups.setdefault(key, []).append((run, results))
    return [_pool(key, members) for key, members in groups.items()]


def _unseen(run: Path) -> list[str]:
    """The conditions whose tested values were not trained on; the values make no other system."""
    where = run_data(run).get("test_where")
    return [f"unseen {' and '.join(where)}"] if where else []


def _start(results: dict[str, Any], kind: str) -> list[str]:
    """What the trunks of a system began with, where that was not at random."""
    weights: dict[str, str] = results.get("weights", {})
    own = [kind] if kind in weights else list(weights)
    given = {sense: weights[sense] for sense in own if weights[sense] != RANDOM}
    title = "trunk" if len(own) == 1 else "{} trunk"
    return [f"{title.format(sense)} from {_named(source)}" for sense, source in given.items()]


def _named(source: str) -> str:
    """A source of weights as briefly as it can be told from others."""
    path = Path(source.partition(" (")[0])  # what it was trained on may follow
    # every run calls its checkpoints the same
    return str(path if path.suffix == SUFFIX else path.name)


def run_data(run: Path) -> dict[str, Any]:
    """The section ``data`` of a run's configuration; empty where it is not kept."""
    path = run / ".hydra" / "config.yaml"
    return _data_section(path, path.stat().st_mtime_ns) if path.is_file() else {}


@lru_cache(maxsize=1024)
def _data_section(path: Path, changed: int) -> dict[str, Any]:
    """Read again when the file has ``changed``: a report of many runs asks often."""
    data: dict[str, Any] = OmegaConf.to_container(OmegaConf.load(path).data)  # type: ignore[assignment]
    return data


def _pool(key: tuple[str, ...], members: list[tuple[Path, dict[str, Any]]]) -> System:
    model, kind, inside, data, variant = key
    entries = [results["networks"][kind] for _, results in members]
    directories = [run for run, _ in members]
    files = [run / "predictions" / f"{kind}.csv" for run in directories]
    outcomes = [outcome for file in files for outcome in read_outcomes(file)]
    classes = members[0][1]["classes"]
    return System(model, kind, inside, data, variant, classes, entries, outcomes, directories)
