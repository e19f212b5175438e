"""Try every class of a user's own once: it keeps its contract, and a checkpoint holds its state."""

import io
import logging
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor, nn

from tex_lightning.baselines.classifier import BaselineClassifier, Loaded, as_part
from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config.instantiation import OWN
from tex_lightning.core.contract import breach, calling, check_batch, describe
from tex_lightning.data.datamodule import TrainingBatches
from tex_lightning.data.recordings import Recording, Recordings, class_indices
from tex_lightning.data.store import Store
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.learning.start import fit_closed_form
from tex_lightning.networks.blocks import score_layer_of
from tex_lightning.senses.base import Sense, as_tensor

if TYPE_CHECKING:
    from tex_lightning.baselines.base import Array

log = logging.getLogger(__name__)

FITTED = 4  # recordings of a class on which a fit in closed form is tried
BATCH = 2


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
    sense, fitted = classifier.sense(card.kind), hasattr(network, "fit")
    rows = _largest(recordings.of(sense.modality), store, FITTED if fitted else 1)
    labels = np.array(class_indices([row.label for row in rows], card.classes))
    bank = sense.bank(rows, store, fit, size=piece, seed=0, learn=True)
    if fitted:
        with calling(*sense.network_part):
            fit_closed_form(network, bank, labels, [row.group_key for row in rows])
    _warn_of_untrained(sense)
    batch = TrainingBatches({card.kind: (bank, labels)}, BATCH, 0)[0]
    inputs = module.train().inputs(batch)[0]
    _check_numbers(inputs, *sense.features_part)
    _check_scores(module.scores(batch), sense, len(card.classes), trained=fit["epochs"] > 0)
    classifier.eval()
    decoded = [as_tensor(store.load(row)) for row in rows[:BATCH]]
    with torch.inference_mode():
        for recording in decoded:
            _check_whole(sense, recording, len(card.classes))
    check_rebuilt(classifier, decoded)


def _largest(recordings: Recordings, store: Store, count: int) -> list[Recording]:
    """So many recordings of each class, the largest ones."""
    found: list[Recording] = []
    for label in recordings.classes:
        rows = [row for row in recordings.rows if row.label == label]
        found += sorted(rows, key=store.extent, reverse=True)[:count]
    return found


def _warn_of_untrained(sense: Sense) -> None:
    if any(each.requires_grad for each in sense.features.parameters()):
        key, _, part = sense.features_part
        log.warning(
            "%s (%s) has parameters, and training does not change those of features; put layers "
            "that learn into model.%s.network.", key, type(part).__name__, sense.name,
        )  # fmt: skip


def _check_numbers(found: Tensor, key: str, kind: str, part: object) -> None:
    if not found.is_floating_point():
        raise breach(key, kind, part, f"returned {describe(found)}")
    if not bool(found.isfinite().all()):
        raise breach(key, kind, part, "gave NaN or infinity")


def _check_scores(scores: Tensor, sense: Sense, classes: int, *, trained: bool) -> None:
    """Check class scores (batch, classes, fragments) of training pieces, and their gradient."""
    part = sense.network_part
    check_batch(scores, *part, BATCH, 3)
    if scores.shape[1] != classes:
        raise breach(
            *part,
            f"gave {scores.shape[1]} scores at each position, and there are {classes} classes",
        )
    _check_numbers(scores, *part)
    if not trained:  # what has only buffers is fitted in closed form
        return
    if not scores.requires_grad:
        raise breach(*part, "gave scores without a gradient, so nothing can be trained")
    with calling(*part):
        scores.square().sum().backward()  # type: ignore[no-untyped-call]  # no annotation
    gradients = [each.grad for each in sense.network.parameters() if each.grad is not None]
    if not all(bool(each.isfinite().all()) for each in gradients):
        raise breach(*part, "gave scores with a gradient that is NaN or infinite")


def _check_whole(sense: Sense, recording: Tensor, classes: int) -> None:
    """Check what is given for a whole recording, as in testing."""
    scores, part = sense.positions(recording, "fc3"), sense.network_part
    if len(scores) != classes:
        raise breach(
            *part, f"gave {len(scores)} scores at each position, and there are {classes} classes"
        )
    _check_numbers(scores, *part)
    layer = score_layer_of(sense.network)
    hidden = len(scores) if layer is None else len(sense.positions(recording, "fc2"))
    if layer is not None and tuple(layer.weight.shape[:2]) != (classes, hidden):
        rows, columns = layer.weight.shape[:2]
        raise breach(
            *part,
            f"has a score_layer that turns {columns} features into {rows} scores, and at level fc2 "
            f"it gave {hidden} features, for {classes} classes",
        )


def check_rebuilt(classifier: SurfaceClassifier, recordings: Sequence[Tensor]) -> None:
    """Check that a classifier of one sense scores as one that is rebuilt from what is saved of it.

    Args:
        classifier: In evaluation mode.
        recordings: Decoded ones.

    Raises:
        UserError: If it does not: something was learnt that no checkpoint holds.
    """
    file = io.BytesIO()
    torch.save(classifier.state_dict(), file)
    file.seek(0)
    rebuilt = SurfaceClassifier(Card.from_dict(classifier.card.to_dict()))
    state = torch.load(file, weights_only=True)
    rebuilt.expect_statistics(state)
    rebuilt.load_state_dict(state)
    rebuilt.eval().to(classifier.device)
    (sense,), (again,) = classifier.senses.values(), rebuilt.senses.values()
    for recording in recordings:
        if not same(*(_outputs(each, each.features, recording) for each in (sense, again))):
            raise breach(
                *sense.features_part,
                "gives other outputs once it is saved and loaded, since it has learnt something "
                "outside of its parameters and buffers: register_buffer keeps it",
            )
        if not same(*(_outputs(each, each.network, recording) for each in (sense, again))):
            raise breach(
                *sense.network_part,
                "gives other scores once it is saved and loaded, since it has learnt something "
                "outside of its parameters and buffers: register_buffer keeps it",
            )


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
    part, file = as_part(classifier.baseline), io.BytesIO()
    with calling(*part):
        state: object = classifier.baseline.state()
    if not isinstance(state, dict) or not all(isinstance(x, Tensor) for x in state.values()):
        raise breach(*part, f"has a state that is {describe(state)} of other things than tensors")
    torch.save(state, file)
    file.seek(0)
    rebuilt = BaselineClassifier(Card.from_dict(classifier.card.to_dict()))
    with calling(*part):
        rebuilt.baseline.load_state(torch.load(file, weights_only=True))
        counts = [each.baseline.count_parameters() for each in (classifier, rebuilt)]
    if not all(isinstance(count, int) for count in counts) or counts[0] != counts[1]:
        raise breach(*part, f"counts parameters as {counts[0]!r} and loaded as {counts[1]!r}")
    for recording in recordings[:BATCH]:
        found, again = (_scores(each, recording) for each in (classifier, rebuilt))
        if len(found) != len(classifier.card.classes):
            classes = len(classifier.card.classes)
            raise breach(*part, f"gave {len(found)} scores, and there are {classes} classes")
        _check_numbers(found, *part)
        if not same(found, again):
            raise breach(
                *part,
                "gives other scores once it is saved and loaded, since it has learnt something "
                "that is not in its state",
            )


@torch.inference_mode()
def _scores(classifier: BaselineClassifier, recording: "Array") -> Tensor:
    torch.manual_seed(0)  # of what draws
    network: Any = classifier.sense(classifier.card.kind).network
    scores: Tensor = network.scores(recording)
    return scores


@torch.inference_mode()
def _outputs(sense: Sense, part: nn.Module, recording: Tensor) -> Tensor:
    torch.manual_seed(0)  # of what draws
    return sense(recording) if part is sense.features else sense.positions(recording, "fc3")


def same(found: Tensor, again: Tensor) -> bool:
    """Return whether two outputs are equal but for rounding."""
    return found.shape == again.shape and torch.allclose(
        found.double(), again.double(), rtol=1e-3, atol=1e-4
    )
