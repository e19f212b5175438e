"""Jobs of a sweep that SLURM ends, beside a stand-in for its programs."""

import csv
import os

import pytest

pytest.importorskip("submitit")

from submitit.slurm import slurm

from tex_lightning.report.sweep_queue import GONE, QueueJob, QueueWatcher

PROGRAMS = {
    "srun": "exit 1",
    "sacct": "echo Slurm accounting storage is disabled >&2; exit 1",
    "sbatch": "echo Submitted batch job 7",
    "squeue": "echo 7_0 OUT_OF_MEMORY",
}


@pytest.fixture
def queue(monkeypatch, tmp_path):
    for name, line in PROGRAMS.items():
        program = tmp_path / "bin" / name
        program.parent.mkdir(exist_ok=True)
        program.write_text(f"#!/bin/sh\n{line}\n")
        program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"), prepend=os.pathsep)
    monkeypatch.setenv("SUBMITIT_LOG_LEVEL", "NOCONFIG")
    monkeypatch.setattr(QueueJob, "watcher", QueueWatcher())
    monkeypatch.setattr(QueueJob, "_results_timeout_s", 0)
    for owner, name in ((slurm, "SlurmJob"), (slurm.SlurmExecutor, "job_class")):
        monkeypatch.setattr(owner, name, slurm.SlurmJob)


def test_jobs_that_slurm_ended_are_named_and_end_the_sweep_by_its_summary(
    queue, cli, tiny, tmp_path
):
    sweep = tmp_path / "sweep"
    run = (
        "-m",
        "hydra/launcher=submitit_slurm",
        "model=mfcc_nb",
        *tiny,
        f"hydra.sweep.dir={sweep}",
    )
    outcome = cli(*run, "data.test_fold=0,2")
    assert outcome.status == 1
    assert "Job 0: SLURM ended this job (OUT_OF_MEMORY); its messages are in " in outcome.err
    assert f"Job 1: SLURM ended this job ({GONE}); its messages are in " in outcome.err
    assert not {"sacct", "accounting", "Traceback"} & {*outcome.err.split()}
    assert outcome.out == ""
    with (sweep / "sweep.csv").open() as stream:
        assert [row["data.test_fold"] for row in csv.DictReader(stream)] == ["0", "2"]


def test_a_job_is_over_where_the_queue_says_so_or_forgot_it():
    watcher = QueueWatcher()
    watcher._registered |= {"5", "6_0", "6_1", "6_2", "6_3"}
    listed = b"5_N/A COMPLETED\n6_0 CANCELLED\n6_1 CONFIGURING\n6_3 SUSPENDED\n66_2 RUNNING\n"
    watcher._info_dict = watcher.read_info(listed)
    jobs = sorted(watcher._registered)
    assert [watcher.is_done(job, mode="cache") for job in jobs] == [True, True, False, True, False]
    assert watcher.get_state("6_2", mode="cache") == GONE
