"""Train and test all networks of a model on one fold."""

import logging
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import torch
from lightning.pytorch.loggers import Logger

from tex_lightning.baselines.classifier import BaselineClassifier, load_classifier
from tex_lightning.classifier.card import CROSSVAL, LABEL, Card, configured_card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, DataConfig, Folding, plain_values
from tex_lightning.config.model import FUSION
from tex_lightning.core.console import log_once
from tex_lightning.core.devices import pick_device
from tex_lightning.core.files import read_record, write_bytes
from tex_lightning.core.progress import track
from tex_lightning.core.ranks import is_rank_zero
from tex_lightning.data.folds import Split, make_samples, split, tested_part
from tex_lightning.data.quality import training_ranges
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import Store, load_recording, load_sample
from tex_lightning.errors import UserError
from tex_lightning.evaluation.calibration import calibrated_card, sample_loss
from tex_lightning.evaluation.outcomes import RANDOM, write_results
from tex_lightning.inference.prediction import name_conflict
from tex_lightning.learning.loggers import log_test, open_loggers
from tex_lightning.learning.start import starting_classifier
from tex_lightning.learning.train import Training, checkpoint_of
from tex_lightning.learning.trial import try_baseline, try_custom_parts, try_training
from tex_lightning.report.board import Piece
from tex_lightning.report.errors import keep_samples
from tex_lightning.studies.dataset import Dataset, open_dataset
from tex_lightning.studies.description import show_opening
from tex_lightning.studies.evaluate_checkpoint import (
    describe_network,
    draw_figures,
    report_network,
    results_frame,
)
from tex_lightning.studies.leaks import refuse_leak, trained_on
from tex_lightning.studies.logged import log_network, looking, test_pieces

log = logging.getLogger(__name__)


def fit_baseline(
    config: Config, card: Card, parts: Split, store: Store, directory: Path
) -> SurfaceClassifier:
    """Fit, calibrate and write the checkpoint, unless it is there already.

    Args:
        config: Settings of fit and decision.
        card: Card of the baseline.
        parts: Recordings by part.
        store: Decoded files.
        directory: The run folder.

    Raises:
        UserError: If a recording is too short, weights do not fit, or a user's class does not
            keep its contract.
    """
    final, weights = checkpoint_of(directory, card.kind), card.baseline["weights"]
    if final.is_file():
        log.info("%s is fitted already.", final)
        return load_classifier(final)
    rows = parts.train.of(card.modalities[0]).rows
    classifier = BaselineClassifier(card)
    if weights is not None:
        log_once(log, classifier.baseline.load_weights(weights))
    log.info("Fitting %s to %d recordings.", card.title, len(rows))
    begin = time.perf_counter()
    classifier.fit(rows, store, config.seed)
    seconds = time.perf_counter() - begin
    try_baseline(classifier, [load_recording(row, store) for row in rows[:2]])
    validation = make_samples(parts.val, card.modalities)
    with torch.inference_mode():
        scores = [classifier.logits(**load_sample(sample, store)) for sample in validation]
    card = calibrated_card(classifier.card, validation, lambda: scores)
    loss = sample_loss(card, validation, scores) if validation else None
    training = {**card.training, "fit_seconds": seconds, "val_loss": loss}
    classifier.card = replace(card, training=training)
    classifier.save(final)
    return classifier


def open_training(config: Config, directory: Path) -> Dataset:
    """Open the data set of a training, once what it will make is made for a trial.

    Args:
        config: Where recordings come from, and the networks to train on them.
        directory: The run folder.

    Raises:
        UserError: If the data or the networks cannot be used.
    """
    card = configured_card(config, ["one", "other"])
    senses = try_training(config, card, directory)
    dataset = open_dataset(config.data, senses)
    if config.decision.unknown and LABEL in dataset.classes:
        raise name_conflict("The data has")
    card = replace(card, classes=dataset.classes)
    try_custom_parts(config.model, card, senses, dataset.recordings, dataset.store)
    return dataset.usable(senses, skip_bad=config.data.skip_bad)


def open_announced(config: Config, directory: Path, trains: Iterable[Folding]) -> Dataset:
    """Open the data set of one or several trainings, each with its division, and show it."""
    dataset, model = open_training(config, directory), config.model
    parts = "" if model.baseline or model.kind != FUSION else f": {', '.join(model.trained)}"
    keep = directory if is_rank_zero() else None
    show_opening(config.data, dataset, f"{model.name}{parts}", trains=trains, keep_in=keep)
    return dataset


def chosen_folds(count: int, only: list[int] | None) -> list[int]:
    """Return the folds that ``crossval.only`` asks for, or all of ``count``.

    Raises:
        UserError: If one does not exist.
    """
    chosen = list(range(count)) if only is None else only
    if not chosen or any(fold not in range(count) for fold in chosen):
        raise UserError(f"crossval.only={chosen} must name folds from 0 to {count - 1}.")
    return sorted(set(chosen))


def training_results(
    config: Config, dataset: Dataset, networks: dict[str, Any], seconds: float
) -> dict[str, Any]:
    """Return ``results.json`` of a training, with the sources of networks' and trunks' weights."""
    model, begun = config.model, {**config.sources, **config.model.checkpoints}
    weights = {name: begun.get(name, RANDOM) for name in model.senses}
    frame = results_frame(
        config, model.name, dataset.classes, dataset.skipped, networks, seconds,
        baseline=model.baseline is not None,
    )  # fmt: skip
    return {**frame, "weights": weights}


def finished_fold(home: Path) -> dict[str, Any] | None:
    """Return the results of a fold that an earlier run finished."""
    if not (home / "results.json").is_file():
        return None
    log.info("Fold %s is done already.", home.name)
    return read_record(home / "results.json")


def run_fold(config: Config, dataset: Dataset, home: Path, **options: Any) -> dict[str, Any]:  # noqa: ANN401
    """Train and test on one fold of several; write its ``results.json`` and return it.

    Arguments are those of :func:`fit_fold`; a process that is not rank zero has no results.
    """
    begin = time.perf_counter()
    networks = fit_fold(config, dataset, home, **options)
    if not is_rank_zero():
        return {}
    results = training_results(config, dataset, networks, time.perf_counter() - begin)
    write_results(home / "results.json", results)
    return results


def fit_fold(
    config: Config,
    dataset: Dataset,
    directory: Path,
    *,
    draw: bool = False,
    test_parts: bool = True,
    networks_in: Path | None = None,
    crossvalidated: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> dict[str, Any]:
    """Train and test all networks that the model consists of on one fold.

    Args:
        config: The model, and the fold.
        dataset: Recordings to train and test on.
        directory: Folder of checkpoints and predictions.
        draw: Whether figures are drawn; of several folds they are drawn of all together.
        test_parts: Whether the networks that a FusionNet consists of are tested, too.
        networks_in: Folder in which systems of a family find networks that they have in common.
        crossvalidated: By network what a cross-validation of the same gave, for its card.

    Returns:
        By network its entry of ``results.json``.
    """
    parts, model, store = dataset.parts(config.data), config.model, dataset.store
    networks: dict[str, Any] = {}
    whole_card = configured_card(config, dataset.classes)
    unimodal = {  # before time is spent on the other networks
        name: given_start(Path(path), whole_card.of([name]), parts.test, config.data)
        for name, path in model.checkpoints.items()
    }
    for name in track(model.trained, "network {}".format):
        whole = name == model.kind
        card = whole_card if whole else whole_card.of([name])
        starts = {sense: unimodal[sense] for sense in model.senses if whole and sense in unimodal}
        card = complete_recipe(config, card, parts, store, starts)
        if name in crossvalidated:
            card = replace(card, training={CROSSVAL: dict(crossvalidated[name])})
        loggers = open_loggers(config.logger, directory, name)
        training = Training(config, card, parts, store, directory, starts, loggers)
        if card.baseline:
            classifier = fit_baseline(config, card, parts, store, directory)
        elif networks_in is None:
            classifier = training.run()
        else:
            shared = replace(training, directory=training.shared_in(networks_in))
            classifier = shared.run()
            write_bytes(training.final, shared.final.read_bytes())
        if not whole:
            unimodal[name] = classifier
        networks[name] = {"fit_seconds": classifier.card.training.get("fit_seconds")}
        if is_rank_zero() and (whole or test_parts):  # it alone tests and writes
            networks[name] = _test_network(
                config, dataset, parts, directory, classifier, loggers, networks, draw=draw
            )
    return networks


def given_start(path: Path, card: Card, test: Recordings, data: DataConfig) -> SurfaceClassifier:
    """Read a unimodal checkpoint, if FusionNet may start from it.

    Args:
        path: The checkpoint.
        card: Card of such a network as this run would train it.
        test: The test recordings.
        data: Division into folds or by condition.

    Raises:
        UserError: If it is no such network, classes differ, or it has seen the fold that this run
            tests.
    """
    start = SurfaceClassifier.from_checkpoint(path, card.kind)
    theirs = start.card
    if theirs.classes != card.classes:
        raise UserError(
            f"Checkpoint {path} knows {len(theirs.classes)} classes that are not the "
            f"{len(card.classes)} of this data; train it on the same data."
        )
    refuse_leak(test.of(theirs.modalities[0]), theirs, f"Checkpoint {path}", data)
    return start


def complete_recipe(
    config: Config,
    card: Card,
    parts: Split,
    store: Store,
    unimodal: Mapping[str, SurfaceClassifier],
) -> Card:
    """Add to the card of a network to train what its data say, and what it starts from.

    Args:
        config: Names the weights that a trunk starts from, and the fold.
        card: Card of the network.
        parts: Recordings by part.
        store: Decoded files.
        unimodal: By sense the networks that FusionNet starts from: its senses are theirs.

    Raises:
        UserError: If its trunk cannot be used or has seen what is to be tested.
    """
    rows, starts = parts.train, [start.card for start in unimodal.values()]
    ranges = {name: known for start in starts for name, known in start.input_ranges.items()}
    for name in card.modalities:
        if name not in ranges:
            ranges[name] = training_ranges(rows.of(name), store)
    senses = {name: start.card.senses[name] for name, start in unimodal.items()}
    card = replace(card, input_ranges=ranges, senses={**card.senses, **senses})
    source = None if card.baseline or starts else config.sources.get(card.kind)
    if source is not None and (start := starting_classifier(source, card.kind)) is not None:
        test = parts.test.of(card.modalities[0])
        refuse_leak(test, start.card, f"weights: checkpoint {source}", config.data)
        starts.append(start.card)
    return replace(card, trained_on=trained_on(card, parts, config.data, starts, source))


def _test_network(
    config: Config,
    dataset: Dataset,
    parts: Split,
    directory: Path,
    classifier: SurfaceClassifier,
    loggers: Sequence[Logger],
    networks: Mapping[str, Any],
    *,
    draw: bool,
) -> dict[str, Any]:
    """Test a trained network, if there is a test part; return its entry of ``results.json``."""
    store = dataset.store
    classifier.to(pick_device(config.trainer.accelerator))
    kind, modalities = classifier.card.kind, classifier.card.modalities
    samples = make_samples(parts.test, modalities)
    unknown = make_samples(split(dataset.unknown, config.data, trains=True).test, modalities)
    checkpoint = checkpoint_of(directory, kind)
    further: Iterable[Piece] = ()
    if samples:
        result, outcomes = report_network(
            classifier, checkpoint, samples, store, directory, config, unknown,
            dataset.condition_bins,
        )  # fmt: skip
        look = looking(classifier, samples, outcomes, store)
        further = test_pieces(classifier, samples, outcomes, store, look)
        if draw:
            draw_figures(outcomes, dataset.classes, kind, directory)
            keep_samples(directory, kind, look, outcomes, samples, dataset.classes)
    else:
        sample = make_samples(parts.train, modalities)[0]
        result = {"test_samples": 0, **describe_network(classifier, checkpoint, sample, store)}
    if draw:
        before = {name: entry for name, entry in networks.items() if name != kind}
        log_network(
            config, dataset, directory, loggers, {**before, kind: result}, [config.data], further
        )
    else:
        log_test(loggers, kind, plain_values(config), result)
    if not samples:
        log.info(
            "%s: trained on %d recordings in %.1f s, and not tested.",
            classifier.card.title[0].upper() + classifier.card.title[1:],
            sum(row.modality in modalities for row in parts.train), result["fit_seconds"],
        )  # fmt: skip
        return result
    tested = tested_part(config.data)
    log.info(
        "%s, %s: %d of %d samples correct, trained in %.1f s.",
        tested[0].upper() + tested[1:], classifier.card.title, result["correct"],
        result["test_samples"], result["fit_seconds"],
    )  # fmt: skip
    return result
