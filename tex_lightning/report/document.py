"""``report.md``: tables, confusion matrices and confused pairs of one run or of a whole sweep."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tex_lightning.config.model import FUSION
from tex_lightning.core.files import read_record, write_rows, write_text
from tex_lightning.data.folds import describe
from tex_lightning.evaluation.outcomes import confused_pairs, fragment_counts
from tex_lightning.report.confusion import class_accuracy_figure, confusion_figure
from tex_lightning.report.figures import LearningPoint, learning_figure, picture, save_figure
from tex_lightning.report.systems import PER_CLASS, System, read_systems, run_data
from tex_lightning.report.table import TINY, is_tiny, run_overrides
from tex_lightning.report.tables import accuracy_tables, conditions_table, profiling_table
from tex_lightning.text import to_markdown

NOTES = """\
Votes are decisions on whole samples, fragments those at single positions. Intervals are Wilson's.
p is the exact McNemar test of the row against the best one in bold on the same samples, with the
samples that only the best row and only this row had right; a dash where the samples are not the
same. Milliseconds run from decoded recordings to the label on this machine; fit s is the time of
training of all folds of a row. Weights are random at first unless a row names where its trunk is
from."""
COLUMNS = """\
Columns headed "paper" are the paper's figures on its own data, all others were measured here."""
LEARNING_COLUMNS = (
    "system", "per_class", "correct", "test_samples", "vote_accuracy", "ci_low", "ci_high",
)  # fmt: skip
PAPER_DATA = ("tum", "kylberg", "kth_tips2b")
PAPER_EXPERIMENTS = ("experiment=paper/", "experiment=table/")
CHOICES = """\
The paper leaves open: magnitude or power of the spectrogram (magnitude here), normalisation of each
trace or of the data set (each trace in the paper's settings), the range of rotation (180 degrees),
the dropout rate (0.5), the kernel of FC1 (6x6, which gives one prediction for 224 pixels), and
which haptic and visual recording of a class form a sample (those of equal number). In its table of
hyper-parameters FusionNet's step k = 4,000,000 exceeds the N = 100,000 iterations, so that its
learning rate never drops. The row D8 names no method that public sources describe: rotation-
invariant local binary patterns with 8 neighbours stand in for it. What the sources of the other
rows leave unknown is said in their file in `conf/model`."""


def write_report(directory: Path, runs: Sequence[Path], command: str) -> None:
    """Write ``report.md`` and its figures; nothing where no run tested anything.

    Args:
        directory: Where they go.
        runs: Finished run folders.
        command: What repeats them.
    """
    systems = read_systems(runs)
    if not systems:
        return
    complete = len({system.model for system in systems if not system.inside}) > 1
    paper = _concerns_paper(systems)
    parts = ["# Which material is it?"]
    if any(is_tiny(run_overrides(run)) for run in runs):
        parts.append(f"> **{TINY}**")
    parts += ["This command repeats the report:", f"```bash\n{command}\n```"]
    parts += [_tested(systems), NOTES, COLUMNS if paper else ""]
    parts.append(accuracy_tables(systems, complete=complete and paper, paper=paper))
    parts.append(conditions_table(systems))
    profiles = _profiles(runs)
    if profiles:
        parts.append(profiling_table(profiles, paper=paper))
    parts.append(_learning_curve(directory, systems))
    parts += [_confusions(directory, systems), _pairs(systems)]
    if paper:
        parts += ["### Where the paper leaves a choice", CHOICES]
    write_text(directory / "report.md", "\n\n".join(part for part in parts if part) + "\n")


def _concerns_paper(systems: Sequence[System]) -> bool:
    """Whether a data set is the paper's, or a table of the paper was asked for."""
    runs = {run for system in systems for run in system.directories}
    return any(system.data in PAPER_DATA for system in systems) or any(
        item.startswith(PAPER_EXPERIMENTS) for run in runs for item in run_overrides(run)
    )


def _tested(systems: Sequence[System]) -> str:
    """List the folds, or conditions, and the number of samples that each row tested."""
    rows: dict[str, list[str]] = {}
    for system in systems:
        name = f"{system.model} in {system.inside}" if system.inside else system.model
        rows.setdefault(f"{_folds(system)}, {len(system.outcomes)} samples", []).append(name)
    lines = [
        f"- {to_markdown(what)}: {to_markdown(', '.join(dict.fromkeys(names)))}"
        for what, names in rows.items()
    ]
    return "\n".join(["What each row tested:", "", *lines])


def _folds(system: System) -> str:
    """Return which folds, or conditions, the runs of a system tested."""
    tested: dict[str, None] = {}
    for run, entry in zip(system.directories, system.entries, strict=True):
        data = run_data(run)
        if where := data.get("test_where"):
            tested[describe(where)] = None
            continue
        folds = [fold["fold"] for fold in entry.get("folds", [{"fold": data.get("test_fold")}])]
        of = f" of {data['folds']}" if data.get("folds") is not None else ""
        tested |= {"all" if fold is None else f"fold {fold}{of}": None for fold in folds}
    return ", ".join(tested)


def _learning_curve(directory: Path, systems: Sequence[System]) -> str:
    """Draw accuracy over the recordings of a class, where runs differ in that."""
    curves = _learning_curves(systems)
    if not curves:
        return ""
    path = directory / "figures" / "learning_curve"
    file = save_figure(learning_figure(curves), path)
    rows = [
        (name, *point, point.accuracy, *point.interval)
        for name, points in curves.items()
        for point in points
    ]
    write_rows(directory / "learning_curve.csv", LEARNING_COLUMNS, rows)
    return (
        "### Few recordings of a class\n\n"
        "Votes over the recordings of each class that were trained on, with Wilson's intervals; "
        "the numbers are in `learning_curve.csv`.\n\n"
        f"{picture('learning curves', file)}"
    )


def _learning_curves(systems: Sequence[System]) -> dict[str, list[LearningPoint]]:
    """Return points by system, in the order of their recordings, of systems with two or more."""
    curves: dict[str, list[LearningPoint]] = {}
    for system in systems:
        items = system.variant.split(", ")
        counts = [item.removeprefix(PER_CLASS) for item in items if item.startswith(PER_CLASS)]
        if system.inside or not counts or not counts[-1].isdecimal():
            continue
        others = [item for item in items if item and not item.startswith(PER_CLASS)]
        hits = [outcome.label == outcome.predicted for outcome in system.outcomes]
        point = LearningPoint(int(counts[-1]), sum(hits), len(hits))
        curves.setdefault(" ".join([system.model, *others]), []).append(point)
    return {name: sorted(points) for name, points in curves.items() if len(points) > 1}


def _profiles(runs: Sequence[Path]) -> dict[str, dict[str, Any]]:
    """Profiles by model that cross-validations left behind."""
    found: dict[str, dict[str, Any]] = {}
    for run in runs:
        file = run / "profile" / "results.json"
        if file.is_file():
            results = read_record(file)
            for kind, network in results["networks"].items():
                found[results["model"]] = {**network, "kind": kind}
    return found


def _networks(systems: Sequence[System]) -> list[System]:
    """The networks, each once: by itself if it was run so, else as a part of a FusionNet."""
    chosen: dict[str, System] = {}
    for system in sorted(systems, key=lambda item: bool(item.inside)):
        if system.kind in (system.model, FUSION):
            chosen.setdefault(system.model, system)
    return list(chosen.values())


def _confusions(directory: Path, systems: Sequence[System]) -> str:
    """Fragments by class, as in the paper's figures of HapticNet, VisualNet and FusionNet."""
    lines = []
    for system in _networks(systems):
        name, classes = system.model, system.classes
        counts = fragment_counts(system.outcomes, classes)
        heading = f"{name}: fragments of {len(system.outcomes)} test samples"
        figures = {
            "fragment_confusion": confusion_figure(counts, classes, heading),
            "fragment_accuracy": class_accuracy_figure(counts, classes, name, heading, "fragment"),
        }
        for title, figure in figures.items():
            file = save_figure(figure, directory / "figures" / f"{name}_{title}")
            lines.append(picture(f"{name}, {title.replace('_', ' ')}", file))
    return "\n".join(["### Fragments by class", "", *lines]) if lines else ""


def _pairs(systems: Sequence[System]) -> str:
    """List the pairs of classes that one sense confuses and another tells apart."""
    senses: dict[str, System] = {}
    for system in _networks(systems):
        if system.kind != FUSION:
            senses.setdefault(system.kind, system)
    classes = [system.classes for system in senses.values()]
    if len(senses) < 2 or any(names != classes[0] for names in classes):
        return ""
    counts = {
        name: fragment_counts(system.outcomes, system.classes) for name, system in senses.items()
    }
    lines = [
        f"- {' and '.join(map(to_markdown, pair.classes))}: confused by the {pair.confused_by} "
        f"network ({pair.confusion:.1%} of fragments), not by the {pair.separated_by} network "
        f"({pair.other:.1%})"
        for pair in confused_pairs(counts, classes[0])
    ]
    title = "### Pairs that one sense confuses and another separates"
    return "\n".join([title, "", *lines]) if lines else ""
