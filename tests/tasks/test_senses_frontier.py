"""Which senses a scene needs: every subset, one's own sense among them, by the command line."""

import csv
import json
import shlex
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest
from conftest import write_forces

from tex_lightning.tasks.frontier import _tested_folds

SYSTEMS = {"haptic", "force", "haptic+force", "haptic+force_sequential"}


@pytest.fixture(scope="module")
def table(surfaces, tmp_path_factory) -> tuple[Path, Path]:
    """Folder with a sense of one's own, and a manifest with its recordings."""
    folder = tmp_path_factory.mktemp("force")
    (folder / "conf/sense").mkdir(parents=True)
    (folder / "conf/sense/force.yaml").write_text(
        "defaults: [signal, bands, _self_]\nmodality: force\n"
    )
    lines = []
    for path in sorted(surfaces.glob("*/haptic/*.wav")):
        label, group = path.stem.split("_")
        lines.append(f"{label},haptic,{path},{group}")
        same = "beta" if label == "gamma" else label  # which force cannot tell apart
        force = folder / f"{label}_{group}.wav"
        shutil.copyfile(surfaces / same / "haptic" / f"{same}_{group}.wav", force)
        lines.append(f"{label},force,{force},{group}")
    manifest = folder / "recordings.csv"
    manifest.write_text("\n".join(["label,modality,path,group", *lines]) + "\n")
    return folder / "conf", manifest


@pytest.fixture(scope="module")
def command(table) -> list[object]:
    conf, manifest = table
    return [
        "--config-dir", conf, "task=frontier", "frontier=senses", "experiment=few/fusion",
        "data=manifest", f"data.manifest={manifest}", "data.classes=3", "debug=tiny",
    ]  # fmt: skip


@pytest.fixture(scope="module")
def measured(run_once, command):
    return run_once(*command)


@pytest.mark.parametrize(
    ("trainings", "only", "folds", "tested"),
    [
        (2, None, 10, [0, 1, 5, 6]),
        (2, None, 3, [0, 1, 2]),
        (9, None, 4, [0, 1, 2, 3]),
        (2, [3], 10, [3]),
        (None, None, 4, [0, 1, 2, 3]),
    ],
)
def test_trainings_decide_which_folds_are_tested(trainings, only, folds, tested):
    config = SimpleNamespace(
        frontier=SimpleNamespace(trainings=trainings),
        crossval=SimpleNamespace(only=only),
        data=SimpleNamespace(folds=folds),
    )
    assert _tested_folds(config) == tested


def read_csv(path: Path) -> list[dict[str, str]]:
    with path.open() as stream:
        return list(csv.DictReader(stream))


def correct(run: Path, system: str, kind: str) -> dict[str, bool]:
    """By the trace of the sample, on both folds."""
    folder = run / "systems" / system / "folds/0-5/predictions"
    rows = [row for name in (kind, f"{kind}_partner") for row in read_csv(folder / f"{name}.csv")]
    return {row.get("haptic", row.get("force")): row["label"] == row["predicted"] for row in rows}


def test_every_subset_of_the_senses_in_the_data_is_a_system(measured):
    results = json.loads((measured / "results.json").read_text())
    assert results["senses"] == ["haptic", "force"]
    assert set(results["systems"]) == SYSTEMS
    assert "model.senses=" in results["command"]


def test_the_command_that_it_prints_trains_what_was_chosen(measured, cli, tmp_path):
    results = json.loads((measured / "results.json").read_text())
    program, *arguments = shlex.split(results["command"].removeprefix("python -m "))
    assert program == "tex_lightning"
    assert not [each for each in arguments if each.startswith("+sense@")]
    if results["chosen"] != "force":  # which is the one that needs the user's folder
        arguments.append("model.senses=[force]")
    outcome = cli(*arguments, f"hydra.run.dir={tmp_path}/r")
    assert outcome.status == 0, outcome.err
    assert list(json.loads((tmp_path / "r/results.json").read_text())["networks"]) == ["force"]


def test_each_network_is_trained_once(measured):
    kinds = sorted(path.name.split("-")[0] for path in (measured / "networks").iterdir())
    assert kinds == ["force", "fusion", "haptic"]


@pytest.mark.parametrize(
    ("senses", "message"),
    [
        ("[haptic,taste]", "frontier.senses is taste"),
        ("every", "frontier.senses is every"),
        ("[]", "frontier.senses names nothing"),
    ],
)
def test_senses_that_cannot_be_meant_are_refused(cli, command, tmp_path, senses, message):
    outcome = cli(*command, f"frontier.senses={senses}", f"hydra.run.dir={tmp_path}/r")
    assert outcome.status == 2
    assert message in outcome.err


def test_data_that_no_sense_reads_is_refused(cli, surfaces, tmp_path):
    manifest = write_forces(surfaces, tmp_path / "forces.csv")
    outcome = cli(
        "task=frontier", "frontier=senses", "data=manifest", f"data.manifest={manifest}",
        f"hydra.run.dir={tmp_path}/r",
    )  # fmt: skip
    assert outcome.status == 2
    assert "recordings of force, and no sense reads these" in outcome.err
