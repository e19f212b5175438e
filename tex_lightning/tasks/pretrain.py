"""Train a network on an endless stream of synthetic surfaces, for others to start from its trunk.

What comes out is an ordinary checkpoint and an ordinary run folder; the accuracy is that of
synthetic specimens which the training has not met, and says nothing of real ones.
"""

import time
from dataclasses import asdict, replace
from typing import Any, cast

from tex_lightning.config import Config
from tex_lightning.config.job import Job
from tex_lightning.data.folds import NEEDS, Kind, Split
from tex_lightning.data.generator import RenderedStore, SpecimenGenerator
from tex_lightning.data.readers.synthetic import spec_of
from tex_lightning.data.recordings import Recordings
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import write_results
from tex_lightning.features.spectrogram import HapticFeatures
from tex_lightning.learning.train import train_network
from tex_lightning.report.table import print_results
from tex_lightning.runs.fold import make_training, results_frame, tested_network
from tex_lightning.runs.usable import find_too_small
from tex_lightning.runs.workspace import (
    Workspace,
    check_networks,
    configured_card,
    decode_settings,
)
from tex_lightning.tasks.fit import finished

NOTE = "synthetic specimens rendered for this test; real surfaces are another matter"


def run(config: Config, job: Job) -> dict[str, Any]:
    """Train on the stream and test on specimens apart from it; write ``results.json``."""
    begin, directory = time.perf_counter(), job.directory
    if (done := finished(directory)) is not None:
        return done
    kind = cast(Kind, config.model.kind)
    min_side = check_networks(config)
    stream = SpecimenGenerator(spec_of(config.data), NEEDS[kind][0], decode_settings(config.data))
    store, test = RenderedStore(stream), stream.unseen(config.pretrain.test)
    trained_on = {"stream": asdict(stream.spec), "seen": []}
    card = replace(configured_card(config, kind, stream.classes), trained_on=trained_on)
    features = HapticFeatures(**card.haptic_features) if kind == "haptic" else None
    if too_small := find_too_small(Recordings(test.rows[:1]), store, features, min_side):
        raise UserError(too_small[0].reason)
    none = Recordings(())
    workspace = Workspace(config, kind, stream.classes, none, none, store, directory)
    parts = Split(none, none, test)
    training = replace(
        make_training(workspace, card, parts, {}),
        stream=stream,
        views=config.pretrain.views,
    )
    networks: dict[str, Any] = {kind: tested_network(workspace, train_network(training), parts)}
    seconds = time.perf_counter() - begin
    results = {**results_frame(workspace, networks, seconds), "tested_on": NOTE}
    write_results(directory / "results.json", results)
    print_results(results, directory)
    return results
