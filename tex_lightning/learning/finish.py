"""Measure what a checkpoint keeps beside the weights: feature statistics and calibration.

The statistics describe the embeddings of every class. The validation fold gives the temperature of
the probabilities and the novelties of known samples, from which ``decision.unknown`` is set.
"""

import math
from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import Any, cast

import torch
from torch import Tensor

from tex_lightning.classifier.card import NOVELTIES, Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.statistics import FeatureStatistics, TrainingRows
from tex_lightning.config import EngineConfig
from tex_lightning.core.groups import leave_out
from tex_lightning.core.progress import track
from tex_lightning.data.banks import Bank, InputBank
from tex_lightning.data.folds import Sample, Split, make_samples
from tex_lightning.data.recordings import Recording, Recordings, class_indices, plural
from tex_lightning.data.store import Store, load_recording, load_sample
from tex_lightning.errors import UserError
from tex_lightning.evaluation.calibration import sample_loss, sample_temperature
from tex_lightning.inference.engine import accelerate
from tex_lightning.learning.start import FrozenTrunk, fits_probabilities, scores_textures

MAX_FEATURE = 1e18  # whose square is a float32
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

    Its :attr:`~SurfaceClassifier.trained_embeddings` are set, too, and the
    :attr:`~SurfaceClassifier.rows` of a network that keeps them.

    Args:
        classifier: Trained, on the device that computes the features; left in evaluation mode.
        rows: The training recordings, which are not perturbed.
        store: Where they are decoded.
        engine: Settings of the accelerated copy that computes the features.
        banks: By sense what was cut from the recordings: of signals the network inputs.
        frozen: Whether nothing but layers in closed form was trained, so that texture features
            are those of any other classifier.
        closed_form: Whether no layer before the scores has learnt the recordings, not even of the
            networks that a fusion starts from. Then those that are left out of the statistics in
            turn are as new ones, and tell the reach, beyond which a sense counts for less in a
            fusion, and the error, which bounds its say.

    Returns:
        By sense the novelties of its recordings that :func:`leave_out_each` gives: None of the only
        recording of a class, and nothing where every class has but one. Nothing at all unless
        ``closed_form``.

    Raises:
        UserError: If features are NaN, or their squares overflow, of weights that are finite.
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
            features = torch.stack([embedding.mean(dim=1) for embedding in positions])
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


def statistics_with_reach(
    features: Tensor, labels: Tensor, classes: int, groups: Sequence[Hashable]
) -> tuple[FeatureStatistics, list[float | None]]:
    """Return statistics with reach and error, and novelties, of recordings left out in turn.

    Arguments are those of :func:`leave_out_each`; novelties are those of :func:`set_statistics`.
    """
    statistics = FeatureStatistics.of(features, labels, classes)
    measured = leave_out_each(features, labels, classes, groups)
    if novelties := _known(measured[:, 0]):
        statistics.reach.copy_(measured[:, 1].nanquantile(REACH))
        statistics.error.copy_(_error_rate(measured[:, 2]))
    return statistics, novelties


def leave_out_each(
    features: Tensor, labels: Tensor, classes: int, groups: Sequence[Hashable]
) -> Tensor:
    """Measure every training recording by statistics without its part of the groups.

    Args:
        features: (recordings, D).
        labels: (recordings,) class indices, of every class at least one.
        classes: Number of classes.
        groups: Group of each recording.

    Returns:
        Novelty, distance to the closest class, and 1 if that is another one, else 0: (recordings,
        3). They are NaN of what is never left out: the only recording of a class, and all where
        every class has but one.
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


def _error_rate(errs: Tensor) -> Tensor:
    """Return half of the rate of errors, which are 1, among 0 and NaN, by Laplace's rule.

    Half, since a recording that is mistaken tells less of its class than others, but not nothing.
    """
    count = (~errs.isnan()).sum()
    return (errs.nansum() + 1) / (count + 2) / 2


def _known(novelties: Tensor) -> list[float | None]:
    """Return plain numbers, None for NaN; nothing where all are NaN."""
    if bool(novelties.isnan().all()):
        return []
    return [None if math.isnan(novelty) else novelty for novelty in novelties.tolist()]


def _texture_features(
    classifier: SurfaceClassifier,
    fast: SurfaceClassifier,
    name: str,
    rows: Sequence[Recording],
    store: Store,
) -> Tensor:
    """Return features (recordings, D), on the CPU, of whole photos that the store may have."""
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
    """Yield features (D, positions) of one sense, on the CPU, of each recording.

    Args:
        classifier: In evaluation mode.
        name: Name of the sense.
        rows: Recordings of its modality.
        store: Where they are decoded.
        bank: Their network inputs, if it begins with them: they are not computed once more.
    """
    sense, layer = classifier.senses[name], classifier.embedding_layer(name)
    inputs = bank.inputs if isinstance(bank, InputBank) and bank.as_given else None
    for number, row in enumerate(track(rows, f"Statistics of {plural(sense.modality)}")):
        if inputs is None:
            yield classifier.embedding(name, load_recording(row, store)).cpu()
        else:
            x = inputs[number][None].to(classifier.device)
            yield sense.dense_grid(x, layer).flatten(1).cpu()


@torch.inference_mode()
def calibrate(
    classifier: SurfaceClassifier,
    parts: Split,
    store: Store,
    engine: EngineConfig,
    left_out: Mapping[str, Sequence[float | None]],
    loss: float | None,
) -> tuple[dict[str, Any], float | None]:
    """Measure a trained classifier on the validation fold, for its card.

    That is the temperature, and the novelties of known samples that ``decision.unknown`` is set
    by. Where no layer before the scores was trained, those of training recordings that were left
    out of the statistics in turn are known samples, too; trained features fit their training
    recordings too well: of new ones a third would lie above their 95 % (docs/calibration.md).

    Args:
        classifier: Trained, on the device that computes.
        parts: Recordings by part.
        store: Decoded files.
        engine: Settings of the accelerated copy that computes scores and novelties.
        left_out: By sense the novelties of training recordings, or nothing.
        loss: The loss of the best epoch; None of what took no step.

    Returns:
        What the card has as ``calibration``, and the loss, which is None without validation.
    """
    card, samples = classifier.card, make_samples(parts.val, classifier.card.modalities)
    fast, scores, validated = accelerate(classifier, engine), [], []
    for sample in samples:
        recordings = load_sample(sample, store)
        outputs = fast.sense_outputs(**recordings).values()
        seed = 0 if fast.fusion is None else fast.seed(**recordings)
        scores.append(fast.fuse([output.partial_logits for output in outputs], seed))
        validated.append([float(cast(Tensor, output.novelty)) for output in outputs])
    # fitted with the weights, to all training recordings: one of a few samples would be worse
    fitted = any(left_out.values()) and fits_probabilities(classifier)
    calibration, loss = _calibrated(card, samples, scores, loss, fitted=fitted)
    if classifier.statistics and (rows := [*_left_out(left_out, classifier, parts), *validated]):
        columns = zip(card.sense_names, map(list, zip(*rows, strict=True)), strict=True)
        calibration[NOVELTIES] = dict(columns)
    return calibration, loss


@torch.inference_mode()
def calibrate_baseline(
    classifier: SurfaceClassifier, parts: Split, store: Store
) -> tuple[dict[str, Any], float | None]:
    """Measure a fitted baseline on the validation fold; see :func:`calibrate`."""
    samples = make_samples(parts.val, classifier.card.modalities)
    scores = [classifier.logits(**load_sample(sample, store)) for sample in samples]
    return _calibrated(classifier.card, samples, scores, None)


def _calibrated(
    card: Card,
    samples: Sequence[Sample],
    scores: Sequence[Tensor],
    loss: float | None,
    *,
    fitted: bool = False,
) -> tuple[dict[str, Any], float | None]:
    """Return temperature, unless probabilities are fitted already, and loss, unless it is known."""
    if not samples:
        return {}, loss
    temperature = card.temperature if fitted else sample_temperature(card, samples, scores)
    if loss is None:
        loss = sample_loss(card, samples, scores, temperature)
    return {} if fitted else {"temperature": temperature}, loss


def _left_out(
    novelties: Mapping[str, Sequence[float | None]], classifier: SurfaceClassifier, parts: Split
) -> list[list[float]]:
    """Return the novelties of samples of the training by all senses, as far as they are known."""
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
