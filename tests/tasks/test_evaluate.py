"""What of a data set a checkpoint is tested on."""

import json
import re
import shutil

import numpy as np
import pytest
import soundfile
from conftest import CLASSES, RATE, make_trace

from tex_lightning.evaluation.outcomes import read_outcomes


@pytest.fixture
def tested(cli, naive_bayes, tmp_path):
    """Evaluate, and return the table of outcomes and the line that says what is tested."""

    def run(root, *arguments, checkpoint=naive_bayes):
        folder = tmp_path / "run"
        shutil.rmtree(folder, ignore_errors=True)
        given = [
            "task=evaluate",
            f"checkpoint={checkpoint}",
            "logger=csv",
            f"hydra.run.dir={folder}",
        ]
        source = ["data=folder", f"data.root={root}"] if root else []
        done = cli(*given, f"hydra.run.dir={folder}", *source, *arguments)
        assert done.status == 0, done.err
        told = re.search(r"^Tests +(.*\n?.*)$", done.err, re.MULTILINE)[1]
        return read_outcomes(folder / "predictions" / "haptic.csv"), " ".join(told.split())

    return run


@pytest.fixture(scope="module")
def others(tmp_path_factory):
    """Eleven other strokes of each class, one of whose folds would be one or two."""
    root = tmp_path_factory.mktemp("others")
    for kind, label in enumerate(CLASSES):
        (root / label).mkdir()
        for number in range(11):
            soundfile.write(root / label / f"{number}.wav", make_trace(kind, 50 + number), RATE)
    return root


def test_all_of_other_data_is_tested_and_a_fold_if_it_is_asked_for(tested, others):
    outcomes, told = tested(others)
    assert len(outcomes) == 33
    assert {outcome.fold for outcome in outcomes} == {""}
    assert "all of the data, which its training has not seen" in told
    outcomes, told = tested(others, "data.test_fold=0")
    assert len(outcomes) == 4  # of 33 in ten folds
    assert "fold 0, as asked for" in told
    assert len(tested(others, "data.test_fold=null")[0]) == 33


def test_of_the_trainings_own_data_what_it_left_out(tested, surfaces, run_once, tiny, naive_bayes):
    for run, fold in ((naive_bayes, 0), (run_once("model=mfcc_nb", *tiny, "data.test_fold=4"), 4)):
        outcomes, told = tested(surfaces, checkpoint=run)
        stems = {path.rpartition("_")[2] for each in outcomes for path in each.files.values()}
        assert (len(outcomes), stems) == (3, {f"{fold}.wav"})
        assert {outcome.fold for outcome in outcomes} == {str(fold)}
        assert f"fold {fold}, which its training left out" in told
        results = json.loads((run / "results.json").read_text())["networks"]["haptic"]
        assert sum(each.label == each.predicted for each in outcomes) == results["correct"]


def test_a_copy_of_a_training_recording_among_others_is_a_leak(
    cli, naive_bayes, others, surfaces, tmp_path
):
    mixed = shutil.copytree(others, tmp_path / "mixed")
    shutil.copy(surfaces / "alpha/haptic/alpha_5.wav", mixed / "alpha/new.wav")
    refused = cli(
        "task=evaluate", f"checkpoint={naive_bayes}", "data=folder", f"data.root={mixed}",
        f"hydra.run.dir={tmp_path}/run",
    )  # fmt: skip
    assert refused.status == 2
    assert "has trained on 1 of the 34 test recordings, new.wav among them" in refused.err


def test_one_class_alone_is_tested(tested, tmp_path):
    (tmp_path / "only/alpha").mkdir(parents=True)
    np.save(tmp_path / "only/alpha/a.npy", make_trace(0, 77))
    outcomes, _ = tested(tmp_path / "only", "data.file_rate=10000")
    assert [outcome.label for outcome in outcomes] == ["alpha"]
    results = json.loads((tmp_path / "run" / "results.json").read_text())
    assert results["model"] == "mfcc_nb"  # and not haptic, which is another in the tables


@pytest.mark.slow
def test_conditions_leave_the_fold_of_the_training_to_senses_without_them(
    cli, run_once, surfaces, tmp_path
):
    lines = ["label,modality,path,group,speed"]
    for label in CLASSES:
        for n in range(10):
            lines.append(f"{label},haptic,{surfaces}/{label}/haptic/{label}_{n}.wav,{n},{n % 5}")
            lines.append(f"{label},image,{surfaces}/{label}/image/{label}_{n}.png,{n},")
    (tmp_path / "table.csv").write_text("\n".join(lines))
    data = ["data=manifest", f"data.manifest={tmp_path}/table.csv", "data.half_scale=false"]
    where, quick = "data.test_where={speed: 2}", ["debug=tiny", "logger=csv"]
    run = ["model=fusion", *data, *quick, where, "data.test_fold=7", f"hydra.run.dir={tmp_path}/a"]
    assert cli(*run).status == 0
    results = []
    for number, given in enumerate(([where], [])):
        folder = tmp_path / f"tested{number}"
        test = ["task=evaluate", f"checkpoint={tmp_path}/a", *data, "logger=csv", *given]
        assert cli(*test, f"hydra.run.dir={folder}").status == 0
        results.append(json.loads((folder / "results.json").read_text())["networks"]["fusion"])
    trained = json.loads((tmp_path / "a/results.json").read_text())["networks"]["fusion"]
    assert {each["test_samples"] for each in (*results, trained)} == {6}
