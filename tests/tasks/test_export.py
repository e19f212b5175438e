"""``task=export`` through the command line, and its files without the package that wrote them."""

import json
import sys
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
import torch
from conftest import make_card, make_trace, save_checkpoint
from random_fusion import PAIRS

import tex_lightning as tl
from tex_lightning.evaluation.outcomes import wilson_interval
from tex_lightning.export import files as export
from tex_lightning.export import onnx_file
from tex_lightning.export.graph import ClassifierGraph


def results(folder: Path) -> dict:
    return json.loads((folder / "export.json").read_text())


def test_export_json_says_what_was_compared(exported):
    _, file = exported
    found = results(file.parent)
    assert (found["format"], found["file"], found["recordings"]) == ("onnx", "fusion.onnx", 3)
    assert found["same_labels"] == 3
    assert found["score_difference"] < 1e-5
    assert found["bytes"] == file.stat().st_size
    assert found["latency_ms"] > 0


@pytest.mark.parametrize(("axes", "side"), [(3, 602)])
def test_it_classifies_sizes_it_was_not_traced_with(exported, axes, side):
    checkpoint, file = exported
    session = onnxruntime.InferenceSession(file)
    classifier = tl.load(checkpoint).classifier
    trace = np.stack([make_trace(axis, 0, 2.9) for axis in range(axes)])
    photo = np.random.default_rng(0).integers(256, size=(side, side + 9, 3), dtype=np.uint8)
    names = [each.name for each in session.get_outputs()]
    outputs = dict(zip(names, session.run(None, {"haptic": trace, "image": photo}), strict=True))
    senses = classifier.senses
    halved, _ = senses["visual"].decode_input(photo, {})
    for name, given in (("haptic", torch.from_numpy(trace)), ("visual", halved)):
        expected = classifier.partial_logits(name, given).detach().numpy()
        found = outputs[f"{name}_scores"]
        np.testing.assert_allclose(found.reshape(3, -1), expected, atol=1e-4)
    spectrogram = senses["haptic"](torch.from_numpy(trace))[0, 0]
    np.testing.assert_allclose(outputs["haptic_input"], spectrogram, atol=1e-3)
    assert outputs["scores"].shape == (3, PAIRS)  # drawn at the seed of the card
    assert outputs["shares"].sum() == pytest.approx(1)
    assert outputs["probabilities"].argmax() in range(3)


def test_a_model_card(cli, bands, tmp_path):
    assert not cli(
        "task=export", f"checkpoint={bands}", "export.format=card", f"export.out={tmp_path}",
    ).status  # fmt: skip
    text = (tmp_path / "MODEL_CARD.md").read_text()
    assert text.startswith("---\nlibrary_name: tex_lightning\n")
    results = json.loads((bands / "results.json").read_text())
    entry = results["networks"]["haptic"]
    low, high = (100 * each for each in wilson_interval(entry["correct"], entry["test_samples"]))
    assert f"| correct labels | {entry['correct']} of {entry['test_samples']}: " in text
    assert f"(Wilson 95 %: {low:.1f} to {high:.1f}) |" in text
    assert "Classes: alpha, beta, gamma" in text
    assert "None were used" in text
    assert "random" not in text  # it is fitted in closed form
    assert results["weights"] == {"haptic": "none"}


def test_what_no_export_wrote_is_not_overwritten(cli, untrained, tmp_path):
    order = ("task=export", f"checkpoint={untrained}", "export.format=card")
    card, record = tmp_path / "MODEL_CARD.md", tmp_path / "export.json"

    def refused(path, content):
        outcome = cli(*order, f"export.out={tmp_path}")
        assert outcome.status == 2
        assert f"{path} was not written by an export" in outcome.err
        assert path.read_text() == content

    card.write_text("my own")
    refused(card, "my own")
    assert not record.exists()
    card.unlink()
    for _ in range(2):  # its own file it writes again
        assert not cli(*order, f"export.out={tmp_path}").status
    card.unlink()
    record.write_text('{"mine": 1}')
    refused(record, '{"mine": 1}')
    assert not card.exists()


@pytest.mark.parametrize("format", ["card", "onnx"])
def test_an_export_that_was_killed_does_not_keep_out_the_next(
    cli, untrained, tmp_path, monkeypatch, format
):
    order = "task=export", f"checkpoint={untrained}", f"export.format={format}"
    said = {"same_labels": 3, "recordings": 3, "score_difference": 0.0}
    monkeypatch.setattr(export, "make_onnx", lambda classifier: None)
    monkeypatch.setattr(export, "onnx_runner", lambda model: None)
    monkeypatch.setattr(export, "compare", lambda *_: dict(said))
    monkeypatch.setattr(export, "require_agreement", lambda *_: None)
    monkeypatch.setattr(export, "onnx_bytes", lambda model: b"onnx")
    with monkeypatch.context() as killed:  # once the file is there
        killed.setattr(export, "say", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            cli(*order, f"export.out={tmp_path}")
    again = cli(*order, f"export.out={tmp_path}")
    assert again.status == 0, again.err
    assert len(results(tmp_path)["files"]) == 2


def test_a_file_that_says_something_else_is_not_written(cli, untrained, tmp_path, monkeypatch):
    wrong = {"scores": np.zeros((3, 50)), "label": -1, "probabilities": np.zeros(3)}
    monkeypatch.setattr(export, "make_onnx", lambda classifier: None)
    monkeypatch.setattr(export, "onnx_runner", lambda model: lambda inputs: wrong)
    outcome = cli("task=export", f"checkpoint={untrained}", f"export.out={tmp_path}/out")
    assert outcome.status == 2
    assert "another label for 12 of 12 recordings" in outcome.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [({"resize": 256}, "resized to 256 pixels"), ({}, "needs onnx, which is not installed")],
)
def test_what_cannot_be_exported(cli, tmp_path, monkeypatch, changes, sentence):
    if not changes:
        monkeypatch.setitem(sys.modules, "onnx", None)
    monkeypatch.setattr(onnx_file, "trace", ClassifierGraph)  # as far as it takes to refuse
    checkpoint = save_checkpoint(
        make_card("visual", width=0.1, **changes), tmp_path / "visual.ckpt"
    )
    outcome = cli("task=export", f"checkpoint={checkpoint}", f"export.out={tmp_path}")
    assert outcome.status == 2
    assert sentence in outcome.err
    assert not (tmp_path / "visual.onnx").exists()


@pytest.mark.slow
def test_band_proportions_are_exported(cli, bands, tmp_path):
    """What mirrors a short recording took a remainder that ONNX cannot translate."""
    outcome = cli(
        "task=export", f"checkpoint={bands}", f"export.out={tmp_path}", "export.check=3",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    assert "3 of 3 labels equal those of the checkpoint" in outcome.err
    assert (tmp_path / "haptic.onnx").is_file()
