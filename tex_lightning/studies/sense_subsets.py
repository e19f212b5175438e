"""``frontier.senses``: every subset of senses as a family."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

from tex_lightning.config import Config, FrontierConfig
from tex_lightning.config.composition import Job
from tex_lightning.config.tasks import AUTO, EVERY_SENSE
from tex_lightning.data.readers import read_recordings
from tex_lightning.errors import UserError
from tex_lightning.inference.early_stopping import SEQUENTIAL

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
