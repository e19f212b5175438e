"""``report.md``: tables, confusion matrices and telling pairs of one run or of a whole sweep."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config.model import FUSION
from tex_lightning.core.files import read_record, write_text
from tex_lightning.data.conditions import describe
from tex_lightning.errors import UserError
from tex_lightning.evaluation.fragments import confused_pairs, fragment_counts
from tex_lightning.report.confused_pairs import pairs_figure
from tex_lightning.report.confusion import class_accuracy_figure, confusion_figure
from tex_lightning.report.figures import picture, save_figure
from tex_lightning.report.learning_curve import learning_curves, learning_figure, write_curves
from tex_lightning.report.systems import System, read_systems, run_data
from tex_lightning.report.table import TINY, is_tiny, run_overrides
from tex_lightning.report.tables import (
    accuracy_tables,
    conditions_table,
    profiling_table,
    rejections_table,
    seeds_table,
)
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


def write_report(
    directory: Path, runs: Sequence[Path], command: str, formats: Sequence[str]
) -> None:
    """Write ``report.md`` and its figures; nothing where no run tested anything.

    Args:
        directory: Where they go.
        runs: Finished run folders.
        command: What repeats them.
        formats: Formats of figures.
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
    parts += [_tested(systems), NOTES, COLUMNS if paper else "", seeds_table(systems)]
    parts.append(accuracy_tables(systems, complete=complete and paper, paper=paper))
    parts += [conditions_table(systems), rejections_table(systems)]
    profiles = _profiles(runs)
    if profiles:
        parts.append(profiling_table(profiles, paper=paper))
    parts.append(_learning_curve(directory, systems, formats))
    parts += [_confusions(directory, systems, formats), _pairs(directory, systems, formats)]
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
    """Numbers of folds and samples that each row tested, and how often; equal rows are joined."""
    rows: dict[str, list[str]] = {}
    for system in systems:
        times = Counter(Counter(outcome.sample for outcome in system.outcomes).values())
        counts = " and ".join(
            f"{number} samples {_times(often)}" for often, number in sorted(times.items())
        )
        name = f"{system.model} in {system.inside}" if system.inside else system.model
        rows.setdefault(f"{_folds(system)}: {counts}", []).append(name)
    lines = []
    for what, names in rows.items():
        who = "Every row" if len(rows) == 1 else ", ".join(dict.fromkeys(names))
        lines.append(f"- {to_markdown(f'{who} tested {what}.')}")
    return "\n".join(["Test samples, and how often each was tested in a row:", "", *lines])


def _times(often: int) -> str:
    return {1: "once", 2: "twice"}.get(often, f"{often} times")


def _folds(system: System) -> str:
    """Which folds, or conditions, a system's runs tested."""
    wheres = [run_data(run).get("test_where") for run in system.directories]
    if any(wheres):
        return ", ".join(dict.fromkeys(describe(where) for where in wheres if where))
    tested: Counter[int | None] = Counter()
    for run, entry in zip(system.directories, system.entries, strict=True):
        data = run_data(run)
        own = [data.get("test_fold")]
        tested.update([fold["fold"] for fold in entry["folds"]] if "folds" in entry else own)
    if None in tested:
        return "all recordings"
    every = run_data(system.directories[0]).get("folds")
    total = f" of {every}" if every is not None else ""
    names = ", ".join(map(str, sorted(tested)))  # type: ignore[type-var]  # None is not there
    often = {_times(number) for number in tested.values()}
    runs = "" if often == {"once"} else f" ({' or '.join(sorted(often))})"
    return f"fold{'s' * (len(tested) > 1)} {names}{total}{runs}"


def _learning_curve(directory: Path, systems: Sequence[System], formats: Sequence[str]) -> str:
    """Accuracy over the recordings of a class, where runs differ in that."""
    curves = learning_curves(systems)
    if not curves:
        return ""
    path = directory / "figures" / "learning_curve"
    file = save_figure(learning_figure(curves), path, formats)
    write_curves(curves, directory / "learning_curve.csv")
    return (
        "### Few recordings of a class\n\n"
        "Votes over the recordings of each class that were trained on, with Wilson's intervals; "
        "the numbers are in `learning_curve.csv`.\n\n"
        f"{picture('learning curves', file)}"
    )


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


def _confusions(directory: Path, systems: Sequence[System], formats: Sequence[str]) -> str:
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
            file = save_figure(figure, directory / "figures" / f"{name}_{title}", formats)
            lines.append(picture(f"{name}, {title.replace('_', ' ')}", file))
    return "\n".join(["### Fragments by class", "", *lines]) if lines else ""


def _pairs(directory: Path, systems: Sequence[System], formats: Sequence[str]) -> str:
    """Pairs that one sense confuses and another tells apart, with their recordings."""
    by_kind: dict[str, System] = {}
    for system in _networks(systems):
        by_kind.setdefault(system.kind, system)
    if FUSION not in by_kind:
        return ""
    fusion = by_kind[FUSION]
    title = "### Pairs that one sense confuses and another separates"
    try:
        branches = SurfaceClassifier.from_checkpoint(fusion.entries[0]["checkpoint"]).senses
    except UserError as error:  # of a class that only the jobs' own processes trust
        return "\n".join([title, "", f"Not drawn: {error}"])
    senses = {name: by_kind[name] for name in branches if name in by_kind}
    if len(senses) < 2 or any(each.classes != fusion.classes for each in senses.values()):
        return ""
    counts = {name: fragment_counts(each.outcomes, each.classes) for name, each in senses.items()}
    pairs = confused_pairs(counts, fusion.classes)
    if not pairs:
        return ""
    figure = pairs_figure(pairs, fusion.outcomes, branches.values())
    file = save_figure(figure, directory / "figures" / "confused_pairs", formats)
    lines = [
        f"- {' and '.join(map(to_markdown, pair.classes))}: confused by the {pair.confused_by} "
        f"network ({pair.confusion:.1%} of fragments), not by the {pair.separated_by} network "
        f"({pair.other:.1%})"
        for pair in pairs
    ]
    return "\n".join([title, "", *lines, "", picture("confused pairs", file)])
