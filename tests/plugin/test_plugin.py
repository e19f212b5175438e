"""A user's own parts through the real command line; nothing of the package is edited."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import CLASSES, make_photo
from PIL import Image

import tex_lightning as tl
from tex_lightning.classifier.checkpoint import read_checkpoint
from tex_lightning.config.user_folders import use_config_dir
from tex_lightning.inference.engine import count_macs, sample_macs

HERE = Path(__file__).parent
CONF = ["--config-dir", HERE / "my_ext" / "conf"]


@pytest.fixture(scope="module", autouse=True)
def importable():
    """As the current folder is, or an installed package."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(HERE))
        yield
    use_config_dir([])


@pytest.fixture(scope="module")
def flat(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("flat")
    for kind, label in enumerate(CLASSES):
        for number in range(10):
            Image.fromarray(make_photo(kind, number)).save(folder / f"{label}_{number}.png")
            np.save(folder / f"{label}_{number}.npy", make_force(kind, number))
    return folder


def make_force(kind: int, number: int) -> np.ndarray:
    """Three seconds at 1 kHz, at a mean and with a ripple of its own for each class."""
    rng = np.random.default_rng([kind, number, 2])
    time = np.arange(3000) / 1000
    ripple = (kind + 1) * np.sin(2 * np.pi * (3 + 4 * kind) * time + rng.uniform(0, 6))
    return (kind + 0.3 * ripple + 0.05 * rng.standard_normal(3000)).astype(np.float32)


@pytest.fixture(scope="module")
def data(flat) -> list[str]:
    return ["data=flat", f"data.reader.folder={flat}", "trainer.threads=1", "debug=tiny"]


@pytest.fixture(scope="module")
def run(run_once, data) -> Path:
    """A reader, a trunk and a sense of the user's in one fusion."""
    senses = ["model=fusion", "model.senses=[force,visual]", "trunk=small"]
    budget = ["model.budget=1", "model.force.fit.learning_rate=0.02", "data.val_fold=null"]
    parts = ["logger=csv", "model.visual.trunk.channels=6"]
    return run_once(*CONF, *data, *senses, *budget, *parts)


def results(folder: Path) -> dict:
    return json.loads((folder / "results.json").read_text())


def test_reader_trunk_and_sense_of_a_user_train(run):
    found = results(run)
    assert (found["data"], found["classes"]) == ("flat", list(CLASSES))
    networks = found["networks"]
    assert list(networks) == ["force", "visual", "fusion"]
    assert networks["force"]["vote_accuracy"] == 1  # its budget is not that of debug=tiny
    assert networks["fusion"]["test_samples"] == 3
    assert networks["fusion"]["parameters"] > networks["force"]["parameters"] > 0
    content = read_checkpoint(run / "checkpoints" / "visual.ckpt")
    card = content["hyper_parameters"]["card"]
    assert card["senses"]["visual"]["trunk"] == {"_target_": "my_ext.SmallTrunk", "channels": 6}
    key = "classifier.senses.visual.network.trunk.layers.0.weight"
    assert content["state_dict"][key].shape == (6, 3, 8, 8)


def test_a_perturbation_of_the_user_is_tried_before_any_trial(cli, run, data, tmp_path):
    line = "{function: my_ext.shatters, unit: a, levels: [0, 1, 2, 3, 4, 5]}"
    (tmp_path / "own.yaml").write_text(f"image: {{mine: {line}}}\n")
    outcome = cli(
        *CONF, *data, "trusted=[my_ext]", "task=stability",
        f"stability.systems=[{run}/checkpoints/visual.ckpt]",
        f"stability.severities=[{tmp_path}/own.yaml]", f"hydra.run.dir={tmp_path}/r",
    )  # fmt: skip
    assert outcome.status == 1
    said = "Error: mine of image in stability.severities (shatters) raised KeyError; a perturbation"
    assert said in outcome.err
    assert 'raise KeyError("boom of a user")' in outcome.err


def test_it_evaluates_predicts_and_is_perturbed(cli, run, data, flat, tmp_path):
    known = [*CONF, *data, "trusted=[my_ext]", f"checkpoint={run}"]
    outcome = cli(*known, "task=evaluate", f"hydra.run.dir={tmp_path}/a")
    assert outcome.status == 0, outcome.err
    both = [f"image={flat}/beta_0.png", f"+force={flat}/beta_0.npy"]
    outcome = cli(*known, "task=predict", *both)
    assert outcome.status == 0, outcome.err
    assert json.loads(outcome.out)["modalities"] == ["force", "image"]
    outcome = cli(*known, "task=predict", f"+weight={flat}/beta_0.npy")
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert "does not look at weight" in outcome.err
    outcome = cli(
        *CONF, *data, "trusted=[my_ext]", "task=stability", f"stability.systems=[{run}]",
        "stability.only=[drift,stains]",
        f"stability.severities=[{HERE}/my_ext/severities.yaml]", f"hydra.run.dir={tmp_path}/s",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    with (tmp_path / "s" / "stability.csv").open() as file:
        tried = dict.fromkeys(row["perturbation"] for row in csv.DictReader(file))
    assert [*tried][-2:] == ["drift", "stains"]


def test_arithmetic_of_an_own_trunk_is_that_of_its_scores_alone(run):
    visual = run / "checkpoints" / "visual.ckpt"
    classifier = tl.load(visual, trusted=["my_ext"]).classifier
    photo = torch.from_numpy(make_photo(0, 0))
    counted = sample_macs(classifier, image=photo)
    assert counted == count_macs(lambda: classifier.logits(image=photo)) > 0


def test_photos_with_features_of_the_user_train_and_predict(cli, run_once, data, flat):
    augmentation = "{_target_: kornia.augmentation.RandomHorizontalFlip, p: 1}"
    given = ["model=fusion", "model.senses=[grey]", f"+model.grey.fit.augmentation={augmentation}"]
    grey = run_once(*CONF, *data, *given)
    assert results(grey)["networks"]["grey"]["test_samples"] == 3
    known = [*CONF, "trusted=[my_ext]", f"checkpoint={grey}"]
    outcome = cli(*known, "task=predict", f"image={flat}/beta_0.png")
    assert json.loads(outcome.out)["label"] in CLASSES


def test_a_baseline_of_the_user_is_fitted_and_loaded(cli, data, flat, monkeypatch, tmp_path):
    outcome = cli(
        *CONF, *data, "model=nearest", "model.baseline.power=1", f"hydra.run.dir={tmp_path}"
    )
    assert outcome.status == 0, outcome.err
    assert results(tmp_path)["networks"]["visual"]["correct"] == 3
    given = [f"checkpoint={tmp_path}", f"image={flat}/beta_0.png", "task=predict"]
    monkeypatch.setattr("tex_lightning.config.instantiation._TRUSTED", set())  # as in a new process
    assert "my_ext is not trusted" in cli(*CONF, *given).err
    outcome = cli(*CONF, *given, "trusted=[my_ext]")
    assert json.loads(outcome.out)["label"] == "beta"
    assert tl.load(tmp_path, trusted=["my_ext"]).classifier.baseline.power == 1
    export = ["task=export", "trusted=[my_ext]", f"export.out={tmp_path}/card"]
    assert not cli(*given[:1], *export, "export.format=card").status
    card = (tmp_path / "card" / "MODEL_CARD.md").read_text()
    assert 'tl.load("visual.ckpt", trusted=["my_ext"]).predict(image="FILE")' in card
    assert "onnx" not in card


def test_help_and_near_matches_know_the_users_files(cli, tmp_path):
    listing = " ".join(cli("--help=all", f"--config-dir={CONF[1]}").out.split())
    assert "| tum | flat" in listing
    assert "| vgg_m | small" in listing
    assert "did you mean small" in cli(*CONF, "model=smal").err
    where = f"hydra.run.dir={tmp_path}"
    wrong = [*CONF, "data=flat", "data.reader.folder=.", "model=small", where]
    assert "did you mean data.reader.suffix?" in cli(*wrong, "data.reader.sufix=.jpg").err
    outcome = cli("--config-dir=/no/such", "model=small")
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert "--config-dir=/no/such is no folder" in outcome.err


def test_what_an_own_class_raises_follows_one_line_with_its_key(cli, tmp_path):
    (tmp_path / "conf" / "data").mkdir(parents=True)
    code = "class Reader:\n    def read(self):\n        raise KeyError(1)\n"
    (tmp_path / "boom.py").write_text(code)
    node = "defaults: [base, _self_]\nname: boom\nreader: {_target_: boom.Reader}\n"
    (tmp_path / "conf" / "data" / "boom.yaml").write_text(node)
    outcome = cli(f"--config-dir={tmp_path}/conf", "data=boom", f"hydra.run.dir={tmp_path}/run")
    assert outcome.status == 1
    assert outcome.err.startswith("Error: data.reader (Reader) raised KeyError; a reader has")
    assert "boom.py" in outcome.err


def test_recordings_of_an_own_sense_are_inspected_whatever_the_model_is(cli, data, tmp_path):
    outcome = cli(*CONF, *data, "task=inspect", f"hydra.run.dir={tmp_path}/run")
    assert outcome.status == 0, outcome.err
    assert "Force" in outcome.err


def test_a_photo_that_is_too_small_for_an_own_trunk_is_named(cli, data, flat, tmp_path):
    small = ["model=visual", "trunk=small", "data.resize=64", f"hydra.run.dir={tmp_path}"]
    outcome = cli(*CONF, *data, *small)
    assert outcome.status == 2
    assert f"Error: {flat}/alpha_0.png: The photo has " in outcome.err


def test_a_broken_file_of_the_user_ends_in_one_sentence(cli, tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "bad.yaml").write_text("name: {a: ???}\n")
    outcome = cli(f"--config-dir={tmp_path}", "data=bad")
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert f"{tmp_path}/data/bad.yaml" in outcome.err
    (tmp_path / "callbacks").mkdir()
    (tmp_path / "callbacks" / "diary.yaml").touch()
    outcome = cli(f"--config-dir={tmp_path}", "callbacks=[default,dairy]")
    assert "(did you mean diary?); choose one of default, diary." in outcome.err


def forge(run: Path, path: Path, target: str) -> Path:
    """The checkpoint with another class for its trunk."""
    content = torch.load(run / "checkpoints" / "visual.ckpt", weights_only=True)
    content["hyper_parameters"]["card"]["senses"]["visual"]["trunk"] = {"_target_": target}
    torch.save(content, path)
    return path


def test_code_of_an_unknown_package_does_not_run(cli, run, flat, monkeypatch, tmp_path):
    (tmp_path / "sneaky.py").write_text("open('ran', 'w').close()\nclass Trunk: pass\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    checkpoint = forge(run, tmp_path / "a.ckpt", "sneaky.Trunk")
    given = ["task=predict", f"checkpoint={checkpoint}", f"image={flat}/beta_0.png"]
    outcome = cli(*given)
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert "names the class sneaky.Trunk" in outcome.err
    assert "trusted=[sneaky]" in outcome.err
    with pytest.raises(tl.UserError, match="sneaky is not trusted"):
        tl.load(checkpoint)
    assert not (tmp_path / "ran").exists()
    assert "sneaky" not in sys.modules
    assert "which is no trunk" in cli(*given, "trusted=[sneaky]").err
    assert (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("target", "said"),
    [
        ("tex_lightning.__main__.os.system", "tex_lightning is not trusted"),
        ("tex_lightning.classifier.card.Path", "tex_lightning is not trusted"),
        ("tex_lightning.core.files.Path", "tex_lightning is not trusted"),
        ("my_ext.Path", "pathlib is not trusted"),
        ("my_ext.torch.nn.Conv2d", "torch is not trusted"),
        ("my_ext.torch.hub.load", "is no class"),
    ],
)
def test_a_trusted_package_does_not_lend_its_name(run, tmp_path, target, said):
    with pytest.raises(tl.UserError, match=said):
        tl.load(forge(run, tmp_path / "a.ckpt", target), trusted=["my_ext"])


def test_an_installed_package_brings_its_files_and_is_trusted(
    cli, run, flat, monkeypatch, tmp_path
):
    info = tmp_path / "my_ext-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my_ext\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[tex_lightning.plugins]\nmy_ext = my_ext\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    listing = " ".join(cli("task=fit", "model=small", "--help").out.split())
    assert "| tum | flat" in listing
    assert "add data.reader.folder=VALUE" in cli("data=flat", f"hydra.run.dir={tmp_path}/r").err
    outcome = cli("task=predict", f"checkpoint={run}", f"image={flat}/beta_0.png")
    assert json.loads(outcome.out)["label"] in CLASSES
    assert tl.load(run).card.kind == "fusion"
