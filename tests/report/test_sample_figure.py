"""Figures of misclassified test samples."""

import pytest
import torch
from conftest import make_card, make_photo, make_trace
from torch import nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.core.files import read_rows
from tex_lightning.studies.evaluate_checkpoint import sample_figure


class Sides(nn.Module):
    """Class b on the left and in the beginning, class c elsewhere."""

    def features(self, x, level):
        columns = torch.arange(10).expand(len(x), 1, 4 if x.shape[1] == 3 else 1, 10)
        return torch.cat([columns < 0, columns < 4, columns >= 4], dim=1).float()


def classifier_of(sense: str) -> SurfaceClassifier:
    classifier = SurfaceClassifier(make_card(sense, classes=["a", "b", "c"], width=0.1))
    old = classifier.senses[sense]
    new = type(old)(sense, old.modality, old.decoder, old.features, Sides())
    classifier.senses[sense], classifier.layers[sense] = new, ("fc3", "fc3")
    return classifier.eval()


@pytest.mark.parametrize("sense", ["haptic", "visual"])
def test_colours_lie_where_the_positions_do(sense):
    trace, photo = torch.from_numpy(make_trace(0, 0))[None], torch.from_numpy(make_photo(1, 0, 300))
    recordings = {"haptic": trace, "image": photo}
    figure = sample_figure(classifier_of(sense), recordings, "a taken for c")
    (part,) = figure.subfigs
    colours = part.axes[1].images[-1]
    if sense == "haptic":
        assert {axes.get_xlim() for axes in part.axes} == {(0, 2.4)}
        assert colours.get_extent()[1] == 2.4
    else:
        assert colours.get_extent() == [0, 300, 300, 0]
    row = colours.get_array()[0].tolist()
    assert row == row[:1] * 4 + row[-1:] * 6
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["c", "b"]  # the most frequent first
    assert figure.get_suptitle() == "a taken for c"


def test_a_run_draws_its_worst_sample(fused):
    lines = read_rows(fused / "predictions" / "fusion.csv")
    wrong = any(line["label"] != line["predicted"] for line in lines)
    assert (fused / "figures" / "fusion_wrong_1.png").is_file() == wrong
    assert not [*fused.glob("figures/*_wrong_2.png"), *fused.glob("figures/haptic_wrong_*")]
