"""The accelerated classifier against the plain one."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from conftest import make_card
from hypothesis import given
from hypothesis import strategies as st
from torch import nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig
from tex_lightning.inference.engine import accelerate, count_macs, sample_macs
from tex_lightning.networks import folding
from tex_lightning.networks.blocks import response_norm as published
from tex_lightning.networks.folding import FastResponseNorm, fold_batch_norm

OFF, DEFAULT = EngineConfig(fast=False, tile=None), EngineConfig(fast=True, tile=None)
SENSES = {
    "haptic": ["haptic"],
    "visual": ["visual"],
    "fusion": ["haptic", "visual", "sound"],
}


def classifier(kind: str, norm: str = "batch", level: str = "fc2") -> SurfaceClassifier:
    """A classifier with statistics as training leaves them, some scales negative."""
    torch.manual_seed(0)
    names = ["a", "b", "c", "d"]
    card = make_card(*SENSES[kind], classes=names, level=level, pairs=200, width=0.1, norm=norm)
    model = SurfaceClassifier(card)
    for module in model.modules():
        if isinstance(module, nn.BatchNorm2d):
            nn.init.uniform_(module.weight, -0.2, 1.5)
            nn.init.normal_(module.bias, std=0.2)
            nn.init.normal_(module.running_mean, std=0.5)
            nn.init.uniform_(module.running_var, 0.3, 3.0)
    for module in model.modules():
        if isinstance(module, nn.Conv2d) and module.out_channels == 4:
            nn.init.normal_(module.weight, std=0.5)
    # torch.matmul takes another way for weights that ask for gradients
    return model.eval().requires_grad_(False)


def inputs(times: int = 1) -> dict[str, torch.Tensor]:
    rng = np.random.default_rng(0)
    trace = rng.standard_normal((1, times * 60_000)).astype(np.float32)
    photo = rng.integers(0, 256, (times * 300, times * 420, 3)).astype(np.uint8)
    sound = rng.standard_normal((1, 100_000)).astype(np.float32)
    arrays = {"haptic": trace, "image": photo, "sound": sound}
    return {name: torch.from_numpy(array) for name, array in arrays.items()}


def test_switched_off_nothing_changes_in_a_single_bit():
    model = classifier("fusion")
    engine = accelerate(model, OFF)
    assert torch.equal(engine.logits(**inputs()), model.logits(**inputs()))


@pytest.mark.parametrize("norm", ["batch", "lrn"])
@pytest.mark.parametrize("kind", SENSES)
def test_the_engine_keeps_class_scores_and_fragments(kind, norm):
    model = classifier(kind, norm)
    expected = model.logits(**inputs())
    found = accelerate(model, DEFAULT).logits(**inputs())
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-4)
    assert torch.equal(found.argmax(0), expected.argmax(0))


@pytest.mark.parametrize("kind", SENSES)
def test_large_inputs_in_pieces_keep_class_scores_and_fragments(kind):
    model, large = classifier(kind), inputs(times=3)  # pieces are twice the receptive field
    expected = model.logits(**large)
    engine = accelerate(model, replace(DEFAULT, tile=25_000 if kind == "haptic" else 60_000))
    sizes = []
    sense = "haptic" if kind == "haptic" else "visual"
    engine.senses[sense].network.trunk.register_forward_pre_hook(
        lambda _, x: sizes.append(x[0].shape[2:])
    )
    found = engine.logits(**large)
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-4)
    assert torch.equal(found.argmax(0), expected.argmax(0))
    assert len(sizes) > 1


@pytest.mark.parametrize(("kind", "modality"), [("haptic", "haptic"), ("visual", "image")])
def test_every_layer_gets_its_channels_innermost(kind, modality):
    last = []

    def check(module, given, output):
        last.append(output.is_contiguous(memory_format=torch.channels_last))

    engine = accelerate(classifier(kind), DEFAULT)
    for module in engine.modules():
        if isinstance(module, nn.Conv2d):
            module.register_forward_hook(check)
    engine.logits(**{modality: inputs()[modality]})
    assert len(last) > 3
    assert all(last)


def test_the_original_is_left_alone_and_the_type_is_kept():
    model = classifier("fusion").requires_grad_(True)
    before = {key: value.clone() for key, value in model.state_dict().items()}
    engine = accelerate(model, DEFAULT)
    assert type(engine.fusion) is type(model.fusion)
    assert engine.card == model.card
    assert not engine.logits(**inputs()).requires_grad
    for parameter in engine.parameters():
        parameter.zero_()
    assert all(torch.equal(before[key], value) for key, value in model.state_dict().items())


@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1)])
@pytest.mark.parametrize(
    ("kind", "norm"), [("haptic", "batch"), ("fusion", "batch"), ("fusion", "lrn")]
)
def test_a_copy_that_takes_later_weights_is_one_made_anew(kind, norm, signs):
    """It stays, but where a normalisation behind a maximum can be folded no longer."""
    model, (before, after) = classifier(kind, norm), signs
    norms = [module.weight for module in model.modules() if isinstance(module, nn.BatchNorm2d)]
    for weight in norms:
        weight.copy_(before * weight.abs())
    earlier = accelerate(model, DEFAULT)
    for values in model.state_dict().values():
        values.copy_(1.1 * values)
    for weight in norms:
        weight.copy_(after * weight.abs())
    expected, found = accelerate(model, DEFAULT), accelerate(model, DEFAULT, earlier)
    assert (found is earlier) == (after == 1 or not norms)
    assert str(found) == str(expected)
    state = expected.state_dict()
    assert found.state_dict().keys() == state.keys()
    assert all(torch.equal(values, state[name]) for name, values in found.state_dict().items())
    assert torch.equal(found.logits(**inputs()), expected.logits(**inputs()))
    assert not any(x.requires_grad for x in found.parameters())


(LAYER,) = published("lrn")


@given(
    st.integers(1, 20),
    st.tuples(st.integers(1, 3), st.integers(1, 7), st.integers(1, 7)),
    st.floats(0.01, 300),
    st.booleans(),
    st.sampled_from([1, 37, 1 << 19]),
)
def test_it_equals_pytorchs_for_every_shape_layout_and_piece(channels, size, scale, last, piece):
    batch, height, width = size
    generator = torch.Generator().manual_seed(channels)
    x = scale * torch.randn(batch, channels, height, width, generator=generator)
    if last:
        x = x.contiguous(memory_format=torch.channels_last)
    expected = LAYER(x)
    before, folding.PIECE = folding.PIECE, piece
    try:
        found = FastResponseNorm(LAYER)(x)
    finally:
        folding.PIECE = before
    torch.testing.assert_close(found, expected, rtol=2e-6, atol=0)


def test_normalisation_is_folded_into_a_convolution_that_has_a_bias():
    torch.manual_seed(0)
    network = nn.Sequential(nn.Conv2d(2, 3, 3), nn.BatchNorm2d(3)).eval()
    nn.init.uniform_(network[1].weight, 0.5, 2)
    nn.init.normal_(network[1].running_mean)
    nn.init.constant_(network[0].bias, 5)
    x = torch.randn(1, 2, 6, 6)
    expected = network(x)
    fold_batch_norm(network)
    assert isinstance(network[1], nn.Identity)
    torch.testing.assert_close(network(x), expected)


@pytest.mark.parametrize("level", ["fc2", "fc3"])
def test_multiply_accumulates_are_those_of_the_scores_without_computing_them(level):
    model, sample = classifier("fusion", level=level), inputs()
    expected, ran = count_macs(lambda: model.logits(**sample)), []
    for sense in model.senses.values():
        sense.network.features = ran.append
    assert sample_macs(model, **sample) == expected
    assert not ran
