"""A sense that is fitted in closed form, through every task that meets it."""

import csv
import json

import pytest
from conftest import write_forces

import tex_lightning as tl

FUSED = ("experiment=few/fusion", "weights=null", "trunk=tcnn", "model.visual.norm=batch")


@pytest.fixture(scope="module")
def fused(run_once, surfaces):
    """Proportions of bands beside a small VisualNet."""
    return run_once(
        *FUSED, "model.visual.head=[30,25]", "model.visual.width=0.1", "debug=tiny", "data=folder",
        f"data.root={surfaces}", "data.half_scale=false", "data.per_class=2",
    )  # fmt: skip


def test_both_senses_and_their_sum_are_tested_on_whole_folds(fused):
    results = json.loads((fused / "results.json").read_text())
    assert list(results["networks"]) == ["haptic", "visual", "fusion"]
    assert results["networks"]["haptic"]["correct"] == 3  # of two recordings of each class
    card = tl.load(fused).card
    assert len(card.trained_on["seen"]) == 2 * (2 * 3 + 3)  # and a validation fold, of both senses


def test_files_are_classified_by_both_or_by_either(fused, surfaces, cli):
    files = {
        "haptic": surfaces / "beta/haptic/beta_0.wav",
        "image": surfaces / "beta/image/beta_0.png",
    }
    for senses in (["haptic"], ["image"], ["haptic", "image"]):
        given = [f"{name}={files[name]}" for name in senses]
        said = json.loads(cli("task=predict", f"checkpoint={fused}", *given).out)
        assert said["modalities"] == senses
        assert 0 < said["probability"] <= 1
    assert tl.load(fused).predict(haptic=files["haptic"]).label == "beta"


def test_perturbed_traces_are_voted_on(fused, surfaces, cli, tmp_path):
    outcome = cli(
        "task=stability", f"stability.systems=[{fused}]", "stability.parts=true", "data=folder",
        f"data.root={surfaces}", "data.half_scale=false", "stability.only=[white_noise]",
        "stability.bisections=0", f"hydra.run.dir={tmp_path}",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    with (tmp_path / "stability.csv").open() as stream:
        assert {row["modality"] for row in csv.DictReader(stream)} == {"haptic"}


def test_a_live_stream_is_refused_with_what_does_it(fused, cli):
    haptic = fused / "checkpoints/haptic.ckpt"
    outcome = cli("task=stream", f"checkpoint={haptic}", "haptic=-")
    assert outcome.status == 2
    assert "a live stream is classified by HapticNet" in outcome.err


def test_a_trace_that_is_too_short_is_refused_by_its_length(fused, cli, tmp_path):
    import numpy as np
    import soundfile

    soundfile.write(tmp_path / "short.wav", np.random.default_rng(0).normal(size=500), 10_000)
    outcome = cli(
        "task=predict", f"checkpoint={fused}/checkpoints/haptic.ckpt",
        f"haptic={tmp_path}/short.wav",
    )  # fmt: skip
    assert outcome.status == 2
    assert "0.05 s of movement, less than one window of 0.256 s" in outcome.err


def test_epochs_without_training_are_for_what_is_fitted_at_once(cli, tmp_path):
    outcome = cli("model=haptic", "model.haptic.fit.epochs=0", f"hydra.run.dir={tmp_path}")
    assert outcome.status == 2
    assert "choose 1 or more" in outcome.err


def test_a_sense_of_ones_own_is_a_file_that_begins_with_it(cli, surfaces, tmp_path):
    (tmp_path / "conf/sense").mkdir(parents=True)
    (tmp_path / "conf/sense/force.yaml").write_text(
        "defaults: [signal, bands, _self_]\nmodality: force\n"
    )
    manifest = write_forces(surfaces, tmp_path / "forces.csv")
    outcome = cli(
        "--config-dir", tmp_path / "conf", "model=haptic", "model.senses=[force]", "data=manifest",
        f"data.manifest={manifest}", f"hydra.run.dir={tmp_path}/run",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    network = json.loads((tmp_path / "run/results.json").read_text())["networks"]["force"]
    assert network["correct"] == network["test_samples"] == 3
    trace = surfaces / "alpha/haptic/alpha_0.wav"
    said = cli("task=predict", f"checkpoint={tmp_path}/run", f"+force={trace}")
    assert json.loads(said.out)["label"] == "alpha"
