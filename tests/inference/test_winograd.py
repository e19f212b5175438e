"""Winograd's convolutions against the direct ones, in float64 and inside the engine."""

from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import nn
from torch.nn import functional

from tex_lightning.card import Card
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig
from tex_lightning.data.decode import DecodeSettings
from tex_lightning.inference import long_conv, rewrite, winograd
from tex_lightning.inference.engine import accelerate
from tex_lightning.inference.long_conv import LongConv
from tex_lightning.inference.streaming.classifier import StreamingClassifier
from tex_lightning.inference.tiles import layer_windows
from tex_lightning.inference.winograd import WinogradConv

FAST = EngineConfig(True, True, True, True, True, "fp32", False, None)


def classifier(kind: str = "haptic", norm: str = "batch") -> SurfaceClassifier:
    """With random weights and statistics, some scales negative, and scores that differ."""
    torch.manual_seed(0)
    network = {"width": 0.1, "norm": norm}
    card = Card(
        kind=kind,
        classes=["a", "b", "c", "d"],
        decode=DecodeSettings().to_dict(),
        decision={"pairs": 10, "seed": 0},
        haptic_features={"axes": "frame"} if kind == "haptic" else {},
        haptic_network=network if kind == "haptic" else {},
        visual_network={**network, "trunk": "alexnet_caffe"} if kind == "visual" else {},
    )
    model = SurfaceClassifier(card)
    for layer in model.modules():
        if isinstance(layer, nn.BatchNorm2d):
            nn.init.normal_(layer.running_mean, std=0.5)
            nn.init.uniform_(layer.weight, -0.2, 1.5)
    nn.init.normal_(model.network.head.score_layer.weight, std=0.5)
    return model.eval().requires_grad_(False)


def recording() -> torch.Tensor:
    return torch.randn(1, 60_000, generator=torch.Generator().manual_seed(0))


@pytest.fixture
def short(monkeypatch) -> None:
    """Take the fast way however little there is to multiply, in many blocks."""
    monkeypatch.setattr(rewrite, "MIN_DEPTH", 1)
    monkeypatch.setattr(winograd, "MIN_MACS", 0)
    monkeypatch.setattr(winograd, "BLOCK", 8000)
    monkeypatch.setattr(long_conv, "MIN_MACS", 0)


def fast_layers(network: nn.Module) -> list[nn.Module]:
    kinds = WinogradConv | LongConv
    return [layer for layer in network.modules() if isinstance(layer, kinds)]


@given(
    st.tuples(st.integers(1, 3), st.integers(1, 6), st.integers(1, 9), st.integers(1, 40)),
    st.integers(1, 5),
    st.booleans(),
    st.booleans(),
    st.booleans(),
    st.sampled_from([1, 2]),
    st.sampled_from([1, 240, 2000, 1 << 20]),
)
def test_it_equals_convolution_and_pooling_for_every_shape_layout_and_block(
    shape, outputs, bias, last, pooled, groups, block
):
    torch.manual_seed(sum(shape))
    shape = (shape[0], groups * shape[1], *shape[2:])
    conv = nn.Conv2d(shape[1], groups * outputs, 3, padding=1, groups=groups, bias=bias)
    conv.requires_grad_(False)
    x = torch.randn(shape)
    if last:
        x = x.contiguous(memory_format=torch.channels_last)
    before, given = x.clone(), [p.double() for p in conv.parameters()]
    expected = functional.conv2d(x.double(), *given, padding=1, groups=groups)
    if pooled:
        expected = functional.max_pool2d(expected, 2, 2, ceil_mode=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(winograd, "MIN_MACS", 0)
        patch.setattr(winograd, "BLOCK", block)
        found = WinogradConv(conv, pooled=pooled)(x)
    torch.testing.assert_close(found.double(), expected, rtol=1e-5, atol=1e-5)
    assert torch.equal(x, before)


@given(
    st.tuples(st.integers(1, 3), st.integers(1, 6), st.integers(1, 5), st.integers(12, 60)),
    st.integers(1, 5),
    st.sampled_from([6, 9, 12]),
    st.booleans(),
    st.sampled_from([("MIN_MACS", 0), ("FEW", 1000), ("FEW", 0)]),
)
def test_a_long_one_equals_convolution_for_every_shape_and_way(shape, outputs, taps, bias, way):
    torch.manual_seed(sum(shape))
    conv = nn.Conv2d(shape[1], outputs, (min(4, shape[2]), taps), bias=bias).requires_grad_(False)
    x = torch.randn(shape)
    expected = functional.conv2d(x.double(), *[p.double() for p in conv.parameters()])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(long_conv, *way)
        found = LongConv(conv)(x)
    torch.testing.assert_close(found.double(), expected, rtol=1e-5, atol=1e-5)


def test_what_is_quicker_directly_is_computed_directly():
    conv = nn.Conv2d(2, 3, 3, padding=1).requires_grad_(False)
    x = torch.randn(1, 2, 9, 30)
    assert torch.equal(WinogradConv(conv)(x), conv(x))
    expected = functional.max_pool2d(conv(x), 2, 2, ceil_mode=True)
    assert torch.equal(WinogradConv(conv, pooled=True)(x), expected)


def test_its_making_leaves_random_numbers_as_they_were():
    conv = nn.Conv2d(2, 3, 3, padding=1)
    torch.manual_seed(0)
    expected = torch.rand(3)
    torch.manual_seed(0)
    WinogradConv(conv)
    assert torch.equal(torch.rand(3), expected)


@pytest.mark.parametrize("norm", ["batch", "lrn"])
@pytest.mark.parametrize("folded", [True, False])
@pytest.mark.parametrize("tile", [None, 25_000])
def test_the_engine_keeps_class_scores_and_fragments(short, norm, folded, tile):
    model = classifier(norm=norm)
    config = replace(FAST, fold_batch_norm=folded, channels_last=folded, tile=tile)
    engine = accelerate(model, config)
    assert len(fast_layers(engine.network)) == 4  # of one channel, the first stays
    expected, found = model.logits(recording()), engine.logits(recording())
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-4)
    assert torch.equal(found.argmax(0), expected.argmax(0))


def test_a_batch_has_the_class_scores_of_each_alone(short):
    network = accelerate(classifier(), FAST).network
    x = torch.randn(5, 1, 50, 230)
    each = torch.cat([network(one[None]) for one in x])
    torch.testing.assert_close(network(x), each, rtol=1e-5, atol=1e-5)


def test_the_geometry_is_told_as_before():
    model = classifier()
    for axis in (0, 1):
        found = layer_windows(accelerate(model, FAST).network, axis)
        assert found == layer_windows(model.network, axis)


def test_a_stream_gives_the_fragments_of_the_whole(short):
    engine, trace = accelerate(classifier(), FAST), recording()
    stream = StreamingClassifier(engine)
    vote = [stream.push(chunk) for chunk in trace.split(7000, dim=1)][-1]
    assert torch.equal(vote.fragments, engine.classify(trace).fragments)


@pytest.mark.parametrize("tile", [None, 60_000])
def test_a_photo_keeps_its_class_scores(short, tile):
    model = classifier("visual", "lrn")
    engine = accelerate(model, replace(FAST, tile=tile))
    assert len(fast_layers(engine.network)) == 3  # conv3 to conv5, two of them in groups
    photo = torch.randint(0, 256, (330, 390, 3), dtype=torch.uint8)
    expected, found = model.logits(photo=photo), engine.logits(photo=photo)
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-4)
    assert torch.equal(found.argmax(0), expected.argmax(0))


def test_few_channels_stay():
    layers = nn.Sequential(nn.Conv2d(32, 128, 3, padding=1), nn.Conv2d(64, 256, 3, padding=1))
    rewrite.speed_up_convolutions(layers)
    assert [type(layer) for layer in layers] == [nn.Conv2d, WinogradConv]


@pytest.mark.parametrize(
    "config",
    [replace(FAST, fast_convolutions=False), replace(FAST, precision="bf16")],  # would lose digits
)
@pytest.mark.parametrize("kind", ["haptic", "visual"])
def test_other_precisions_and_the_switch_keep_the_convolutions(short, kind, config):
    assert not fast_layers(accelerate(classifier(kind), config))
