"""A classifier as a program of torch.export, for signals of any length and photos of any size."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr
from io import StringIO

import numpy as np
import torch
from torch import Tensor
from torch.export import Dim, ExportedProgram

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.data.decode import PhotoDecoder, SignalDecoder
from tex_lightning.errors import UserError, shorten
from tex_lightning.export.graph import DRAWS, ClassifierGraph
from tex_lightning.senses.base import Sense
from tex_lightning.senses.features.movement import KNOWN_SECONDS
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

WINDOWS = 3  # of the network, that the recordings have with which it is traced
SIDE = 400  # pixels of a photo for a network that does not say what it needs
SECONDS = 4  # likewise of a signal
AXES = (1, 3)  # of signals with which it is compared, if it takes any number of axes


def trace(classifier: SurfaceClassifier) -> tuple[ExportedProgram, dict[str, Tensor], list[str]]:
    """Trace a classifier with dynamic sizes.

    Args:
        classifier: On the CPU, in evaluation mode.

    Returns:
        A program that takes its inputs by name and gives a dictionary of named tensors; the inputs
        with which it was traced (``draws`` are those of the card's seed); the names of the outputs.

    Raises:
        UserError: If PyTorch cannot trace what it is made of.
    """
    graph = ClassifierGraph(classifier).eval()
    inputs, sizes = {}, {}
    for sense in classifier.senses.values():
        inputs[sense.modality] = example(sense)
        fixed = getattr(sense.features, "levels", 0)  # as many channels as were trained on
        sizes[sense.modality] = {0: Dim.STATIC if fixed else Dim.DYNAMIC, 1: Dim.DYNAMIC}
    if graph.fused:  # the positions that are drawn at the card's seed
        decision, senses = classifier.card.decision, len(classifier.card.sense_names)
        inputs[DRAWS] = draws(decision["seed"], decision["pairs"], senses)
        sizes[DRAWS] = {0: Dim.DYNAMIC}
    graph.name_inputs(list(inputs))
    try:
        with quiet(), torch.no_grad():
            program = torch.export.export(graph, (), inputs, dynamic_shapes=sizes, strict=False)
            outputs = list(graph(**inputs))
    except UserError:
        raise
    except Exception as error:  # whatever PyTorch cannot trace, it says in as many ways
        raise untraceable(classifier, error) from error
    return program, inputs, outputs


def untraceable(classifier: SurfaceClassifier, error: Exception) -> UserError:
    """Return the error for a network that cannot be exported."""
    parts = {
        type(part).__name__: None
        for sense in classifier.senses.values()
        for part in (sense.features, sense.network)
    }
    said = shorten(next(iter(str(error).strip().splitlines()), "").rstrip("."))
    return UserError(
        f"This {classifier.card.title} ({', '.join(parts)}) cannot be exported: "
        f"{type(error).__name__}: {said}; write its parts without Python that depends on values or "
        "sizes (see torch.export)."
    )


def draws(seed: int, count: int, senses: int) -> Tensor:
    """Return the words (count, senses) from which PyTorch's generator draws positions.

    Both it and NumPy's RandomState are the Mersenne Twister, seeded alike, and a position is a word
    modulo the number of positions.
    """
    words = np.frombuffer(np.random.RandomState(seed).bytes(4 * count * senses), "<u4")
    return torch.from_numpy(words.astype(np.int64).reshape(senses, count).T.copy())


def axes_of(sense: Sense) -> tuple[int, ...]:
    """Return how many axes the signals have with which a sense is compared, the most last."""
    levels: int = getattr(sense.features, "levels", 0)
    return (levels,) if levels else AXES


def example(sense: Sense, seed: int = 0) -> Tensor:
    """Return a recording of noise that gives several positions."""
    generator = torch.Generator().manual_seed(seed)
    decoder = sense.decoder
    if isinstance(decoder, SignalDecoder):
        size = axes_of(sense)[-1], _samples(sense, decoder.sampling_rate)
        return torch.randn(size, generator=generator)
    least = (SIDE, SIDE) if sense.geometry is None else sense.window_size
    scale = 2 if isinstance(decoder, PhotoDecoder) and decoder.half_scale else 1
    row = SIDE // 8 if sense.geometry is None else sense.stride  # to the second row of positions
    height, width = scale * (least[0] + row), scale * (least[1] + SIDE // 4) + 1
    return torch.randint(256, (height, width, 3), generator=generator, dtype=torch.uint8)


def _samples(sense: Sense, rate: float) -> int:
    features = sense.features
    if isinstance(features, SpectrogramFeatures) and sense.geometry is not None:
        movement = features.samples(WINDOWS * sense.window_size[1])
        return movement + int(KNOWN_SECONDS * rate)
    return int(SECONDS * rate)


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress the progress messages of PyTorch's exporters."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        logging.disable(logging.WARNING)
        try:
            with redirect_stderr(StringIO()):  # to which they print the whole graph of what fails
                yield
        finally:
            logging.disable(logging.NOTSET)
