"""Checks of what a training makes, before work: settings, weights and every class of a user's."""

import io
import logging
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tex_lightning.baselines.classifier import BaselineClassifier, FittedBaseline, as_part
from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, ModelConfig
from tex_lightning.config.instantiation import OWN
from tex_lightning.config.model import FUSION
from tex_lightning.core.contract import Part, breach, calling, describe
from tex_lightning.data.datamodule import TrainingBatches
from tex_lightning.data.recordings import Recording, Recordings, class_indices
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError
from tex_lightning.learning.loggers import open_loggers
from tex_lightning.learning.module import SurfaceModule
from tex_lightning.learning.start import fit_closed_form, start_trunk
from tex_lightning.learning.train import checkpoint_of, make_module
from tex_lightning.learning.trainer import (
    build_callbacks,
    make_trainer,
    quiet_lightning,
)
from tex_lightning.networks.blocks import is_builtin
from tex_lightning.senses.base import Sense, as_tensor

log = logging.getLogger(__name__)

FITTED = 4  # recordings of a class on which a fit in closed form is tried
BATCH = 2


def try_training(config: Config, card: Card, directory: Path) -> list[Sense]:
    """Make all parts of the training of a model once, so that errors show before it starts.

    Args:
        config: Configuration of the training.
        card: Card of the model, for any classes.
        directory: The run folder.

    Returns:
        The senses of the model, with weights of no meaning.

    Raises:
        UserError: Naming the key that does not fit.
    """
    model, sources = config.model, config.sources
    loggers = open_loggers(config.logger, directory, card.kind)
    if model.baseline is not None:
        classifier = BaselineClassifier(card)
        for source in sources.values():
            classifier.baseline.load_weights(source)
        return [*classifier.senses.values()]
    callbacks, fit = build_callbacks(config.callbacks, config.trainer.flags), model.fit_values
    working = checkpoint_of(directory, card.kind).with_suffix("")
    with quiet_lightning():
        make_trainer(config.trainer, callbacks, loggers, fit(card.kind), working, validated=True)
    senses = [_try_sense(model, card.of([name]), sources.get(name)) for name in card.sense_names]
    if card.kind == FUSION:
        make_module(model, card, config.seed).configure_optimizers()
    return senses


def _try_sense(model: ModelConfig, card: Card, source: str | None) -> Sense:
    """Make one sense as it will be trained, or load it from the checkpoint that is given."""
    name = card.kind
    if name in model.checkpoints:
        return SurfaceClassifier.from_checkpoint(model.checkpoints[name], name).senses[name]
    module = make_module(model, card, 0)
    module.configure_optimizers()
    if source is not None:
        start_trunk(module.classifier, source)
    sense, fit = module.classifier.eval().senses[name], model.sense(name).fit
    least = sense.known_min_size if is_builtin(sense.features) else None
    if least is not None and fit.piece < least[1]:
        raise UserError(
            f"model.{name}.fit.{fit.piece_key} is {fit.piece}, and this network needs {least[1]} "
            f"for a prediction; choose {least[1]} or more."
        )
    return sense


def try_custom_parts(
    model: ModelConfig, card: Card, senses: Sequence[Sense], recordings: Recordings, store: Store
) -> None:
    """Train the senses with custom parts on two recordings, as in the run.

    Args:
        model: Settings of the training.
        card: Card of the model, for the classes of the data.
        senses: Senses of the model.
        recordings: Decoded recordings.
        store: Store of the decoded recordings.

    Raises:
        UserError: If a part does not keep its contract.
    """
    for sense in senses if model.baseline is None else ():
        fit, name = model.fit_values(sense.name), sense.name
        builtin = sense.is_builtin and fit.get("augmentation") is None
        if not builtin and name not in model.checkpoints:
            try_sense(card.of([name]), fit, model.sense(name).fit.piece, recordings, store)


def try_sense(
    card: Card, fit: Mapping[str, Any], piece: int, recordings: Recordings, store: Store
) -> None:
    """Train one sense with custom parts on two recordings, save and load it.

    Args:
        card: Its card, for the classes of the data.
        fit: The settings of its training.
        piece: Length or side of the pieces that it is trained on.
        recordings: Decoded recordings.
        store: Store of the decoded recordings.

    Raises:
        UserError: If a part does not keep its contract.
    """
    module = SurfaceModule(card, dict(fit), 0, {card.kind: piece})
    (sense,), network = module.classifier.senses.values(), module.network
    features, scored = _parts(sense)
    rows = _largest(recordings.of(sense.modality), store, FITTED if hasattr(network, "fit") else 1)
    labels = np.array(class_indices([row.label for row in rows], card.classes))
    bank = sense.bank(rows, store, fit, size=piece, seed=0, learn=True)
    if hasattr(network, "fit"):
        with calling(*scored):
            fit_closed_form(network, bank, labels, [row.group_key for row in rows])
    if any(weight.requires_grad for weight in sense.features.parameters()):
        log.warning(
            "%s (%s) has parameters, and training does not change those of features; put layers "
            "that learn into model.%s.network.", features[0], type(sense.features).__name__,
            card.kind,
        )  # fmt: skip
    batch = TrainingBatches({card.kind: (bank, labels)}, BATCH, 0)[0]
    _check_numbers(module.train().inputs(batch)[0], features)
    scores = module.scores(batch)
    _check_scores(scores[0], scored, len(card.classes))
    if fit["epochs"]:  # else what has only buffers is fitted in closed form
        _check_gradient(scores, sense, scored)
    _check_outputs(module.classifier.eval(), [as_tensor(store.load(row)) for row in rows[:BATCH]])


def try_baseline(classifier: BaselineClassifier, recordings: Sequence[Tensor]) -> None:
    """Check what a user's fitted baseline gives, and that its state is all that it has learnt.

    Args:
        classifier: Classifier with the fitted baseline.
        recordings: Decoded recordings that it was fitted to.

    Raises:
        UserError: If it does not keep its contract.
    """
    if type(classifier.baseline).__module__.startswith(OWN):
        return
    part = as_part(classifier.baseline)
    with calling(*part):
        state: object = classifier.baseline.state()
    if not isinstance(state, dict) or not all(isinstance(x, Tensor) for x in state.values()):
        raise breach(*part, f"has a state that is {describe(state)} of other things than tensors")
    _check_outputs(classifier.eval(), recordings[:BATCH])


def _parts(sense: Sense) -> tuple[Part, Part]:
    """Return features and network, as a contract names them."""
    key, network = f"model.{sense.name}", sense.network
    if isinstance(network, FittedBaseline):
        return (f"{key}.features", "features", sense.features), as_part(network.baseline)
    return (f"{key}.features", "features", sense.features), (f"{key}.network", "network", network)


def _largest(recordings: Recordings, store: Store, count: int) -> list[Recording]:
    """Return the largest ``count`` recordings of each class."""
    largest: list[Recording] = []
    for label in recordings.classes:
        rows = [row for row in recordings.rows if row.label == label]
        largest += sorted(rows, key=store.extent, reverse=True)[:count]
    return largest


def _check_numbers(values: Tensor, part: Part) -> None:
    if not values.is_floating_point():
        raise breach(*part, f"returned {describe(values)}")
    if not bool(values.isfinite().all()):
        raise breach(*part, "gave NaN or infinity")


def _check_scores(scores: Tensor, part: Part, classes: int) -> None:
    if len(scores) != classes:
        raise breach(
            *part, f"gave {len(scores)} scores at each position, and there are {classes} classes"
        )
    _check_numbers(scores, part)


def _check_gradient(scores: Tensor, sense: Sense, part: Part) -> None:
    if not scores.requires_grad:
        raise breach(*part, "gave scores without a gradient, so nothing can be trained")
    with calling(*part):
        scores.square().sum().backward()  # type: ignore[no-untyped-call]  # no annotation
    gradients = [weight.grad for weight in sense.network.parameters() if weight.grad is not None]
    if not all(bool(weight.isfinite().all()) for weight in gradients):
        raise breach(*part, "gave scores with a gradient that is NaN or infinite")


@torch.inference_mode()
def _check_outputs(classifier: SurfaceClassifier, recordings: Sequence[Tensor]) -> None:
    """Check the scores of recordings, and that they are the same once a checkpoint is loaded."""
    rebuilt = type(classifier)(Card.from_dict(classifier.card.to_dict())).eval()
    rebuilt.load_state_dict(_saved(classifier.state_dict()))
    (sense,), (again,) = classifier.senses.values(), rebuilt.senses.values()
    (features, scored), classes = _parts(sense), len(classifier.card.classes)
    for recording in recordings:
        _check_same(partial(sense, recording), partial(again, recording), features)
        with calling(*scored):  # by its score_layer, if it has one
            scores = classifier.partial_logits(sense.name, recording)
        _check_scores(scores, scored, classes)
        positions = partial(sense.positions, recording, "fc3")
        _check_same(positions, partial(again.positions, recording, "fc3"), scored)


def _saved(state: dict[str, Any]) -> dict[str, Any]:
    """Return a state as it comes out of a file."""
    file = io.BytesIO()
    torch.save(state, file)
    file.seek(0)
    loaded: dict[str, Any] = torch.load(file, weights_only=True)
    return loaded


def _check_same(run: Callable[[], Tensor], again: Callable[[], Tensor], part: Part) -> None:
    """Check that two calls give the same but for rounding."""
    outputs = []
    for call in (run, again):
        torch.manual_seed(0)  # of what draws
        outputs.append(call().double())
    one, other = outputs
    if one.shape != other.shape or not torch.allclose(one, other, rtol=1e-3, atol=1e-4):
        raise breach(
            *part, "gives other outputs once it is saved and loaded: of what it learns only "
            "parameters, buffers (register_buffer) and the state() of a baseline are kept",
        )  # fmt: skip
