"""What features and networks of a user must give, and what is said where they do not."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from conftest import make_card
from torch import nn

from tex_lightning.branches.contract import PartFault, check_gradient, is_own
from tex_lightning.branches.photo import PhotoBranch
from tex_lightning.branches.signal import SignalBranch
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.data.decode import PhotoDecoder, SignalDecoder
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError
from tex_lightning.networks.trunks.alexnet import CaffeAlexNet
from tex_lightning.networks.visualnet import VisualNet
from tex_lightning.runs.usable import find_unusable, try_parts

RATE = 1000.0


def failing(_):
    raise ValueError("boom of features")


class Means(nn.Module):
    """Means of ten samples (1, 1, frames), then what spoils them."""

    def __init__(self, spoil=lambda x: x):
        super().__init__()
        self.spoil = spoil

    def forward(self, signal):
        return self.spoil(signal[:1].unfold(-1, 10, 10).mean(-1)[None])


class Net(nn.Module):
    """Scores of five frames, then what spoils them."""

    def __init__(self, spoil=lambda x: x, classes=2, kernel=1):
        super().__init__()
        self.spoil = spoil
        self.hidden = nn.Conv1d(1, 4, 5)
        self.score_layer = nn.Conv1d(4, classes, kernel)

    def features(self, x, level):
        hidden = self.hidden(x)
        return hidden if level == "fc2" else self.spoil(self.score_layer(hidden))


class Blind(Net):
    """Gives scores at every level."""

    def features(self, x, level):
        return super().features(x, "fc3")


def own(features=None, network=None) -> SignalBranch:
    parts = features or Means(), network or Net()
    return SignalBranch("touch", "force", SignalDecoder(RATE, RATE), *parts)


@pytest.fixture
def world(tmp_path) -> tuple[Recordings, Store]:
    """Four recordings of a force, the last too short for any network here."""
    rows = []
    for number, samples in enumerate((900, 1200, 1000, 20)):
        path = tmp_path / f"{number}.npy"
        np.save(path, np.random.default_rng(number).standard_normal(samples))
        rows.append(Recording("ab"[number % 2], "force", path, number))
    return Recordings(tuple(rows)), Store(tmp_path, {"force": own().decoder})


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (failing, r"raised ValueError: boom of features; correct Means\.$"),
        (lambda _: None, "returned NoneType, and a floating-point tensor of shape .1, ..., frames"),
        (lambda x: x.numpy(), "returned ndarray"),
        (lambda x: (x,), "returned tuple"),
        (lambda x: x.repeat(2, 1, 1), r"returned a tensor of float32 of shape \(2, 1, 90\)"),
        (lambda x: x[0, 0], r"returned a tensor of float32 of shape \(90,\)"),
        (lambda x: x.long(), "returned a tensor of int64"),
    ],
)
def test_a_fault_of_features_is_not_one_of_the_recordings(world, spoil, said):
    with pytest.raises(PartFault, match=f"^Means of touch {said}"):
        find_unusable(*world, [own(Means(spoil))], skip_bad=True)


def boom(_):
    raise RuntimeError("boom of a network")


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (boom, r"raised RuntimeError on what Means gives: boom of a network; correct Net or Means"),
        (lambda x: {}["k"], "raised KeyError on what Means gives: 'k'"),
        (lambda _: None, r"returned NoneType, and a .* tensor of shape \(1, D, \*positions\)"),
        (lambda x: x.mean(-1), r"returned a tensor of float32 of shape \(1, 2\)"),
        (lambda x: x[0], r"returned a tensor of float32 of shape \(2, 86\)"),
        (lambda x: (x,), "returned tuple"),
        (lambda x: x.long(), "returned a tensor of int64"),
    ],
)
def test_a_fault_of_a_network_is_not_one_of_the_recordings(world, spoil, said):
    with pytest.raises(PartFault, match=f"^Net of touch {said}"):
        find_unusable(*world, [own(network=Net(spoil))], skip_bad=True)


def test_a_recording_that_is_too_short_is_still_one_that_cannot_be_used(world):
    (short,) = find_unusable(*world, [own()], skip_bad=True)
    assert short.recording.group == 3
    assert "Net makes nothing of 0.02 s of a force recording (Calculated padded" in short.reason
    first = Recordings(world[0].rows[::-1]), world[1]
    assert [each.recording.group for each in find_unusable(*first, [own()], skip_bad=True)] == [3]


@pytest.mark.parametrize(
    ("network", "said"),
    [
        (Net(classes=3), "Net of touch gives 3 scores at each position, and there are 2 classes"),
        (Net(lambda x: x.mT), "Net of touch gives 86 scores"),
        (Blind(), "score_layer of Blind of touch turns 4 features .* gives 2 features, for 2"),
    ],
)
def test_the_trial_counts_classes(world, network, said):
    with pytest.raises(PartFault, match=said):
        try_parts(own(network=network), *world, 2)
    try_parts(own(), *world, 2)
    try_parts(own(network=Net(kernel=3)), *world, 2)  # is fused on the scores


def test_doubles_are_cast_in_training_as_in_a_prediction():
    branch = own(Means(lambda x: x.double()))
    assert branch.positions(torch.ones(1, 100), "fc3").dtype == torch.float32
    read = branch.read(torch.ones(1, 100))
    assert read.dtype == torch.float64
    pieces = {"input": read}
    assert branch.as_weights(branch.training_input(pieces, 10)).dtype == torch.float32


def test_a_network_of_one_axis_that_declares_its_geometry_is_not_tiled():
    class Declared(Net):
        window_size = min_size = (1, 5)
        stride = 1

        def output_size(self, height, width):
            return 1, width - 4

    branch = replace(own(network=Declared()), tile=10)
    assert branch.positions(torch.ones(1, 1000), "fc3").shape == (2, 96)


def test_features_with_a_gradient_are_kept_without(tmp_path, world):
    branch = own(Means(lambda x: x.requires_grad_()))
    fit = {"perturb": [], "perturbed_copies": 0}
    rows = world[0].rows[:2]
    bank = branch.bank(rows, world[1], fit, size=6, seed=0, learn=True)
    assert not bank.inputs[0].requires_grad


def test_features_of_ones_own_may_be_what_makes_nan(world):
    recording = torch.ones(1, 100)
    with pytest.raises(UserError, match="or Means makes them; repair the recording or that class"):
        own(Means(lambda x: x / 0))(recording)
    unscaled = SurfaceClassifier(make_card("haptic", width=0.1)).branch("haptic")
    with pytest.raises(UserError, match=r"to square; repair the recording\.$"):
        unscaled(torch.full((1, 24_000), torch.inf))


class Trunk(CaffeAlexNet):
    """A user's, of which a fault is made."""

    def forward(self, x):
        raise RuntimeError("boom of a trunk")


def test_a_trunk_of_ones_own_is_named_within_visualnet():
    network = VisualNet(2, Trunk(width=0.1, norm="batch"))
    assert not is_own(network)
    assert is_own(VisualNet(2, CaffeAlexNet(width=0.1, norm="batch")))
    features = SurfaceClassifier(make_card("visual", width=0.1)).branch("visual").features
    branch = PhotoBranch("gloss", "gloss", PhotoDecoder(), features, network.eval())
    said = "^Trunk of gloss raised RuntimeError: boom of a trunk; correct Trunk.$"
    with pytest.raises(PartFault, match=said):
        branch.positions(torch.zeros(300, 300, 3, dtype=torch.uint8), "fc3")


def test_scores_without_a_gradient_cannot_be_trained_on():
    with pytest.raises(PartFault, match=r"^The scores of Net of touch carry no gradient, so"):
        check_gradient(Net(), "touch", Net().features(torch.ones(1, 1, 9), "fc3").detach())
    check_gradient(Net(), "touch", Net().features(torch.ones(1, 1, 9), "fc3"))


def test_faults_of_this_package_keep_their_traceback(monkeypatch):
    branch = SurfaceClassifier(make_card("haptic", width=0.1)).eval().branch("haptic")
    assert branch.is_own
    monkeypatch.setattr(type(branch.features), "forward", failing)
    with pytest.raises(TypeError):
        branch.positions(torch.randn(1, 24_000), "fc3")


class Grey(nn.Module):
    """Grey photos (batch, 1, height, width)."""

    def forward(self, photos):
        assert photos.dtype == torch.uint8
        return photos.float().mean(1, keepdim=True) / 255


class Stripes(nn.Module):
    def __init__(self, classes=2):
        super().__init__()
        self.layer = nn.Conv2d(1, classes, 40, 20)

    def features(self, x, level):
        return self.layer(x)


def photo_branch(features: nn.Module) -> PhotoBranch:
    return PhotoBranch("gloss", "gloss", PhotoDecoder(), features, Stripes())


def test_photos_are_turned_before_any_features():
    torch.manual_seed(0)
    crop = torch.randint(0, 256, (3, 3, 60, 60), dtype=torch.uint8)
    pieces = {"crop": crop, "degrees": torch.tensor([0.0, 90.0, 30.0])}
    found = photo_branch(Grey()).training_input(pieces, 40)
    assert found.shape == (3, 1, 40, 40)
    middle = Grey()(crop[:, :, 10:50, 10:50])
    torch.testing.assert_close(found[0], middle[0])
    torch.testing.assert_close(found[1], middle[1].rot90(1, (1, 2)))
    # as this package's own, but for the rounding to 8 bits
    visual = SurfaceClassifier(make_card("visual", width=0.1)).branch("visual")
    turned = visual.training_input(pieces, 40)
    features = visual.features
    grey = (turned * features.std + features.mean).mean(1, keepdim=True)
    torch.testing.assert_close(found, grey, atol=0.6 / 255, rtol=0)


def test_their_augmentation_is_one_of_photos():
    crop = torch.randint(0, 256, (2, 3, 40, 40), dtype=torch.uint8)
    pieces = {"crop": crop, "degrees": torch.zeros(2)}
    branch = photo_branch(Grey())
    found = branch.training_input(pieces, 40, lambda photos: 1 - photos)
    torch.testing.assert_close(found, Grey()(255 - crop))


def test_photos_that_are_too_small_are_told_from_faults():
    branch = photo_branch(Grey())
    with pytest.raises(UserError, match="Stripes makes nothing of") as caught:
        branch.check(np.zeros((39, 200, 3), np.uint8))
    assert not isinstance(caught.value, PartFault)
    with pytest.raises(PartFault, match="Stripes of gloss raised RuntimeError on what Identity"):
        photo_branch(type("Identity", (Grey,), {"forward": lambda _, x: x.float()})()).check(
            np.zeros((39, 200, 3), np.uint8)
        )
