"""Look at a data set before anything is trained: what it is, what looks wrong, what may leak."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from tex_lightning.config import Config, Job
from tex_lightning.core.console import say
from tex_lightning.data.inspection import Finding, named_files, suspicions
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.readers.layout import hint
from tex_lightning.data.readers.vocabulary import rename
from tex_lightning.data.recordings import Recordings, plural
from tex_lightning.data.store import Store, cache_root
from tex_lightning.errors import UserError, listed
from tex_lightning.report.data_page import print_findings
from tex_lightning.senses.base import Sense
from tex_lightning.senses.making import make_sense
from tex_lightning.studies.dataset import EMPTY, Dataset
from tex_lightning.studies.description import keep_description, show_opening
from tex_lightning.studies.network_results import results_frame


def run(config: Config, job: Job) -> dict[str, Any]:
    """Describe the data and what is suspected of them."""
    begin, data = time.perf_counter(), config.data
    dataset, senses = _open(config)
    divisions = [config.on_fold(fold).data for fold in range(data.folds)]
    told = show_opening(data, dataset, "", trains=divisions)
    found = [*suspicions(dataset.recordings, dataset.store), *_too_small(dataset, senses)]
    told["findings"] = [finding._asdict() for finding in found]
    keep_description(told, dataset, job.directory)
    print_findings(told["findings"])
    frame = results_frame(config, "", dataset, {}, time.perf_counter() - begin)
    results = {**frame, **told, "data": data.name}
    say(f"The report is {job.directory / 'report.html'}")
    return results


def _open(config: Config) -> tuple[Dataset, list[Sense]]:
    """Decode all recordings of senses that are known, without those that cannot be read."""
    known = [config.model.sense(name).modality for name in config.model.known]
    rendered = config.data.name == "synthetic"  # by which senses are asked for
    table = read_recordings(config.data, known if rendered else None, least=1)
    senses = _senses(config, table)
    unread = sorted({row.modality for row in table} - {sense.modality for sense in senses})
    if not senses:
        raise UserError(
            f"No sense reads {listed(unread)}; give data of {listed(config.model.known)}, or add "
            f"a sense (conf/sense/NAME.yaml and --config-dir conf).{rename(unread)}"
            + "".join(f" {text}" for text in hint(config.data.root, table))
        )
    store = Store(
        cache_root(config.data.cache_dir), {sense.modality: sense.decoder for sense in senses}
    )
    rows = table.without(row for row in table if row.modality in unread)
    if unread:
        note = f"No sense reads {listed(unread)}, and they are passed over.{rename(unread)}"
        lost = {*table.classes} - {*rows.classes}
        rows = replace(
            rows, notes=(*rows.notes, note, *(hint(config.data.root, table) if lost else ()))
        )
    dataset = Dataset.decode(rows, EMPTY, store, table.classes)
    if not len(dataset.recordings):
        raise UserError(
            f"None of {len(rows)} recordings can be read; the first: {dataset.skipped[0].reason}"
        )
    return dataset, senses


def _too_small(dataset: Dataset, senses: Sequence[Sense]) -> Iterator[Finding]:
    """Yield how many recordings the networks of this configuration cannot use, and why."""
    for sense in senses:
        rows = dataset.recordings.of(sense.modality)
        small = [unusable for row in rows if (unusable := dataset.too_small(row, sense))]
        if small:
            count = f"{len(small)} of {len(rows)} {plural(sense.modality)}; the first: "
            files = named_files([unusable.recording for unusable in small])
            yield Finding("too small", f"{count}{small[0].reason}", files)


def _senses(config: Config, table: Recordings) -> list[Sense]:
    """Make the first known sense of each modality that there are recordings of."""
    there, senses = {row.modality for row in table}, dict[str, Sense]()
    for name in [*config.model.senses, *config.model.known]:
        settings = config.model.sense(name)
        if settings.modality in there and settings.modality not in senses:
            senses[settings.modality] = make_sense(name, settings.node, 2)
    return [*senses.values()]
