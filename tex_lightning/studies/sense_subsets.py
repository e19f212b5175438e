"""``frontier.senses``: every subset of senses as a family, and what each further sense is worth."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

from tex_lightning.config import Config, FrontierConfig
from tex_lightning.config.check_tasks import AUTO
from tex_lightning.config.composition import Job
from tex_lightning.config.tasks import EVERY_SENSE
from tex_lightning.data.readers import read_recordings
from tex_lightning.errors import UserError
from tex_lightning.evaluation.comparison import difference
from tex_lightning.inference.early_stopping import SEQUENTIAL
from tex_lightning.report.frontier_chart import AddedSense
from tex_lightning.studies.family import Measured

TOGETHER = "together"
ORDERS = (TOGETHER, SEQUENTIAL)  # all senses at once, or the next only if unsure
MODEL = "model="


def with_subsets(config: Config, job: Job) -> FrontierConfig:
    """The family with the subsets of senses that it asks for, and with these senses by name.

    Raises:
        UserError: If the data has recordings of no known sense, or cannot be read.
    """
    frontier = config.frontier
    if frontier.senses is None:
        return frontier
    senses = frontier.senses if frontier.senses != EVERY_SENSE else _senses_of_data(config)
    model = _model(job)
    systems: dict[str, str | None] = {
        _name(subset, order): f"{model} model.senses=[{','.join(subset)}]"
        + (f" decision={SEQUENTIAL}" if order == SEQUENTIAL else "")
        for order in ORDERS
        for subset in _subsets(senses)
        if order == TOGETHER or len(subset) > 1
    }
    return replace(frontier, senses=senses, systems=systems | frontier.systems)


def _model(job: Job) -> str:
    """The override that names the model: the user's or a preset's, else the family's."""
    given = [item for item in job.overrides if item != f"{MODEL}{AUTO}"]  # that is yet to be chosen
    chosen = [item for item in given if item.startswith(MODEL)]
    return chosen[-1] if chosen else f"{MODEL}{job.compose(given).model.name}"


def _senses_of_data(config: Config) -> list[str]:
    """Known senses that the data has recordings of."""
    model = config.model
    modalities = {name: model.sense(name).modality for name in model.known}
    table = read_recordings(config.data, list(dict.fromkeys(modalities.values())))
    present = {row.modality for row in table}
    found = [name for name, modality in modalities.items() if modality in present]
    if not found:
        raise UserError(
            f"The data has recordings of {', '.join(sorted(present))}, and no sense reads these: "
            f"known are {', '.join(modalities)}; write conf/sense/NAME.yaml for another."
        )
    return found


def _subsets(senses: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """All but the empty one, the smallest first."""
    for count in range(1, len(senses) + 1):
        yield from combinations(senses, count)


def _name(subset: Sequence[str], order: str) -> str:
    """What a system of the family is called; of one sense there is one order only."""
    together = order == TOGETHER or len(subset) == 1
    return "+".join(subset) + ("" if together else f"_{order}")


def added_senses(
    senses: Sequence[str], measured: Sequence[Measured], latencies: Mapping[str, float]
) -> list[AddedSense]:
    """Cost and repaired samples of each sense added to a subset, where both are measured.

    Args:
        senses: Whose subsets are the family.
        measured: The systems.
        latencies: Mean ms of a sample, by system.
    """
    named = {system.member.name: system for system in measured}
    found: list[AddedSense] = []
    for order in ORDERS:
        for subset in _subsets(senses):
            after = named.get(_name(subset, order))
            for sense in subset if len(subset) > 1 else ():
                rest = [name for name in subset if name != sense]
                before = named.get(_name(rest, order))
                if before is not None and after is not None:
                    found += _added(sense, order, before, after, latencies)
    return found


def _added(
    sense: str, order: str, before: Measured, after: Measured, latencies: Mapping[str, float]
) -> Iterator[AddedSense]:
    told = difference(before.outcomes, after.outcomes)
    if told is None:  # there is no sample of all these senses
        return
    old, new = before.member.name, after.member.name
    yield AddedSense(
        before=old,
        after=new,
        sense=sense,
        order=order,
        added_ms=latencies[new] - latencies[old],
        **told._asdict(),
    )


def chain(
    senses: Sequence[str], chosen: str, latencies: Mapping[str, float], added: Sequence[AddedSense]
) -> list[AddedSense]:
    """The additions, one after another, that lead to the chosen system and on to all senses.

    Each time the sense that is quickest alone comes next, those of the chosen system first.
    """
    order = SEQUENTIAL if chosen.endswith(f"_{SEQUENTIAL}") else TOGETHER
    own = chosen.removesuffix(f"_{SEQUENTIAL}").split("+")
    ordered = sorted(senses, key=lambda name: (name not in own, latencies.get(name, 0.0)))
    steps = {(each.before, each.after): each for each in added}
    found = []
    for count in range(1, len(ordered)):
        subsets = [
            [name for name in senses if name in ordered[:several]] for several in (count, count + 1)
        ]
        before, after = (_name(subset, order) for subset in subsets)
        if (before, after) in steps:
            found.append(steps[before, after])
    return found
