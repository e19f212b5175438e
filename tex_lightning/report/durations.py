"""Warnings of sampling rates that are probably wrong."""

from collections import defaultdict
from collections.abc import Sequence
from statistics import median

from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.quality import MEASURES
from tex_lightning.data.recordings import Recording, Recordings, plural
from tex_lightning.data.store import Store

FACTOR = 2  # by which a duration must differ from the others' to be pointed out
SHOWN = 3  # classes in the warning


def spread(values: Sequence[float], unit: str, form: str) -> str:
    """Return the smallest and the largest of some numbers, once if they read alike.

    Args:
        values: At least one.
        unit: Stands behind them; may be empty.
        form: Format of a number.
    """
    low, high = format(min(values), form), format(max(values), form)
    return f"{low if low == high else f'{low} to {high}'} {unit}".rstrip()


def mixed_rates(signals: Recordings, store: Store) -> str | None:
    """Warn of signals of a much lower rate than others, which lack what the others have above it.

    Returns:
        The warning, or None if there are none.
    """
    decoder = store.decoders[signals.rows[0].modality]
    if not isinstance(decoder, SignalDecoder):
        return None
    rates = {row: min(store.rate(row).hz, decoder.sampling_rate) for row in signals}
    highest = max(rates.values())
    low = {row: rate for row, rate in rates.items() if rate * MEASURES["rate"][0] < highest}
    if not low:
        return None
    row = min(low, key=lambda each: low[each])
    return (
        f"{len(low)} of {len(rates)} {plural(row.modality)} have a lower rate than the "
        f"{highest:,.6g} Hz of others, {low[row]:,.6g} Hz in {row.path.name}: nothing above "
        f"{low[row] / 2:,.6g} Hz is in it, and such recordings are classified less well; record "
        f"all at one rate, or set data.sampling_rate={low[row]:g}."
    )


def unlike_the_others(signals: Recordings, store: Store) -> str | None:
    """Warn of signals whose assumed rate makes them much longer or shorter than the rest.

    Returns:
        The warning, or None if there are none.
    """
    seconds = {row: store.extent(row) for row in signals if store.is_signal(row)}
    if not seconds:
        return None
    middle = median(seconds.values())
    odd: dict[str, list[Recording]] = defaultdict(list)
    for row, length in seconds.items():
        differs = length >= FACTOR * middle or length <= middle / FACTOR
        if differs and store.rate(row).source == "assumed":
            odd[row.label].append(row)
    if not odd:
        return None
    told = [
        f"{label}, {spread([seconds[row] for row in rows], 's', '.3g')} ({len(rows)} files, "
        f"{rows[0].path} for one)"
        for label, rows in [*odd.items()][:SHOWN]
    ]
    first = next(iter(odd.values()))[0]
    more = f"; and {len(odd) - SHOWN} more classes" if len(odd) > SHOWN else ""
    return (
        f"Is {store.rate(first).hz:,.6g} Hz the rate of all files that name none? At this assumed "
        f"rate some {plural(first.modality)} last much longer or shorter than the median of "
        f"{middle:.3g} s: {'; '.join(told)}{more}. If not, correct data.file_rate, or give these "
        "files their rate (a column of the manifest)."
    )
