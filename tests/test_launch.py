"""Training from a program or notebook, and the installed command."""

import builtins
import errno
import importlib.util
import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import hydra
import pytest
import torch
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.utils import JobRuntime
from hydra.version import VersionBase, getbase
from omegaconf import OmegaConf
from packaging.version import Version

import tex_lightning as tl
from tex_lightning import __main__ as main_module
from tex_lightning import cli as command
from tex_lightning.cli import to_user_error
from tex_lightning.config import CONF
from tex_lightning.tasks import fit

QUICK = ["model=mfcc_nb", "debug=tiny"]


@pytest.fixture
def given(surfaces, cache):
    return ["data=folder", f"data.root={surfaces}", f"data.cache_dir={cache}"]


def own_application(function, folder: Path, version: str) -> None:
    """An application of the user's, with a configuration and a schema of its own, runs a job."""
    (folder / "config").mkdir()
    (folder / "config" / "mine.yaml").write_text("defaults: [schema, _self_]\nsize: 3\n")
    ConfigStore.instance().store(name="schema", node={"colour": "red"})
    with hydra.initialize_config_dir(str(folder / "config"), "mine", version):
        application = GlobalHydra.instance().hydra
        application.run("mine", function, [f"hydra.run.dir={folder / 'mine'}"], False)


def hydra_state() -> tuple[object, ...]:
    config = HydraConfig.instance().cfg
    return GlobalHydra.instance().hydra, config, JobRuntime.instance().get("name"), getbase()


def without_times(results) -> str:
    """Results, but for what differs from run to run."""
    (network,) = results["networks"].values()
    for key in ("latency_ms", "fit_seconds", "checkpoint"):
        network.pop(key)
    return json.dumps({**results, "wall_seconds": 0, "environment": None})


def test_python_trains_what_the_command_line_does(cli, given, tmp_path, monkeypatch):
    arguments = [
        "model=haptic",
        "debug=tiny",
        "model.haptic.width=0.1",
        *given,
    ]
    monkeypatch.setattr(VersionBase.instance(), "version_base", Version("1.2"))
    before, threads = hydra_state(), torch.get_num_threads()
    results = tl.train(*arguments, f"hydra.run.dir={tmp_path / 'python'}")
    assert (hydra_state(), torch.get_num_threads()) == (before, threads)
    assert results.folder == tmp_path / "python"
    assert dict(results) == json.loads((results.folder / "results.json").read_text())
    outcome = cli(*arguments, f"hydra.run.dir={tmp_path / 'shell'}")
    assert outcome.status == 0, outcome.err
    shell = json.loads((tmp_path / "shell" / "results.json").read_text())
    assert without_times(results) == without_times(shell)
    files = [tmp_path / run / "checkpoints" / "haptic.ckpt" for run in ("python", "shell")]
    left, right = (torch.load(file, weights_only=True)["state_dict"] for file in files)
    assert all(torch.equal(left[key], right[key]) for key in right)
    recorded = [tmp_path / run / ".hydra" / "overrides.yaml" for run in ("python", "shell")]
    python, shell = (sorted(map(str, OmegaConf.load(file))) for file in recorded)
    assert python == sorted({*shell})


def test_it_works_twice_inside_a_running_application_and_leaves_it_as_it_was(
    given, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    seen = []

    def work(config):
        before = hydra_state()
        seen.append(tl.train(*QUICK, *given, "seed=0"))
        seen.append(tl.train(*QUICK, *given, "seed=1", "hydra.run.dir=second"))
        tl.load(seen[0].folder, "top_k=1")
        with pytest.raises(tl.UserError, match="did you mean model"):
            tl.train("modle=haptic")
        assert all(now is then for now, then in zip(hydra_state(), before, strict=True))
        assert config.colour == "red"
        assert hydra.compose("mine").colour == "red"

    before = hydra_state()
    own_application(work, tmp_path, "1.2")
    assert [results["seed"] for results in seen] == [0, 1]
    assert seen[0].folder.parent == tmp_path / "outputs" / "fit" / "mfcc_nb-folder"
    assert seen[1].folder == tmp_path / "second"
    assert HydraConfig.instance().cfg is before[1]


def test_other_tasks_run_and_a_family_is_composed_with_what_was_asked_for(given, tmp_path):
    folder = f"hydra.run.dir={tmp_path / 'frontier'}"
    only = ["frontier.only=[mfcc_nb,mfcc_gmm]", "crossval.only=[0]", "seed=7"]
    results = tl.train("task=frontier", "debug=tiny", *given, *only, folder)
    assert set(results["systems"]) == {"mfcc_nb", "mfcc_gmm"}
    assert "seed=7" in results["command"]
    (checkpoint,) = results.folder.glob("systems/mfcc_nb/folds/*/checkpoints/haptic.ckpt")
    folder = f"hydra.run.dir={tmp_path / 'evaluate'}"
    tested = tl.train("task=evaluate", "data.classes=2", *given, f"checkpoint={checkpoint}", folder)
    assert tested["networks"]["haptic"]["test_samples"] == 2


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["model=hptic"], r"model=hptic does not exist \(did you mean haptic"),
        (["model.haptic.width=abc"], "could not be converted to Float"),
        (["model.haptic.width=0"], "choose more than 0"),
        (["data=folder"], "No value for data.root"),
        (["hydra.run.dir=/dev/null/run"], "run folder cannot be made"),
        (["-m", "seed=0,1"], "-m is for the command line"),
        (["experiment=paper/all"], "ask for a sweep"),
        (["task=predict", "checkpoint=a.ckpt"], "task=predict leaves no results"),
        (["trainer=ddp", "trainer.accelerator=cpu", "trainer.devices=2"], "in this process alone"),
    ],
)
def test_mistakes_are_said_as_the_command_line_says_them(overrides, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(tl.UserError, match=said):
        tl.train(*overrides)


def test_a_fault_of_the_program_keeps_its_own_exception(given, tmp_path, monkeypatch):
    def fail(*arguments):
        raise ZeroDivisionError("a fault of ours")

    monkeypatch.setattr("tex_lightning.tasks.fit.open_announced", fail)
    with pytest.raises(ZeroDivisionError, match="a fault of ours"):
        tl.train(*QUICK, *given, f"hydra.run.dir={tmp_path}")


@pytest.fixture
def own_folder(tmp_path):
    """A folder of configuration beside the current one."""
    folder = tmp_path / "mine" / "experiment"
    folder.mkdir(parents=True)
    own = "# @package _global_\nseed: 5\nmodel: {haptic: {width: 0.1, norm: lrn}}\n"
    (folder / "own.yaml").write_text(own)
    return folder.parent


@pytest.mark.parametrize("how", ["--config-dir=mine", "hydra.searchpath=[file://{}]"])
def test_what_a_job_composes_further_is_looked_for_in_the_users_folders(
    how, own_folder, cli, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    seen = []
    monkeypatch.setattr(fit, "run", lambda _, job: seen.append(job.compose(["experiment=own"])))
    outcome = cli(how.format(own_folder), "seed=1")
    assert outcome.status == 0, outcome.err
    assert seen[0].seed == 5


@pytest.fixture
def installed(tmp_path):
    """Run the console script, as pip writes it, in the folder that holds the user's own."""
    project = tomllib.loads((CONF.parent / "pyproject.toml").read_text())["project"]
    module, _, function = project["scripts"]["tex-lightning"].partition(":")
    script = tmp_path / "bin" / "tex-lightning"
    script.parent.mkdir()
    script.write_text(f"import sys\nfrom {module} import {function}\nsys.exit({function}())\n")

    def run(*arguments):
        finished = subprocess.run(
            [sys.executable, script, "--config-dir", "mine", "experiment=own", *arguments],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(CONF.parent), "OMP_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            timeout=200,
        )
        assert finished.returncode == 0, finished.stderr
        return finished

    return run


def test_the_installed_command_finds_folders_beside_it(own_folder, installed):
    assert "seed: 5\n" in installed("--cfg", "job").stdout


@pytest.mark.slow
def test_the_installed_command_starts_its_second_process(own_folder, installed, given, tmp_path):
    two = ["trainer=ddp", "trainer.accelerator=cpu", "trainer.devices=2"]
    finished = installed("debug=tiny", "hydra.run.dir=run", *given, *two)
    assert finished.stderr.count("Results in") == 1
    results = json.loads((tmp_path / "run" / "results.json").read_text())
    assert (results["seed"], results["model"]) == (5, "haptic")


def test_a_disk_that_is_full_is_the_users_to_mend():
    full = OSError(errno.ENOSPC, "No space left on device", "/run/events")
    said = str(to_user_error(full, began=True))
    assert said.startswith("Cannot write /run/events (No space left on device); free some space")
    assert to_user_error(OSError(errno.EIO, "Input/output error"), began=True) is None


def test_ctrl_c_names_the_folder_to_go_on_in(tmp_path, monkeypatch):
    jobs = [(tmp_path, "hydra.run.dir=RUN"), (tmp_path / "x", "")]
    monkeypatch.setattr(command, "STARTED", jobs)
    assert command._interrupted() == "Interrupted."
    (tmp_path / "checkpoints").mkdir()
    assert "the same command with hydra.run.dir=RUN goes on" in command._interrupted()


def test_ctrl_c_while_python_imports_is_one_line_too(monkeypatch, capsys):
    spec = importlib.util.spec_from_file_location("fresh", main_module.__file__)
    fresh, load = importlib.util.module_from_spec(spec), builtins.__import__

    def interrupted(name, *rest):
        if name == "tex_lightning.cli":
            raise KeyboardInterrupt
        return load(name, *rest)

    monkeypatch.setattr(builtins, "__import__", interrupted)
    with pytest.raises(SystemExit) as stop:
        spec.loader.exec_module(fresh)
    assert stop.value.code == 130
    assert capsys.readouterr().err == "Interrupted.\n"
