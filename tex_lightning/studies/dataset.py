"""Open a data set: recordings, store and folds, checked; and describe the classifier to train."""

import logging
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

from rich.table import Table
from rich.text import Text

from tex_lightning.baselines.classifier import make_baseline, new_classifier
from tex_lightning.classifier.card import DECISION, LABEL, Card
from tex_lightning.classifier.classifier import SurfaceClassifier, Trained, read_trained
from tex_lightning.config import Config, DataConfig
from tex_lightning.core.console import QUIET, Screen, console
from tex_lightning.core.progress import track
from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.folds import Sample, Split, check_split, make_samples, split, tested_part
from tex_lightning.data.quality import MEASURES, training_ranges
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings, plural
from tex_lightning.data.store import Store, Unusable, cache_root, list_files
from tex_lightning.errors import UserError, listed
from tex_lightning.inference.prediction import taken
from tex_lightning.learning.start import start_trunk, starting_classifier
from tex_lightning.learning.trainer import try_parts_of_training
from tex_lightning.learning.trial import try_branch
from tex_lightning.networks.blocks import is_builtin
from tex_lightning.senses.base import Sense
from tex_lightning.studies.leaks import refuse_leak, trained_on
from tex_lightning.text import printable_lines

FACTOR = 2  # by which a duration differs from the median where its rate may be wrong

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Dataset:
    """Recordings of one task, checked and decoded.

    Attributes:
        config: Where they come from, how they are divided, and what is done with them.
        classes: Class names in natural order.
        recordings: Those of the modalities that the model needs.
        unknown: The same of the classes held out of everything but a test of their own.
        store: Decoded files.
        skipped: Files that were left out since they cannot be used (``data.skip_bad``).
    """

    config: Config
    classes: list[str]
    recordings: Recordings
    unknown: Recordings
    store: Store
    skipped: tuple[Unusable, ...] = ()

    def on_fold(self, fold: int) -> "Dataset":
        """Copy it with another test fold."""
        data = replace(self.config.data, test_fold=fold)
        return replace(self, config=replace(self.config, data=data))

    def parts(self) -> Split:
        """Training, validation and test recordings, checked."""
        data = self.config.data
        parts = split(self.recordings, data)
        check_split(parts, self.classes, self.config.model.modalities, data)
        return parts

    def unknown_samples(self, modalities: Sequence[str]) -> list[Sample]:
        """Samples of the held-out classes in the test fold."""
        return make_samples(split(self.unknown, self.config.data).test, modalities)


def open_dataset(config: Config, directory: Path) -> Dataset:
    """Read the data set to train on, and decode what the cache does not have.

    Args:
        config: Where recordings come from, and the networks to train on them.
        directory: The run folder.

    Raises:
        UserError: If the data or the networks cannot be used.
    """
    try_parts_of_training(config, directory)
    data, modalities = config.data, config.model.modalities
    senses = check_networks(config)
    rows = read_recordings(data, modalities)
    needed = rows.without(row for row in rows if row.modality not in modalities)
    recordings, unknown = hold_out(needed, data.hold_out)
    store = Store(cache_root(data.cache_dir), {each.modality: each.decoder for each in senses})
    if len(recordings.classes) < 2:
        raise UserError(
            f"The data has {' or '.join(modalities)} recordings of "
            f"{listed(recordings.classes) or 'no class'} for a {config.model.kind} network, and "
            "telling classes apart takes two; choose another model or add recordings."
        )
    if config.decision.unknown and LABEL in recordings.classes:
        raise taken("The data has")
    damaged = store.fill(needed)
    readable = recordings.without(each.recording for each in damaged)
    for sense in senses:
        _try_custom(config, sense, readable, store)
    skipped = find_unusable(needed, store, senses, damaged, skip_bad=data.skip_bad)
    bad = [each.recording for each in skipped]
    usable, held = recordings.without(bad), unknown.without(bad)
    return Dataset(config, recordings.classes, usable, held, store, tuple(skipped))


def open_test_data(config: Config, classifier: SurfaceClassifier, who: str) -> Dataset:
    """Read what a checkpoint is tested on: the test fold, decoded as the checkpoint says.

    Only ``data.file_rate`` belongs to the files themselves and counts if it is given.

    Args:
        config: Where recordings come from, and which fold.
        classifier: What is tested.
        who: Its name in messages.

    Raises:
        UserError: If classes are unknown to the checkpoint, it was trained on these recordings, or
            they cannot be used.
    """
    data, card = config.data, classifier.card
    rows, held = hold_out(read_recordings(data, card.modalities), data.hold_out)
    if unknown := [label for label in rows.classes if label not in card.classes]:
        raise UserError(
            f"{who} does not know the class {listed(unknown)}; leave it out of the "
            "data, name it in data.hold_out or train on it."
        )
    tested, strange = (_tested(part, config.data, card, who) for part in (rows, held))
    store = open_store(config.data, classifier)
    both = replace(tested, rows=tested.rows + strange.rows)
    senses = classifier.senses.values()
    skipped = find_unusable(both, store, senses, store.fill(both), skip_bad=data.skip_bad)
    bad = [each.recording for each in skipped]
    usable = tested.without(bad)
    if not make_samples(usable, card.modalities):
        raise UserError(
            f"{who} has nothing to be tested on in {tested_part(data)}; choose another "
            "data.test_fold or data.test_where, or data.test_fold=null for everything."
        )
    return Dataset(config, card.classes, usable, strange.without(bad), store, tuple(skipped))


def _tested(rows: Recordings, data: DataConfig, card: Card, who: str) -> Recordings:
    wanted = rows.without(row for row in rows if row.modality not in card.modalities)
    test = split(wanted, data).test
    refuse_leak(test, card, who, data)
    return replace(test, notes=rows.notes)


def open_store(data: DataConfig, classifier: SurfaceClassifier) -> Store:
    """Open a store that decodes recordings with a checkpoint's settings."""
    decoders = {
        sense.modality: sense.decoder.assuming(data.file_rate)
        for sense in classifier.senses.values()
    }
    return Store(cache_root(data.cache_dir), decoders)


def hold_out(recordings: Recordings, classes: list[str] | None) -> tuple[Recordings, Recordings]:
    """Divide recordings into those of known classes and those of the classes named.

    Raises:
        UserError: If there is no such class.
    """
    if absent := sorted(set(classes or ()) - set(recordings.classes)):
        raise UserError(
            f"data.hold_out names {listed(absent)}, and the data has no such class; choose from "
            f"{listed(recordings.classes)}, with commas between names."
        )
    known = [label for label in recordings.classes if label not in (classes or ())]
    return recordings.in_classes(known), recordings.in_classes(classes or [])


def find_unusable(
    recordings: Recordings,
    store: Store,
    senses: Iterable[Sense],
    damaged: Sequence[Unusable],
    *,
    skip_bad: bool,
) -> list[Unusable]:
    """Find recordings that cannot be decoded, or give no fragment.

    Args:
        recordings: All that a task will need.
        store: Filled with them.
        senses: Branches that look at them.
        damaged: Those that it could not be filled with.
        skip_bad: Whether the task goes on without them (``data.skip_bad``).

    Raises:
        UserError: Listing them, unless the task goes on.
    """
    readable = recordings.without(each.recording for each in damaged)
    pairs = [(row, sense) for sense in senses for row in readable.of(sense.modality)]
    small = []
    for row, sense in track(pairs, "Checking"):
        try:
            sense.check(store.load(row))
        except UserError as error:
            small.append(Unusable(row, f"{row.source}: {error}"))
    unusable = list({each.recording: each for each in (*damaged, *small)}.values())
    if unusable and not skip_bad:
        raise UserError(
            f"{len(unusable)} of {len(recordings)} files cannot be used; repair them, take them "
            "out or set data.skip_bad=true to go on without them:",
            *list_files(unusable),
        )
    return unusable


def show_opening(config: Config, dataset: Dataset, what: str, *, trains: bool = True) -> None:
    """Warn of what was passed over or looks wrong; print the data and what is done with it.

    Args:
        config: Where the recordings come from.
        dataset: All that will be trained or tested on.
        what: What is trained or tested.
        trains: Whether folds are trained on.
    """
    rows, data = dataset.recordings, config.data
    modalities = list(dict.fromkeys(row.modality for row in rows))
    warnings = [*rows.notes]
    if dataset.skipped:
        files = list_files(dataset.skipped)
        warnings.append("\n".join([f"Going on without {len(dataset.skipped)} files:", *files]))
    for modality in modalities:
        warnings += rate_warnings(rows.of(modality), dataset.store)
    for text in warnings:
        log.warning("%s", text)
    if Screen.verbose == QUIET:
        return
    block = Table.grid(padding=(0, 2))
    block.add_column(no_wrap=True)  # so that the other is what a narrow screen cuts

    def add(title: str, text: str) -> None:
        block.add_row(title, Text(printable_lines(text), no_wrap=True, overflow="ellipsis"))

    add("Data", f"{data.name} {data.manifest or data.root or ''}")
    add("Classes", f"{len(rows.classes)}: {', '.join(rows.classes)}")
    for modality in modalities:
        own, title = rows.of(modality), plural(modality).partition(" ")[0].capitalize()
        decoder, counts = dataset.store.decoders[modality], Counter(row.label for row in own)
        sizes = [dataset.store.extent(row) for row in own]
        size = _spread(sizes, decoder.unit, decoder.precision)
        each = _spread([*counts.values()], "", "d")
        add(title, f"{len(own)}; {size}; {each} of a class")
    add("Trains" if trains else "Tests", what)
    console.print(block)


def _spread(values: Sequence[float], unit: str, form: str) -> str:
    """Return the smallest and the largest value in a format, once if they read alike."""
    low, high = format(min(values), form), format(max(values), form)
    return f"{low if low == high else f'{low} to {high}'} {unit}".rstrip()


def rate_warnings(signals: Recordings, store: Store) -> list[str]:
    """Warn of signals of a much lower rate than others, and of assumed rates that seem wrong."""
    modality = signals.rows[0].modality
    decoder, kind, warnings = store.decoders[modality], plural(modality), []
    if not isinstance(decoder, SignalDecoder):
        return []
    rates = {row: store.rate(row) for row in signals}
    highest = min(max(rate.hz for rate in rates.values()), decoder.sampling_rate)
    low = [row for row, rate in rates.items() if rate.hz * MEASURES["rate"][0] < highest]
    if low:
        slowest = min(low, key=lambda row: rates[row].hz)
        hz = rates[slowest].hz
        warnings.append(
            f"{len(low)} of {len(rates)} {kind} have a lower rate than the {highest:,.6g} Hz of "
            f"others, {hz:,.6g} Hz in {slowest.path.name}, and nothing above half of it: record "
            f"all at one rate, or set data.sampling_rate={hz:g}."
        )
    seconds = {row: store.extent(row) for row in rates}
    middle = median(seconds.values())
    odd = [row for row in rates if not middle / FACTOR < seconds[row] < FACTOR * middle]
    if odd := [row for row in odd if rates[row].source == "assumed"]:
        warnings.append(
            f"Is {rates[odd[0]].hz:,.6g} Hz the rate of all files that name none? At this assumed "
            f"rate {len(odd)} {kind} last much longer or shorter than the median of {middle:.3g} s,"
            f" {odd[0].path} {seconds[odd[0]]:.3g} s for one. If not, correct data.file_rate, or "
            "give these files their rate (a column of the manifest)."
        )
    return warnings


def check_networks(config: Config) -> list[Sense]:
    """Build the networks, so that settings and weights that do not fit are refused at once.

    Returns:
        The senses, with weights of no meaning.

    Raises:
        UserError: Naming the key that does not fit.
    """
    model = config.model
    if model.baseline is None:
        return [_checked_branch(config, name) for name in model.senses]
    baseline = make_baseline(model.name, model.baseline, model.budget)
    if config.baseline_weights is not None:
        baseline.load_weights(config.baseline_weights)
    card = configured_card(config, model.senses, ["one", "other"])
    return list(new_classifier(card).senses.values())


def _checked_branch(config: Config, name: str) -> Sense:
    given, source = config.model.checkpoints.get(name), config.weights_of(name)
    if given is not None:
        return SurfaceClassifier.from_checkpoint(given, name).senses[name]
    start = SurfaceClassifier(configured_card(config, [name], ["one", "other"]))
    if source is not None:
        start_trunk(start, source)
    sense, fit = start.eval().senses[name], config.model.sense(name).fit
    least = sense.known_min_size if is_builtin(sense.features) else None
    if least is not None and fit.piece < least[1]:
        raise UserError(
            f"model.{name}.fit.{fit.piece_key} is {fit.piece}, and this network needs {least[1]} "
            f"for a prediction; choose {least[1]} or more."
        )
    return sense


def _try_custom(config: Config, sense: Sense, recordings: Recordings, store: Store) -> None:
    """Try a sense with parts of the user's as it will be trained, for the classes of the data."""
    model = config.model
    fit = model.fit_values(sense.name)
    builtin = sense.is_builtin and fit.get("augmentation") is None
    if builtin or model.baseline is not None or model.checkpoints.get(sense.name) is not None:
        return
    card = configured_card(config, [sense.name], recordings.classes)
    try_branch(card, fit, model.sense(sense.name).fit.piece, recordings, store)


def make_card(dataset: Dataset, senses: Sequence[str], unimodal: dict[str, Trained]) -> Card:
    """Describe the classifier to train; FusionNet's branches are those of its networks.

    Raises:
        UserError: If its trunk cannot be used or has seen what is to be tested.
    """
    config, parts = dataset.config, dataset.parts()
    card = configured_card(config, senses, dataset.classes)
    ranges = {
        modality: training_ranges(parts.train.of(modality), dataset.store)
        for modality in card.modalities
    }
    starts = {name: start.classifier.card for name, start in unimodal.items()}
    branches = {name: starts[name].senses[name] if starts else card.senses[name] for name in senses}
    card = replace(card, input_ranges=ranges, senses=branches)
    source = None if card.baseline or starts else config.start_of(card.kind)
    begun = list(starts.values())
    if source is not None and (start := starting_classifier(source, card)) is not None:
        test = parts.test.of(card.modalities[0])
        refuse_leak(test, start.card, f"weights: checkpoint {source}", config.data)
        begun.append(start.card)
    return replace(card, trained_on=trained_on(card, parts, config.data, begun, source))


def configured_card(config: Config, senses: Sequence[str], classes: list[str]) -> Card:
    """Describe a classifier by its recipe alone, as if nothing had trained it."""
    model = config.model
    baseline = {
        "name": model.name,
        "node": model.baseline,
        "budget": model.budget,
        "weights": config.baseline_weights,
    }
    return Card(
        classes=classes,
        senses={name: model.sense(name).node for name in senses},
        decision={key: getattr(config.decision, key) for key in DECISION},
        fusion={"level": model.fusion.level} if len(senses) > 1 else {},
        baseline={} if model.baseline is None else baseline,
    )


def given_start(dataset: Dataset, name: str, path: Path) -> Trained:
    """Read a unimodal checkpoint, if FusionNet may start from it.

    Raises:
        UserError: If it is no such network, classes or decoding differ, or it has seen the fold
            that this run tests.
    """
    start, config = read_trained(path, name), dataset.config
    card = start.classifier.card
    if card.classes != dataset.classes:
        raise UserError(
            f"Checkpoint {path} knows {len(card.classes)} classes that are not the "
            f"{len(dataset.classes)} of this data; train it on the same data."
        )
    configured = config.model.sense(name).decode
    for key, value in card.senses[name]["decode"].items():
        if key != "file_rate" and value != configured.get(key):
            raise UserError(
                f"Checkpoint {path} was trained with data.{key}={value}, this run has "
                f"{configured.get(key)}; make them equal."
            )
    test = dataset.parts().test.of(card.modalities[0])
    refuse_leak(test, card, f"Checkpoint {path}", config.data)
    return start
