"""Check the contract of the parts of a sense: train on two recordings, save, load, compare.

A part that does not keep its contract is a UserError (:func:`~tex_lightning.core.contract.breach`).
"""

import io
import logging
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import chain
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.core.contract import Component, breach, calling, check_call, describe_value
from tex_lightning.data.datamodule import TrainingBatches
from tex_lightning.data.recordings import Recording, Recordings, class_indices
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import is_builtin
from tex_lightning.networks.trunks import Trunk
from tex_lightning.senses.base import Augment, Sense, as_tensor
from tex_lightning.senses.signal import fit_closed_form

log = logging.getLogger(__name__)

FITTED = 4  # recordings of a class on which a fit in closed form is tried
BATCH = 2
UNSAVED = "gives other outputs once it is saved and loaded"


def check_parts(
    classifier: SurfaceClassifier,
    rebuilt: SurfaceClassifier,
    fit: Mapping[str, Any],
    piece: int,
    recordings: Recordings,
    store: Store,
    augment: Augment | None = None,
) -> None:
    """Check the parts of one sense: train it on two recordings, save it and load it again.

    Args:
        classifier: Classifier of a single sense.
        rebuilt: A new classifier of the same card, which gets the state of ``classifier``.
        fit: The training recipe.
        piece: Length or side of the pieces that it is trained on.
        recordings: Decoded recordings.
        store: Store of the decoded recordings.
        augment: The augmentation of photos; None for none.

    Raises:
        UserError: If a part does not keep its contract.
    """
    (sense,), network, card = classifier.senses.values(), classifier.network, classifier.card
    features, scored = parts_of(sense)
    _check_calls(sense)
    rows = _largest(recordings.of(sense.modality), store, FITTED if hasattr(network, "fit") else 1)
    labels = np.array(class_indices([row.label for row in rows], card.classes))
    bank = sense.bank(rows, store, fit, size=piece, seed=0, learn=True)
    _check_normalised(sense, as_tensor(store.load(rows[0])))
    if hasattr(network, "fit"):
        with calling(*scored):
            fit_closed_form(network, bank, labels, [row.group_key for row in rows])
    _warn_of_parameters(sense)
    batch: Any = TrainingBatches({sense.name: (bank, labels)}, BATCH, 0)[0]
    classifier.train()
    inputs = sense.training_input(batch[sense.name], piece, augment)
    check_numbers(inputs, features)
    trunk = getattr(network, "trunk", None)
    if isinstance(trunk, Trunk) and not is_builtin(trunk):
        check_trunk((f"model.{sense.name}.trunk", "trunk", trunk), trunk, inputs)
    scores = sense.score(inputs, "fc3").flatten(2)
    check_scores(scores[0], scored, len(card.classes))
    if fit["epochs"]:  # else what has only buffers is fitted in closed form
        check_gradient(scores, sense, scored)
    examples = [as_tensor(store.load(row)) for row in rows[:BATCH]]
    for row, example in zip(rows, examples, strict=False):
        _check_size(sense, row, example)
    check_outputs(classifier.eval(), rebuilt.eval(), examples)


def parts_of(sense: Sense) -> tuple[Component, Component]:
    """Return features and network of a sense with their keys, as contracts name them."""
    key, network = f"model.{sense.name}", sense.network
    scored: Component = getattr(network, "contract_part", (f"{key}.network", "network", network))
    return (f"{key}.features", "features", sense.features), scored


def _check_calls(sense: Sense) -> None:
    """Reject features or a network whose methods lack the parameters of their contract."""
    features, scored = parts_of(sense)
    if not is_builtin(sense.features):
        argument = "signal" if sense.medium == "signal" else "photos"
        check_call(features, sense.features.forward, argument)
    network: Any = sense.network
    if not is_builtin(network):
        check_call(scored, network.features, "x", "level")


def _check_size(sense: Sense, row: Recording, recording: Tensor) -> None:
    """Name the file if even the largest recording is too small for one prediction."""
    try:
        if sense.knows_min_size:
            sense.check(recording)
    except UserError as error:
        raise UserError(f"{row.source}: {error}") from error


def _check_normalised(sense: Sense, recording: Tensor) -> None:
    """Reject features that give a network other shapes in a training than in a prediction."""
    part, features = parts_of(sense)[0], cast(Any, sense.features)
    if is_builtin(sense.features) or not hasattr(features, "magnitudes"):
        return
    with calling(*part), torch.no_grad():
        trained = tuple(features.normalise(features.magnitudes(recording))[None, None].shape)
        given = tuple(features(recording).shape)
    if trained != given:
        raise breach(
            *part,
            f"gives {given} by forward(signal) and {trained} by normalise(magnitudes(signal))"
            "[None, None], which a training takes in its place",
        )


def _warn_of_parameters(sense: Sense) -> None:
    """Warn that no training changes parameters of features."""
    if any(weight.requires_grad for weight in sense.features.parameters()):
        log.warning(
            "model.%s.features (%s) has parameters, and training does not change those of "
            "features; put layers that learn into model.%s.network.",
            sense.name, type(sense.features).__name__, sense.name,
        )  # fmt: skip


def _largest(recordings: Recordings, store: Store, count: int) -> list[Recording]:
    """Return the largest ``count`` recordings of each class."""
    of_class: dict[str, list[Recording]] = {label: [] for label in recordings.classes}
    for row in sorted(recordings, key=store.extent, reverse=True):
        if len(of_class[row.label]) < count:
            of_class[row.label].append(row)
    return list(chain.from_iterable(of_class.values()))


def check_numbers(values: Tensor, part: Component) -> None:
    """Reject values that are not finite floating-point numbers."""
    if not values.is_floating_point():
        raise breach(*part, f"returned {describe_value(values)}")
    if not bool(values.isfinite().all()):
        raise breach(*part, "gave NaN or infinity")


def check_scores(scores: Tensor, part: Component, classes: int) -> None:
    """Reject scores (classes, positions) of another number of classes, or not finite."""
    if len(scores) != classes:
        raise breach(
            *part, f"gave {len(scores)} scores at each position, and there are {classes} classes"
        )
    check_numbers(scores, part)


def check_gradient(scores: Tensor, sense: Sense, part: Component) -> None:
    """Reject scores without a gradient, or with one that is not finite."""
    if not scores.requires_grad:
        raise breach(*part, "gave scores without a gradient, so nothing can be trained")
    with calling(*part):
        scores.square().sum().backward()  # type: ignore[no-untyped-call]  # no annotation
    gradients = [weight.grad for weight in sense.network.parameters() if weight.grad is not None]
    if not all(bool(weight.isfinite().all()) for weight in gradients):
        raise breach(*part, "gave scores with a gradient that is NaN or infinite")


def check_trunk(part: Component, trunk: Trunk, images: Tensor) -> None:
    """Reject a trunk whose features are not finite (batch, out_channels, rows, columns).

    Args:
        part: The trunk, as its contract names it.
        trunk: The trunk.
        images: Images (batch, 3, height, width).

    Raises:
        UserError: If they are not.
    """
    check_call(part, trunk.forward, "images")
    with calling(*part):
        features: object = trunk(images)
    shape = features.shape if isinstance(features, Tensor) else ()
    if not isinstance(features, Tensor) or len(shape) != 4 or shape[0] != len(images):
        raise breach(*part, f"returned {describe_value(features)} for a batch of {len(images)}")
    if shape[1] != trunk.out_channels:
        raise breach(
            *part,
            f"returned {describe_value(features)}, and its out_channels are {trunk.out_channels}",
        )
    check_numbers(features, part)


@torch.inference_mode()
def check_outputs(
    classifier: SurfaceClassifier, rebuilt: SurfaceClassifier, recordings: Sequence[Tensor]
) -> None:
    """Check the scores of recordings, and that a loaded checkpoint gives the same."""
    (sense,), (again,) = classifier.senses.values(), rebuilt.senses.values()
    (features, scored), classes = parts_of(sense), len(classifier.card.classes)
    try:
        rebuilt.load_state_dict(saved(classifier.state_dict()))
    except RuntimeError as error:  # PyTorch names what is missing or of another size
        wrong = re.search(r"\bsenses\.\w+\.(features|network)\.([\w.]+)", str(error))
        if wrong is None:
            raise
        part = features if wrong[1] == "features" else scored
        raise breach(
            *part, f"cannot be loaded from a checkpoint: its constructor makes no {wrong[2]} of "
            "the size that is saved",
        ) from error  # fmt: skip
    for recording in recordings:
        check_same(partial(sense, recording), partial(again, recording), features)
        with calling(*scored):  # by its score_layer, if it has one
            scores = classifier.partial_logits(sense.name, recording)
        check_scores(scores, scored, classes)
        positions = partial(sense.positions, recording, "fc3")
        check_same(positions, partial(again.positions, recording, "fc3"), scored)


def check_baseline(
    classifier: SurfaceClassifier, rebuilt: SurfaceClassifier, recordings: Sequence[Tensor]
) -> None:
    """Check the outputs of a fitted baseline, and that its state restores them."""
    (sense,), network = classifier.senses.values(), cast(Any, classifier.network)
    _, part = parts_of(sense)
    with calling(*part):
        state: object = network.baseline.state()
    if not isinstance(state, dict) or not all(isinstance(x, Tensor) for x in state.values()):
        raise breach(
            *part, f"has a state that is {describe_value(state)} of other things than tensors"
        )
    check_outputs(classifier.eval(), rebuilt.eval(), recordings)


def saved(state: Mapping[str, Any]) -> dict[str, Any]:
    """Return a state after it was written to a file and read back."""
    file = io.BytesIO()
    torch.save(state, file)
    file.seek(0)
    loaded: dict[str, Any] = torch.load(file, weights_only=True)
    return loaded


def check_same(run: Callable[[], Tensor], again: Callable[[], Tensor], part: Component) -> None:
    """Check that two calls return the same but for rounding."""
    outputs = []
    for call in (run, again):
        torch.manual_seed(0)  # of what draws
        outputs.append(call().double())
    one, other = outputs
    if one.shape != other.shape or not torch.allclose(one, other, rtol=1e-3, atol=1e-4):
        raise breach(
            *part, f"{UNSAVED}: of what it learns only parameters, buffers (register_buffer) and "
            "the state() of a baseline are kept",
        )  # fmt: skip
