"""The command line itself: what a person types, right and wrong."""

import json
import os
import subprocess
import sys
from pathlib import Path
from pkgutil import iter_modules

import pytest
import torch
from omegaconf import OmegaConf

import tex_lightning
from tex_lightning import tasks
from tex_lightning.config import CONF, READS, flatten
from tex_lightning.config.check import missing_keys
from tex_lightning.config.composition import compose_config, keys_read
from tex_lightning.config.keys import Key
from tex_lightning.config.model import kind_of
from tex_lightning.config.usage import config_groups
from tex_lightning.perturbations.table import trainable

REPOSITORY = CONF.parent
LONG = "a" * 100_000


def python(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "tex_lightning", *arguments],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


def test_help_fits_a_screen_and_works_from_anywhere(tmp_path):
    finished = python("--help", cwd=tmp_path)
    assert finished.returncode == 0
    lines = finished.stdout.splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 80
    assert "  python -m tex_lightning model=fusion" in lines
    for task in READS:
        (line,) = [line for line in lines if line.startswith(f"  {task} ")]
        assert len(line) > 25
    assert not list(tmp_path.iterdir())


def test_help_needs_no_torch():
    code = (
        "import sys; from tex_lightning.__main__ import main; sys.argv[1:] = ['--help=all']; "
        "main(); assert not {'torch', 'lightning'} & {*sys.modules}"
    )
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)


def test_version_is_that_of_the_package(cli):
    assert cli("--version").out == f"tex_lightning {tex_lightning.__version__}\n"


def test_help_of_a_task_lists_the_keys_that_it_reads_with_the_values_now(cli):
    outcome = cli("model=visual", "model.visual.width=0.25", "task=fit", "--help")
    assert outcome.status == 0
    lines = outcome.out.splitlines()
    assert max(map(len, lines)) <= 80
    place = lines.index("model.visual.width=0.25")
    assert "1 is the published size [more than 0 and at" in lines[place + 1]
    assert "data.sampling_rate=10000" in lines
    assert lines[lines.index("model.visual.norm=batch") + 1].endswith("without one [batch")
    names = {line.partition("=")[0] for line in lines}
    assert "model.visual.fit.epochs" in names
    assert not any(name.startswith(("model.haptic.", "stream.", "profile.")) for name in names)


def test_every_key_has_a_meaning_and_a_task_that_reads_it():
    assert set(READS) == {module.name for module in iter_modules(tasks.__path__)}
    config = compose_config(CONF, ["model=fusion"])
    listed: dict[str, Key] = {}
    for task in READS:
        listed |= keys_read(OmegaConf.merge(config, {"task": task}))
    sections = OmegaConf.to_container(config)
    sections_of_others = tuple(f"{name}." for name in ("hydra", *listed))  # whose classes read them
    leaves = {name for name in flatten(sections) if not name.startswith(sections_of_others)}
    assert leaves <= set(listed)
    assert all(len(key.meaning) > 8 for key in listed.values())


EVERY_MODEL = [(model, "folder") for model in config_groups()["model"]]
EVERY_DATA_SET = [("fusion", data) for data in config_groups()["data"]]


@pytest.mark.parametrize(("model", "data"), sorted({*EVERY_MODEL, *EVERY_DATA_SET}))
def test_every_model_and_data_set_composes_without_open_values_but_paths(model, data):
    config = compose_config(CONF, [f"model={model}", f"data={data}"])
    assert set(missing_keys(config)) <= {"data.root", "data.manifest"}
    assert config.model.name == model


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        # Hydra's and OmegaConf's
        (["model=hptic"], "model=hptic does not exist (did you mean haptic?)"),
        (["hydra/launcher=jbolib"], "hydra/launcher=jbolib does not exist"),
        (["model.haptic.width=abc"], "could not be converted to Float"),
        (
            ["task=crossval", "crossval.only=0,1"],
            "Ambiguous value for argument",
        ),
        (["seed=" + "9" * 5000], "Exceeds the limit (4300 digits)"),
        (["seed"], "'seed' cannot be read; write key=value"),
        (["haptic=a b(.wav"], "cannot be read; write key=value"),
        (["--multrun", "seed=0,1"], "cannot be read (unrecognized arguments: --multrun)"),
        (["task=evaluate", "data=folder"], "No value for checkpoint, data.root"),
        (["hydra.run.dir=/dev/null/run"], "The run folder cannot be made"),
        ([f"model={LONG}"], "more characters"),
        (["data=folder", f"data.root={LONG}"], "is too long; give a shorter one"),
        # wrong keys
        (["model.haptic.widht=2"], "no key model.haptic.widht (did you mean model.haptic.width"),
        (["--cfg", "job", "modle=haptic"], "no key modle (did you mean model"),
        (["task=fit", "modle=haptic", "--help"], "no key modle (did you mean model?)"),
        (["model=minirocket", "model.baseline.kernel=5"], "did you mean model.baseline.kernels"),
        (["+extra=1"], "There is no key extra"),
        (["+model.haptic.extra=1"], "There is no key model.haptic.extra"),
        (["+model.smell.width=2"], "There is no key model.smell"),
        (
            ["model=fusion", "epochs=3"],
            "model.haptic.fit.epochs or model.visual.fit.epochs or model.fusion.fit.epochs?)",
        ),
        (["task=profile", "width=300"], "(did you mean model.haptic.width or profile.width?)"),
        (["lr=0.1"], "no key lr (did you mean model.haptic.fit.learning_rate?)"),
        # ranges and choices
        (["model.haptic.width=0"], "width is 0: choose more than 0 and at most 8"),
        (["model.haptic.width=nan"], "model.haptic.width is nan: choose more than 0"),
        (["decision.confidence_thresholds=[0.5,2]"], "decision.confidence_thresholds is 2"),
        (["data.test_fold=12", "model.haptic.norm=bathc"], "(did you mean batch?): choose batch, "),
        (
            ["data.test_fold=12", "model.haptic.norm=bathc"],
            "data.test_fold is 12: choose from 0 to 9; model.haptic.norm",
        ),
        # keys that need each other
        (["model.baseline=minirocket"], "Cannot assign str to Dict"),
        (["model.senses=[]"], "model.senses is []: name one sense or several"),
        (["model=fusion", "model.senses=[haptic,smell]"], "model.senses names smell"),
        (["model=minirocket", "model.senses=[haptic,sound]"], "looks at one sense"),
        (["model=lbp", "model.senses=[haptic]"], "lbp looks at a photo, and haptic is a signal"),
        (["model.haptic.fit.epochs=0"], "model.haptic.fit.epochs is 0: choose 1 or more"),
        (["data.root=/somewhere"], "data.root is not read by data=synthetic"),
        (["data.val_fold=0"], "both 0: choose different folds"),
        (["data.test_fold=null"], "data.test_fold is null"),
        (["task=crossval", "data.val_fold=2"], "leave it null"),
        (["checkpoint=a.ckpt"], "not by task=fit"),
        (["image=a.jpg"], "image is read by task=predict, task=stream"),
        (["task=predict", "checkpoint=null"], "task=predict needs one: give it"),
        (["task=profile", "model=minirocket"], "measures networks, and model=minirocket is none"),
        (["task=frontier", "frontier.only=[]"], "frontier.only names nothing: leave it null"),
        (
            ["task=stability", "stability.systems=[a]", "decision=sequential"],
            "decision=sequential looks at parts of a recording",
        ),
        (
            ["task=crossval", "model=fusion", "model.fusion.haptic_checkpoint=a.ckpt"],
            "fit one fold only",
        ),
        # what is not there
        (["trainer.accelerator=mps"], "mps is not available on this machine"),
        (["task=generate", "generate.out=/dev/null/x"], "cannot be made"),
        (["task=profile", "haptic=a.wav"], "File a.wav does not exist"),
        (["task=crossval", "crossval.only=[0,10]"], "must name folds from 0 to 9"),
        (["data=folder", "data.root=/no/such/folder"], "Folder /no/such/folder does not exist"),
        (["data=tum", "data.root=/no/tum"], "/no/tum/Training/Accel holds no"),
        (["model=visual", "model.visual.fit.patch=50"], "patch is 50, and this network needs"),
        (["weights=x.npz"], "HapticNet starts from a checkpoint"),
        (["model=visual_efficientnet", "weights=/no/x.npz"], "/no/x.npz"),
        (
            ["model=visual", "trunk=efficientnet_lite0", "model.visual.norm=lrn"],
            "model.visual.norm",
        ),
        (["model=fusion", "model.fusion.haptic_checkpoint=/no.ckpt"], "/no.ckpt does not exist"),
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


def test_an_internal_fault_keeps_its_traceback(cli, tmp_path, monkeypatch):
    def fail(*arguments):
        raise ZeroDivisionError("a fault of ours")

    monkeypatch.setattr("tex_lightning.tasks.fit.open_announced", fail)
    with pytest.raises(ZeroDivisionError, match="a fault of ours"):
        cli(f"hydra.run.dir={tmp_path}")


def test_the_defaults_run_on_synthetic_surfaces(cli, tmp_path):
    outcome = cli("debug=tiny", "data.classes=3", f"hydra.run.dir={tmp_path}")
    assert outcome.status == 0, outcome.err
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["data"] == "synthetic"
    assert len(results["classes"]) == 3


@pytest.mark.parametrize(
    "preset",
    [
        "haptic",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("visual_tcnn", "fusion_fc3")),
    ],
)
def test_presets_of_the_paper_run(cli, tmp_path, preset):
    arguments = ["debug=tiny", "data.classes=2", "data.synthetic.photo_width=1000"]
    outcome = cli(
        f"experiment=paper/{preset}",
        *arguments,
        "data.synthetic.photo_height=1000",
        f"hydra.run.dir={tmp_path}",
    )
    assert outcome.status == 0, outcome.err
    kind = preset.partition("_")[0]
    content = torch.load(tmp_path / f"checkpoints/{kind}.ckpt", weights_only=True)
    assert content["hyper_parameters"]["fit"]["optimizer"]["_target_"] == "torch.optim.Adam"


@pytest.mark.parametrize(
    ("preset", "kind", "expected"),
    [
        ("haptic", "haptic", (1e-4, 0.3, 40_000, 100_000, 10, 300)),
        ("visual", "visual", (3e-5, 0.75, 40_000, 100_000, 2, 384)),
        ("visual_tcnn", "visual", (3e-5, 0.75, 40_000, 100_000, 2, 384)),
        ("fusion_fc2", "fusion", (1e-6, 0.1, 4_000_000, 100_000, 1, None)),
        ("fusion_fc3_tcnn", "fusion", (1e-6, 0.1, 4_000_000, 100_000, 1, None)),
    ],
)
def test_presets_hold_the_papers_table_of_hyper_parameters(preset, kind, expected):
    config = compose_config(CONF, [f"experiment=paper/{preset}"])
    assert kind_of(config.model.senses) == kind
    fit = config.model[kind].fit
    size = fit.get("frames", fit.get("patch"))
    steps = fit.epochs * fit.steps_per_epoch
    schedule = fit.schedule
    found = (fit.learning_rate, schedule.gamma, schedule.step_size, steps, fit.batch_size, size)
    assert found == expected
    assert fit.optimizer.weight_decay == 5e-4
    assert fit.optimizer._target_ == "torch.optim.Adam"
    assert schedule._target_ == "torch.optim.lr_scheduler.StepLR"


@pytest.mark.parametrize("preset", ["haptic", "visual", "fusion"])
def test_robust_presets_train_on_what_is_not_held_out(preset):
    config = compose_config(CONF, [f"experiment=robust/{preset}"])
    plain = compose_config(CONF, [f"model={config.model.name}"])
    assert kind_of(config.model.senses) == preset
    assert {*config.model.haptic.fit.perturb} < {*trainable("haptic")}
    assert {*config.model.visual.fit.perturb} < {*trainable("image")}
    assert plain.model.haptic.fit.perturb == plain.model.visual.fit.perturb == []


@pytest.mark.slow
def test_a_robust_preset_runs(cli, tmp_path):
    arguments = ["debug=tiny", "data.classes=2", "logger=csv", "trainer.threads=1"]
    outcome = cli("experiment=robust/fusion", *arguments, f"hydra.run.dir={tmp_path}")
    assert outcome.status == 0, outcome.err
    fits = {
        kind: torch.load(tmp_path / f"checkpoints/{kind}.ckpt", weights_only=True)[
            "hyper_parameters"
        ]["fit"]
        for kind in ("haptic", "visual", "fusion")
    }
    assert "white_noise" in fits["haptic"]["perturb"]
    assert "jpeg" in fits["visual"]["perturb"]
    assert fits["fusion"]["modality_dropout"] == 0


def test_a_held_out_perturbation_is_not_trained_on(cli, tmp_path):
    key = "model.haptic.fit.perturb"
    outcome = cli(f"{key}=[mains_hum]", f"hydra.run.dir={tmp_path}")
    assert outcome.status == 2
    assert f"{key} is mains_hum" in outcome.err


def test_a_prediction_does_without_what_is_slow_to_import():
    slow = {"lightning", "matplotlib", "torch._dynamo"}
    finished = subprocess.run(
        [sys.executable, "-c", "import tex_lightning.cli, tex_lightning.tasks.predict, sys;"
         f"print(sorted({slow} & sys.modules.keys()))"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert finished.stdout.strip() == "[]"
