"""``check_part``: the parts of the package pass, and what breaks a contract is told."""

import doctest
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import kornia.augmentation
import numpy as np
import own_networks
import pytest
import torch
from conftest import configured_classes, make_photo, make_trace
from haptic_sets import write_cluster, write_tum
from own_baselines import Loudness
from own_parts import Frames, SpoiltNet
from torch import nn

import tex_lightning as tl
from tex_lightning import testing
from tex_lightning.baselines.base import Baseline
from tex_lightning.config import CONF
from tex_lightning.config.check import read_config
from tex_lightning.config.composition import compose_config
from tex_lightning.config.instantiation import build, find_class
from tex_lightning.core.contract import fault_of
from tex_lightning.data.manifest import write_manifest
from tex_lightning.data.readers.folder import FolderReader, ManifestReader
from tex_lightning.data.readers.published import PatternReader, TumReader
from tex_lightning.data.readers.synthetic import SyntheticReader
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.errors import UserError
from tex_lightning.networks.linear import LinearNet
from tex_lightning.networks.trunks import Trunk
from tex_lightning.perturbations import traces
from tex_lightning.perturbations.table import perturbations
from tex_lightning.senses.features.image import ImageFeatures
from tex_lightning.senses.features.proportions import BandProportions
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures
from tex_lightning.senses.making import make_sense
from tex_lightning.senses.photo import PhotoSense
from tex_lightning.senses.signal import SignalSense
from tex_lightning.testing import check_part

RATE = 1000
# Settings that make them quick, and those that have no value by default
BASELINES = {
    "acnn": {"fragment_seconds": 0.4, "steps": 3, "patches": 300, "batch_size": 9},
    "alexnet_fv": {"scales": [-1.0], "components": 2},
    "vgg_m_fv": {"scales": [-1.0], "components": 2},
    "lbp": {},
    "mfcc_gmm": {"components": 2},
    "mfcc_nb": {},
    "minirocket": {"kernels": 84},
}
PROPORTIONS = {
    "windows": [0.032, 0.256, 0.93], "bands_per_octave": [6, 6, 12], "thresholds": 5,
    "fragment_seconds": 0.5, "levels": None, "sampling_rate": RATE, "skip_impact": True,
}  # fmt: skip


def sense(name: str, *, small: bool = True) -> Any:
    """A sense of the package, of a tenth of its width."""
    model = read_config(compose_config([f"model={name}", "data.half_scale=false"])).model
    (name,) = model.senses
    node = model.sense(name).node
    return make_sense(name, {**node, "width": 0.1} if small and "width" in node else node, 3)


def baseline(name: str) -> Baseline:
    model = read_config(compose_config([f"model={name}"])).model
    return build("model.baseline", {**model.baseline, **BASELINES[name]})


def named(base: type) -> set[type]:
    """All classes of a kind that the configuration puts into a card."""
    classes = {find_class("", {"_target_": name}) for name in configured_classes()}
    return {cls for cls in classes if issubclass(cls, base)}


def test_the_example_runs():
    assert doctest.testmod(testing) == (0, 3)  # failures, lines


@pytest.mark.parametrize("network", [tl.HapticNet, tl.VisualNet])
def test_the_networks_keep_their_contract(network):
    assert check_part(network) == "network"


def test_a_network_that_is_fitted_at_once_keeps_its_contract():
    features = BandProportions(**PROPORTIONS)
    x = features(torch.from_numpy(make_trace(0, 0))[None, ::10])
    network = partial(LinearNet, bands=features.bands, blocks=features.blocks, bins=features.bins)
    assert check_part(network, example=x) == "network"


USERS = [  # orders of layers, which matter to the accelerated copy, in the slow suite alone
    pytest.param(node, id="".join(node.values()), marks=[pytest.mark.slow] * ("shape" in node))
    for node in own_networks.NODES
]


@pytest.mark.parametrize("node", USERS)
def test_networks_as_users_bring_them_pass(node):
    network = build("model.haptic.network", {**node, "classes": 3})
    assert check_part(network) == "network"


@pytest.mark.parametrize("trunk", sorted(named(Trunk), key=lambda cls: cls.__name__))
def test_the_trunks_keep_their_contract(trunk):
    assert check_part(trunk) == "trunk"


@pytest.mark.parametrize("name", ["haptic", "visual", "sound", "band_proportions"])
def test_the_senses_and_their_features_keep_their_contract(name):
    whole = sense(name)
    assert check_part(whole, rate=2000) == "sense"
    assert check_part(whole.features, rate=getattr(whole.decoder, "sampling_rate", RATE)) == (
        "features"
    )


def test_every_class_that_a_card_may_name_is_in_these_tests():
    tried = {tl.HapticNet, tl.VisualNet, LinearNet, *named(Trunk), SignalSense, PhotoSense}
    tried |= {ImageFeatures, BandProportions, SpectrogramFeatures}
    tried |= {type(baseline(name)) for name in BASELINES}
    assert named(object) == tried
    assert {*BASELINES} == {
        path.stem for path in CONF.glob("model/*.yaml") if "baseline:" in path.read_text()
    } - {"base"}


@pytest.mark.parametrize("cls", [SignalSense, PhotoSense])
def test_the_senses_pass_by_their_class(cls):
    assert check_part(cls) == "sense"


@pytest.mark.parametrize("name", BASELINES)
def test_the_baselines_keep_their_contract(name):
    assert check_part(baseline(name), rate=8000) == "baseline"


@pytest.mark.parametrize("name", perturbations())
def test_the_perturbations_keep_their_contract(name):
    assert check_part(perturbations()[name]) == "perturbation"


@pytest.mark.parametrize(
    "augmentation",
    [
        kornia.augmentation.RandomHorizontalFlip(p=1.0),
        kornia.augmentation.ColorJitter(0.1, 0.1, 0.1, 0.1),
        lambda patches: patches.flip(-1),
        nn.AvgPool2d(3, 1, 1),
    ],
    ids=["flip", "jitter", "function", "module"],
)
def test_augmentations_keep_their_contract(augmentation):
    assert check_part(augmentation, kind="augmentation") == "augmentation"


def test_the_kind_of_a_function_follows_from_its_arguments():
    assert check_part(lambda patches: patches.flip(-1)) == "augmentation"
    assert check_part(lambda recording, value, scene: recording * value) == "perturbation"
    assert check_part(lambda classes: SpoiltFrames(classes)) == "network"
    assert check_part(traces.white_noise, values=[30, 0]) == "perturbation"


class SpoiltFrames(SpoiltNet):
    """The network of ``own_parts``, on spectrograms."""

    def features(self, x: torch.Tensor, level: str) -> Any:
        return super().features(x.mean(2), level)


@pytest.mark.parametrize(
    ("part", "said"),
    [
        (Frames("none"), "features (Frames) returned a NoneType for a batch of 1"),
        (Frames("array"), "returned a ndarray of float32 of shape (1, 1, 400)"),
        (Frames("batch"), "returned a Tensor of float32 of shape (3, 1, 400) for a batch of 1"),
        (Frames("nan"), "or Frames makes them; repair the recording or that class"),
        (Frames("outside"), "features (Frames) gives other outputs once it is saved and loaded"),
        (SpoiltFrames(3, "none"), "network (SpoiltFrames) returned a NoneType for a batch of 2"),
        (SpoiltFrames(3, "flat"), "returned a Tensor of float32 of shape (2, 3) for a batch"),
        (SpoiltFrames(3, "nan"), "network (SpoiltFrames) gave NaN or infinity"),
        (SpoiltFrames(3, "detached"), "gave scores without a gradient, so nothing can be trained"),
        (SpoiltFrames(3, "outside"), "gives other outputs once it is saved and loaded"),
        (SpoiltFrames(3, more=1), "gave 4 scores at each position, and there are 3 classes"),
        (SpoiltFrames(2), "gave 2 scores at each position, and there are 3 classes"),
    ],
)
def test_modules_that_break_their_contract(part, said):
    with pytest.raises(UserError) as caught:
        check_part(part, rate=RATE)
    assert said in str(caught.value)


class Drawn(nn.Module):
    """Features with a projection that no checkpoint holds."""

    def __init__(self, rows: int = 4, kept: bool = False) -> None:
        super().__init__()
        projection = torch.randn(rows, 10)
        if kept:
            self.register_buffer("projection", projection)
        else:
            self.projection = projection

    def forward(self, signal):
        return (self.projection @ signal[0].unfold(-1, 10, 10).T)[None]


def test_values_that_a_constructor_draws_have_to_be_kept():
    for part in (Drawn(), Drawn, partial(Drawn, rows=2), Drawn(rows=2)):
        with pytest.raises(UserError, match="gives other outputs once it is saved and loaded"):
            check_part(part, rate=RATE)
    for part in (Drawn(kept=True), partial(Drawn, kept=True)):
        assert check_part(part, rate=RATE) == "features"


class Tinted(nn.Module):
    """Features of photos that could be an augmentation, with a colour that no checkpoint holds."""

    def __init__(self) -> None:
        super().__init__()
        self.colour = torch.rand(3, 1, 1)

    def forward(self, photos):
        return photos * self.colour


def test_a_part_that_forgets_what_it_drew_is_no_augmentation_instead():
    with pytest.raises(UserError, match="gives other outputs once it is saved and loaded"):
        check_part(Tinted, example=make_photo(0, 0))


class Scaled(nn.Module):
    """Features whose constant follows from an argument, which the card keeps."""

    def __init__(self, gain: float = 1.0) -> None:
        super().__init__()
        self.gain = torch.tensor(gain)

    def forward(self, signal):
        return self.gain * signal[:1].unfold(-1, 10, 10).mean(-1)[None]


def test_constants_of_arguments_need_not_be_kept():
    assert check_part(Scaled(2.0), rate=RATE) == "features"


class NoLevel(SpoiltFrames):
    def features(self, x):
        return super().features(x, "fc3")


class NoFeatures(nn.Module):
    def forward(self, x, y):
        return x + y


class TwoArguments(nn.Module):
    def forward(self, signal, rate):
        return signal[:1][None]


def test_methods_that_cannot_be_called_are_told_with_what_they_get():
    said = "network (NoLevel) has features, which takes x, where it gets x, level; a network has"
    with pytest.raises(UserError) as caught:
        check_part(NoLevel(3))
    assert said in str(caught.value)
    with pytest.raises(UserError, match="takes signal, rate, where it gets signal; features map"):
        check_part(TwoArguments())
    with pytest.raises(UserError, match=r"has no method features\(x, level\)"):
        check_part(NoFeatures(), kind="network")
    with pytest.raises(UserError, match="takes recording, value, where it gets recording, value, "):
        check_part(lambda recording, value: recording * value)


class Map(Trunk):
    """A trunk, then what spoils it."""

    norms = ("none",)
    patch = 64

    def __init__(self, *, width: float = 1, norm: Any = "none", spoil: str = "") -> None:
        self.spoil = spoil
        super().__init__(width=width, norm=norm)

    def build(self) -> nn.Sequential:
        self.out_channels = 8
        return nn.Sequential(nn.Conv2d(3, 8, 8, 8), nn.ReLU(), nn.MaxPool2d(4))

    def forward(self, x):
        features = super().forward(x)
        changes = {
            "flat": lambda: features.flatten(2), "nan": lambda: features * torch.nan,
            "few": lambda: features[:, :3], "list": lambda: [features],
        }  # fmt: skip
        return changes[self.spoil]() if self.spoil else features


def test_a_trunk_of_ones_own_passes_and_so_does_its_class():
    assert check_part(Map()) == check_part(Map) == "trunk"


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        ("flat", r"returned a Tensor of float32 of shape \(2, 8, 4\) for a batch of 2; a trunk"),
        (
            "few",
            r"returned a Tensor of float32 of shape \(2, 3, 2, 2\), and its out_channels are 8; a ",
        ),
        ("nan", "gave NaN or infinity; a trunk maps images"),
        ("list", "returned a list for a batch of 2; a trunk maps images"),
    ],
)
def test_trunks_that_break_their_contract(spoil, said):
    with pytest.raises(UserError, match=rf"^model\.visual\.trunk \(Map\) {said}"):
        check_part(Map(spoil=spoil))


@pytest.mark.parametrize(
    ("augmentation", "said"),
    [
        (lambda patches: patches.flatten(1), r"of shape \(2, 150528\) for a batch of 2; an augm"),
        (lambda patches: patches * torch.nan, "gave NaN or infinity; an augmentation maps patches"),
        (lambda patches: None, "returned a NoneType for a batch of 2; an augmentation maps"),
    ],
)
def test_augmentations_that_break_their_contract(augmentation, said):
    with pytest.raises(UserError, match=said):
        check_part(augmentation)


def brighter(recording, value, scene):
    recording += 1  # the files of the cache are only read
    return recording


@pytest.mark.parametrize(
    ("perturbation", "said"),
    [
        (lambda x, value, scene: x[0], r"returned a ndarray of float32 of shape \(40000,\) for"),
        (lambda x, value, scene: x * np.nan, "gave NaN or infinity; a perturbation takes"),
        (lambda x, value, scene: None, "returned a ndarray of object"),
    ],
)
def test_perturbations_that_break_their_contract(perturbation, said):
    with pytest.raises(UserError, match=said):
        check_part(perturbation)


def test_a_perturbation_of_one_kind_of_recording_is_tried_on_that():
    def stains(photo, share, scene):
        photo = photo.copy()
        photo[: int(share * photo.shape[0]), :, 2] = 0
        return photo

    assert check_part(stains) == "perturbation"
    assert check_part(stains, example=make_photo(0, 0)) == "perturbation"
    with pytest.raises(ValueError, match="read-only") as caught:
        check_part(brighter)
    assert fault_of(caught.value).startswith("stability.severities (brighter) raised ValueError")


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        ("none", "returned a NoneType for a recording"),
        ("nan", "gave NaN or infinity"),
        ("more", "gave 6 scores at each position, and there are 3 classes"),
        ("arrays", "has a state that is a dict of other things than tensors"),
        ("outside", "gives other outputs once it is saved and loaded"),
    ],
)
def test_baselines_that_break_their_contract(spoil, said):
    assert check_part(Loudness()) == check_part(Loudness) == "baseline"
    with pytest.raises(UserError, match=rf"^model\.baseline \(Loudness\) {said}.*; a baseline has"):
        check_part(Loudness(spoil))


class Alone:
    """A baseline of no base."""

    def logits(self, recording):
        return torch.zeros(3, 1)


def test_what_is_no_part_is_said():
    with pytest.raises(UserError, match="names Alone, which is no baseline; derive it from"):
        check_part(Alone())
    other = type("Other", (Loudness,), {"kind": "force"})
    with pytest.raises(UserError, match="names Other, whose kind is force; let it be haptic for"):
        check_part(other())
    with pytest.raises(UserError, match="str is no part that is known; give kind"):
        check_part("a string")
    with pytest.raises(UserError, match="kind=layer is no kind of part; give network, features"):
        check_part(Frames(), kind="layer")
    with pytest.raises(UserError, match="needs hidden, which check_part does not know"):
        check_part(NeedsHidden)


class NeedsHidden(nn.Module):
    def __init__(self, classes: int, hidden: int) -> None:
        super().__init__()

    def features(self, x, level):
        return x


def test_what_a_part_raises_keeps_its_traceback_and_the_part_stays_as_it_was():
    with pytest.raises(KeyError, match="boom of a user") as caught:
        check_part(SpoiltFrames(3, "raise"))
    assert fault_of(caught.value).startswith("model.haptic.network (SpoiltFrames) raised KeyError")
    network, generator = SpoiltFrames(3), torch.get_rng_state()
    before = {name: value.clone() for name, value in network.state_dict().items()}
    check_part(network)
    assert all(torch.equal(before[name], it) for name, it in network.state_dict().items())
    assert all(weight.grad is None for weight in network.parameters())
    assert network.steps == 0
    assert network.training
    assert torch.equal(torch.get_rng_state(), generator)


def test_an_example_says_what_a_network_gets():
    network = nn.Module()
    network.features = lambda x, level: x[:, :3]
    with pytest.raises(UserError, match="without a gradient"):
        check_part(network, kind="network", example=torch.randn(2, 5, 40))

    class Net(nn.Module):
        def __init__(self, classes: int) -> None:
            super().__init__()
            self.layer = nn.Conv1d(5, classes, 3)

        def features(self, x, level):
            return self.layer(x)

    assert check_part(Net, example=torch.randn(2, 5, 40)) == "network"
    with pytest.raises(RuntimeError, match="Expected 2D"):
        check_part(Net)


@dataclass
class FlatReader:
    folder: str
    rows: ClassVar[Any] = ()

    def read(self) -> Any:
        return self.rows or Recordings(
            tuple(
                Recording(path.parent.parent.name, "haptic", path, path.stem)
                for path in sorted(Path(self.folder).glob("*/haptic/*.wav"))
            )
        )


class Asking(FlatReader):
    """A reader whose method asks for what is a field."""

    def read(self, folder: str) -> Any:
        return self.rows


class Locked(SignalSense):
    """A sense whose decoder no other process can be given."""

    @classmethod
    def make_decoder(cls, decode):
        decoder = super().make_decoder(decode)
        object.__setattr__(decoder, "lock", lambda: None)
        return decoder


def reader(*overrides: str) -> Any:
    return build("data.reader", read_config(compose_config(overrides)).data.reader)


def test_the_readers_keep_their_contract(surfaces, tmp_path, cache):
    write_manifest(tl.read_folder(surfaces), tmp_path / "table.csv")
    readers = [
        reader("data=folder", f"data.root={surfaces}"),
        reader("data=manifest", f"data.manifest={tmp_path}/table.csv"),
        reader("data=synthetic", f"data.cache_dir={cache}", "debug=tiny", "data.classes=2"),
        reader("data=tum", f"data.root={write_tum(tmp_path / 'tum', 2, 0.1, 16)}"),
        reader("data=cluster", f"data.root={write_cluster(tmp_path / 'cluster', 0.6)}"),
    ]
    assert {type(it) for it in readers} == {
        FolderReader, ManifestReader, SyntheticReader, TumReader, PatternReader
    }  # fmt: skip
    for it in readers:
        assert check_part(it) == "reader"


def test_readers_and_senses_that_break_their_contract(surfaces, tmp_path):
    assert check_part(FlatReader(str(surfaces))) == "reader"
    with pytest.raises(UserError, match=r"FlatReader.* found no recordings; check the keys of"):
        check_part(FlatReader(str(tmp_path)))
    broken = FlatReader("")
    broken.rows = ["oak"]
    with pytest.raises(UserError, match=r"FlatReader\.read\(\) .* returned list; let it return"):
        check_part(broken)
    with pytest.raises(UserError, match=r"^data\.reader \(Recordings\) has no method read; a re"):
        check_part(Recordings(()), kind="reader")
    with pytest.raises(UserError, match="has read, which takes folder, where it gets nothing; a r"):
        check_part(Asking("a"))
    with pytest.raises((AttributeError, TypeError)) as caught:
        check_part(Locked)
    assert "model.haptic (Locked) raised" in fault_of(caught.value)
