"""Accelerate a trained classifier for tests and predictions, and count its arithmetic.

Layers are rewritten by exact algebra, so that only the rounding of float32 differs.
:func:`input_macs` counts the multiply-accumulates of a decision before it is made.
"""

import logging
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from itertools import product

import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig
from tex_lightning.core.console import log_once
from tex_lightning.networks.blocks import Level, independent_copy, is_builtin, shared_copy
from tex_lightning.networks.folding import FastResponseNorm, fold_batch_norm, sequences
from tex_lightning.senses.base import Sense
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

# Noise on which a rewritten network is compared, until the network takes it
SECONDS, AXES = (4, 16), (1, 3)
SIDES = (64, 160, 320, 640)  # pixels
TOLERANCE, TINY = 1e-3, 1e-6  # of the largest output, and besides
ROUNDINGS = 8  # the same, in roundings of weights in half precision

log = logging.getLogger(__name__)


def accelerate(
    classifier: SurfaceClassifier, config: EngineConfig, earlier: SurfaceClassifier | None = None
) -> SurfaceClassifier:
    """Return an accelerated copy of a classifier; the copy of a baseline shares the baseline.

    Args:
        classifier: A trained classifier on any device; it is not changed.
        config: Whether layers are rewritten, and the size of tiles.
        earlier: An accelerated copy of the same classifier with other weights, which takes the
            present ones if its layers can stay.

    Returns:
        An independent classifier on the same device, in evaluation mode and without gradients.
    """
    if earlier is not None and _renew(earlier, classifier):
        return earlier
    if classifier.card.baseline:
        return shared_copy(classifier)
    device, without_rows = classifier.device, shared_copy(classifier, rows=nn.ModuleDict())
    fast = independent_copy(without_rows).eval().requires_grad_(False)
    for name, sense in fast.senses.items():
        sense.tile = config.tile
        for features in sense.features.modules():
            if isinstance(features, SpectrogramFeatures):
                features.fast_spectrogram = config.fast and device.type == "cpu"
        if config.fast:
            # a custom network is compared on the CPU, whose random numbers alone are restored
            part = sense if is_builtin(sense.network) else sense.cpu()
            levels = {fast.embedding_layer(name), fast.fused_layer(name)}
            sense.network = rewritten(part, levels, REWRITINGS)
            sense.to(device)
    return fast


@torch.no_grad()
def _renew(fast: SurfaceClassifier, classifier: SurfaceClassifier) -> bool:
    """Copy the weights of a classifier into its accelerated copy; return whether that suffices.

    It does for senses of this package, unless a normalisation no longer is what can be folded.
    """
    senses = classifier.senses.items()
    if fast.device != classifier.device or not all(sense.is_builtin for _, sense in senses):
        return False
    state = classifier.state_dict()
    for name, values in fast.state_dict().items():
        if name in state:  # a folded layer has a bias of its own
            values.copy_(state[name])
    pairs = [(fast.senses[name].network, sense.network) for name, sense in senses]
    return all(fold_batch_norm(*pair) == _norms(pair[1]) - _norms(pair[0]) for pair in pairs)


def _norms(network: nn.Module) -> int:
    """Count the layers of batch normalisation."""
    return sum(isinstance(layer, nn.BatchNorm2d) for layer in network.modules())


def _rewrite(network: nn.Module) -> int:
    """Rewrite all layers that can be rewritten exactly; return their number."""
    count, in_place = fold_batch_norm(network), is_builtin(network)
    for layers in sequences(network):
        for place, layer in enumerate(layers):
            if FastResponseNorm.fits(layer):
                layers[place] = FastResponseNorm(layer, in_place=in_place)  # type: ignore[arg-type]
                count += 1
    return count


def _rewrite_channels_last(network: nn.Module) -> int:
    """Rewrite layers, and lay out weights with the channels innermost, which is faster."""
    count, layout = _rewrite(network), torch.channels_last
    images = [values for values in network.parameters() if values.dim() == 4]
    for values in images:  # .contiguous would leave those of a single channel as they are
        values.data = values.data.to(memory_format=layout)
    return count + len(images)


REWRITINGS = (_rewrite_channels_last, _rewrite)  # the second for what depends on the layout


def rewritten(
    sense: Sense, levels: Collection[Level], ways: Sequence[Callable[[nn.Module], int]]
) -> nn.Module:
    """Return the rewritten network of a sense, or the network itself if no rewriting is equal.

    Networks of this package are known to be rewritten exactly. A user's network may call its layers
    in other ways, so its rewritten copy has to give the same outputs on noise.

    Args:
        sense: Sense in evaluation mode, without gradients; with a user's network on the CPU. A
            network of this package is changed in place, a user's is copied.
        levels: Levels at which the network is used.
        ways: Functions that rewrite a network and return the number of changes, the best first.
    """
    network = sense.network
    if is_builtin(network):
        ways[0](network)
        return network
    if (probe := _probe(sense, levels)) is None:
        return network
    for rewrite in ways:
        copied = independent_copy(network)
        if not rewrite(copied):  # as it was
            return network
        sense.network = copied
        if _agrees(sense, levels, *probe):
            return copied
        sense.network = network
    log_once(
        log,
        f"Layers of model.{sense.name}.network ({type(network).__name__}) were rewritten to run "
        "faster and then gave other scores, so it runs as it was trained; layers that are used one "
        "by one belong into an nn.ModuleList and not into an nn.Sequential.",
        logging.WARNING,
    )
    return network


def _probe(sense: Sense, levels: Collection[Level]) -> tuple[Tensor, list[Tensor]] | None:
    """Return noise of sufficient size as network input, and the outputs; None if not finite."""
    for recording in _noise(sense):
        with suppress(Exception):  # which is raised again where the network is used
            x = sense.dense_input(recording)
            scores = _scores(sense, x, levels)
            return (x, scores) if all(bool(each.isfinite().all()) for each in scores) else None
    return None


def _noise(sense: Sense) -> Iterator[Tensor]:
    """Yield decoded recordings of noise, larger and larger ones."""
    generator = torch.Generator().manual_seed(0)
    if sense.medium == "photo":
        for side in SIDES:
            yield torch.randint(256, (side, side, 3), generator=generator, dtype=torch.uint8)
    else:
        rate = getattr(sense.decoder, "sampling_rate", 1.0)
        for seconds, axes in product(SECONDS, AXES):
            yield torch.randn(axes, math.ceil(seconds * rate), generator=generator)


@torch.inference_mode()
def _scores(sense: Sense, x: Tensor, levels: Collection[Level]) -> list[Tensor]:
    """Return the outputs of a network at some levels; random numbers are the same in every call."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        return [sense.score(x.clone(), level).float() for level in sorted(levels)]


def _agrees(sense: Sense, levels: Collection[Level], x: Tensor, expected: Sequence[Tensor]) -> bool:
    """Return whether the outputs of a network are the expected ones but for rounding."""
    weights = next(sense.network.parameters(), x)
    share = max(TOLERANCE, ROUNDINGS * torch.finfo(weights.dtype).eps)
    try:
        outputs = _scores(sense, x, levels)
    except Exception as error:  # of a user's class that depends on the layout of its layers
        log.debug("%s: %s", type(sense.network).__name__, error)
        return False
    return all(
        one.shape == other.shape
        and float((one - other).abs().max()) <= share * float(one.abs().max()) + TINY
        for one, other in zip(expected, outputs, strict=True)
    )


def count_macs(function: Callable[[], object]) -> int:
    """Count the multiply-accumulates of the convolutions and matrix products that a function runs.

    PyTorch counts two operations for each; normalisation, pooling and Fourier transforms are not
    counted.
    """
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        function()
    return int(counter.get_total_flops()) // 2


def sample_macs(classifier: SurfaceClassifier, **recordings: Tensor) -> int:
    """Count the multiply-accumulates of the class scores of a sample, including its features.

    Networks of this package run on meta tensors, without memory: not tiled, a large photo would
    take far more memory than its test.

    Args:
        classifier: Classifier as it was trained and not accelerated.
        **recordings: Decoded recordings by modality.
    """
    senses = classifier.senses.items()
    for _, sense in senses:
        _ = sense.geometry  # found by a pass over an example, which is not counted
    if classifier.card.baseline or not all(sense.is_builtin for _, sense in senses):
        return count_macs(lambda: classifier.logits(**recordings))
    empty = empty_classifier(classifier.card)

    def run() -> None:
        for name, sense in senses:
            x = sense.dense_input(recordings[sense.modality]).to("meta")
            empty.output_of(name, empty.embedding_of_input(name, x))

    return count_macs(run)


def empty_classifier(card: Card) -> SurfaceClassifier:
    """Return a card's classifier on the meta device, where its arithmetic is counted."""
    return SurfaceClassifier(card).eval().to("meta")


def input_macs(empty: SurfaceClassifier, sense: str, height: int, width: int) -> int:
    """Count the multiply-accumulates of a sense with its part of a fusion layer.

    Nothing is computed. Convolutions and matrix products are counted; features, pooling and
    normalisation are not.

    Args:
        empty: An :func:`empty_classifier`, perhaps with some of its senses.
        sense: Name of the sense.
        height: Height of its input.
        width: Width of its input.
    """
    part, level = empty.senses[sense], empty.fused_layer(sense)
    x = part.blank(height, width).to("meta")
    return count_macs(lambda: empty.project(sense, part.dense_grid(x, level).flatten(1)))
