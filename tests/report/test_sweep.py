"""What a sweep says of jobs whose results have no networks, or that failed."""

import csv
import json
from pathlib import Path

import pytest
from omegaconf import OmegaConf

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
        SweepSummary().on_multirun_end(OmegaConf.create({"hydra": {"sweep": {"dir": str(folder)}}}))
        with (folder / "sweep.csv").open() as stream:
            return {row["job"]: row["status"] for row in csv.DictReader(stream)}

    return end


def test_tasks_with_tables_of_their_own_are_done(tmp_path, ended):
    job(tmp_path / "0", "frontier", {"chosen": "lbp"})
    job(tmp_path / "1", "stability", {"systems": {}})
    job(tmp_path / "2", "stream", None)
    assert ended(tmp_path) == {"0": "done", "1": "done", "2": "done"}
    assert SweepSummary.failures == 0


def test_a_failure_among_them_is_counted(tmp_path, ended):
    job(tmp_path / "0", "frontier", {"chosen": "lbp"})
    job(tmp_path / "1", "fit", None)
    assert ended(tmp_path) == {"0": "done", "1": "not finished"}
    assert SweepSummary.failures == 1
