"""The contract check of every class that a user brings to a training, run once before work."""

import io
import logging
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tex_lightning.baselines.classifier import BaselineClassifier, Loaded, as_part
from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config.instantiation import OWN
from tex_lightning.core.contract import breach, calling, describe
from tex_lightning.data.datamodule import TrainingBatches
from tex_lightning.data.recordings import Recording, Recordings, class_indices
from tex_lightning.data.store import Store
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.learning.start import fit_closed_form
from tex_lightning.networks.blocks import score_layer_of
from tex_lightning.senses.base import Sense, as_tensor

log = logging.getLogger(__name__)

FITTED = 4  # recordings of a class on which a fit in closed form is tried
BATCH = 2
LEARNT_OUTSIDE = "once it is saved and loaded, since it has learnt something outside of its "

Part = tuple[str, str, object]  # key, kind and object, as a contract names them


def try_branch(
    card: Card, fit: Mapping[str, Any], piece: int, recordings: Recordings, store: Store
) -> None:
    """Take one sense with parts of a user's own through a training of two recordings and back.

    Args:
        card: Its card, for the classes of the data.
        fit: The settings of its training.
        piece: Length or side of the pieces that it is trained on.
        recordings: Decoded ones.
        store: Holds them.

    Raises:
        UserError: If a part does not keep its contract.
    """
    module = SurfaceModule(card.to_dict(), dict(fit), 0, {card.kind: piece})
    classifier, network = module.classifier, module.network
    sense = classifier.senses[card.kind]
    features: Part = f"model.{card.kind}.features", "features", sense.features
    scored: Part = f"model.{card.kind}.network", "network", network
    rows = _largest(recordings.of(sense.modality), store, FITTED if hasattr(network, "fit") else 1)
    labels = np.array(class_indices([row.label for row in rows], card.classes))
    bank = sense.bank(rows, store, fit, size=piece, seed=0, learn=True)
    if hasattr(network, "fit"):
        with calling(*scored):
            fit_closed_form(network, bank, labels, [row.group_key for row in rows])
    if any(each.requires_grad for each in sense.features.parameters()):
        log.warning(
            "%s (%s) has parameters, and training does not change those of features; put layers "
            "that learn into model.%s.network.", features[0], type(sense.features).__name__,
            card.kind,
        )  # fmt: skip
    batch = TrainingBatches({card.kind: (bank, labels)}, BATCH, 0)[0]
    _check_numbers(module.train().inputs(batch)[0], features)
    scores = module.scores(batch)
    _check_scores(scores, scored, len(card.classes), dim=1)
    if fit["epochs"]:  # else what has only buffers is fitted in closed form
        _check_gradient(scores, sense, scored)
    classifier.eval()
    decoded = [as_tensor(store.load(row)) for row in rows[:BATCH]]
    with torch.inference_mode():
        for recording in decoded:
            _check_scores(sense.positions(recording, "fc3"), scored, len(card.classes), dim=0)
            _check_score_layer(sense, recording, scored, len(card.classes))
        _check_rebuilt(classifier, decoded, features, scored)


def _largest(recordings: Recordings, store: Store, count: int) -> list[Recording]:
    """Return so many recordings of each class, the largest ones."""
    found: list[Recording] = []
    for label in recordings.classes:
        rows = [row for row in recordings.rows if row.label == label]
        found += sorted(rows, key=store.extent, reverse=True)[:count]
    return found


def _check_numbers(found: Tensor, part: Part) -> None:
    if not found.is_floating_point():
        raise breach(*part, f"returned {describe(found)}")
    if not bool(found.isfinite().all()):
        raise breach(*part, "gave NaN or infinity")


def _check_scores(scores: Tensor, part: Part, classes: int, *, dim: int) -> None:
    if scores.shape[dim] != classes:
        raise breach(
            *part,
            f"gave {scores.shape[dim]} scores at each position, and there are {classes} classes",
        )
    _check_numbers(scores, part)


def _check_gradient(scores: Tensor, sense: Sense, part: Part) -> None:
    if not scores.requires_grad:
        raise breach(*part, "gave scores without a gradient, so nothing can be trained")
    with calling(*part):
        scores.square().sum().backward()  # type: ignore[no-untyped-call]  # no annotation
    gradients = [each.grad for each in sense.network.parameters() if each.grad is not None]
    if not all(bool(each.isfinite().all()) for each in gradients):
        raise breach(*part, "gave scores with a gradient that is NaN or infinite")


def _check_score_layer(sense: Sense, recording: Tensor, part: Part, classes: int) -> None:
    layer = score_layer_of(sense.network)
    if layer is None:
        return
    (rows, columns), hidden = layer.weight.shape[:2], len(sense.positions(recording, "fc2"))
    if (rows, columns) != (classes, hidden):
        raise breach(
            *part,
            f"has a score_layer that turns {columns} features into {rows} scores, and at level fc2 "
            f"it gave {hidden} features, for {classes} classes",
        )


def _check_rebuilt(
    classifier: SurfaceClassifier, recordings: Sequence[Tensor], features: Part, scored: Part
) -> None:
    """Check that a classifier of one sense gives the same once it is rebuilt from what is saved."""
    rebuilt = SurfaceClassifier(Card.from_dict(classifier.card.to_dict()))
    rebuilt.load_state_dict(_saved(classifier.state_dict()))
    senses = [*classifier.senses.values(), *rebuilt.eval().senses.values()]
    for recording in recordings:
        if not _same([partial(each, recording) for each in senses]):
            raise breach(
                *features, f"gives other outputs {LEARNT_OUTSIDE}parameters and buffers: "
                "register_buffer keeps it",
            )  # fmt: skip
        if not _same([partial(each.positions, recording, "fc3") for each in senses]):
            raise breach(
                *scored, f"gives other scores {LEARNT_OUTSIDE}parameters and buffers: "
                "register_buffer keeps it",
            )  # fmt: skip


def _saved(state: dict[str, Tensor]) -> dict[str, Tensor]:
    file = io.BytesIO()
    torch.save(state, file)
    file.seek(0)
    found: dict[str, Tensor] = torch.load(file, weights_only=True)
    return found


def _same(functions: Sequence[Callable[[], Tensor]]) -> bool:
    """Return whether two functions give the same but for rounding."""
    found = []
    for function in functions:
        torch.manual_seed(0)  # of what draws
        found.append(function().double())
    one, other = found
    return one.shape == other.shape and torch.allclose(one, other, rtol=1e-3, atol=1e-4)


@torch.inference_mode()
def try_baseline(classifier: BaselineClassifier, recordings: Loaded) -> None:
    """Check what a user's fitted baseline gives, and that its state is all that it has learnt.

    Args:
        classifier: Holds it.
        recordings: What it was fitted to.

    Raises:
        UserError: If it does not keep its contract.
    """
    if type(classifier.baseline).__module__.startswith(OWN):
        return
    part, classes = as_part(classifier.baseline), len(classifier.card.classes)
    with calling(*part):
        state: object = classifier.baseline.state()
    if not isinstance(state, dict) or not all(isinstance(x, Tensor) for x in state.values()):
        raise breach(*part, f"has a state that is {describe(state)} of other things than tensors")
    rebuilt = BaselineClassifier(Card.from_dict(classifier.card.to_dict()))
    with calling(*part):
        rebuilt.baseline.load_state(_saved(state))
        counts = [each.baseline.count_parameters() for each in (classifier, rebuilt)]
    if not all(isinstance(count, int) for count in counts) or counts[0] != counts[1]:
        raise breach(*part, f"counts parameters as {counts[0]!r} and loaded as {counts[1]!r}")
    networks: list[Any] = [each.network for each in (classifier, rebuilt)]
    for recording in recordings[:BATCH]:
        scores = networks[0].scores(recording)
        if len(scores) != classes:
            raise breach(*part, f"gave {len(scores)} scores, and there are {classes} classes")
        _check_numbers(scores, part)
        if not _same([partial(each.scores, recording) for each in networks]):
            raise breach(*part, f"gives other scores {LEARNT_OUTSIDE}state")
