"""Prediction and evaluation from a checkpoint alone."""

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import CLASSES, make_trace

import tex_lightning as tl
from tex_lightning.evaluation.outcomes import read_outcomes


def checkpoint(run: Path, kind: str) -> str:
    return f"checkpoint={run}/checkpoints/{kind}.ckpt"


@pytest.mark.parametrize("kind", ["haptic", "fusion"])
def test_evaluate_and_predict_agree_with_the_test_after_training(
    cli, surfaces, fused, tmp_path, kind
):
    # half-scaling is the checkpoint's business: the default of the data set must not matter
    data = ["data=folder", f"data.root={surfaces}", f"hydra.run.dir={tmp_path}"]
    outcome = cli("task=evaluate", checkpoint(fused, kind), *data)
    assert outcome.status == 0, outcome.err
    assert json.loads((tmp_path / "results.json").read_text())["task"] == "evaluate"
    tested = read_outcomes(fused / "predictions" / f"{kind}.csv")
    evaluated = read_outcomes(tmp_path / "predictions" / f"{kind}.csv")
    assert [(o.predicted, o.share, o.fragments) for o in evaluated] == [
        (o.predicted, o.share, o.fragments) for o in tested
    ]
    files = [f"{name}=[{','.join(o.files[name] for o in tested)}]" for name in tested[0].files]
    predicted = cli("task=predict", checkpoint(fused, kind), *files)
    lines = [json.loads(line) for line in predicted.out.splitlines()]
    assert [line["label"] for line in lines] == [o.predicted for o in tested]
    assert [line["confidence"] for line in lines] == [o.share for o in tested]
    model = tl.load(fused / "checkpoints" / f"{kind}.ckpt")  # one at a time, the other way round
    alone = [model.predict(**o.files).label for o in reversed(tested)]
    assert alone[::-1] == [o.predicted for o in tested]


def test_what_a_prediction_holds(cli, surfaces, fused):
    wav = surfaces / "alpha" / "haptic" / "alpha_0.wav"
    outcome = cli("task=predict", checkpoint(fused, "haptic"), f"haptic={wav}", "top_k=2")
    (line,) = outcome.out.splitlines()
    prediction = json.loads(line)
    contract = {"haptic", "label", "confidence", "top_k", "fragments", "latency_ms"}
    assert set(prediction) == contract | {
        "probability", "probabilities", "relative_macs", "warnings",
    }  # fmt: skip
    assert [*prediction["probabilities"]] == [*CLASSES]
    assert sum(prediction["probabilities"].values()) == pytest.approx(1)
    assert prediction["probabilities"][prediction["label"]] == prediction["probability"]
    assert prediction["warnings"] == []
    assert 0 < prediction["probability"] <= 1
    assert prediction["relative_macs"] == 1
    assert len(prediction["top_k"]) == 2
    assert prediction["top_k"][0] == {
        "label": prediction["label"],
        "share": prediction["confidence"],
    }
    assert prediction["fragments"] == 4  # 2.4 s are 236 frames


def test_what_lies_far_outside_of_the_training_is_said(surfaces, fused, tmp_path):
    trace, rate = soundfile.read(surfaces / "beta" / "haptic" / "beta_0.wav")
    files = {
        "level": (trace / 100, rate),  # volts in place of g, say
        "nothing was measured": (np.full(len(trace) * 4, 0.3), 4 * rate),
    }
    model = tl.load(fused / "checkpoints" / "haptic.ckpt")
    for said, (samples, its_rate) in files.items():
        soundfile.write(tmp_path / f"{said}.wav", samples, its_rate, subtype="FLOAT")
        found = model.predict(haptic=tmp_path / f"{said}.wav")
        (warning,) = found.warnings
        assert said in warning
        assert found.confidence < 0.67  # half of three classes' votes is spread
        assert found.probability < 0.67
        if "nothing" in said:
            assert [found.probability, found.confidence] == pytest.approx([1 / 3] * 2)


def test_the_rate_of_bare_files_travels_with_the_checkpoint(cli, tmp_path):
    for kind in range(2):
        folder = tmp_path / "data" / f"class{kind}" / "haptic"
        folder.mkdir(parents=True)
        for recording in range(3):
            np.save(folder / f"{recording}.npy", make_trace(kind, recording, 4.0)[::2])
    common = ["data=folder", f"data.root={tmp_path}/data", "data.folds=3"]
    run = cli(
        "model=haptic", *common, "data.file_rate=5000", "debug=tiny", f"hydra.run.dir={tmp_path}/r"
    )
    assert run.status == 0, run.err
    given = f"checkpoint={tmp_path}/r/checkpoints/haptic.ckpt"
    tested = read_outcomes(tmp_path / "r" / "predictions" / "haptic.csv")
    again = cli("task=evaluate", given, *common, f"hydra.run.dir={tmp_path}/e")
    assert again.status == 0, again.err
    evaluated = read_outcomes(tmp_path / "e" / "predictions" / "haptic.csv")
    assert [o.fragments for o in evaluated] == [o.fragments for o in tested]
    prediction = json.loads(cli("task=predict", given, f"haptic={tested[0].files['haptic']}").out)
    assert prediction["fragments"] == tested[0].fragments
    assert prediction["label"] == tested[0].predicted


def test_unusable_input_is_said_in_one_sentence(cli, surfaces, fused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wav = surfaces / "alpha" / "haptic" / "alpha_0.wav"
    soundfile.write("short.wav", np.random.default_rng(0).standard_normal(9000) * 0.1, 10_000)
    Path("cut.ckpt").write_bytes((fused / "checkpoints/haptic.ckpt").read_bytes()[:-5000])

    def refuse(message, *arguments):
        outcome = cli("task=predict", *arguments)
        assert outcome.status == 2
        assert message in outcome.err
        assert outcome.out == ""
        assert "Traceback" not in outcome.err

    haptic = checkpoint(fused, "haptic")
    refuse("short.wav: The trace has 0.90 s of movement", haptic, "haptic=short.wav")
    refuse("has an unknown type", haptic, "haptic=cut.ckpt")
    refuse("was not written by tex_lightning", "checkpoint=cut.ckpt", f"haptic={wav}")
    refuse("is not a file or a list", haptic, "haptic={a:1}")
    refuse("haptic= is not a file or a list", haptic, "haptic=")  # and not the current folder


def test_evaluation_refuses_what_would_flatter_or_mislead(cli, surfaces, fused, tmp_path):
    common = ["task=evaluate", checkpoint(fused, "haptic"), f"data.root={surfaces}"]
    leak = cli(*common, "data=folder", "data.test_fold=4", f"hydra.run.dir={tmp_path}/a")
    assert leak.status == 2
    assert "set data.folds=10 data.test_fold=0" in leak.err
    for label in ("alpha", "beta"):
        source = surfaces / label / "haptic" / f"{label}_4.wav"
        (folder := tmp_path / "copy" / label / "haptic").mkdir(parents=True)
        (folder / "renamed.wav").write_bytes(source.read_bytes())
    copied = ["data=folder", f"data.root={tmp_path}/copy", "data.test_fold=null"]
    copied += [f"hydra.run.dir={tmp_path}/c"]
    outcome = cli("task=evaluate", checkpoint(fused, "haptic"), *copied)
    assert outcome.status == 2
    assert "has trained on 2 of the 2 test recordings, renamed.wav among them" in outcome.err
    (tmp_path / "other" / "delta" / "haptic").mkdir(parents=True)
    (tmp_path / "other" / "alpha" / "haptic").mkdir(parents=True)
    for label in ("alpha", "delta"):
        np.save(tmp_path / "other" / label / "haptic" / "0.npy", np.zeros(30_000))
    other = ["data=folder", f"data.root={tmp_path}/other", f"hydra.run.dir={tmp_path}/b"]
    unknown = cli("task=evaluate", checkpoint(fused, "haptic"), *other)
    assert unknown.status == 2
    assert "does not know the class delta" in unknown.err
