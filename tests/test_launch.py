"""Training from a program or notebook, and the installed command."""

import json
import os
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor

import pytest
import torch
from conftest import make_trace
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.utils import JobRuntime
from hydra.version import VersionBase, getbase
from omegaconf import OmegaConf
from packaging.version import Version

import tex_lightning as tl
from tex_lightning import cli as command
from tex_lightning.config import CONF
from tex_lightning.config.composition import compose_for
from tex_lightning.core.devices import computing_threads
from tex_lightning.tasks import fit

QUICK = ["model=mfcc_nb", "debug=tiny"]


@pytest.fixture
def given(surfaces, cache):
    return ["data=folder", f"data.root={surfaces}", f"data.cache_dir={cache}"]


def hydra_state() -> tuple[object, ...]:
    config = HydraConfig.instance().cfg
    return GlobalHydra.instance().hydra, config, JobRuntime.instance().get("name"), getbase()


def without_times(results) -> str:
    """Results, but for what differs from run to run."""
    (network,) = results["networks"].values()
    for key in ("latency_ms", "fit_seconds", "checkpoint"):
        network.pop(key)
    return json.dumps({**results, "wall_seconds": 0, "environment": None})


def test_python_trains_what_the_command_line_does(naive_bayes, tiny, cache, tmp_path, monkeypatch):
    monkeypatch.setattr(VersionBase.instance(), "version_base", Version("1.2"))
    before, folder = hydra_state(), tmp_path / "python"
    common = [f"data.cache_dir={cache}", f"hydra.run.dir={folder}"]
    with computing_threads(2):
        results = tl.train("model=mfcc_nb", *tiny, *common)
        assert (hydra_state(), torch.get_num_threads()) == (before, 2)
    assert results.folder == folder
    assert dict(results) == json.loads((folder / "results.json").read_text())
    shell = json.loads((naive_bayes / "results.json").read_text())
    assert without_times(results) == without_times(shell)
    trace = make_trace(1, 20)
    python, shell = (tl.load(run).predict(haptic=trace) for run in (folder, naive_bayes))
    assert (python.label, python.top_k) == (shell.label, shell.top_k)
    recorded = [run / ".hydra" / "overrides.yaml" for run in (folder, naive_bayes)]
    python, shell = ({*map(str, OmegaConf.load(file))} for file in recorded)
    assert python == shell


def test_other_tasks_run_and_a_family_is_composed_with_what_was_asked_for(given, tmp_path):
    folder = f"hydra.run.dir={tmp_path / 'frontier'}"
    only = ["frontier.only=[mfcc_nb,mfcc_gmm]", "crossval.only=[0]", "seed=7"]
    results = tl.train("task=frontier", "debug=tiny", *given, *only, folder)
    assert set(results["systems"]) == {"mfcc_nb", "mfcc_gmm"}
    assert "seed=7" in results["command"]
    assert [*results.folder.glob("systems/mfcc_nb/folds/*/checkpoints/haptic.ckpt")]


def test_threads_train_one_after_the_other_in_folders_of_their_own(given, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with ThreadPoolExecutor(2) as threads:
        jobs = [threads.submit(tl.train, *QUICK, *given, f"seed={seed}") for seed in (0, 1)]
        both = [job.result() for job in jobs]
    assert [results["seed"] for results in both] == [0, 1]
    assert len({results.folder for results in both}) == 2
    first, second = (compose_run_folder() for _ in range(2))
    assert first != second  # within one second


def compose_run_folder() -> str:
    """The folder that a run would make now."""
    with initialize_config_dir(str(CONF), version_base="1.3"):
        composed = compose("config", return_hydra_config=True)
        HydraConfig.instance().set_config(composed)
        return composed.hydra.run.dir


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["model.haptic.width=0"], r"give a number in \(0, 8\]"),
        (["hydra.run.dir=/dev/null/run"], "run folder cannot be made"),
        (["hydra.run.dir="], r"hydra\.run\.dir is empty; give a folder"),
        (["-m", "seed=0,1"], "'-m' cannot be read; write key=value"),
        ([["model=haptic"]], r"\['model=haptic'\] is no argument of a command line; give each as"),
        (["experiment=paper/all"], "are a sweep"),
        (["task=predict", "checkpoint=a.ckpt"], "task=predict leaves no results"),
        (["trainer=ddp", "trainer.accelerator=cpu", "trainer.devices=2"], "in this process alone"),
    ],
)
def test_mistakes_are_said_as_the_command_line_says_them(overrides, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(tl.UserError, match=said):
        tl.train(*overrides)


@pytest.fixture
def own_folder(tmp_path):
    """A folder of configuration beside the current one."""
    folder = tmp_path / "mine" / "experiment"
    folder.mkdir(parents=True)
    own = "# @package _global_\nseed: 5\nmodel: {haptic: {width: 0.1, norm: lrn}}\n"
    (folder / "own.yaml").write_text(own)
    return folder.parent


def test_what_a_job_composes_further_is_looked_for_in_the_users_folders(
    own_folder, cli, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    seen = []
    further = ["experiment=own"]
    monkeypatch.setattr(fit, "run", lambda _, job: seen.append(compose_for(job, further)))
    outcome = cli(f"hydra.searchpath=[file://{own_folder}]", "seed=1")
    assert outcome.status == 0, outcome.err
    assert seen[0].seed == 5


def test_the_installed_command_finds_folders_beside_it(own_folder, tmp_path):
    """The console script is as pip writes it."""
    project = tomllib.loads((CONF.parent / "pyproject.toml").read_text())["project"]
    module, _, function = project["scripts"]["tex-lightning"].partition(":")
    script = tmp_path / "bin" / "tex-lightning"
    script.parent.mkdir()
    script.write_text(f"import sys\nfrom {module} import {function}\nsys.exit({function}())\n")

    finished = subprocess.run(
        [sys.executable, script, "--config-dir", "mine", "experiment=own", "--cfg", "job"],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(CONF.parent)}, check=True,
        capture_output=True, text=True,
    )  # fmt: skip
    assert "seed: 5\n" in finished.stdout


def test_ctrl_c_names_the_folder_to_go_on_in(tmp_path, monkeypatch):
    jobs = [(tmp_path, "hydra.run.dir=RUN"), (tmp_path / "x", "")]
    monkeypatch.setattr(command, "STARTED", jobs)
    assert command._how_to_continue() == "Interrupted."
    (tmp_path / "checkpoints").mkdir()
    assert "the same command with hydra.run.dir=RUN goes on" in command._how_to_continue()


def test_an_error_that_ctrl_c_has_led_to_is_told_as_ctrl_c(monkeypatch, capsys):
    def cut_short(_):
        try:
            raise KeyboardInterrupt
        finally:
            getattr(None, "half_changed")  # noqa: B009

    monkeypatch.setattr(command, "_run", cut_short)
    monkeypatch.setattr(sys, "argv", ["tex_lightning", "model=mfcc_nb"])
    assert command.main() == 130
    assert capsys.readouterr().err == "Interrupted.\n"


def test_ctrl_c_while_modules_are_imported_leaves_no_traceback():
    class Finder:
        def find_spec(self, name, *_):
            if name == "tex_lightning.cli":
                raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "meta_path", [Finder(), *sys.meta_path])
        patch.delitem(sys.modules, "tex_lightning.cli")
        patch.delitem(sys.modules, "tex_lightning.__main__", raising=False)
        with pytest.raises(SystemExit, match="130"):
            import tex_lightning.__main__  # noqa: F401


def test_a_wrong_command_ends_before_pytorch_is_imported(tmp_path):
    code = (
        "import sys; from tex_lightning.__main__ import main\n"
        "for command in sys.argv[1:]:\n"
        "    sys.argv[1:] = [command]\n"
        "    try: status = main()\n"
        "    except SystemExit as end: status = end.code\n"
        "    print(status, 'torch' in sys.modules)"
    )
    wrong = ["model.haptic.width=0", "modle=haptic", "task=evaluate"]
    ran = subprocess.run(
        [sys.executable, "-c", code, *wrong],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert (ran.stdout, ran.stderr.count("\n")) == ("2 False\n" * 3, 3)
