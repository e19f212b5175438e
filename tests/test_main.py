"""The command line itself: what a person types, right and wrong."""

import os
import subprocess
import sys
from pkgutil import iter_modules

import pytest
from omegaconf import OmegaConf
from omegaconf.errors import ValidationError

import tex_lightning
from tex_lightning import tasks
from tex_lightning.config import CONF, TASKS, Config, flatten
from tex_lightning.config.check import check_config, missing_keys, read_config
from tex_lightning.config.composition import compose_config, split_flags
from tex_lightning.config.nodes import walk
from tex_lightning.config.user_folders import config_groups
from tex_lightning.errors import UserError

LONG = "a" * 100_000


def test_help_fits_a_screen_and_works_from_anywhere(tmp_path):
    command = [sys.executable, "-m", "tex_lightning", "--help"]
    environment = {**os.environ, "PYTHONPATH": str(CONF.parent)}
    said = subprocess.check_output(command, cwd=tmp_path, env=environment, text=True)
    lines = said.splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 80
    assert "  python -m tex_lightning model=fusion" in lines
    for task in TASKS:
        (line,) = [line for line in lines if line.startswith(f"  {task} ")]
        assert len(line) > 25
    assert not list(tmp_path.iterdir())


def test_version_is_that_of_the_package(cli):
    assert cli("--version").out == f"tex_lightning {tex_lightning.__version__}\n"


def test_help_lists_all_keys_with_the_values_now(cli):
    outcome = cli("model=visual", "model.visual.width=0.25", "task=fit", "--help")
    assert outcome.status == 0
    lines = outcome.out.splitlines()
    assert max(map(len, lines)) <= 80
    place = lines.index("model.visual.width=0.25")
    assert "1 is the published size: (0, 8]" in lines[place + 1]
    assert "data.sampling_rate=10000" in lines
    assert lines[lines.index("model.visual.norm=batch") + 1].endswith("trunks: batch | lrn |")
    names = {line.partition("=")[0] for line in lines}
    assert "model.visual.fit.epochs" in names


def test_every_key_has_a_meaning():
    assert set(TASKS) == {module.name for module in iter_modules(tasks.__path__)}
    sections = OmegaConf.to_container(compose_config(["model=fusion"]))
    keys = dict(walk(Config, sections))
    assert all(len(key.meaning) > 8 for key in keys.values())
    sections_of_others = tuple(f"{name}." for name in ("hydra", *keys))  # whose classes read them
    leaves = {name for name in flatten(sections) if not name.startswith(sections_of_others)}
    assert leaves <= set(keys)


@pytest.mark.slow  # other tests read each published data set by its configuration
@pytest.mark.parametrize("group", ["model", "data"])
def test_every_model_and_data_set_composes_without_open_values_but_paths(group):
    for option in config_groups()[group]:
        config = compose_config(["data=folder", f"{group}={option}"])
        assert set(missing_keys(config)) <= {"data.root", "data.manifest"}
        assert config[group].name == option


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        # Hydra's and OmegaConf's
        (["model=hptic"], "model=hptic does not exist (did you mean haptic?)"),
        (["model=few/haptic"], "does not exist (did you mean experiment=few/haptic?)"),
        (
            ["experiment=few/haptc"],
            "experiment=few/haptc does not exist (did you mean few/haptic?)",
        ),
        (["experiment=few_haptic"], "(did you mean few/haptic?); choose one of best/fusion, "),
        (["model=haptic_bands"], "it is called model=band_proportions now."),
        (["sense@model.haptic=bands"], "it is called sense=band_proportions now."),
        (["task=crossval", "crossval.only=0,1"], "Ambiguous value for argument"),
        (["task=crossval", "crossval.only=3"], "only=3 cannot be used; give a list, as in [A,B]."),
        (["data.folds=-1"], "Error: data.folds is -1: give a number in [2, 100000]."),
        (
            ["data.file_rate=-1"],
            "Error: data.file_rate is -1: give a number in [20, 200000] Hz or null.",
        ),
        (["seed=abc"], "Error: seed=abc cannot be used; give a whole number."),
        (["decision.unknown=yes"], "decision.unknown=yes cannot be used; give a number."),
        (["data.half_scale=half"], "data.half_scale=half cannot be used; give true or false."),
        (["decision.rule={a: 1}"], "cannot be used; give text."),
        (
            ["logger=7"],
            "an option is a name; choose one of csv, mlflow, tensorboard, or leave it out",
        ),
        (["--config-path=conf"], "The package has its own config.yaml, which cannot be replaced;"),
        (
            ["--config-dir=.", "--config-name", "config"],
            "give one of another name by --config-dir=DIR",
        ),
        (["decision=max"], "does not exist; choose one of max_vote, sequential."),
        (["data=published/base"], "and none itself; choose one of cluster, folder, kth"),
        (["experiment=paper/recipe/base"], "and none itself; choose one of best/fusion"),
        (["recipe=base"], "recipe=base is what options begin with, and none itself; leave it out."),
        (
            ["logger=null"],
            "an option is a name; choose one of csv, mlflow, tensorboard, or leave it out",
        ),
        (["~model.haptic.fit.schedule"], "cannot be used; it cannot be taken away, give another"),
        (
            ["export.out=${data.nmae}"],
            "export.out cannot be used: Interpolation key 'data.nmae' not found (did you mean "
            "data.name?); correct what stands in ${…}.",
        ),
        (["export.out=${nope:1}"], "export.out cannot be used: Unsupported interpolation"),
        (["task=generate", "generate.out=/dev/null/x"], "Cannot write /dev/null/x (Not a dir"),
        (["seed"], "'seed' cannot be read; write key=value"),
        (["haptic=a b(.wav"], "put quotes of two kinds around a value"),
        (["--multrun", "seed=0,1"], "cannot be read (unrecognized arguments: --multrun)"),
        (["task=evaluate", "data=folder"], "No value for checkpoint, data.root"),
        (["hydra.run.dir=/dev/null/run"], "The run folder cannot be made"),
        ([f"model={LONG}"], "more characters"),
        # wrong keys
        (["model.haptic.widht=2"], "no key model.haptic.widht (did you mean model.haptic.width"),
        (["~model.haptic.widht"], "no key model.haptic.widht (did you mean model.haptic.width"),
        (
            ["experiment=few/haptic", "~model.haptic.features.thresholdz"],
            "(did you mean model.haptic.features.thresholds",
        ),
        (["~weights"], "weights is null already."),
        (["~model.haptic.width=7"], "The value of 'model.haptic.width' is 0.48 and not 7."),
        (["task=fit", "modle=haptic", "--help"], "no key modle (did you mean model?)"),
        (["+extra=1"], "There is no key extra"),
        (["task=predict", "checkpoint=a", "force=A.wav"], "with a plus sign, as +force=FILE"),
        (["lr=0.1"], "no key lr (did you mean model.haptic.fit.learning_rate or "),
        (["model=lbp", "model.senses=[haptic]"], "lbp looks at a photo, and haptic is a signal"),
        # what is not there
        (["trainer.accelerator=mps"], "can not run on your system"),
        (["task=crossval", "crossval.only=[0,10]"], "must name folds from 0 to 9"),
        (["data=folder", "data.root=~no_one/a"], "Nobody's home folder is known for ~no_one/a"),
        (["data=folder", "data.root=/no/such/folder"], "Folder /no/such/folder does not exist"),
        (["model=visual", "model.visual.fit.patch=50"], "patch is 50, and this network needs"),
        (["model=fusion", "model.fusion.haptic_checkpoint=/no.ckpt"], "/no.ckpt does not exist"),
        (["model=fusion", "model.fusion.haptic_checkpoint=/dev"], "/dev holds no finished check"),
        (["task=predict", "checkpoint=/no.ckpt", "haptic=a.wav"], "/no.ckpt does not exist"),
    ],
)
def test_mistakes_end_in_one_sentence_and_status_2(cli, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    outcome = cli(*arguments)
    (complaint,) = [line for line in outcome.err.splitlines() if line.startswith("Error: ")]
    assert message in complaint
    assert len(complaint) < 1000
    assert outcome.status == 2
    assert outcome.out == ""
    assert "Traceback" not in outcome.err
    assert not list(tmp_path.rglob("results.json"))


def test_a_current_folder_that_was_deleted_is_said(cli, tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    outcome = cli("model=haptic")
    assert outcome.status == 2
    assert outcome.err == "Error: The current folder was deleted; change to one that is there.\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["model.haptic.width=0"], "width is 0: give a number in (0, 8]"),
        (["decision.confidence_threshold=2"], "decision.confidence_threshold is 2"),
        (
            ["data.test_fold=12", "model.haptic.norm=bathc"],
            "is 12: choose from 0 to 9; model.haptic.norm is 'bathc' (did you mean batch?): give",
        ),
        (["model.senses=[]"], "model.senses is []: name one sense or several"),
        (["model=fusion", "model.senses=[haptic,smell]"], "model.senses names smell"),
        (["model.senses=[[haptic]]"], "model.senses names ['haptic'] (did you mean haptic?)"),
        (["model=minirocket", "model.senses=[haptic,sound]"], "looks at one sense"),
        (["data.root=/somewhere"], "data.root is not read by data=synthetic"),
        (["data.root=.", "data.manifest=a"], "data.manifest is not read by data=synthetic"),
        (["data.val_fold=0"], "both 0: choose different folds"),
        (["task=crossval", "data.val_fold=2"], "not by task=crossval: leave it out"),
        (["checkpoint=a.ckpt"], "not by task=fit"),
        (["decision.unknown=0.05", "model=minirocket"], "and model=minirocket is none"),
        (["decision.unknown=0.05", "data.val_fold=null"], "give data.val_fold=1"),
        (["task=predict", "checkpoint=null"], "task=predict needs one: give it"),
        (["task=profile", "model=minirocket"], "measures networks, and model=minirocket is none"),
        (
            ["task=stability", "stability.systems=[a]", "decision=sequential"],
            "decision=sequential looks at parts of a recording",
        ),
        (
            ["task=crossval", "model=fusion", "model.fusion.haptic_checkpoint=a.ckpt"],
            "fit one fold only",
        ),
    ],
)
def test_wrong_values_are_refused_together(arguments, message):
    with pytest.raises((UserError, ValidationError)) as caught:
        check_config(read_config(compose_config(arguments)))
    assert message in str(caught.value)
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize(
    "value", ["${data.root}/sub", "{b: ['${data.root}', 1]}", "[{b: ${data.root}}]"]
)
def test_a_root_may_be_a_part_of_what_a_reader_is_given(value):
    given = ["data.root=/somewhere", f"+data.reader.a={value}", "data.reader._target_=mine.Reader"]
    check_config(read_config(compose_config(given)))


def test_an_internal_fault_keeps_its_traceback(cli, tmp_path, monkeypatch):
    def fail(*arguments):
        raise ZeroDivisionError("a fault of ours")

    monkeypatch.setattr("tex_lightning.tasks.fit.open_and_show", fail)
    with pytest.raises(ZeroDivisionError, match="a fault of ours"):
        cli(f"hydra.run.dir={tmp_path}")


def test_flags_may_stand_between_overrides():
    flags = ["-m", "--cfg", "job", "--config-dir=a"]
    given = ["model=haptic", *flags[:3], "seed=0,1", flags[3], "+x=-1"]
    assert split_flags(given) == (flags, ["model=haptic", "seed=0,1", "+x=-1"])
