"""What a sweep says of jobs whose results have no networks, or that failed."""

import csv
import json
import pickle
import statistics
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from tex_lightning.evaluation.outcomes import Outcome, summarise, write_outcomes
from tex_lightning.report.sweep import SweepSummary


def job(folder: Path, task: str, results: dict | None) -> None:
    (folder / ".hydra").mkdir(parents=True)
    OmegaConf.save([f"task={task}", "seed=1"], folder / ".hydra" / "overrides.yaml")
    if results is not None:
        (folder / "results.json").write_text(json.dumps(results))


@pytest.fixture
def ended(monkeypatch):
    monkeypatch.setattr(SweepSummary, "failures", 0)

    def end(folder: Path) -> dict[str, str]:
        config = {"hydra": {"sweep": {"dir": str(folder)}}}
        SweepSummary().on_multirun_end(OmegaConf.create(config))
        with (folder / "sweep.csv").open() as stream:
            return {row["job"]: row["status"] for row in csv.DictReader(stream)}

    return end


def test_tables_of_their_own_are_done_and_a_failure_among_them_is_counted(tmp_path, ended):
    job(tmp_path / "0", "frontier", {"chosen": "lbp"})
    job(tmp_path / "1", "stream", None)
    job(tmp_path / "2", "fit", None)
    assert ended(tmp_path) == {"0": "done", "1": "done", "2": "not finished"}
    assert SweepSummary.failures == 1


def finish(folder: Path, seed: int, correct: int, fold: int = 0) -> None:
    """A finished run that classified ten samples of a fold."""
    job(folder, "fit", None)
    overrides = ["model=haptic", f"seed={seed}", f"data.test_fold={fold}", "debug=tiny"]
    OmegaConf.save(overrides, folder / ".hydra" / "overrides.yaml")
    settings = {"seed": seed, "data.test_fold": fold, "data.val_fold": fold + 1, "model": "haptic"}
    (folder / "settings.json").write_text(json.dumps(settings))
    outcomes = [
        Outcome({"haptic": f"{fold}-{n}.wav"}, "a", "ab"[n >= correct], 1.0, 1, 1, 2.0)
        for n in range(10)
    ]
    write_outcomes(outcomes, folder / "predictions" / "haptic.csv")
    entry = {**summarise(outcomes), "fit_seconds": 40.0, "parameters": 7, "checkpoint": ""}
    results = {"model": "haptic", "data": "folder", "classes": ["a", "b"]}
    results |= {"networks": {"haptic": entry}}
    (folder / "results.json").write_text(json.dumps(results))


def swept(folder: Path) -> list[dict[str, str]]:
    config = {"sweep": {"dir": str(folder)}, "overrides": {"task": ["seed=0,1,2", "debug=tiny"]}}
    SweepSummary().on_multirun_end(OmegaConf.create({"hydra": config}))
    with (folder / "sweep.csv").open() as stream:
        return list(csv.DictReader(stream))


def test_seeds_get_mean_and_sample_deviation_with_the_counts_of_each(tmp_path):
    for seed, correct in enumerate((8, 9, 10)):
        finish(tmp_path / str(seed), seed, correct)
    *_, row = swept(tmp_path)
    assert row["job"] == "3 seeds"
    assert float(row["vote_accuracy"]) == pytest.approx(statistics.mean([0.8, 0.9, 1]))
    assert float(row["vote_accuracy_sd"]) == pytest.approx(statistics.stdev([0.8, 0.9, 1]))
    assert row["correct"] == row["ci_low"] == ""  # the same samples three times are no thirty
    report = (tmp_path / "report.md").read_text()
    assert report.count("HapticNet (seed=") == 3
    assert "**debug=tiny shrank every budget" in report


def test_folds_are_pooled_before_seeds_and_fit_seconds_are_one_sum(tmp_path, capfd):
    for seed in (0, 1):
        for fold in (0, 1):
            finish(tmp_path / f"{seed}{fold}", seed, 9 - seed, fold)
    rows = swept(tmp_path)
    assert [row["job"] for row in rows[4:]] == ["2 folds", "2 folds", "2 seeds"]
    assert [row["fit_seconds"] for row in rows[4:]] == ["80.0", "80.0", "160.0"]
    assert [row["correct"] for row in rows[4:6]] == ["18", "16"]
    assert float(rows[6]["vote_accuracy"]) == pytest.approx(0.85)
    report = (tmp_path / "report.md").read_text()
    lines = [line for line in report.splitlines() if "| HapticNet (seed=" in line]
    assert len(lines) == 2
    assert all("| 80.0 | 7 |" in line for line in lines)
    assert "85.0% ± 7.1%" in capfd.readouterr().err


def test_a_second_sweep_in_the_folder_is_refused_until_the_first_has_ended(tmp_path, capsys):
    trainer = {"devices": 1, "num_nodes": 1}
    hydra = {"sweep": {"dir": str(tmp_path)}}
    values = {"hydra": hydra, "trainer": trainer, "trusted": [], "model": {}}
    config = OmegaConf.create(values)
    first, second = SweepSummary(), SweepSummary()
    first.on_multirun_start(config)
    pickle.loads(pickle.dumps(first))  # as launchers send it to their processes
    with pytest.raises(SystemExit) as stop:
        second.on_multirun_start(config)
    assert stop.value.code == 2
    assert "choose another hydra.sweep.dir" in capsys.readouterr().err
    first.on_multirun_end(config)
    second.on_multirun_start(config)
    second.on_multirun_end(config)
