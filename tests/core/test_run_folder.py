"""Which checkpoint a run folder stands for, and that one process has it at a time."""

import errno
import json
import os
import signal
import time
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from tex_lightning.config import CONF, Job, register, subject
from tex_lightning.config.quoting import as_typed
from tex_lightning.core.run_folder import (
    claim_folder,
    find_checkpoint,
    locked_folder,
    remove_if_empty,
)
from tex_lightning.errors import UserError


def make(folder, *kinds, **settings):
    (folder / "checkpoints").mkdir(parents=True)
    for kind in kinds:
        (folder / "checkpoints" / f"{kind}.ckpt").touch()
    if settings:
        (folder / "settings.json").write_text(json.dumps(settings))
    return folder


@pytest.mark.parametrize(
    ("kinds", "settings", "kind"),
    [
        (["haptic", "visual", "fusion"], {"model.senses": ["haptic", "visual"]}, "fusion"),
        (["visual"], {}, "visual"),
        (["visual"], {"task": "enroll", "model.senses": ["haptic"]}, "visual"),
    ],
)
def test_a_run_folder_stands_for_its_models_own_network(tmp_path, kinds, settings, kind):
    folder = make(tmp_path / "run", *kinds, **settings)
    assert find_checkpoint(str(folder)) == folder / "checkpoints" / f"{kind}.ckpt"
    assert find_checkpoint(tmp_path / "none.ckpt") == tmp_path / "none.ckpt"


def test_an_ambiguous_damaged_or_empty_folder_is_said(tmp_path):
    with pytest.raises(UserError, match="no finished checkpoint"):
        find_checkpoint(tmp_path)
    folder = make(tmp_path / "a", "haptic", "visual")
    with pytest.raises(UserError, match=r"no finished fusion.ckpt; give .*haptic.ckpt or .*visual"):
        find_checkpoint(folder)
    (folder / "settings.json").write_text("[1]")
    with pytest.raises(UserError, match=r"Record .*settings.json is damaged"):
        find_checkpoint(folder)
    make(tmp_path / "c" / "folds" / "0", "haptic")
    with pytest.raises(UserError, match=r"file of a fold, .*folds/0/checkpoints/haptic.ckpt"):
        find_checkpoint(tmp_path / "c")


def test_a_folder_belongs_to_one_process_until_that_ends(tmp_path):
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        with locked_folder(tmp_path / "run"):
            os.write(writing, b"x")
            time.sleep(60)
        os._exit(0)
    os.read(reading, 1)
    with (
        pytest.raises(UserError, match=r"Another process runs in .*choose another hydra\.run\.dir"),
        locked_folder(tmp_path / "run"),
    ):
        pass
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    with locked_folder(tmp_path / "run"):
        pass


@pytest.mark.parametrize(("origin", "key"), [("sweep", "sweep"), ("command", "run")])
def test_a_folder_of_another_run_is_refused_by_the_key_that_chose_it(tmp_path, origin, key):
    folder = make(tmp_path, "haptic", seed=1)
    job = Job((), folder, origin, True, (), OmegaConf.create(), OmegaConf.create())
    with pytest.raises(UserError, match=rf"another seed; choose another hydra\.{key}\.dir"):
        claim_folder(folder, {"seed": 2}, job.record, job.folder_key)


def test_a_run_goes_on_beside_senses_that_came_to_the_folder_since(tmp_path):
    base = {"model.senses": ["force"], "model.force._target_": "a", "model.force.width": 1}
    folder = make(tmp_path, "force", **base)
    rest = {}, "hydra.run.dir"
    claim_folder(folder, {**base, "model.heat._target_": "b", "model.heat.width": 2}, *rest)
    claim_folder(folder, base, *rest)
    wrong = (
        {"model.force.width": 2}, {"model.baseline._target_": "b"}, {"data.reader._target_": "b"},
        {"model.senses": ["force", "heat"], "model.heat._target_": "b"},
    )  # fmt: skip
    for change in wrong:
        with pytest.raises(UserError, match=f"another {min(change)}"):
            claim_folder(folder, {**base, **change}, *rest)


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EOPNOTSUPP])
def test_a_file_system_without_locks_is_said_and_works(tmp_path, monkeypatch, caplog, number):
    def no_lock(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("fcntl.flock", no_lock)
    with locked_folder(tmp_path / "run"):
        assert (tmp_path / "run").is_dir()
    assert "lies on a file system without locks" in caplog.text


def test_a_run_folder_in_bytes_that_are_no_text_is_refused(tmp_path):
    folder = tmp_path / os.fsdecode(b"stra\xdfe")
    with pytest.raises(UserError, match="is no text in UTF-8"), locked_folder(folder):
        pass
    assert not folder.exists()


def test_a_command_that_fails_at_once_leaves_no_empty_folders(cli):
    for arguments in (["decision.pairs=-1"], ["data=folder", "data.root=/nowhere"]):
        assert cli("model=haptic", *arguments).status == 2
        assert list(Path.cwd().iterdir()) == []
    Path("outputs/mine").mkdir(parents=True)
    assert cli("model=haptic", "decision.pairs=-1").status == 2
    assert list(Path.cwd().rglob("*")) == [Path.cwd() / "outputs", Path.cwd() / "outputs/mine"]


def test_a_prediction_writes_nothing_where_it_runs(cli, bands, surfaces, monkeypatch):
    monkeypatch.setattr("pathlib.Path.mkdir", lambda path, *_, **__: path.stat())  # refuses more
    files = f"haptic=[{surfaces}/alpha/haptic/alpha_0.wav,{surfaces}/beta/haptic/beta_1.wav]"
    outcome = cli("task=predict", f"checkpoint={bands}", files, "verbose=2")
    assert (outcome.status, outcome.out.count("\n")) == (0, 2), outcome.err
    assert list(Path.cwd().iterdir()) == []


def test_an_empty_current_folder_is_not_removed(tmp_path, monkeypatch):
    here = tmp_path / "a" / "b"
    (here / "outputs" / "fit" / "haptic" / "now").mkdir(parents=True)
    monkeypatch.chdir(here)
    remove_if_empty(Path("outputs/fit/haptic/now"))
    assert not list(here.iterdir())
    remove_if_empty(Path())
    assert here.is_dir()


def test_a_run_folder_says_what_is_evaluated(tmp_path, bands):
    def named(task: str, checkpoint: object) -> str:
        root = {"task": task, "checkpoint": checkpoint, "model": {"name": "visual"}}
        return subject(_root_=OmegaConf.create(root))

    assert named("fit", None) == named("evaluate", None) == named("fit", str(bands)) == "visual"
    assert named("evaluate", str(bands)) == "band_proportions"
    part = tmp_path / "checkpoints" / "haptic.ckpt"
    part.parent.mkdir()
    networks = {"haptic": {}, "visual": {}, "fusion": {}}
    (tmp_path / "results.json").write_text(json.dumps({"model": "mine", "networks": networks}))
    part.touch()
    assert named("evaluate", str(part)) == "haptic"
    part.rename(part.with_name("fusion.ckpt"))
    assert named("evaluate", str(part.with_name("fusion.ckpt"))) == "mine"
    assert named("export", str(tmp_path / "nothing")) == "nothing"
    assert named("export", "") == "checkpoint"


@pytest.mark.parametrize(
    ("given", "name"),
    [
        (["task=stability", "stability.systems=[RUN,b.ckpt]"], "mine+b-synthetic"),
        (["task=stability", "stability.systems=[a,b,c,d]"], "4_systems-synthetic"),
        (["task=frontier", "frontier=sound"], "sound-synthetic"),
        (["task=enroll", "checkpoint=/gone/my best 2.ckpt"], "my_best_2-synthetic"),
        (["task=export", "checkpoint=RUN/folds/0/checkpoints/haptic.ckpt"], "mine-synthetic"),
        (["experiment=few/sound"], "band_proportions-synthetic"),
    ],
)
def test_a_comparison_or_a_fold_is_not_called_after_the_default_model(tmp_path, given, name):
    run = make(tmp_path / "run", "haptic")
    make(run / "folds" / "0", "haptic")
    (run / "results.json").write_text(json.dumps({"model": "mine", "networks": {"haptic": {}}}))
    register()
    overrides = [each.replace("RUN", str(run)) for each in given]
    with initialize_config_dir(str(CONF), version_base="1.3"):
        config = compose("config", as_typed(overrides), return_hydra_config=True)
    assert Path(config.hydra.run.dir).parts[:3] == ("outputs", config.task, name)


def test_a_former_name_is_answered_with_the_one_of_today(cli):
    outcome = cli("model=haptic_bands")
    assert outcome.status == 2
    assert "it is called model=band_proportions now" in outcome.err
