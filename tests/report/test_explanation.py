"""The picture of why, and what it says."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from conftest import make_card, make_photo, make_trace
from torch import nn

import tex_lightning as tl
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.data.quality import Quality
from tex_lightning.errors import UserError
from tex_lightning.inference.evidence import Evidence, classify_with_maps, equal_parts
from tex_lightning.inference.prediction import describe
from tex_lightning.report.explanation import Explanation


def photo_evidence(labels: np.ndarray, classes: int) -> Evidence:
    """A photo whose positions say the labels, all as surely."""
    scores = 2.0 * (np.arange(classes)[:, None, None] == labels)
    rows, columns = (equal_parts(count, 0, 300) for count in labels.shape)
    pixels = np.zeros((300, 300, 3), np.uint8)
    return Evidence("visual", scores, rows, columns, 1.0, pixels)


def explanation(*evidence: Evidence, label: int = 0) -> Explanation:
    classes = [f"class {index}" for index in range(len(evidence[0].scores))]
    prediction = tl.Prediction(
        classes[label], None, 0.5, 0.5, ({"label": classes[label], "share": 0.5},), 1, 1.0, (), (),
        1.0,
    )  # fmt: skip
    senses = {each.name: each for each in evidence}
    return Explanation.of(prediction, classes, label, senses)


def legend(found: Explanation) -> dict[str, str]:
    (entries,) = [each.legends[-1] for each in found.figure().subfigs if each.legends]
    patches = zip(entries.get_texts(), entries.get_patches(), strict=True)
    return {text.get_text(): patch.get_facecolor() for text, patch in patches}


def test_only_classes_that_occur_are_coloured_and_named():
    labels = np.array([[90, 90, 7], [90, 3, 7]])
    named = legend(explanation(photo_evidence(labels, 108), label=7))
    assert list(named) == ["class 7", "class 90", "class 3"]  # the winner, then by positions
    assert len(set(named.values())) == 3


@pytest.fixture(scope="module")
def fused() -> Explanation:
    torch.manual_seed(1)
    classifier = SurfaceClassifier(make_card("haptic", "visual", width=0.1)).eval()
    nn.init.normal_(classifier.fusion.head.weight)
    given = {
        "haptic": torch.from_numpy(make_trace(0, 0))[None],
        "image": torch.from_numpy(make_photo(1, 0, 300)),
    }
    vote, senses = classify_with_maps(classifier, given)
    prediction = describe(
        vote, classifier.card, Quality(("It hums.",)), 3, 0.0, ("haptic", "image")
    )
    return Explanation.of(prediction, classifier.card.classes, vote.label, senses)


def test_what_senses_contribute_adds_up_to_the_mean_of_all_pairs(fused):
    haptic, visual = (each.scores.reshape(3, -1) for each in fused.senses.values())
    pairs = (haptic[:, :, None] + visual[:, None, :]).reshape(3, -1).mean(axis=1)
    best = np.delete(pairs, fused.label).max()
    assert pairs[fused.rival] == best
    total = sum(fused.contributions.values())
    assert total == pytest.approx(pairs[fused.label] - best, rel=1e-4)


def test_it_is_drawn_over_seconds_hertz_and_pixels(fused):
    figure = fused.figure("a.wav, b.jpg")
    title = figure.get_suptitle().splitlines()
    assert title[0] == "a.wav, b.jpg"
    assert title[1].startswith(fused.classes[fused.label])
    assert title[2] == "It hums."
    signal = figure.subfigs[0]
    spectrogram, strip, line = signal.axes
    assert {axes.get_xlim() for axes in signal.axes} == {(0, 2.4)}
    assert (spectrogram.get_ylabel(), line.get_xlabel()) == ("Hz", "s")
    centres = fused.senses["haptic"].columns.mean(axis=1)
    np.testing.assert_allclose(line.lines[0].get_xdata(), centres.clip(0, 2.4))
    covered = [(bar.get_x(), bar.get_x() + bar.get_width()) for bar in strip.patches]
    assert covered[0][0] == 0
    assert covered[-1][1] == pytest.approx(2.4)
    assert all(one[1] == other[0] for one, other in pairwise(covered))


def test_a_rejected_sample_is_drawn_and_what_cannot_be_written_is_said(fused, tmp_path):
    rejected = replace(fused, prediction=replace(fused.prediction, rejected=True, label=None))
    name = fused.classes[fused.label]
    assert rejected.title.startswith(f"rejected, most like {name}: confidence")
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match="Cannot write"):
        fused.save(tmp_path / "file" / "why.png")
