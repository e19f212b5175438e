"""Measure what a checkpoint keeps beside the weights: feature statistics and calibration.

The statistics describe the embeddings of every class. The validation fold gives the temperature of
the probabilities and the novelties of known samples, from which ``decision.unknown`` is set.
"""

import math
from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from tex_lightning.classifier.card import NOVELTIES
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.statistics import FeatureStatistics, TrainingRows
from tex_lightning.config import EngineConfig
from tex_lightning.core.devices import to_cpu
from tex_lightning.core.groups import leave_out
from tex_lightning.core.progress import track
from tex_lightning.data.banks import Bank, InputBank
from tex_lightning.data.folds import Split, make_samples
from tex_lightning.data.recordings import Recording, Recordings, class_indices, plural
from tex_lightning.data.store import Store, load_recording, load_sample
from tex_lightning.errors import UserError
from tex_lightning.evaluation.calibration import sample_loss, sample_temperature
from tex_lightning.inference.engine import accelerate
from tex_lightning.learning.linear_head import FrozenTrunk, fits_probabilities, scores_textures
from tex_lightning.networks.blocks import score_layer_of
from tex_lightning.networks.ridge import discriminants

MAX_FEATURE = 1e18  # whose square is a float32
MIN_RECORDINGS = 5  # of a class, on average, that tell how recordings of a class differ
REACH = 0.9  # share of left-out recordings that are like the training


def set_statistics(
    classifier: SurfaceClassifier,
    rows: Recordings,
    store: Store,
    engine: EngineConfig,
    banks: Mapping[str, Bank],
    *,
    frozen: bool,
    closed_form: bool,
) -> dict[str, list[float | None]]:
    """Set the :attr:`~SurfaceClassifier.statistics` of every sense of a trained classifier.

    Its :attr:`~SurfaceClassifier.trained_embeddings` are set as well, and the
    :attr:`~SurfaceClassifier.rows` of a network that keeps them. It is on the device that computes,
    and is left in evaluation mode. Network inputs in the ``banks`` of the training are used again,
    and if no step was taken (``frozen``) the cached texture features of a trunk.

    ``closed_form`` says that no layer before the scores was trained on the recordings, not even in
    the networks that a fusion starts from. Recordings that are left out of the statistics are then
    like new ones. They give ``reach`` and ``error`` of the statistics, by which a fusion weights
    its senses.

    Returns:
        By sense the novelty of each recording when it is left out (:func:`leave_out_each`); None
        for the only recording of a class. Lists are empty if no class has two recordings, and there
        are none unless ``closed_form``.

    Raises:
        UserError: If features are NaN, or so large that their squares overflow.
    """
    left_out: dict[str, list[float | None]] = {}
    classes = classifier.card.classes
    fast = accelerate(classifier.eval(), engine)
    for name, sense in classifier.senses.items():
        recordings = rows.of(sense.modality).rows
        labels = torch.tensor(class_indices([row.label for row in recordings], classes))
        if frozen and scores_textures(sense.network):
            features = _texture_features(classifier, fast, name, recordings, store)
        else:
            positions = position_features(fast, name, recordings, store, banks.get(name))
            features = torch.stack([embedding.mean(dim=1) for embedding in positions]).cpu()
        if not bool((features.abs() < MAX_FEATURE).all()):  # false for NaN
            raise UserError(
                f"Training of the {name} network diverged, its features are NaN or too large to "
                f"square; lower model.{name}.fit.learning_rate or weight_decay of its optimizer."
            )
        classifier.trained_embeddings[name] = recordings, features
        groups = [row.group_key for row in recordings]
        if closed_form:
            statistics, left_out[name] = statistics_with_reach(
                features, labels, len(classes), groups
            )
        else:
            statistics = FeatureStatistics.of(features, labels, len(classes))
        classifier.statistics[name] = statistics.to(classifier.device)
        if classifier.fusion is None and getattr(sense.network, "keep_rows", False):
            classifier.rows[name] = TrainingRows.of(features, labels, groups)
    return left_out


@torch.no_grad()
def refit_scores(classifier: SurfaceClassifier, shrinkage: float) -> bool:
    """Replace FC3 of a trained network by linear discriminants (Fisher 1936), in closed form.

    A network that fits every fragment of its few training recordings has nothing left to learn of
    how recordings of a class differ. The discriminants are those of the recordings' mean features,
    so that they count each recording once and weigh directions by the scatter between them
    (docs/reports/2026-11-29-last-layer.md). The scores keep their spread over the training
    recordings, and so the confidence that they have. FC3 stays as it is where it has no weights of
    its own, classes have fewer than five recordings on average, or features do not differ.

    Args:
        classifier: Of a single sense, after :func:`set_statistics`.
        shrinkage: Added to the variance of every feature within the classes, as a multiple of
            their mean.

    Returns:
        Whether FC3 is another.
    """
    ((name, (recordings, features)),) = classifier.trained_embeddings.items()
    layer: Any = score_layer_of(classifier.senses[name].network)
    classes = classifier.card.classes
    if layer is None or not isinstance(layer.weight, nn.Parameter):
        return False
    if len(recordings) < MIN_RECORDINGS * len(classes):
        return False
    labels = torch.tensor(class_indices([row.label for row in recordings], classes))
    rows = features.cpu().double()
    coefficients, intercept = discriminants(rows, labels, len(classes), shrinkage)
    trained = rows @ layer.weight.cpu().double().flatten(1).T + layer.bias.cpu().double()
    centred = [x - x.mean(dim=1, keepdim=True) for x in (trained, rows @ coefficients + intercept)]
    factor = float(centred[0].norm() / centred[1].norm())
    if not 0 < factor < math.inf:
        return False
    coefficients -= coefficients.mean(dim=1, keepdim=True)  # what all classes have in common
    layer.weight.copy_((factor * coefficients.T).reshape(layer.weight.shape))
    layer.bias.copy_(factor * (intercept - intercept.mean()))
    return True


def statistics_with_reach(
    features: Tensor, labels: Tensor, classes: int, groups: Sequence[Hashable]
) -> tuple[FeatureStatistics, list[float | None]]:
    """Return statistics with ``reach`` and ``error``, and novelties of left-out recordings.

    Arguments are those of :func:`leave_out_each`; novelties are as :func:`set_statistics` returns
    them.
    """
    statistics = FeatureStatistics.of(features, labels, classes)
    novelty, distance, errs = leave_out_each(features, labels, classes, groups).T
    if bool(novelty.isnan().all()):
        return statistics, []
    statistics.reach.copy_(distance.nanquantile(REACH))
    # half of the error rate by Laplace's rule: a recording that is taken for another class still
    # says something of its own
    measured = (~errs.isnan()).sum()
    statistics.error.copy_((errs.nansum() + 1) / (measured + 2) / 2)
    return statistics, [None if math.isnan(value) else value for value in novelty.tolist()]


def leave_out_each(
    features: Tensor, labels: Tensor, classes: int, groups: Sequence[Hashable]
) -> Tensor:
    """Measure every training recording by statistics from which its group was left out.

    Args:
        features: (recordings, D).
        labels: (recordings,) class indices, of every class at least one.
        classes: Number of classes.
        groups: Group of each recording.

    Returns:
        (recordings, 3): novelty, distance to the closest class, and 1 if that is a wrong class,
        else 0. A recording that is never left out, such as the only one of its class, has NaN.
    """
    parts = torch.tensor(leave_out(labels.tolist(), groups))
    measured = torch.full((len(parts), 3), torch.nan)
    for part in set(parts.tolist()) - {-1}:
        out = parts == part
        statistics = FeatureStatistics.of(features[~out], labels[~out], classes)
        distance, closest = statistics.nearest(features[out])
        errs = (closest != labels[out]).to(distance)
        measured[out] = torch.stack((statistics.novelty(features[out]), distance, errs), dim=1)
    return measured


def _texture_features(
    classifier: SurfaceClassifier,
    fast: SurfaceClassifier,
    name: str,
    rows: Sequence[Recording],
    store: Store,
) -> Tensor:
    """Return texture features (recordings, D) of whole photos, on the CPU, cached in the store."""
    trunk = FrozenTrunk(fast, name)
    photos = track(rows, f"Statistics of {plural(rows[0].modality)}")
    raw = [trunk.kept(store.load(row), (0, 0), row, store) for row in photos]
    network: Any = classifier.senses[name].network
    features: Tensor = network.trunk.layers[-1].standardised(torch.stack(raw).to(classifier.device))
    return features.cpu()


@torch.inference_mode()
def position_features(
    classifier: SurfaceClassifier,
    name: str,
    rows: Sequence[Recording],
    store: Store,
    bank: Bank | None = None,
) -> Iterator[Tensor]:
    """Yield features (D, positions) of one sense, on the device that computes, of each recording.

    Args:
        classifier: In evaluation mode.
        name: Name of the sense.
        rows: Recordings of its modality.
        store: Where they are decoded.
        bank: Bank whose network inputs are used, if its recordings are the same; else None.
    """
    modality = classifier.senses[name].modality
    inputs = bank.inputs if isinstance(bank, InputBank) and bank.as_given else None
    for number, row in enumerate(track(rows, f"Statistics of {plural(modality)}")):
        if inputs is None:
            yield classifier.embedding(name, load_recording(row, store))
        else:
            x = inputs[number][None].to(classifier.device)
            yield classifier.embedding_of_input(name, x)


@torch.inference_mode()
def calibrate(
    classifier: SurfaceClassifier,
    parts: Split,
    store: Store,
    engine: EngineConfig,
    left_out: Mapping[str, Sequence[float | None]],
    loss: float | None,
) -> tuple[dict[str, Any], float | None]:
    """Measure temperature and novelties of a classifier, or of a baseline, on the validation fold.

    The novelties of known samples set the threshold of ``decision.unknown``. If no layer before the
    scores was trained, they include those of left-out training recordings. Trained features fit
    their training recordings too well for that: of new recordings a third would be above the 95 %
    quantile (docs/calibration.md).

    Returns:
        ``calibration`` of the card, and the validation loss. That is the given one of the best
        epoch; if it is None, since no step was taken or FC3 is another, it is measured, unless
        there is no fold.
    """
    card, samples = classifier.card, make_samples(parts.val, classifier.card.modalities)
    fast, scores, validated = accelerate(classifier, engine), [], []
    for sample in samples:
        recordings = load_sample(sample, store)
        outputs = fast.sense_outputs(**recordings).values()
        partials = [output.partial_logits for output in outputs]
        scores.append(fast.fuse(partials, fast.seed(**recordings)))
        validated.append([output.novelty for output in outputs if output.novelty is not None])
    calibration: dict[str, Any] = {}
    if samples:
        # such scores are calibrated on all training recordings, better than on a few samples
        fitted = any(left_out.values()) and fits_probabilities(classifier)
        temperature = card.temperature if fitted else sample_temperature(card, samples, scores)
        loss = sample_loss(card, samples, scores, temperature) if loss is None else loss
        calibration = {} if fitted else {"temperature": temperature}
    if classifier.statistics:
        known = [x.tolist() for x in to_cpu([*map(torch.stack, validated)])]
        if rows := [*_left_out(left_out, classifier, parts), *known]:
            columns = map(list, zip(*rows, strict=True))
            calibration[NOVELTIES] = dict(zip(card.sense_names, columns, strict=True))
    return calibration, loss


def _left_out(
    novelties: Mapping[str, Sequence[float | None]], classifier: SurfaceClassifier, parts: Split
) -> list[list[float]]:
    """Return the novelties by all senses of those training samples that have all of them."""
    if not all(novelties.get(name) for name in classifier.card.sense_names):
        return []
    modalities = {name: sense.modality for name, sense in classifier.senses.items()}
    known = {
        name: dict(zip(parts.train.of(modality).rows, novelties[name], strict=True))
        for name, modality in modalities.items()
    }
    samples = make_samples(parts.train, classifier.card.modalities)
    rows = [
        [known[name][sample.recordings[modality]] for name, modality in modalities.items()]
        for sample in samples
    ]
    return [[x for x in row if x is not None] for row in rows if None not in row]
