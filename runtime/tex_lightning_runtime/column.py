"""What a column of a table means, by its name: time, an axis, or neither.

An index, a counter, an id and a label are left out, as is text; a rising column is time only if
its name says so. Without names all numbers are axes.
"""

import re
import unicodedata
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from tex_lightning_runtime.samples import MAX_AXES, Array
from tex_lightning_runtime.times import (
    EVEN,
    ONLY_DATE,
    STAMP,
    UNITS,
    TableError,
    are_moments,
    ask_unit,
    number_seconds,
    stamp_seconds,
)

if TYPE_CHECKING:
    import pandas as pd

TIMES = {  # one of them makes a column one of time
    "time", "times", "timestamp", "timestamps", "datetime", "zeit", "zeiten", "zeitstempel",
    "uhrzeit", "datenum", "temps", "tiempo", "tempo", "tijd", "czas", "epoch", "epoc", "elapsed",
    "时间", "時間", "время", "시간",
}  # fmt: skip
OF_TIME = {  # a name is one of time if all of its words are such
    *TIMES, *UNITS, "t", "date", "clock", "stamp", "unix", "ts", "since", "start", "stop", "end",
    "boot", "utc",
    "system", "relative", "rel", "header", "field", "local",
} - {"s", "d", "h", "min"}  # fmt: skip
STEPS = {"dt", "delta", "diff", "difference"}  # between samples
NO_TIMES = {
    "flight", "constant", "exposure", "integration", "response", "width", "pulse", "delay", "lag",
    "latency", "period", *STEPS,
}  # fmt: skip
INDICES = {  # may begin anew, and several samples may have one number
    "index", "idx", "counter", "cnt", "seq", "sequence", "packet", "packets", "packetcounter",
}  # fmt: skip
COUNTS = {  # go up by the same number if they are no measurement
    "number", "num", "no", "nr", "count", "counts", "n", "i", "sample", "samples", "row", "rows",
    "line", "frame", "frames", "record", "step", "point",
}  # fmt: skip
DATES = {"date", "datum", "year", "month", "week", "gpsweek", "day"}  # whole numbers
STATES = {  # few whole numbers so called are no measurement
    "label", "labels", "class", "target", "activity", "category", "annotation", "groundtruth",
    "surface", "material", "terrain", "texture", "user", "subject", "participant", "person",
    "trial", "session", "run", "group", "fold", "experiment", "series", "measurement", "event",
    "marker", "repetition", "rep", "block", "table", "fs", "odr",
}  # fmt: skip
FLAGS = {  # the same, if one of the words is such
    "status", "state", "flag", "flags", "valid", "validity", "quality", "accuracy", "alarm",
    "trigger",
}  # fmt: skip
HOUSEKEEPING = {  # of a device or its radio
    "rssi", "snr", "battery", "batt", "vbat", "crc", "checksum", "chksum", "cksum", "chk", "xor",
}  # fmt: skip
SLOW = {  # beside a signal
    "temp", "temperature", "tmp", "humidity", "latitude", "longitude", "altitude", "°c", "degc",
    "hz",
}  # fmt: skip
SENSORS = {"sensor", "channel", "node", "device", "imu", "axis", "source", "address"}
IDS = {"id", "ids", "uid", "uuid", "guid", "msgid"}
NO_UNITS = re.compile(
    r"[-+\d:]*|[a-z]{3,}\d+|utc|gmt|unix|epoch|txt|local|n|hh.*|yyyy.*|mm.*|dd.*|iso.*|since.*"
)
SEEN = 100  # cells
LONGEST = 400  # letters of a name, in which units stand
FEW, FULL = 10, 0.99  # recordings that a counter may number; share at which it begins anew
MIN_RISING = 8  # samples; fewer numbers may rise by chance
OFTEN = 0.1  # of the samples, at which a label or text changes if rows take turns
BOTH_WAYS = 0.25  # of the steps rise, and more fall, of a signal such as DE_time, one over time
USUAL = 0.9  # of the steps of a counter, which may begin anew or miss some
WITHIN = re.compile(r"\d[.,]\d|^\[\d+\]$|([]:>,;=|] ?|\d )-?\d+\s*$")  # numbers within text
GLUED = ("time", "timestamp", "zeit", "gpstow")  # unixtime
UNNAMED = re.compile(r"(unnamed: \d+(_level_\d+)?(\.\d+)?)?")


@dataclass(eq=False)
class Column:
    """One column of a table."""

    name: str  # or its number from 1
    unit: str  # in a row of units, or behind every number
    values: "pd.Series[Any]"  # numbers (samples,), or cells of text
    named: bool = True  # whether the table has names
    first: bool = False
    fault: str = ""  # a cell of text in a column of numbers, and its place
    array: str = ""  # of which it is one axis
    words: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        self.words = split_words(re.split(r"[(\[]|(?:^|\s)in\s", self.name)[0])

    @property
    def title(self) -> str:
        """Its name and unit in messages, or its number."""
        if not self.named:
            return f"column {self.name}"
        return f"{self.name!r} in {self.unit}" if self.unit else repr(self.name)

    @property
    def is_text(self) -> bool:
        """Whether its cells are text."""
        return self.values.dtype.kind not in "iuf"

    @property
    def is_stamp(self) -> bool:
        """Whether its cells are dates or clock times."""
        return self.is_text and _is(STAMP, self.values.iloc[0])

    @property
    def has_fractions(self) -> bool:
        """Whether clock times in its cells have fractions of a second."""
        return bool(re.search(r":\d\d[.,]\d|\d:\d\d:\d\d:\d", str(self.values.iloc[0])))

    @property
    def units(self) -> list[str]:
        """Units that name and row of units state, in small letters."""
        stated = [*re.findall(r"[(\[]([^)\]]{0,80})[)\]]", self.name[:LONGEST]), self.unit]
        stated += re.findall(r"(?:^|\s)in\s+(\S+)$", self.name)
        if "/" in self.name:
            stated.append(self.name.rpartition("/")[2])
        return [each for each in map(plain_unit, stated) if each]

    @property
    def is_time(self) -> bool:
        """Whether its name, or its cells if there are no names, say that it is of time."""
        if self.is_stamp:
            return not _is(ONLY_DATE, self.values.iloc[0])
        words = {*self.words}
        if self.is_text or words & NO_TIMES:
            return False
        values, counts = np.asarray(self.values), words & {*INDICES, *COUNTS, *IDS}
        if words & TIMES or (not counts and are_moments(values)):
            return not (words - OF_TIME and _swings(values))
        units, alone = {*self.units}, words - ({*UNITS} - {*self.words[:1]}) == {"t"}
        last = {unit for unit in self.words[1:][-1:] if unit in UNITS}
        first = (self.first or rising(values)) and "/" not in self.name
        glued = any(word.endswith(GLUED) for word in ("".join(self.words), *words))
        return mostly_rising(values) and (
            (first and not {*UNITS}.isdisjoint(units or {u for u in last if len(u) > 1}))
            or (words == {"min"} and rising(values))
            or (glued and not words & FLAGS)
            or (units <= {*UNITS} if alone else bool(words) and words - last <= OF_TIME)
        )

    def reason(self) -> str:
        """Return why it is no axis; "" if it is one."""
        words = {*self.words} if self.named else set()
        if self.named and UNNAMED.fullmatch(self.name.casefold()) and self.first:
            ordered = self.is_text or self.is_whole or self.values.is_monotonic_increasing
            return "index" if ordered else ""
        if "hex" in self.units:
            return "hexadecimal"
        if words & IDS:
            return "id"
        if words & {"label", "labels"}:
            return "label"
        if words & HOUSEKEEPING:
            return "housekeeping"
        if self.is_text:
            return "" if self.fault else "date" if self.is_stamp else "text"
        if not self.named:
            return ""
        if "dt" in words or (words & STEPS and len(words) > 1 and words <= OF_TIME | STEPS | {"s"}):
            return "steps of time"
        if words & DATES and words <= {*DATES, *OF_TIME, "gps", "of"} and self.is_whole:
            return "date"
        few, states = max(1, len(self.values) // 10), words and words <= STATES
        if (states or words & FLAGS) and self.is_whole and self.values.nunique() <= few:
            return "label" if states else "state"
        return "counter" if self._counts() else ""

    @property
    def interleaved(self) -> int:
        """Number of things whose rows take turns, as the column names them; 0 if none do."""
        import pandas as pd

        words = {*self.words}
        sensors = self.named and bool(words) and words <= SENSORS and not self.is_text
        if not sensors and self.reason() not in ("id", "label", "text"):
            return 0
        codes, values = pd.factorize(self.values)
        count = len(values)
        if not 2 <= count <= min(MAX_AXES, len(codes) // 4):
            return 0
        if sensors:  # or a quiet sensor
            return count if (codes[count:] == codes[:-count]).mean() > USUAL else 0
        return count if (np.diff(codes) != 0).mean() > OFTEN else 0

    @property
    def change(self) -> int:
        """Sample at which a label of few values changes, or a counter begins anew; 0 if none."""
        why, values = self.reason(), np.asarray(self.values)
        if why == "counter":
            falls = np.flatnonzero(np.diff(values) < 0)
            tops = np.maximum(values[falls] + 1.0, 1.0)  # full in bits or digits, or nearly
            next_to = np.minimum(2 ** np.ceil(np.log2(tops)), 10 ** np.ceil(np.log10(tops)))
            new = 0 < len(falls) < FEW and (tops < FULL * next_to).any()
            return int(falls[0]) + 1 if new else 0
        if why not in ("id", "label", "text"):
            return 0
        first = self.values.ne(self.values.iloc[0]).to_numpy()
        few = self.values.notna().all() and self.values.nunique() <= max(2, len(first) // 10)
        return int(first.argmax()) if few else 0

    @property
    def hidden(self) -> str:
        """A cell of text that holds a number which changes; "" if there is none, or few cells."""
        cells = [str(cell) for cell in self.values.iloc[:SEEN].dropna()]
        if len(cells) < USUAL * min(SEEN, len(self.values)):
            return ""
        numbers = [cell for cell in cells if WITHIN.search(cell)]
        return numbers[0] if len({*numbers}) > 0.5 * len(cells) else ""

    @property
    def is_whole(self) -> bool:
        """Whether its numbers are whole."""
        return self.values.dtype.kind in "iu" or bool((self.values % 1 == 0).all())

    @property
    def is_code(self) -> bool:
        """Whether few whole numbers without a name may be those of sensors or labels."""
        if self.named or not self.is_whole:
            return False
        return len(np.unique(self.values)) <= len(self.values) // 10

    @property
    def by_one(self) -> bool:
        """Whether whole numbers go up one by one, but for some that miss or begin anew."""
        steps = np.diff(np.asarray(self.values, np.float64))
        return len(steps) > MIN_RISING and bool((steps == 1).mean() > USUAL) and self.is_whole

    def _counts(self) -> bool:
        """Whether whole numbers count samples: by their name, or one by one without a unit."""
        words = {*self.words}
        index = bool(words & INDICES) or "sequence" in self.units
        called = words & COUNTS and words <= COUNTS | STATES | {"of", "sub", "logging"}
        values = np.asarray(self.values, np.float64)
        steps = np.diff(values)
        by_one = self.by_one and not self.units
        if not (index or called or by_one or self.name == "#") or not self.is_whole:
            return False
        if index or by_one:
            return by_one or bool((steps < 0).sum() <= (1 - USUAL) * len(steps))
        steps %= np.ptp(values) + 1  # sub-frames begin anew with each frame
        rises = np.flatnonzero(steps)  # at every sample, or at every tenth
        if len(rises) < 2:
            return len(steps) > len(rises) == 0
        even = [(a == np.median(a)).mean() > USUAL for a in (steps[rises], np.diff(rises))]
        return bool(all(even) and np.median(steps[rises]) > 0)

    def seconds(self, time_unit: str | None) -> Array:
        """Return the times in seconds since the first.

        Raises:
            TableError: If they cannot be understood.
        """
        if self.is_text:
            try:
                return stamp_seconds(self.values)
            except (ValueError, OverflowError) as error:
                raise self.no_times() from error
        unit = UNITS[time_unit] if time_unit else self._unit()
        values = np.asarray(self.values)
        if len(self.values) and not np.isfinite(values).all():
            raise missing(self, int(np.isfinite(values).argmin()))
        return number_seconds(values, unit, self.name)

    def no_number(self) -> TableError:
        """Return the error for cells of text in the place of numbers."""
        return TableError(
            f"has {self.fault or 'text'} in the column {self.name!r}, and no number; correct it, "
            "divide the file there if a recording begins anew, or choose other columns by "
            "data.channels"
        )

    def no_times(self) -> TableError:
        """Return the error for cells that are no times."""
        if self.fault:
            return self.no_number()
        return TableError(
            f"has {self.values.iloc[0]!r} in the column {self.name!r}, and not all of its cells "
            "can be read as such times; write them as 2026-03-01T10:00:00.000"
        )

    def _unit(self) -> float | None:
        """Return the unit of a time in seconds as name and row of units have it; None if not."""
        stated = {UNITS[unit]: unit for unit in self.units if unit in UNITS}
        for unit in () if stated else self.units:
            if not NO_UNITS.fullmatch(unit) and not {*split_words(unit)} <= OF_TIME:
                raise ask_unit(self.name, f"whose unit {unit!r} is not known")
        if not stated and re.search(r"(?<![^\W_])\d+[mun]s", self.name):  # time_100us
            raise ask_unit(self.name, "whose unit has a number")
        words = self.words[: (*self.words, "of").index("of")]  # seconds of the day
        if not stated:
            return next((UNITS[word] for word in reversed(words) if word in UNITS), None)
        stated |= {UNITS[word]: word for word in words[-1:] if word in UNITS and len(word) > 1}
        if len(stated) > 1:
            raise ask_unit(self.name, f"whose units {' and '.join(stated.values())} differ")
        return next(iter(stated))


def split_words(name: str) -> tuple[str, ...]:
    """Return the words of a name in small letters, and its numbers: ``accX_2`` has three."""
    plain = unicodedata.normalize("NFKC", name)
    parts = re.sub(r"(?<=[a-zµμ])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", plain).casefold()
    unit = r"(?<![a-z])(?:(nano|micro|milli)[\W_]+(?=s)|([mun]) (?=sec))"  # nano seconds, mSec
    whole = re.sub(unit, r"\1\2", parts)
    return tuple(re.findall(r"[^\W\d_]+|\d+", whole))


def plain_unit(unit: str) -> str:
    """Return a unit in small letters, without brackets."""
    return unicodedata.normalize("NFKC", unit).casefold().strip(" .()[]")


def _is(pattern: re.Pattern[str], cell: object) -> bool:
    return isinstance(cell, str) and pattern.fullmatch(cell.strip()) is not None


def _swings(samples: Array) -> bool:
    """Return whether samples rise and fall about zero, as no time does in whatever order."""
    steps = np.diff(samples)
    about = (samples < 0).any() and (samples > 0).any()
    return bool(about and min((steps < 0).sum(), (steps > 0).sum()) > BOTH_WAYS * len(steps))


def rising(samples: Array) -> bool:
    """Return whether samples (samples,) rise evenly, as times do."""
    if not np.isfinite(samples).all():
        return False
    steps = np.diff(samples.astype(np.float64))
    return len(steps) > MIN_RISING and bool((abs(steps - steps.mean()) < EVEN * steps.mean()).all())


def mostly_rising(samples: Array) -> bool:
    """Return whether samples (samples,) rise or rest, or rise at nearly all steps."""
    steps = np.diff(samples)
    never_falls = bool((steps >= 0).all() and steps.any())
    return never_falls or bool((steps > 0).sum() > USUAL * len(steps) > 0)


def missing(column: Column, place: int, found: str = "no number") -> TableError:
    """Return the error for a cell without a number."""
    return TableError(
        f"has {found} in the column {column.name!r} at sample {place}; repair the recording, or "
        "choose other columns by data.channels"
    )
