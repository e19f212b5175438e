"""Adapt a checkpoint to unlabelled recordings: files, or the tested part of a data set."""

import time
from typing import Any

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.config import Config, Job
from tex_lightning.core.console import say
from tex_lightning.core.run_folder import checkpoint_of, system_name
from tex_lightning.data.folds import split, tested_part
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.readers.given_files import find_files
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.errors import UserError
from tex_lightning.inference.predictor import Predictor
from tex_lightning.learning.adaptation import adapt, check_adaptable
from tex_lightning.learning.finish import position_features
from tex_lightning.learning.provenance import seen_of
from tex_lightning.studies.dataset import Dataset, decode_for
from tex_lightning.studies.description import show_opening
from tex_lightning.studies.network_results import results_frame


def run(config: Config, job: Job) -> dict[str, Any]:
    """Fit ``checkpoint`` again with unlabelled recordings; write the new one.

    Where that does not seem safe the checkpoint is written as it is, and the reason is said.
    """
    begin, source = time.perf_counter(), str(config.checkpoint)
    classifier = load_classifier(source)
    check_adaptable(classifier)
    predictor = Predictor(classifier, config)  # puts it on the device that computes
    dataset = open_unlabelled(predictor)
    if not config.files:
        show_opening(config.data, dataset, f"no labels, for {source}")
    (name,), card = classifier.senses, classifier.card
    rows = dataset.recordings.rows
    features = position_features(classifier, name, rows, dataset.store)
    adaptation = adapt(classifier, features, predictor.card.unknown_above)
    target = checkpoint_of(job.directory, card.kind)
    adaptation.classifier.cpu().save(target)
    seconds = time.perf_counter() - begin
    entry = {
        "adapted": not adaptation.reason,
        "reason": adaptation.reason or None,
        "recordings": adaptation.recordings,
        "taught": adaptation.taught,
        "changed": adaptation.changed,
        "adapt_seconds": seconds,
        "checkpoint": str(target.resolve()),
    }
    networks = {card.kind: entry}
    results = results_frame(config, system_name(source), dataset, networks, seconds)
    results["data"] = None if config.files else results["data"]
    say(f"{adaptation} The checkpoint is {target}.")
    return results


def open_unlabelled(predictor: Predictor) -> Dataset:
    """Read and decode the files of its configuration, or else the tested part of its data set.

    What the checkpoint was trained on is left out of a data set. Labels are not looked at.

    Raises:
        UserError: If there is nothing, or the checkpoint does not use a modality that is given.
    """
    config, classifier = predictor.config, predictor.classifier
    card, data = classifier.card, config.data
    if config.files:
        predictor.check_senses(config.files)
        files = {name: find_files(name, value) for name, value in config.files.items()}
        rows = Recordings(
            tuple(
                Recording("", modality, path.resolve(), str(number))
                for modality, paths in files.items()
                for number, path in enumerate(paths)
            )
        )
    else:
        table = read_recordings(data, card.modalities, least=1)
        tested = split(table.of(*card.modalities), data).test
        rows = tested.without(seen_of(tested, card))
        if not rows.rows:
            raise UserError(
                f"There is nothing to adapt to in {tested_part(data)} that the checkpoint was not "
                "trained on; give other recordings."
            )
    return decode_for(classifier, data, rows, card.classes)
