"""Fitting a baseline, and what its checkpoint is good for, on MiniRocket."""

import json

import pytest
import soundfile
import torch

import tex_lightning as tl


@pytest.fixture(scope="module")
def checkpoint(run_once, surfaces):
    return run_once("model=minirocket", "data=folder", f"data.root={surfaces}") / (
        "checkpoints/haptic.ckpt"
    )


def test_results_name_the_modality_and_the_checkpoint_holds_tensors(checkpoint):
    results = json.loads((checkpoint.parents[1] / "results.json").read_text())
    network = results["networks"]["haptic"]
    assert results["model"] == "minirocket"
    assert network["correct"] == network["test_samples"] == 3
    assert network["macs_per_sample"] is None
    content = torch.load(checkpoint, weights_only=True)
    assert content["baseline"]["estimator"].dtype == torch.uint8


def test_predict_and_evaluate_read_the_checkpoint(checkpoint, surfaces, cli, tmp_path):
    trace = surfaces / "beta/haptic/beta_0.wav"
    out = cli("task=predict", f"checkpoint={checkpoint}", f"haptic={trace}").out
    line = json.loads(out)
    assert line["label"] == "beta"
    found = tl.load(checkpoint).predict(haptic=trace)
    assert (found.label, found.probability) == ("beta", line["probability"])
    stream, (samples, _) = tl.load(checkpoint).stream(), soundfile.read(trace)
    assert [stream.push(samples[:9]).label, stream.push(samples[9:]).label] == [None, "beta"]
    outcome = cli(
        "task=evaluate", f"checkpoint={checkpoint}", "data=folder", f"data.root={surfaces}",
        "data.test_fold=0", f"hydra.run.dir={tmp_path}",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err


def test_wrong_setting_is_named(cli):
    outcome = cli("model=minirocket", "+model.baseline.kernel=5")
    assert outcome.status == 2
    assert "kernel" in outcome.err
