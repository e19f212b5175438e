"""Recordings of materials never seen, through the command line and in Python."""

import json

import pytest
import soundfile
import torch
from conftest import FEW, RATE, make_photo, make_trace

import tex_lightning as tl
from tex_lightning.classifier.statistics import FeatureStatistics
from tex_lightning.errors import UserError

STRANGE = 7  # a tone of no class


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """A trace of a known class, and one of another."""
    folder = tmp_path_factory.mktemp("recordings")
    for name, kind in (("known", 1), ("strange", STRANGE)):
        soundfile.write(folder / f"{name}.wav", make_trace(kind, 42, 4.0), RATE, subtype="FLOAT")
    return folder


@pytest.mark.parametrize(
    "how",
    [["task=predict"], ["task=predict", "decision=sequential"], ["task=stream", "stream.window=2"]],
    ids=["predict", "sequential", "window"],
)
def test_what_is_unlike_every_class_is_called_unknown(cli, bands, recordings, how):
    common = [*how, f"checkpoint={bands}", "decision.unknown=0.05"]

    def last(name):
        outcome = cli(*common, f"haptic={recordings}/{name}.wav")
        assert outcome.status == 0, outcome.err
        return json.loads(outcome.out.splitlines()[-1])

    known, strange = last("known"), last("strange")
    assert (known["label"], known["rejected"]) == ("beta", False)
    assert (strange["label"], strange["rejected"]) == ("unknown", True)
    assert strange["novelty"] > known["novelty"]


def test_novelty_in_python_is_that_of_the_prediction(bands, recordings, caplog):
    strange = recordings / "strange.wav"
    model = tl.load(bands, "decision.unknown=0.05")
    prediction = model.predict(haptic=strange)
    trace = torch.from_numpy(make_trace(STRANGE, 42, 4.0))[None]
    novelty = model.classifier.classify(haptic=trace).novelty
    assert prediction.novelty == pytest.approx(novelty, rel=1e-3)
    assert model.card.unknown_above < novelty
    assert len(model.card.known_novelties) == 27  # 24 left out in turn, 3 of the validation fold
    plain = tl.load(bands, "decision.unknown=0").predict(haptic=strange).to_dict()
    assert plain["label"] in ("alpha", "beta", "gamma")
    assert not {"rejected", "novelty"} & set(plain)


def test_crossval_measures_held_out_classes_and_never_trains_on_them(cli, surfaces, tmp_path):
    outcome = cli(
        "task=crossval", *FEW, "data=folder", f"data.root={surfaces}",
        "data.hold_out=[gamma]", "crossval.only=[0,1]", "decision.unknown=0.05",
        f"hydra.run.dir={tmp_path}",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    haptic = json.loads((tmp_path / "results.json").read_text())["networks"]["haptic"]
    assert tl.load(haptic["checkpoint"]).card.classes == ["alpha", "beta"]
    unknown = haptic["unknown"]
    assert (unknown["classes"], unknown["novelty_auroc"]) == (["gamma"], 1)
    assert unknown["accepted_unknown"]["of"] == 2
    assert unknown["false_rejections"]["of"] == haptic["test_samples"] == 4


def test_a_missing_sense_leaves_the_novelty_of_the_others(untrained, tmp_path):
    """The statistics are made up: what counts is who adds what."""
    content = torch.load(untrained / "checkpoints" / "fusion.ckpt", weights_only=True)
    model = tl.load(untrained)
    for name, size in zip(model.card.sense_names, model.classifier.fusion.sizes, strict=True):
        torch.manual_seed(0)
        statistics = FeatureStatistics.of(torch.rand(9, size), torch.arange(9) % 3, 3)
        for key, value in statistics.state_dict().items():
            content["state_dict"][f"classifier.statistics.{name}.{key}"] = value
    novelties = {"haptic": [0.0] * 30, "visual": [1e9] * 30}
    content["hyper_parameters"]["card"]["calibration"] = {"novelties": novelties}
    path = tmp_path / "fusion.ckpt"
    torch.save(content, path)
    both = tl.load(path, "decision.unknown=0.05")
    trace, photo = make_trace(0, 0), make_photo(0, 0)
    joint, alone = both.predict(haptic=trace, image=photo), both.predict(haptic=trace)
    assert joint.rejected is False
    assert (alone.label, alone.rejected) == ("unknown", True)
    parts = [alone.novelty, both.predict(image=photo).novelty]
    assert joint.novelty == pytest.approx(sum(parts), rel=1e-4)


def test_checkpoints_that_cannot_tell_are_refused(untrained, bands, tmp_path):
    with pytest.raises(UserError, match="needs statistics"):
        tl.load(untrained, "decision.unknown=0.05")
    content = torch.load(bands / "checkpoints" / "haptic.ckpt", weights_only=True)
    card = content["hyper_parameters"]["card"]
    for change, message in (
        ({"calibration": {}}, "validation fold"),
        ({"classes": ["alpha", "beta", "unknown"]}, "a class named unknown"),
    ):
        content["hyper_parameters"]["card"] = card | change
        torch.save(content, tmp_path / "haptic.ckpt")
        with pytest.raises(UserError, match=message):
            tl.load(tmp_path / "haptic.ckpt", "decision.unknown=0.05")
