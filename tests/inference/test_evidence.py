"""What every position says lies where the network looked."""

import numpy as np
import pytest
import torch
from conftest import RATE, make_card, make_photo, make_trace
from torch import nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.inference.evidence import classify_with_maps
from tex_lightning.senses.features.spectrogram import movement_start


class Brightness(nn.Module):
    """Bright, dark or neither, by the mean of windows of what is bright less what is dark."""

    def __init__(self, window: tuple[int, int], stride: int) -> None:
        super().__init__()
        self.window_size = self.min_size = window
        self.stride = stride
        self.pool = nn.AvgPool2d(window, stride)

    def features(self, x, level):
        mean = self.pool(self.tell(x))
        return torch.cat([mean, -mean, torch.full_like(mean, -9)], dim=1)

    def tell(self, x):
        return x.mean(dim=1, keepdim=True)

    def output_size(self, height, width):
        sides = zip((height, width), self.window_size, strict=True)
        return tuple((size - window) // self.stride + 1 for size, window in sides)


class Bass(Brightness):
    """Whether in most frames the lower half of the bands is the louder one."""

    def tell(self, x):
        low, high = x[:, :, :25].mean(dim=2), x[:, :, 25:].mean(dim=2)
        sign = (low - high) / (low - high).abs().clamp(min=1e-9)  # which keeps NaN, as layers do
        return sign[:, None].expand(-1, -1, 50, -1)


def with_network(sense: str, network: nn.Module, **changes: object) -> SurfaceClassifier:
    classifier = SurfaceClassifier(make_card(sense, width=0.1, **changes))
    old = classifier.senses[sense]
    new = type(old)(sense, old.modality, old.decoder, old.features, network)
    classifier.senses[sense], classifier.layers[sense] = new, ("fc3", "fc3")
    return classifier.eval()


def halves(across: bool) -> torch.Tensor:
    photo = torch.zeros(300, 420, 3, dtype=torch.uint8)
    (photo if across else photo.transpose(0, 1))[:, 170:] = 255
    return photo


@pytest.mark.parametrize("across", [True, False])
def test_the_border_of_a_photo_in_halves_lies_where_it_is(across):
    classifier = with_network("visual", Brightness((40, 40), 8))
    _, found = classify_with_maps(classifier, {"image": halves(across)})
    labels = found["visual"].label_map()
    assert labels.shape == (300, 420)
    covered = labels[:296, :416]  # the last full windows end there
    assert (covered >= 0).all()
    assert (labels[296:] == -1).all()
    assert (labels[:, 416:] == -1).all()
    lines = covered if across else covered.T
    assert (lines == lines[0]).all()
    (border,) = np.flatnonzero(np.diff(lines[0]))
    assert abs(border + 1 - 170) <= 4  # half a stride
    assert (lines[0][0], lines[0][-1]) == (1, 0)
    coarse = found["visual"].label_map(step=7)
    assert coarse.shape == (43, 60)
    np.testing.assert_array_equal(coarse[:42, :59], labels[3::7, 3::7][:42, :59])


@pytest.mark.parametrize("quiet", [0.0, 0.6])
def test_a_trace_changes_class_when_it_changes(quiet):
    seconds = np.arange(int(6 * RATE)) / RATE
    tones = np.where(seconds < 3.5, np.sin(700 * seconds), np.sin(20_000 * seconds))
    trace = np.where(seconds < quiet, 1e-4, tones).astype(np.float32)
    classifier = with_network("haptic", Bass((50, 20), 4))
    _, found = classify_with_maps(classifier, {"haptic": torch.from_numpy(trace)[None]})
    evidence = found["haptic"]
    (turn,) = np.flatnonzero(np.diff(evidence.labels[0])) + 1
    assert abs(evidence.edges[turn] - 3.5) <= 0.02 + 0.025  # half a stride, half a frame
    assert evidence.labels[0, 0] == 0
    start = movement_start(torch.from_numpy(trace)[None], RATE) / RATE
    assert (start > quiet) == (quiet > 0)
    assert evidence.start == evidence.columns[0, 0] == start
    assert evidence.columns[0, 1] - start == pytest.approx(0.01 * 19 + 0.05)  # 20 frames


@pytest.mark.parametrize("level", ["fc2", "fc3"])
def test_it_is_the_decision_of_classify_and_the_scores_of_each_sense_alone(level):
    torch.manual_seed(1)
    card = make_card("haptic", "visual", level=level, width=0.1)
    classifier = SurfaceClassifier(card).eval()
    nn.init.normal_(classifier.fusion.head.weight)
    nn.init.normal_(classifier.fusion.head.bias)
    given = {
        "haptic": torch.from_numpy(make_trace(0, 0))[None],
        "image": torch.from_numpy(make_photo(1, 0, 300)),
    }
    vote, found = classify_with_maps(classifier, given)
    whole = classifier.classify(**given)
    assert vote.label == whole.label
    assert torch.equal(vote.fragments, whole.fragments)
    assert torch.equal(vote.probabilities, whole.probabilities)
    assert found["visual"].scores.ndim == 3
    if level == "fc2":
        for name, modality in (("haptic", "haptic"), ("visual", "image")):
            alone = classifier.with_senses((name,)).logits(**{modality: given[modality]})
            dense = torch.from_numpy(found[name].scores).flatten(1)
            torch.testing.assert_close(dense, alone, atol=1e-4, rtol=1e-4)
            shares = found[name].probabilities(2)
            torch.testing.assert_close(
                torch.from_numpy(shares).flatten(), alone.double().softmax(0)[2], atol=1e-4, rtol=0
            )
