"""Rates that are stated in words above a table, or stand there alone."""

import re
from collections.abc import Sequence
from math import isclose

from tex_lightning_runtime.cells import POINTS, THOUSANDS, decimal_mark
from tex_lightning_runtime.resampling import MAX_RATE, MIN_RATE
from tex_lightning_runtime.times import NOMINAL, UNITS

DIVIDED = re.compile(r"\b(?:decimat|downsampl)\w*\W+(?:[2-9]|\d\d)", re.IGNORECASE)
NO_RATE = re.compile(  # units of full scales, speeds and lines
    r"m?g|[mk]?[vn]|pa|dps|[cmµμ]?m|rpm|bpm|baud|[km]?bps|[km]?bits?|deg|db", re.IGNORECASE
)
DRIVEN = re.compile(  # a frequency that is not that of the samples
    r"excit|stimul|filter|cut-?off|(?:low|high|band)[ -]?pass|shaker|generator|\bsine|anregung",
    re.IGNORECASE,
)
BARE = re.compile(r"\W*freq", re.IGNORECASE)
LONG = 0.05  # s, from which on a time of sampling is that of the whole
ROUND = 25  # Hz, of which a rate that nothing calls so is a multiple
VALUE = r"(?P<value>\d{1,3}(?:[ '’\u00a0\u202f]\d{3})+(?= ?k?hz)|\.?\d[\d.,]*(?:e[-+]?\d+)?)"
SAMPLING = r"(?:samp\w*|update|output(?:[ _-]data)?|acq\w*|meas\w*|scan|log\w*)"
HERTZ = (
    r"[km]?hz|kilohertz|[km]?s/s|[km]?sps|fps|samples ?(?:/|per )s\w*"
    r"|(?:samples ?)?(?:/|per )min"
)
SECONDS = rf"(?:µs|{'|'.join(UNITS)})\b"
IN_HERTZ = rf"(?=\W*(?:set to\W+)?\d[\d.,]* *(?:{HERTZ}))"
KNOWN = rf"{HERTZ}|{SECONDS}(?![-^⁻])"  # s^-1
OF = rf"(?:was|of) (?=[\d.,'’ ]+(?:{KNOWN}|$))"  # a rate of 500 Hz, and not of 3 axes
AMOUNT = rf"[ \t:=,;@\"']+(?:is |- |set to:? |{OF})?[\"']?\+?{VALUE}[ \t,;(\"']*"
OF_UNIT = (
    r"(?:(?:[ ]*[(\[]|(?:[ _/]| in )?(?=k?hz\b))(?P<before>\w+/?\w*)[)\]]?)?"
    rf"{AMOUNT}(?P<unit>{KNOWN})?"
)
RATE = re.compile(
    r"(?:\bf_?s(?:amp\w*)?|\bodr"
    rf"|(?:\b|_)s(?:_?rate|_?freq|r(?= ?[(\[_]k?hz)|r(?= ?[:=])|r{IN_HERTZ})"
    rf"|(?<!max[ .])(?<!imum )\b{SAMPLING}(?:\. ?|[ _-])?(?:rate|freq\w*\.?)(?: per channel)?"
    r"|\b(?:abtast|mess)(?:rate|frequenz)|\bsamples[ _]?(?:per |/)s\w*"
    r"|fr[eé][cq]u\w*\W+\w+\W+(?:échantillonnage|muestreo|campionamento|amostragem)"
    r"|采样(?:率|频率)|サンプリング(?:レート|周波数)|частота дискретизации"
    r"|\b(?:samples|sampled|recorded|logged|created)\b(?:(?!pass|filter|cut).){0,200} at"
    rf"{IN_HERTZ}"
    rf"|(?=@){IN_HERTZ}|^\W*(?= \d[\d.,]* *(?:{HERTZ})\W*$)){OF_UNIT}",
    re.IGNORECASE,
)
OTHER_RATE = re.compile(  # which may be that of a camera or a radio beside the sensor
    rf"(?:^\W*(?:rate|freq(?:uency)?|hz(?= ?=)|f(?= ?={IN_HERTZ}))"
    rf"|\b(?:sampling|(?:data|daq|frame|capture|sensor|polling)[ _]?rate){IN_HERTZ}){OF_UNIT}",
    re.IGNORECASE,
)
PERIOD = re.compile(
    rf"(?:\bsampl\w*[ _-]?(?:period|time)|\b{SAMPLING}[ _-]?interval|(?:\bdelta[ _]?|[Δ∆])[xt]|\bdt"
    r"|\btime between samples|\babtast(?:intervall|zeit|periode)|\bperiod(?=_)"
    r"|^\W*in(?:crement|terval)"
    r"|\bts(?= *(?:[=(\[]|: *[\d.]+ *[mun]?s\b))|(?= \d[\d.,]* *[mun]?s\w*/(?:sample|point|pt))"
    r"|\b(?:[hxt][_ ]?|x-axis |time ?|waveform )(?:inc\w*|delta|interval|step|resolution))"
    rf"(?:(?:[ ]*[(\[]|_(?=[mun]?s\b))(?P<before>[µμ\w]+)[)\]]?)?{AMOUNT}"
    rf"(?P<unit>{SECONDS})?",
    re.IGNORECASE,
)
THREE_DIGITS = re.compile(r"(?<![\d.,])[1-9]\d{1,2}[.,]\d{3} ?Hz", re.IGNORECASE)  # 20.000 Hz


def lone_rate(cell: str, rows: Sequence[Sequence[str]], notes: list[str]) -> float | None:
    """Return a number that stands alone above the table, if it is a rate.

    It may as well be what is left of a line whose beginning was cut off: rates are round, and are
    none of the numbers below.
    """
    value = amount(cell)
    if value is not None and MIN_RATE <= value <= MAX_RATE:
        below = [abs(number) for row in rows for c in row if (number := amount(c)) is not None]
        power = value.is_integer() and int(value).bit_count() == 1
        if (value % ROUND == 0 or power) and not min(below) <= value <= max(below):
            return value
    told = f"; if it is the rate, write fs={cell}" if value and value >= MIN_RATE else ""
    notes.append(f"the line {cell!r} above the numbers is left out{told}")
    return None


def rate_doubts(
    lines: Sequence[str], rows: Sequence[Sequence[str]], rate: float | None, decimal: str
) -> list[str]:
    """Say of lines above the numbers that they may state another rate in Hz than is taken."""
    if not rate:
        told = "stands alone above the names; if it is the rate, give data.file_rate="
        return [f"{n!r} {told}{n}" for n in map(str.strip, lines) if lone_rate(n, rows, [])]
    told = f"may change the rate of {rate:,.6g} Hz; if it does, write fs=RATE in place of both"
    doubts = []
    for line in lines:
        stated = _stated(RATE, line, decimal) or rate
        if DIVIDED.search(line) or not isclose(stated, rate, rel_tol=NOMINAL):
            doubts.append(f"{line.strip()[:40]!r} {told}")
        elif decimal == "," and THREE_DIGITS.search(line):
            doubts.append(f"{line.strip()[:40]!r} is read as {stated:,.6g} Hz; else write fs=RATE")
    return doubts


def stated_rate(lines: Sequence[str], decimal: str = ".") -> float | None:
    """Return the rate in Hz that lines state, if they do; a period may be that of the whole.

    A bare frequency below words of an excitation or a filter is none. ``decimal`` is the mark of
    the numbers below: with a comma, 200,000 are two hundred.
    """
    driven = next((n for n, line in enumerate(lines) if DRIVEN.search(line)), len(lines))
    others = [line for n, line in enumerate(lines) if n < driven or not BARE.match(line)]
    ways = ((RATE, lines), (PERIOD, lines), (OTHER_RATE, others))
    return next(filter(None, (_stated(how, x, decimal) for how, said in ways for x in said)), None)


def _stated(how: re.Pattern[str], line: str, decimal: str) -> float | None:
    """Return the rate in Hz that a line states as a rate or as a period."""
    found = how.search(f" {line}")
    value = amount(found["value"], decimal) if found else None
    if found is None or not value:
        return None
    unit = (found["unit"] or found["before"] or "").replace("µ", "μ").casefold()
    if how is PERIOD or unit in UNITS:  # Sample rate: 10 ms
        if not unit and re.match(r" ?[^\W\d_]", found.string[found.end("value") :]):
            return None  # delta x: 0.1 mm
        period = value * UNITS.get(unit or "s", 0.0)
        whole = period > LONG and re.search(r"sampl\w*[ _-]?time", found[0], re.IGNORECASE)
        return 1 / period if period and not whole else None
    if NO_RATE.fullmatch(unit or re.findall(r"^\w*", found.string[found.end() :])[0]):
        return None  # FS: 4 g
    if unit.startswith("k"):
        return value * 1000
    grouped = value < MIN_RATE and (
        POINTS.fullmatch(found["value"]) or THOUSANDS.fullmatch(found["value"])
    )
    large = 1e6 if re.match("mhz|ms", unit) else 1 / 60 if unit.endswith("min") else 1
    return value * (1000 if grouped else large)  # 1.000 Hz in Germany


def amount(text: str, decimal: str = ".") -> float | None:
    """Return the first number of a text, with whatever signs it has; None of none.

    ``decimal`` is the mark of numbers beside it.
    """
    text = re.sub(r"[\s'’]", "", text.rstrip(".,"))
    grouped = decimal == "." and THOUSANDS.fullmatch(text)
    decimal, group = (".", ",") if grouped else decimal_mark([[text]])
    plain = text.replace(group or " ", "").replace(decimal, ".")
    first, _, rest = text.partition(",")
    for each in (plain, first) if {first} != {*rest.split(",")} else (first,):  # of columns
        try:
            return float(each)
        except ValueError:
            continue
    return None
