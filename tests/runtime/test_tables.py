"""Tables as people and programs write them, against the numbers they were written from."""

import csv
import gzip
import json
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from time import process_time

import numpy as np
import pytest

from tex_lightning_runtime import plain_text
from tex_lightning_runtime.cells import kind
from tex_lightning_runtime.errors import UserError
from tex_lightning_runtime.plain_text import check_size
from tex_lightning_runtime.tables import read_table
from tex_lightning_runtime.times import TableError
from tex_lightning_runtime.traces import read_samples

RATE, COUNT = 2000, 240
RNG = np.random.default_rng(0)
AXES = RNG.uniform(-1, 1, (3, COUNT)).round(5)
TIMES = np.arange(COUNT) / RATE
BEGIN = datetime(2026, 3, 1, 23, 59, 59, 950_000, tzinfo=UTC)  # passes midnight
MOMENTS = [BEGIN + timedelta(seconds=time) for time in TIMES.tolist()]
NUMBERS = range(COUNT)
SHARED = Path(__file__).parents[3] / "shared" / "data" / "tables"


def column(values, form="{:.5f}"):
    return [form.format(value) for value in values]


X, Y, Z = map(column, AXES)
XYZ = (X, Y, Z)
COMMAS = [[cell.replace(".", ",") for cell in each] for each in XYZ]


def table(*columns, mark=",", names="", end="\n", comma=False, quote=False):
    """Text of columns of cells below a line of names."""
    cells = [[c.replace(".", ",") for c in each] if comma else each for each in columns]
    cells = [[f'"{c}"' for c in each] if quote else each for each in cells]
    return names + "".join(mark.join(row) + end for row in zip(*cells, strict=True))


def clock(form, digits=6, begin=0):
    return [each.strftime(form)[: digits - 6 or None] for each in MOMENTS[begin:]]


def times(scale=1.0, form="{:.6f}", start=0.0):
    return column(TIMES * scale + start, form)


def at(scale):
    """Times since 1970 as whole numbers."""
    return [str(1_772_359_200 * int(scale) + int(i * scale) // RATE) for i in NUMBERS]


COUNTER = column(NUMBERS, "{}")
TWICE = "".join(
    f"{line}\n" * (1 + (n == 99)) for n, line in enumerate(table(times(), *XYZ).splitlines())
)
WORDS = ["walk"] * COUNT
PHYPHOX = '"Time (s)","Acceleration x (m/s^2)","Acceleration y (m/s^2)","Acceleration z (m/s^2)"\n'
LVM = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
    "Multi_Headings\tNo\nX_Columns\tOne\nTime_Pref\tRelative\nDate\t2026/03/01\nTime\t10:00:00.1\n"
    "***End_of_Header***\t\n\t\nChannels\t3\t\t\t\nSamples\t240\t240\t240\t\nY_Unit_Label\tg\tg\tg\t\n"
    "X_Dimension\tTime\tTime\tTime\t\nX0\t0.0\t0.0\t0.0\t\nDelta_X\t0.0005\t0.0005\t0.0005\t\n"
    "***End_of_Header***\t\t\t\t\nX_Value\tAcc X\tAcc Y\tAcc Z\tComment\n"
)
GULF = (
    ";Title, http://www.gcdataconcepts.com, X16-1c\r\n;Start_time, 2012-10-24, 03:29:25.409\r\n"
    ";Temperature, 35.00, deg C,  Vbat, 1681, mv\r\n;Gain, low\r\n;SampleRate, 2000,Hz\r\n"
    ";Deadband, 0, counts\r\n;DeadbandTimeout, 1,sec\r\n"
)
PROSE = "Recorded by tool A, in Munich, on a Monday\nSerial: 12, 13, 14\n\n"

UNITS = {
    "ms": 1e3, "(ms)": 1e3, "us": 1e6, "µs": 1e6, "\u03bcs": 1e6, "[ns]": 1e9, "ns": 1e9, "s": 1,
    "sec": 1, "seconds": 1, "min": 1 / 60, "minutes": 1 / 60, "msec": 1e3,
}  # fmt: skip

# text, and the rate in Hz that it states
READ = {
    # dialects
    "semicolons": (table(*XYZ, mark=";", names="x;y;z\n"), None),
    "semicolons, decimal commas": (table(*XYZ, mark=";", comma=True, names="x;y;z\n"), None),
    "tabs, decimal commas": (table(*XYZ, mark="\t", comma=True), None),
    "blanks": (table(*XYZ, mark=" "), None),
    "several blanks": (table(*XYZ, mark="   ", names="x y z\n"), None),
    "blanks, decimal commas": (table(*XYZ, mark=" ", comma=True), None),
    "aligned": ("".join("".join(f"{v:12.5f}" for v in row) + "\n" for row in AXES.T), None),
    "commas and blanks": (table(*XYZ, mark=", ", names="x, y, z\n"), None),
    "bars": (table(*XYZ, mark=" | ", names="x | y | z\n"), None),
    "quoted": (table(*XYZ, quote=True, names='"x","y","z"\n'), None),
    "quoted, decimal commas": (table(*XYZ, quote=True, comma=True, names="x,y,z\n"), None),
    "quoted, semicolons": (table(*XYZ, mark=";", quote=True, comma=True, names="x;y;z\n"), None),
    "sep=": ("sep=;\n" + table(*XYZ, mark=";", comma=True, names="x;y;z\n"), None),
    "separators at the ends": (table(*XYZ, end=",\n", names="x,y,z,\n"), None),
    "separators at the ends, no names": (table(*XYZ, mark=";", end=";;\n"), None),
    "empty rows of a spreadsheet": (table(*XYZ, names="x,y,z\n") + ",,\n" * 5, None),
    "empty lines": (table(*XYZ, end="\n\n", names="\n\nx,y,z\n\n"), None),
    "CRLF": (table(*XYZ, end="\r\n", names="x,y,z\r\n"), None),
    "CR": (table(*XYZ, end="\r", names="x,y,z\r"), None),
    "exponents": (table(*(column(axis, "{:.9E}") for axis in AXES), names="x,y,z\n"), None),
    "name:number": (
        "".join(f"x:{a},y:{b},z:{c}\n" for a, b, c in zip(*XYZ, strict=True)), None
    ),
    "name=number": (
        "".join(f"x={a} y={b} z={c}\r\n" for a, b, c in zip(*XYZ, strict=True)), None
    ),
    "name: number, tabs": (
        "ready\n" + "".join(f"x: {a}\ty: {b}\tz: {c}\n" for a, b, c in zip(*XYZ, strict=True)), None
    ),
    "lines of JSON": (
        "".join(f'{{"x": {a}, "y": {b}, "z": {c}}}\n' for a, b, c in zip(*XYZ, strict=True)), None
    ),
    "a unit in every cell": (table(*([f"{c} g" for c in each] for each in XYZ)), None),
    "vectors": (table(times(), [f'"({x}, {y}, {z})"' for x, y, z in zip(*XYZ, strict=True)],
                      names="time,acc\n"), RATE),
    "vectors without quotes": (
        table(times(), [f"({x}, {y}, {z})" for x, y, z in zip(*XYZ, strict=True)],
              names="time,acc\n"), RATE
    ),
    "vectors of NumPy": (table(times(), [f"[ {x}  {y} {z} ]" for x, y, z in zip(*XYZ, strict=True)],
                               names="time,acc\n"), RATE),
    # what stands above and below
    "Gulf Coast's logger": (
        GULF + ";Headers, time,Ax,Ay,Az\r\n" + table(times(), *XYZ, end="\r\n"), RATE
    ),
    "Gulf Coast's new logger": (
        f"{GULF};Time, Ax, Ay, Az\r\n" + table(times(), *XYZ) + ";shutdown: switched off\n", RATE
    ),
    "semicolons before all": (table([""] * COUNT, *XYZ, mark=";", names=";x;y;z\n"), None),
    "a long remark": ("#" + "a" * 200_000 + "\n" + table(*XYZ, names="x,y,z\n"), None),
    "prose": (PROSE + table(*XYZ, names="x,y,z\n"), None),
    "prose, as many words": ("Tool A, Munich, Monday\n" + table(*XYZ, names="x,y,z\n"), None),
    "prose, no names": ("Tool A\n-----\n" + table(*XYZ), None),
    "comments": (
        "# tool A\n% lab, 3, b\n// c\n" + table(*XYZ, end="\n# d\n", names="x,y,z\n"), None
    ),
    "names in a comment": ("# lab 3\n# x y z\n" + table(*XYZ, mark=" "), None),
    "units": (table(*XYZ, names="x,y,z\nm/s²,m/s²,m/s²\n"), None),
    "units in brackets": (table(*XYZ, names="x;y;z\n[g];[g];[g]\n", mark=";"), None),
    "levels of pandas": (table(COUNTER, *XYZ, names=",acc,acc,acc\n,x,x,z\n"), None),
    "names that repeat": (table(*XYZ, names="a,a,a\n"), None),
    "numbered columns": (table(*XYZ, names="0,1,2\n"), None),
    "numbered columns and index": (table(COUNTER, *XYZ, names=",0,1,2\n"), None),
    "a footer": (table(*XYZ, names="x,y,z\n") + "\n--- end ---\nSamples: 240\n", None),
    "a number of samples": (f"{COUNT * 1000}\n" + table(*XYZ), None),
    "a rate": ("2000\n" + table(*XYZ), RATE),
    "thousands": ("Abtastrate: 2.000 Hz\n" + table(*XYZ), RATE),
    "settings in JSON": (
        '{"fs": 2000, "axes": ["x", "y", "z"]}\n' + table(*XYZ, names="x,y,z\n"), RATE
    ),
    "fs=": ("fs=2000\n" + table(*XYZ, names="x,y,z\n"), RATE),
    "# rate:": ("# rate: 2000 Hz\n" + table(*XYZ), RATE),
    "kHz": ("Sampling rate (kHz);2\n" + table(*XYZ, mark=";", comma=True, names="x;y;z\n"), RATE),
    "Abtastrate": ("Abtastrate: 2.000,0 Hz\n".replace(".", "") + table(*XYZ), RATE),
    "sample interval": ('"Sample Interval",5.00E-4,s\n' + table(*XYZ, names="x,y,z\n"), RATE),
    "period in µs": ("# sampling period: 500 µs\n" + table(*XYZ), RATE),
    **{
        stated: (f"{stated}\nx,y,z\n" + table(*XYZ), RATE)
        for stated in (
            "sampleRateHz: 2000", "Abtastrate in Hz: 2000", "Sampling Rate - 2000 Hz", "sr=2000",
            "Sampling rate is 2 kHz", "2000 samples per second", "2 kilohertz", "f = 2000 Hz",
            "Timestep=0.0005", "Time between samples: 0.5 ms", "freq: 2000", "采样率: 2000",
            "Excitation: sine\nFrequency: 50 Hz\nSampling rate: 2000", "Filter\nRate: 2000 Hz",
            "Frequency: 50 Hz\nSampling rate: 2000 Hz", "Sample time: 0.12 s\nRate: 2000",
            "Frequency: 2000\nFilter: 50 Hz",
            "Sampling rate: 2 000 Hz", "Sampled in the lab at a sampling rate of 2000 Hz by A",
            "Sample rate: 0.002 MHz", "Sample rate: 0.002 MS/s", "Sample rate: 0.5 ms",
            "Sampling interval (ms),0.5", "Sampling rate: 2000 s^-1", "Sampling rate (max): 2000",
            "2000 Hz", "# a b c @2000Hz", "Created on 1/3/2026 at 2000 Hz by A", "0.5 msec/sample",
            '"RDT Sample Rate:","2000"', '"Sample interval","0.5","ms"', "X increment,0.0005",
            "Sampling rate per channel (Hz): 2000",
            "Data rate set to: 2000 Hz",
        )
    },
    **{
        told: (f"# {told}\nx,y,z\n" + table(*XYZ), None)
        for told in ("Sampling rate of 3 axes", "The sampling rate was 10 times that of the camera")
    },
    "a filter, which has no rate": (
        "Created with a low pass at 50 Hz\nx,y,z\n" + table(*XYZ), None
    ),
    "a rate of three digits for each column": (
        "Rate,250,250,250\nName,a,b,c\n" + table([""] * COUNT, *XYZ), 250
    ),
    # columns that are no axes
    "sub-frames": (
        table(column(np.arange(COUNT) // 4, "{}"), column(np.arange(COUNT) % 4, "{}"), *XYZ,
              names="Frame,Sub Frame,x,y,z\n"), None
    ),
    "packet": (table(column(np.arange(COUNT) // 3, "{}"), *XYZ, names="packet,x,y,z\n"), None),
    "counter of a byte": (
        table(column(np.arange(COUNT) % 256, "{}"), *XYZ, names="PacketCounter,x,y,z\n"), None
    ),
    "index that missed some": (
        table(column(np.arange(COUNT) + (np.arange(COUNT) > 99), "{}"), *XYZ, names="idx,x,y,z\n"),
        None,
    ),
    "sample": (table(COUNTER, *XYZ, names="sample,x,y,z\n"), None),
    "Sample No.": (table(COUNTER, *XYZ, names="Sample No.,x,y,z\n"), None),
    "#": (table(COUNTER, *XYZ, names='"#",x,y,z\n'), None),
    "N": (table(COUNTER, *XYZ, names="N;x;y;z\n", mark=";"), None),
    "Unnamed: 0": (table(COUNTER, *XYZ, names="Unnamed: 0,x,y,z\n"), None),
    "ids": (table(["7"] * COUNT, *XYZ, ["a7"] * COUNT, names="series_id,x,y,z,device id\n"), None),
    "labels": (table(*XYZ, ["2"] * COUNT, WORDS, names="x,y,z,class,activity\n"), None),
    "trial and surface": (
        table(["1"] * COUNT, *XYZ, ["3"] * COUNT, names="Trial,x,y,z,surface\n"), None
    ),
    "text": (table(*XYZ, WORDS, names="x,y,z,note\n"), None),
    "one hexadecimal number": (table(["0x50"] * COUNT, *XYZ, names="port,x,y,z\n"), None),
    "text without names": (table(*XYZ, WORDS), None),
    "an empty column": (table(*XYZ, [""] * COUNT, names="x,y,z,comment\n"), None),
    "an empty column between": (table(X, [""] * COUNT, Y, Z, names="x,,y,z\n"), None),
    # times
    "time": (table(times(), *XYZ, names="time,x,y,z\n"), RATE),
    "t": (table(times(), *XYZ, names="t,x,y,z\n"), RATE),
    "T / s": (table(times(), *XYZ, names="T / s;x;y;z\n", mark=";", comma=True), RATE),
    "time last": (table(*XYZ, times(), names="x,y,z,Time\n"), RATE),
    "time_ms": (table(times(1e3), *XYZ, names="time_ms,x,y,z\n"), RATE),
    "timeMs": (table(times(1e3), *XYZ, names="timeMs,x,y,z\n"), RATE),
    "t in s": (table(times(), *XYZ, names="t in s;x;y;z\n", mark=";", comma=True), RATE),
    "Zeit in ms": (table(times(1e3), *XYZ, names="Zeit in ms;x;y;z\n", mark=";", comma=True), RATE),
    "TimeUS": (table(times(1e6, "{:.0f}", 5e7), *XYZ, names="TimeUS,x,y,z\n"), RATE),
    "micros": (table(times(1e6, "{:.0f}"), *XYZ, names="micros,x,y,z\n"), RATE),
    "Milliseconds": (table(times(1e3), *XYZ, names="Milliseconds,x,y,z\n"), RATE),
    "time [µs]": (table(times(1e6, "{:.0f}"), *XYZ, names="time [µs],x,y,z\n"), RATE),
    "time (min)": (table(times(1 / 60, "{:.12f}"), *XYZ, names="time (min),x,y,z\n"), RATE),
    **{
        f"row of units, {unit}": (
            table(times(scale, "{:.12g}"), *XYZ, names=f"Time,a,b,c\n{unit},g,g,g\n"), RATE
        )
        for unit, scale in UNITS.items()
    },
    **{
        f"since 1970 in {scale:g}": (table(at(scale), *XYZ, names="timestamp,x,y,z\n"), RATE)
        for scale in (1e6, 1e9)
    },
    "since 1970 in s": (
        table(column(1_772_359_200 + TIMES, "{:.6f}"), *XYZ, names="Timestamp,x,y,z\n"), RATE
    ),
    "seconds_elapsed": (
        table(at(1e9), times(), *XYZ, names="time,seconds_elapsed,z,y,x\n"), RATE
    ),
    "ROS": (
        table(at(1e9), COUNTER, at(1e9), ["imu"] * COUNT, *XYZ, names="%time,field.header.seq,"
              "field.header.stamp,field.header.frame_id,field.a.x,field.a.y,field.a.z\n"), RATE
    ),
    "secs and nsecs": (
        table(COUNTER, column((np.arange(COUNT) + 1900) // 2000 + 1_772_359_200, "{}"),
              column((np.arange(COUNT) + 1900) % 2000 * 500_000, "{}"), *XYZ,
              names=".header.seq,.header.stamp.secs,.header.stamp.nsecs,.x,.y,.z\n"), RATE
    ),
    "Phyphox": (table(*(column(v, "{:.9E}") for v in (TIMES, *AXES)), names=PHYPHOX), RATE),
    "Phyphox, tabs, commas": (
        table(*(column(v, "{:.9E}") for v in (TIMES, *AXES)), mark="\t", comma=True,
              names=PHYPHOX.replace(",", "\t")), RATE
    ),
    "LabVIEW": (LVM + table(times(), *XYZ, mark="\t"), RATE),
    "LabVIEW without X": (
        LVM.replace("One", "No") + table([""] * COUNT, *XYZ, mark="\t"), RATE
    ),
    "ISO": (table(clock("%Y-%m-%dT%H:%M:%S.%f"), *XYZ, names="time,x,y,z\n"), RATE),
    "ISO, blank": (table(clock("%Y-%m-%d %H:%M:%S.%f"), *XYZ, names="Date,x,y,z\n"), RATE),
    "ISO, Z": (table(clock("%Y-%m-%dT%H:%M:%S.%fZ"), *XYZ, names="timestamp,x,y,z\n"), RATE),
    "ISO, zone": (table(clock("%Y-%m-%d %H:%M:%S.%f+01:00"), *XYZ, names="time,x,y,z\n"), RATE),
    "ISO, comma": (
        table(clock("%Y-%m-%d %H:%M:%S,%f"), *XYZ, mark=";", comma=True, names="time;x;y;z\n"), RATE
    ),
    "index of pandas": (table(clock("%Y-%m-%d %H:%M:%S.%f"), *XYZ, names=",x,y,z\n"), RATE),
    "dd.mm.yyyy": (
        table(clock("%d.%m.%Y %H:%M:%S,%f"), *COMMAS, mark=";", names="Zeit;x;y;z\n"), RATE
    ),
    "mm/dd/yyyy, AM": (
        table(clock("%m/%d/%Y %I:%M:%S.%f %p"), *XYZ, names="Date/Time,x,y,z\n"), RATE
    ),
    "days of Excel": (
        table(column(45250.52 + TIMES / 86_400, "{:.11f}"), *XYZ, names="Date,x,y,z\n"), RATE
    ),
    **{
        f"ticks of {system}": (
            table(column(range(begin, begin + 5000 * COUNT, 5000), "{}"), *XYZ,
                  names="timestamp,x,y,z\n"), RATE
        )
        for system, begin in {"Windows": 134_168_328_000_000_000, ".NET": 639_079_560_000_000_000}
        .items()
    },
    "minutes alone": (table(times(1 / 60, "{:.12f}"), *XYZ, names="min,x,y,z\n"), RATE),
    "clock of twelve hours": (
        table([c.replace("23:59:", "12:59:").replace("00:00:", "01:00:")
               for c in clock("%H:%M:%S.%f")], *XYZ, names="time,x,y,z\n"), RATE
    ),
    "clock": (table(clock("%H:%M:%S.%f"), *XYZ, names="time,x,y,z\n"), RATE),
    "clock, comma": (
        table(clock("%H:%M:%S,%f"), *XYZ, mark=";", comma=True, names="Uhrzeit;x;y;z\n"), RATE
    ),
    "clock, colon": (table(clock("%H:%M:%S:%f"), *XYZ, names="time,x,y,z\n"), RATE),
    "clock, a tab before commas": (
        table([f"{t}\t{x}" for t, x in zip(clock("%H:%M:%S.%f"), X, strict=True)], Y, Z), RATE
    ),
    "clock, PM": (table(clock("%I:%M:%S.%f %p"), *XYZ, names="time,x,y,z\n"), RATE),
    "minutes of Excel": (table([f"00:0{t:.4f}" for t in TIMES], *XYZ, names="Time,x,y,z\n"), RATE),
    "dd.mm.yy": (
        table(clock("%d.%m.%y %H:%M:%S.%f"), *COMMAS, mark="\t", names="Zeit\tx\ty\tz\n"), RATE
    ),
    "date and clock, commas": (
        table(clock("%d.%m.%Y"), clock("%H:%M:%S,%f"), *COMMAS, mark=";",
              names="Datum;Zeit;x;y;z\n"), RATE
    ),
    "date and clock": (
        table(clock("%d.%m.%Y"), clock("%H:%M:%S.%f"), *XYZ, mark="\t",
              names="Datum\tUhrzeit\tx\ty\tz\n"), RATE
    ),
    "no names, ISO": (table(clock("%Y-%m-%dT%H:%M:%S.%f"), *XYZ), RATE),
    "dd-mm-yyyy, points": (
        table(clock("%d-%m-%Y %H.%M.%S,%f"), *COMMAS, mark=";", names="Tidspunkt;x;y;z\n"), RATE
    ),
    "ISO without marks": (table(clock("%Y%m%dT%H%M%S.%f"), *XYZ, names="time,x,y,z\n"), RATE),
    "mSec": (table(times(1e3), *XYZ, names="Time_mSec,x,y,z\n"), RATE),
    "uSec": (table(times(1e6, "{:.0f}"), *XYZ, names="TimeStamp uSec,x,y,z\n"), RATE),
    "lines twice": (
        "t,x,y,z\n" + "".join(f"{line}\n" * 2 for line in table(times(), *XYZ).splitlines()), RATE
    ),
    "a line twice": ("t,x,y,z\n" + TWICE, RATE),
    "temps en secondes": (table(times(), *XYZ, names="Temps (secondes),x,y,z\n"), RATE),
    "names of months": (table(clock("%d-%b-%Y %H:%M:%S.%f"), *XYZ, names="Time,x,y,z\n"), RATE),
    "minutes and seconds past the hour": (
        table(clock("%M:%S.%f"), *XYZ, names="Time,x,y,z\n"), RATE
    ),
    "differences of pandas": (
        table([f"0 days 00:00:{t:09.6f}" for t in TIMES], *XYZ, names=",x,y,z\n"), RATE
    ),
    "differences of Python": (
        table([f"1 day, 0:00:0{t:.6f}" for t in TIMES], *XYZ, mark=";", names="elapsed;x;y;z\n"),
        RATE,
    ),
    "hours, minutes, seconds": (
        table(*(clock(f) for f in ("%H", "%M")), clock("%S.%f"), *XYZ,
              names="hour,minute,second,x,y,z\n"), RATE
    ),
    "date in parts and milliseconds": (
        table(["2026"] * COUNT, clock("%m"), clock("%d"), *(clock(f) for f in ("%H", "%M", "%S")),
              [f"{m.microsecond / 1000:.1f}" for m in MOMENTS], *XYZ,
              names="Year,Month,Day,hour,min,sec,ms,x,y,z\n"), RATE
    ),
    "clock and milliseconds": (
        table(clock("%H:%M:%S"), [f"{m.microsecond / 1000:.1f}" for m in MOMENTS], *XYZ,
              names="time,ms,x,y,z\n"), RATE
    ),
    "a number as date": (
        table(["20260301"] * COUNT, clock("%H:%M:%S.%f"), *XYZ, names="date,time,x,y,z\n"), RATE
    ),
    "unixtime": (table(at(1e6), *XYZ, names="unixtime,x,y,z\n"), RATE),
    "no word of time, but its unit": (table(times(), *XYZ, names="X [s],a,b,c\n"), RATE),
    "unit of time below": (
        table(times(), *XYZ, names="x-axis,1,2,3\nsecond,Volt,Volt,Volt\n"), RATE
    ),
    "stated period alone": (
        table(times(1, "{:.4f}", -0.1), *XYZ, names="Sample Interval,5.0E-4\n"), RATE
    ),
    "ticks beside a stated rate that may be moments": (
        "Output rate: 2000 Hz\n" + table(column(np.array(NUMBERS) * 500_000 + 2_938_472_613, "{}"),
                                         *XYZ, names="TimeFine,x,y,z\n"), RATE
    ),
    "ticks beside a stated rate": (
        table(COUNTER, at(1e4), *XYZ, names="// Update Rate: 2000.0Hz\npacket,TimeFine,x,y,z\n"),
        RATE,
    ),
    "a time without its dots": (
        table(times(), clock("%Y-%m-%dT%H.%M.%S.%f"), *XYZ, names="elapsed (s),timestamp,x,y,z\n"),
        RATE,
    ),
    "steps of time": (table(["0.5"] * COUNT, *XYZ, names="delta_ms,x,y,z\n"), None),
    "steps of time in words": (
        table(["5", "6"] * (COUNT // 2), *XYZ, names="time diff in ms,x,y,z\n"), None
    ),
    "even times beside those of arrival": (
        table(column(TIMES + RNG.uniform(0, 4e-4, COUNT), "{:.6f}"), times(1e6, "{:.0f}"), *XYZ,
              names="host_time,uptime_us,x,y,z\n"), RATE
    ),
    "weeks of satellites and their seconds": (
        table(["2417"] * COUNT, times(start=397_000), *XYZ, names="GPSWeek,GPSTOW,x,y,z\n"), RATE
    ),
    "seconds of the day": (
        table(["127"] * COUNT, times(start=52_522), *XYZ, names="DayOfYear,SecondOfDay,x,y,z\n"),
        RATE
    ),
    "German marks in a rate": ("Abtastrate: 2.000,00 Hz\nx;y;z\n" + table(*COMMAS, mark=";"), RATE),
    **{
        f"{stated} beside decimal commas": (
            f"{stated}\nx;y;z\n" + table(*COMMAS, mark=";"), rate
        )
        for stated, rate in {
            "Abtastrate: 200,000 Hz": 200, "fs=200,000": 200, "Abtastrate: 2.000 Hz": RATE,
            "Abtastrate: 1,344 kHz": 1344, "Abtastintervall: 5,000 ms": 200,
            "Sampling rate: 2,000 Hz": RATE, "Sampling rate: 52.734 Hz": 52.734,
        }.items()
    },
    "German interval": ("Abtastintervall: 0,5 ms\nx;y;z\n" + table(*COMMAS, mark=";"), RATE),
    "a rate in a sentence": ("# 240 samples at 2000 Hz, 3 sensors\n" + table(*XYZ), RATE),
    "a unit within the name of the rate": ("# sensor=A fs_hz=2000 range_g=8\n" + table(*XYZ), RATE),
    "a unit within the name of the period": ("# period_us=500\n" + table(*XYZ), RATE),
    "full scale, which is no rate": ("FS: 100 g\nSampling rate: 2000 Hz\n" + table(*XYZ), RATE),
    "even times that are rounded": (
        table(column(np.array(NUMBERS) * 5 // 2, "{}"), *XYZ, names="time_ms,x,y,z\n"), 400
    ),
    "date in parts of one name": (
        table(clock("%f000"), *(clock(f) for f in ("%Y", "%m", "%d", "%H", "%M", "%S")), *XYZ,
              names="UTC_Nano,UTC_Year,UTC_Month,UTC_Day,UTC_Hour,UTC_Minute,UTC_Second,x,y,z\n"),
        RATE
    ),
    "one stamp beside a stated rate": (
        "Sample Rate: 2000\n" + table(*XYZ, ["1/3/26 10:00:00"] * COUNT, names="x,y,z,Time\n"), RATE
    ),
    # no signals
    "hexadecimal numbers": (
        table(column(np.array(NUMBERS) * 7 + 0x1000, "{:x}"), *XYZ, names="RDT (hex),x,y,z\n"), None
    ),
    "upkeep of a device": (
        table(times(), *XYZ, ["C3", "12", "E4", "A0"] * (COUNT // 4), ["-61", "-62"] * (COUNT // 2),
              names="t,x,y,z,crc8,rssi_dbm\n"), RATE
    ),
    "states of a device": (
        table(["7"] * 9 + ["8"] * (COUNT - 9), *XYZ, ["1"] * 9 + ["2"] * (COUNT - 9),
              names="robot_state,x,y,z,runtime_state\n"), None
    ),
    "a counter of a byte that misses some": (
        table(column(np.array([*range(100), *range(103, COUNT + 3)]) % 128, "{}"), *XYZ,
              names="pkt,x,y,z\n"), None
    ),
    "an index of pandas, twice": (
        table(COUNTER, column(np.array(NUMBERS) + 500, "{}"), *XYZ,
              names="Unnamed: 0.1,Unnamed: 0,x,y,z\n"), None
    ),
    # settings beside the table, and results above it
    "results": (
        "Results\n,Peak,Mean\n1,0.9,0.1\nAll,0.9,0.1\n\nRaw data\n"
        + table(*XYZ, names="x,y,z\n(N),(N),(N)\n"), None
    ),
    "titles above their numbers": (
        "channels:\na\tb\tc\ndt:\n0.0005\t0.0005\t0.0005\ndata:\n" + table(*XYZ, mark="\t"), RATE
    ),
    "a measurement without a name": (table(*XYZ, names=",y,z\n"), None),
    "settings left of it": (
        "".join(
            f"{key},{value},,{t:.4f},{x},{y},{z}\n" for (key, value), t, x, y, z in zip(
                [("Record Length", "240"), ("Sample Interval", "5.0E-4"), ("Source", "CH1"),
                 *[("", "")] * (COUNT - 3)], TIMES, *XYZ, strict=True)), RATE
    ),
    "settings left of it, all of them numbers": (
        "".join(
            f'"{key}",{value},{t:.4f},{x},{y},{z}\n' for (key, value), t, x, y, z in zip(
                [("Record Length", 240), ("", ""), ("Sample Interval", "5.0E-4"),
                 *[("", "")] * (COUNT - 3)], TIMES, *XYZ, strict=True)), RATE
    ),
    "a title left of the first row": (
        table(["values", *[""] * (COUNT - 1)], times(), *XYZ, mark=";",
              names="name;time;x;y;z\nunit;s;g;g;g\n"), RATE
    ),
    "settings of every column": (
        "Channel,a,b,c\nSample rate,2000.0,2000.0,2000.0\nStart,0,0,0\n"
        + table([""] * COUNT, *XYZ), RATE
    ),
    "settings behind the names": (
        table(times(), *XYZ, end=",\n",
              names="t(s),x(V),y(V),z(V),t0 =-2.0e-01, tInc = 5.0e-04,\n"), RATE
    ),
    "settings behind names and units": (
        table(COUNTER, *XYZ, end=",\n",
              names="X,a,b,c,Start,Increment,\nSequence,Volt,Volt,Volt,0,5.0e-04\n"), RATE
    ),
    "total and rate": (
        "Sampling time: 0.12 s\nSampling rate: 2 kHz\n" + table(*XYZ, names="x,y,z\n"), RATE
    ),
    "one column without X of LabVIEW": (
        "Writer_Version\t2\nX_Columns\tNo\n***End_of_Header***\t\nChannels\t3\nSamples\t240\n"
        "Delta_X\t0.0005\n***End_of_Header***\nX_Value\tx\ty\tz\tComment\n"
        + table([""] * COUNT, *XYZ, mark="\t"), RATE
    ),
    "# as a name": (table(COUNTER, *XYZ, names="#,x,y,z\n"), None),
    "a table of Markdown": (
        "| x | y | z |\n|---|---|---|\n"
        + "".join(f"| {a} | {b} | {c} |\n" for a, b, c in zip(*XYZ, strict=True)), None
    ),
    "a remark in the first row": (
        table(*XYZ, ["start", *[""] * (COUNT - 1)], names="x,y,z,remark\n"), None
    ),
    "names over two lines": (
        table(times(), *XYZ, names='"Time\n(s)","Acc\nx","Acc\ny","Acc\nz"\n'), RATE
    ),
    "text that begins with digits": (
        table(*XYZ, ["192.168.0.12"] * COUNT, ["1.2.3"] * COUNT, names="x,y,z,host,version\n"), None
    ),
    # names among other lines
    "the number of samples below the names": (
        "a.acq\n3 channels\nx\ng\ny\ng\nz\ng\nmsec,a,b,c,\n,240,240,240,\n"
        + table(times(1e3), *XYZ, end=",\n"), RATE
    ),
    "the number of samples below the names, no times": (
        "0.5 msec/sample\na\tb\tc\n240\t240\t240\n" + table(*XYZ, mark="\t"), RATE
    ),
    "units of many letters below types": (
        table(times(1e3), *XYZ, mark="\t", names="A\tA\tA\tA\nTime\tx\ty\tz\nCAL\tCAL\tCAL\tCAL\n"
              "mSecs\tm/(sec^2)\tm/(sec^2)\tm/(sec^2)\n"), RATE
    ),
    "types of many letters below units": (
        table(times(1e3), *XYZ, names="Time,x,y,z\nms,g,g,g\nfloat64,float64,float64,float64\n"),
        RATE
    ),
    "units that are not known below a time": (
        table(times(), *XYZ, mark="\t", names="Time\ta\tb\tc\ns\tmV/V\tbar\tfoo\n"), RATE
    ),
    "remarks below units that all differ": (
        table(times(), *XYZ, mark="\t", names="Time\ta\tb\tc\ns\tN\tV\tg\n\tleft\tup\tin\n"),
        RATE
    ),
    "rates of columns below their names": (
        table(times(), *XYZ, names="t (s),a,b,c\n(2000.5 Hz),,,\n"), RATE
    ),
    "rates of columns without brackets below their names": (
        table(times(), *XYZ, names="t (s),a,b,c\n2000.5 Hz,,2000.5 Hz,\n"), RATE
    ),
    "a line that is cut below the names": (
        table(times(), *XYZ, names="time,a,b,c\n21,0.5\n"), RATE
    ),
    "a setting of three words": (
        "X-Axis Delta: 5.0E-4\nTitle 1: Time(Acc)\n" + table(*XYZ, mark="\t"), RATE
    ),
    "three levels of names": (
        table(times(), *XYZ, names="time_s,imu,imu,gyro\nhost,mean,mean,mean\nx,x,y,x\n"), RATE
    ),
    "ranges in names": (table(times(), *XYZ, names="t (s),X (1.5 g),Y (1.5 g),Z (2.5 g)\n"), RATE),
    "an index that is named below the levels": (
        table(times(1e3), *XYZ, names="sensor,a,a,a\naxis,x,y,z\ntime_ms,,,\n"), RATE
    ),
    "columns numbered below a title of as many words": (
        "Recording of Monday\n" + table(*XYZ, names="0,1,2\n"), None
    ),
    "separators at the ends below a remark of as many words": (
        "# By A B\n" + table(*XYZ, end=",\n", names="x,y,z,\n"), None
    ),
    "a source in the place of a unit": (
        table(times(), *XYZ, mark="\t", names="sep=\t\ntime (source1)\tx\ty\tz\n"), RATE
    ),
    "results beside the names": (
        table(times(), *XYZ, end=",,,\n", names="Time (s),x,y,z,,Mean,0.1\n"), RATE
    ),
    "a list of settings above lines of blanks and separators": (
        "Device,A7\nMeasurement Frequency,2000.0 Hz\nRange,-8 to 8\nUnits,lux\nMore,\n , \n , \n"
        + table(*XYZ), RATE
    ),
    "a list of settings above an empty line": (
        "Device,A7\nUnits,g\nMeasurement Frequency,2000 Hz\nRange,-8 to 8\nUnits,lux\n\n"
        + table(*XYZ), RATE
    ),
    "a comment of as many words and signs as names": (
        "% Third = label\n" + table(*XYZ, mark=", "), None
    ),
    "types and units below the names": (
        table(clock("%Y-%m-%d %H:%M:%S.%f"), COUNTER, *XYZ, names="TOA,B,C,D\nTIMESTAMP,RECORD,x,"
              'y,z\nTS,RN,g,g,g\n"","",Smp,Smp,Smp\n'), RATE
    ),
    "remarks below names and units": (
        table(times(), *XYZ, mark="\t",
              names="Time\ta\tb\tc\ns\tg\tg\tg\n\tleft\tright\ttop\n"), RATE
    ),
    "names of a group above some": (
        table(COUNTER, times(), *XYZ, mark="\t", names="No#\tTime\tA\t\t\n\t\tX1\tY1\tZ1\n\n"), RATE
    ),
    "a row of blanks and numbers above the names": (
        table(COUNTER, times(), *XYZ, names=',,"1","1","1"\n,,p,p,p\nFrame,Time (s),X,Y,Z\n'), RATE
    ),
    "names with blanks, two between them": (
        "% Points: 3\n% Time (s)    Acc, X (g)     Y (g)    Z\n" + table(times(), *XYZ, mark="  "),
        RATE
    ),
    "names with units, a blank between": (
        "# stroke 3, at noon\n# t [s] x [g] y (g) z [g]\n" + table(times(), *XYZ, mark=" "), RATE
    ),
    "a name that ends with a colon": (
        table(*XYZ, times(1e3), WORDS, names="x;y;z: ;since start in ms;note\n", mark=";"), RATE
    ),
    "a title before the names": ("# Fields: time x y z\n" + table(times(), *XYZ, mark=" "), RATE),
    "a title below settings": ("gain = 2\nXInc:,+5.0E-04\nData:,\n" + table(*XYZ), RATE),
    "an increment of every column": (
        "Comment;;;\nWaveform increment;0,0005;0,0005;0,0005\nChannel;x;y;z\n"
        + table([""] * COUNT, *XYZ, mark=";", comma=True), RATE
    ),
    "units by in": (table(times(), *XYZ, names="in s,C1 in V,C2 in V,C3 in V\n"), RATE),
    "lines of JSON with numbers as text": (
        "".join(f'{{"date": "2026-03-01", "x": "{a}", "y": "{b}", "z": {c}}}\n'
                for a, b, c in zip(*XYZ, strict=True)), None
    ),
    "rows in brackets": (
        "".join(f"({a}, {b}, {c})\n" for a, b, c in zip(*XYZ, strict=True)), None
    ),
    "rows between signs": (table([f"<{x}" for x in X], Y, Z, end=">\n"), None),
    "rows in brackets, blanks": (
        "".join(f"[ {a} {b} {c}]\n" for a, b, c in zip(*XYZ, strict=True)), None
    ),
    "rows in quotes": (
        '"t (s),x,y,z"\n' + table([f'"{t}' for t in times()], *XYZ, end='"\n'), RATE
    ),
    "rows in quotes, decimal commas": (
        '"x;y;z"\n' + table([f'"{x}' for x in COMMAS[0]], *COMMAS[1:], mark=";", end='"\n'), None
    ),
    "units and titles between named numbers": (
        "".join(f"t={t} ms\tX: {a} \tY: {b} \tG Z: {c} \tm/s^2\tEND:\n"
                for t, a, b, c in zip(times(1e3), *XYZ, strict=True)), RATE
    ),
    "one word before all numbers": (table(["a/g:"] * COUNT, *XYZ, mark="\t"), None),
    "numbers one by one of any name": (table(COUNTER, *XYZ, names="Scan,x,y,z\n"), None),
    "frames of several samples": (
        table(column(np.arange(COUNT) // 8, "{}"), *XYZ, names="Frame,x,y,z\n"), None
    ),
    # further times
    "ISO, colon before fractions": (
        "Measurement Frequency,2000 Hz\n\n" + table(clock("%Y-%m-%d %H:%M:%S:%f"), *XYZ), RATE
    ),
    "ISO, UTC in words": (table([f"{m:%Y-%m-%d %H:%M:%S.%f} UTC" for m in MOMENTS], *XYZ), RATE),
    "ISO, place of the zone": (
        table([f"{m:%Y-%m-%dT%H:%M:%S.%f}+02:00[Europe/Berlin]" for m in MOMENTS], *XYZ), RATE
    ),
    "clock before date": (table([f"{m:%H:%M:%S.%f %d.%m.%Y}" for m in MOMENTS], *XYZ), RATE),
    "digits left out": (
        table([f"{m.year}-{m.month}-{m.day} {m.hour}:{m.minute}:{m:%S.%f}" for m in MOMENTS], *XYZ),
        RATE
    ),
    "a unit behind every time": (
        table([f"{t * 1e3:.2f} ms" for t in TIMES], *XYZ, names="Time,x,y,z\n"), RATE
    ),
    "letters without width": (
        table(times(), [f"\u200e{x}" for x in X], Y, Z, names="t,x,y,z\n"), RATE
    ),
    "times of arrival of unequal batches": (
        table(column(np.repeat(np.cumsum([3, 5, 4, 8] * 12), [3, 5, 4, 8] * 12) * 500, "{}"), *XYZ,
              names="time_us,x,y,z\n"), RATE
    ),
    "times of batches": (table(column(np.array(NUMBERS) // 24 * 12, "{}"), *XYZ,
                               names="time_ms,x,y,z\n"), RATE),
    "a clock of 16 bits": (
        table(column((np.array(NUMBERS) * 500 + 65_000) % 65_536, "{}"), *XYZ,
              names="micros,x,y,z\n"), RATE
    ),
    **{
        f"a clock of {bits} bits from {begin}": (
            table(column((np.array(NUMBERS) * 500 - 700) % 2**bits + begin, "{}"), *XYZ,
                  names="micros,x,y,z\n"), RATE
        )
        for bits, begin in ((16, -(2**15)), (24, 0), (30, 0), (32, -(2**31)))
    },
    "since 1970 without a name": (table(*XYZ, at(1e6)), RATE),
    "since 1970 of any name": (table(at(1e9), *XYZ, names="stamp_host,x,y,z\n"), RATE),
    "begin and rate above the numbers": (
        table([f"{BEGIN.timestamp()}", "64.0", *X], [f"{BEGIN.timestamp()}", "64.0", *Y],
              [f"{BEGIN.timestamp()}", "64.0", *Z], mark=", "), 64
    ),
    "seconds and nanoseconds in words": (
        table(column((np.array(NUMBERS) + 1900) // 2000 + 1_772_359_200, "{}"),
              column((np.array(NUMBERS) + 1900) % 2000 * 500_000, "{}"), *XYZ,
              names="StampSec,StampNanoSec,x,y,z\n"), RATE
    ),
    "seconds and microseconds of one name": (
        table(column((np.array(NUMBERS) + 1900) // 2000 + 9, "{}"),
              column((np.array(NUMBERS) + 1900) % 2000 * 500, "{}"), *XYZ,
              names="stamp_s,stamp_us,x,y,z\n"), RATE
    ),
    "seconds and nanoseconds without names": (
        table(column((np.array(NUMBERS) + 1900) // 2000 + 1_772_359_200, "{}"),
              column((np.array(NUMBERS) + 1900) % 2000 * 500_000, "{}"), *XYZ), RATE
    ),
    "a unit of time behind the name": (table(*XYZ, times(1e3), names="x,y,z,device_ms\n"), RATE),
    **{
        stated: (f"{stated}\nx,y,z\n" + table(*XYZ), RATE)
        for stated in (
            "Sampling interval: 0.5 msec", "Abtastintervall: 500 Mikrosekunden", "Δt: 0.0005 s",
            "f_s = 2 kHz", "Sampling 2 kHz", "Data rate: 2000 Hz", "Frame rate: 2000 fps",
        )
    },
    "rate of a camera beside that of the sensor": (
        "Frame rate: 30 fps\nSampling rate: 2000 Hz\nx,y,z\n" + table(*XYZ), RATE
    ),
    "a distance between samples": ("delta x: 0.1 mm\nx,y,z\n" + table(*XYZ), None),
    "rate in French": ("Fréquence d'échantillonnage : 2000 Hz\n" + table(*XYZ), RATE),
    "rate in Spanish": ("Frecuencia de muestreo: 2000 Hz\n" + table(*XYZ), RATE),
    "samples per second": ("Samples per second: 2000\n" + table(*XYZ), RATE),
    "another rate that is the largest": (
        "Max sampling rate: 5000 Hz\nSampling rate: 2000 Hz\n" + table(*XYZ), RATE
    ),
    "a first column with a unit of time": (
        table(times(1e3), *XYZ, names="device_ms,x,y,z\n"), RATE
    ),
    "begin and end of each sample": (
        table(times(), times(start=1 / RATE), *XYZ, names="start_s,stop_s,x,y,z\n"), RATE
    ),
    # rows and columns
    "numbers of rows without a name": (
        table([f'"{n + 1}"' for n in NUMBERS], times(), *XYZ, mark=" ", names='"t" "x" "y" "z"\n'),
        RATE
    ),
    "an axis a line with its name": (
        "\n".join(",".join(line) for line in (["t", *times()], *(
            [name, *each] for name, each in zip("xyz", XYZ, strict=True)))), RATE
    ),
    "a rule below the names": (
        table(times(), *XYZ, mark=" | ", names=" t | x | y | z\n---+---+---+---\n")
        + "(240 rows)\n", RATE
    ),
    "an array of JSON": (
        "[" + ",\n".join(f'{{"x": {a}, "y": {b}, "z": {c}}}'
                         for a, b, c in zip(*XYZ, strict=True)) + "]\n", None
    ),
    # lines of loggers
    **{
        f"logged as {before[:24]!r}": ("".join(
            f"{moment:{before}}{a}{mark}{b}{mark}{c}\n"
            for moment, a, b, c in zip(MOMENTS, *XYZ, strict=True)), RATE)
        for before, mark in {
            "%Y-%m-%d %H:%M:%S,%f - INFO - ": ",",
            " %Y-%m-%d %H:%M:%S,%f - a.b - DEBUG - ": ", ",
            "%Y-%m-%d %H:%M:%S,%f INFO ": ",",
            "%Y-%m-%d %H:%M:%S.%f | INFO     | __main__:main:12 - ": ", ",
            "[%H:%M:%S.%f] <inf> imu: ": " ",
            "[%H:%M:%S.%f][D][imu:042]: ": ", ",
            "%Y-%m-%dT%H:%M:%S.%f+0100 ": ", ",
            "%Y-%m-%d %H:%M:%S.%f ": "\t",
            "[%H:%M:%S.%f]◆": ",",
            "%m-%d %H:%M:%S.%f  812  815 D acc     : ": ",",
            "I (%H:%M:%S.%f) acc: ": ", ",
        }.items()
    },
    "logged with microseconds behind a comma": (
        "".join(f"[{t[:-3]},{t[-3:]}] <inf> imu: {a}, {b}, {c}\n"
                for t, a, b, c in zip(clock("%H:%M:%S.%f"), *XYZ, strict=True)), RATE
    ),
    "logged in brackets": (
        "".join(f"{t} - INFO - [{a}, {b}, {c}]\n"
                for t, a, b, c in zip(clock("%H:%M:%S,%f"), *XYZ, strict=True)), RATE
    ),
    "logged with names": (
        "".join(f"{t} imu: x={a}, y={b}, z={c}\n"
                for t, a, b, c in zip(clock("%H:%M:%S.%f"), *XYZ, strict=True)), RATE
    ),
    "logged in colour, ms since the start": (
        "".join(f"\x1b[0;32mI ({5 * n + 59_900}) imu: {a}, {b}, {c}\x1b[0m\n"
                for n, a, b, c in zip(NUMBERS, *XYZ, strict=True)), 200
    ),
    "logged in s since the start": (
        "".join(f"[{t:>13}] imu: {a} {b} {c}\n"
                for t, a, b, c in zip(times(start=59.9), *XYZ, strict=True)), RATE
    ),
    "logged in s since 1970": (
        "".join(f"[INFO] [{1_772_359_200 + t:.6f}] [imu]: {a}, {b}, {c}\n"
                for t, a, b, c in zip(TIMES, *XYZ, strict=True)), RATE
    ),
    **{
        f"milliseconds without their zeros, {form}": (
            table([f"{m:{form}}{m.microsecond // 1000}" for m in (
                BEGIN + timedelta(milliseconds=5 * n) for n in NUMBERS)], *XYZ, names="t,x,y,z\n"),
            200
        )
        for form in ("%H:%M:%S.", "%H:%M:%S:", "%Y-%m-%d %H:%M:%S.")
    },
    # names and settings
    "names and rate in JSON": (
        '# {"00:07": {"sampling rate": 2000, "column": ["nSeq", "x", "y", "z"]}}\n# EndOfHeader\n'
        + table(COUNTER, *XYZ, mark="\t", end="\t\n"), RATE
    ),
    "keys in capitals": (
        "NO_OF_FRAMES\t240\nFREQUENCY\t2000\nTIME_STAMP\t2026-03-01, 10:00\t1.2\n"
        "DATA_INCLUDED\t3D\nMARKER_NAMES\ttip\n" + table(*XYZ, mark="\t"), RATE
    ),
    "names numbered with points": (
        table(times(), *XYZ, names="t,ch 1.1,ch 1.2,ch 2.1\n"), RATE
    ),
    "a long footer": (
        table(*XYZ, names="x,y,z\n") + "".join(f"Mean {n},1,2\n" for n in range(20)), None
    ),
    **{
        stated: (f"{stated}\nx,y,z\n" + table(*XYZ), RATE)
        for stated in (
            "SR(Hz),2000", "Ts: 0.5ms", "Ts [ms]: 0.5", "sfreq: 2000", "nominal_srate: 2000",
            "Samp. Rate 2000", "Fsamp = 2000", "120000/min", "Sample rate: 120000/min",
            "Logging rate: 120000 samples per minute",
        )
    },
    # numbers
    "tabs and blanks": (table([f"{t}\t{x}" for t, x in zip(times(), X, strict=True)], Y, Z,
                              mark=" ", names="t\tx y z\n"), RATE),
    "exponents of Mathematica": (
        table(*(column(axis, "{:.9e}") for axis in AXES)).replace("e", "*^"), None
    ),
    "dashes as minus": (
        table(*([c.replace("-", "\u2013") for c in each] for each in XYZ), names="x,y,z\n"), None
    ),
    "minus of typography": (
        table(*([c.replace("-", "\u2212") for c in each] for each in XYZ), names="x,y,z\n"), None
    ),
    "exponents of Fortran": (
        table(*(column(axis, "{:.9E}") for axis in AXES), mark="  ").replace("E", "D"), None
    ),
    "a unit of two words": (table(*([f"{c} m/s²" for c in each] for each in XYZ)), None),
    **{
        f"before all numbers {before!r}": ("".join(
            f"{before}{a}{mark}{b}{mark}{c}{behind}\n" for a, b, c in zip(*XYZ, strict=True)), None)
        for before, mark, behind in (
            ("ACC: ", ",", ""), ("imu/acc ", ",", ""), ("[ACC] ", "\t", ""),
            ("D/acc     ( 812): ", ", ", ""), ("acc: [", ", ", "]"), ("array([", ", ", "])"),
        )
    },
    **{
        f"before the first name {form[:4]!r}": (
            "".join(form.format(a, b, c) for a, b, c in zip(*XYZ, strict=True)), None
        )
        for form in ('imu/acc {{"x": {}, "y": {}, "z": {}}}\n', "Acc(x={}, y={}, z={})\n")
    },
    "semicolons at the ends of lines with commas": (table(*XYZ, end=";\n"), None),
    "semicolons at the ends of lines with tabs": (
        table(times(), *XYZ, mark="\t", end=";\n", names="t (s)\tx\ty\tz\n"), RATE
    ),
    "semicolons at the ends of lines with blanks": (table(*XYZ, mark=" ", end=";\n"), None),
    "commas at the ends of lines with bars": (
        table(*XYZ, mark="|", end=",\n", names="x|y|z\n"), None
    ),
    "blanks, decimal commas, a counter and a label": (
        table(COUNTER, *XYZ, WORDS, mark=" ", comma=True, names="index x y z label\n"), None
    ),
    **{
        f"since 1970, {form!r}": ("".join(
            f"{1_772_359_200 + t:.6f}{form.format(a, b, c)}\n"
            for t, a, b, c in zip(TIMES, *XYZ, strict=True)), RATE)
        for form in (" {},{},{}", ": {}, {}, {}", " [{}, {}, {}]", ",({}, {}, {})", "\t{},{},{}")
    },
    "a place behind a time": (
        table([f"{m:%Y-%m-%d %H:%M:%S.%f}+0100 [Europe/London]" for m in MOMENTS], *XYZ), RATE
    ),
    "a title behind dashes": ("--------- beginning of main\n" + table(*XYZ, mark=" "), None),
    "places on a screen": ("\x1b[2J\x1b[H" + table(*XYZ), None),
    "lines of events between": (
        "t,x,y,z,event\n" + "".join(
            f"{t},{a},{b},{c},\n" + f"{t},,,,blink\n" * (n % 10 == 5)
            for n, (t, a, b, c) in enumerate(zip(times(), *XYZ, strict=True))), RATE
    ),
    "sentences of numbers": (
        "".join(f"\t\tAccel X: {a} \tY: {b} \tZ: {c} m/s^2 \n\n"
                for a, b, c in zip(*XYZ, strict=True)), None
    ),
}  # fmt: skip


def write(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "a.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
    return path


@pytest.mark.parametrize("name", READ)
def test_axes_and_rate_are_those_that_were_written(tmp_path, name):
    text, expected = READ[name]
    samples, rate, _ = read_table(write(tmp_path, text))
    np.testing.assert_allclose(samples, AXES, atol=1e-9)
    assert rate == (expected if expected is None else pytest.approx(expected, rel=1e-4))


SIZES = column(np.abs(AXES[0]))


@pytest.mark.parametrize(
    ("text", "counted"),
    [
        ("Device,A7\nX increment,0.0005\nSize,3\n\n" + table(times(), SIZES), False),
        (table(at(1e9), SIZES), False),  # which are no nanoseconds
        ("fs=2000\n" + table(COUNTER, times(), SIZES), True),
    ],
)
def test_times_of_columns_without_names(tmp_path, text, counted):
    samples, rate, _ = read_table(write(tmp_path, text))
    np.testing.assert_allclose(samples, [[*NUMBERS]] * counted + [np.abs(AXES[0])], atol=1e-9)
    assert rate == pytest.approx(RATE)


COUNTS = [column(np.trunc(axis * 5e4), "{:.0f}") for axis in AXES]


@pytest.mark.parametrize(
    ("form", "comma", "mark"),
    [
        ("{:,.1f}", False, ";"),
        ("{:,.1f}", True, ";"),
        ("{:,.0f}", False, "\t"),
        ("{:,.0f}", False, '"'),
    ],
)
def test_marks_of_thousands(tmp_path, form, comma, mark):
    values = (AXES * 3e6).round(1 if "1" in form else 0)
    cells = [column(axis, form) for axis in values]
    if comma:
        cells = [[c.translate(str.maketrans(",.", ".,")) for c in each] for each in cells]
    quoted = mark == '"'
    text = table(*cells, mark="," if quoted else mark, quote=quoted, names="")
    np.testing.assert_allclose(read_table(write(tmp_path, text))[0], values)


@pytest.mark.parametrize("blank", [" ", "\u00a0", "\u2009", "\u202f"])
def test_blanks_between_thousands(tmp_path, blank):
    values = (AXES[:2] * 1e3 + 5e3).round(2)
    cells = [[c.replace(",", blank) for c in column(axis, "{:,.2f}")] for axis in values]
    text = table(times(), *cells, mark=";", comma=True, names="Temps (s);Accélération;y\n")
    for encoding in ("utf-8", "cp1252")[: 1 if blank > "\u2000" else 2]:
        samples, rate, reading = read_table(write(tmp_path, text, encoding))
        np.testing.assert_allclose(samples, values)
        assert (round(rate), reading.axes) == (RATE, ("Accélération", "y"))


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
def test_utf_16_without_a_mark(tmp_path, encoding):
    text = "x [µm]\ty\tz\r\n" + table(*XYZ, mark="\t", end="\r\n") * 5
    samples, _, reading = read_table(write(tmp_path, text, encoding))
    np.testing.assert_allclose(samples, np.tile(AXES, 5))
    assert reading.axes == ("x [µm]", "y", "z")


def test_commas_before_blanks_divide(tmp_path):
    assert [kind(cell) for cell in ("0.5,", "1,234.5", "5.", "7")] == ["text", *["number"] * 3]
    text = "".join(f"I acc: {x}, {y}\n" for x, y in zip(X, Y, strict=True))
    np.testing.assert_allclose(read_table(write(tmp_path, text))[0], AXES[:2])
    text = "".join(f'"{x}"\n' for x in COMMAS[0])  # and others do not
    np.testing.assert_allclose(read_table(write(tmp_path, text))[0], AXES[:1])


def test_units_below_names_may_begin_with_a_capital_letter(tmp_path):
    text = table(times(), *XYZ, mark="\t", names="Time\ta\tb\tc\nSec\tN\tmm\tg\n")
    assert read_table(write(tmp_path, text))[2].axes == ("a", "b", "c")
    text = table(times(), *XYZ, mark="\t", names="Time\ta\tb\tc\ns\tN\tNm\tN·m\n")
    assert read_table(write(tmp_path, text))[2].axes == ("a", "b", "c")


def test_what_looks_like_a_mark_of_missing_numbers_may_be_measured(tmp_path):
    for cells in (["999", *["0"] * (COUNT - 1)], ["999"] * COUNT, ["999", *["400"] * (COUNT - 1)]):
        samples = read_table(write(tmp_path, table(X, cells, names="x,code\n")))[0]
        np.testing.assert_allclose(samples[1], [*map(float, cells)])


def test_few_counts_that_rest_within_a_coarse_time_are_all_kept(tmp_path):
    cells = column(np.round(AXES[0]), "{:.0f}")
    coarse = column(np.array(NUMBERS) // 24 * 12, "{}")
    samples, _, _ = read_table(write(tmp_path, table(coarse, cells, names="time_ms,x\n")))
    assert samples.shape == (1, COUNT)


def test_counts_are_no_counter_of_sub_frames(tmp_path):
    cells = column(RNG.poisson(4, COUNT), "{}")
    samples = read_table(write(tmp_path, table(cells, X, names="count,x\n")))[0]
    np.testing.assert_allclose(samples, [[*map(float, cells)], AXES[0]])


def test_numbers_above_a_table_are_left_out_with_a_note(tmp_path):
    text = READ["titles above their numbers"][0]
    assert read_table(write(tmp_path, text))[2].notes == ("the numbers above 'data:' are left out",)


def test_a_sample_that_is_missing_is_interpolated_and_no_other(tmp_path):
    cells = [[*each[:99], *each[100:]] for each in (times(), *XYZ)]
    samples, rate, _ = read_table(write(tmp_path, table(*cells, names="time,x,y,z\n")))
    np.testing.assert_allclose(np.delete(samples - AXES, 99, axis=1), 0, atol=1e-9)
    np.testing.assert_allclose(samples[:, 99], AXES[:, [98, 100]].mean(axis=1))
    assert rate == pytest.approx(RATE)


def test_settings_above_are_no_incomplete_lines(tmp_path):
    text = "Range=\t10.0 V\t5.0 V\t5.0 V\n" + table(times(), *XYZ, mark="\t")
    assert not any("incomplete" in note for note in read_table(write(tmp_path, text))[2].notes)


def test_a_rate_of_each_of_two_columns_is_no_fraction(tmp_path):
    text = '"SampleRate",2000,2000\n' + table([""] * COUNT, X, Y)
    assert read_table(write(tmp_path, text))[1] == RATE


def test_milliseconds_since_1970_beside_whole_numbers_are_no_seconds(tmp_path):
    moments = column(np.array(NUMBERS) * 5 + 1_772_359_200_000, "{}")
    counts = column(np.array(NUMBERS) % 97, "{}")
    samples, rate, _ = read_table(write(tmp_path, table(moments, counts, X, mark=" ")))
    assert (len(samples), rate) == (2, pytest.approx(200))


@pytest.mark.parametrize("form", ["%H:%M:%S.%f ", "%Y-%m-%d %H:%M:%S.%f "])
def test_whole_numbers_behind_a_clock_and_a_blank(tmp_path, form):
    first = [f"{time}{cell}" for time, cell in zip(clock(form), COUNTS[0], strict=True)]
    samples, rate, _ = read_table(write(tmp_path, table(first, *COUNTS[1:])))
    np.testing.assert_array_equal(samples, np.trunc(AXES * 5e4))
    assert rate == pytest.approx(RATE)


@pytest.mark.parametrize("names", ["", "x,y,z\n"])
def test_whole_numbers_are_axes_whatever_they_do(tmp_path, names):
    rising = column(np.arange(COUNT) * 3 + 17, "{}")
    text = table(rising, *COUNTS[1:], names=names)
    samples, rate, reading = read_table(write(tmp_path, text))
    np.testing.assert_array_equal(samples[0], np.arange(COUNT) * 3 + 17)
    assert (len(samples), rate) == (3, None)
    assert reading.axes == (("x", "y", "z") if names else ())


@pytest.mark.parametrize(
    "names",
    [
        "position_mm,force_N,z", "T,force,z", "T1,T2,T3", "temperature,b,c", "x,y,z", "depth,b,c",
        "time constant of the delta,y,z", "count,y,z", "n,y,z", "index finger,thumb,ring",
        "tow,b,c", "pulse width (us),b,c",
        "speed m/s,b,c", "distance (m),b,c", "trial_1,force,z",
        "sensor 1,sensor 2,sensor 3", "data,counts,raw", "target force,y,z",
    ],
)  # fmt: skip
def test_what_rises_is_time_or_counter_only_by_its_name(tmp_path, names):
    depth = np.cumsum(np.abs(AXES[0])) if not names.startswith("T,") else -np.abs(AXES[0])
    text = table(column(depth), Y, Z, names=names + "\n")
    samples, rate, reading = read_table(write(tmp_path, text))
    np.testing.assert_allclose(samples, [depth, *AXES[1:]], atol=1e-5)
    assert (rate, reading.left_out) == (None, ())


def test_a_signal_that_is_called_one_over_time_is_an_axis(tmp_path):
    samples, _, reading = read_table(write(tmp_path, table(X, Y, names="DE_time,FE_time\n")))
    np.testing.assert_allclose(samples, AXES[:2])
    assert reading.axes == ("DE_time", "FE_time")


@pytest.mark.parametrize("name", ["time_ms", "timestamp", "sensor_time"])
def test_times_in_any_order_are_no_axis(tmp_path, name):
    order = np.random.default_rng(0).permutation(COUNT)
    shuffled = table(column(10.0 * order), X, Y, names=f"{name},x,y\n")
    with pytest.raises(TableError, match=r"has (times that do not rise|the column of time)"):
        read_table(write(tmp_path, shuffled))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])
def test_encodings(tmp_path, encoding):
    names = "Zeit (µs);Weg °;größe;z m/s²\n"
    text = table(times(1e6, "{:.0f}"), *XYZ, mark=";", comma=True, names=names)
    samples, rate, reading = read_table(write(tmp_path, text, encoding))
    np.testing.assert_allclose(samples, AXES)
    assert (round(rate), reading.axes) == (RATE, ("Weg °", "größe", "z m/s²"))


@pytest.mark.parametrize(
    "text",
    [
        table(*XYZ)[:-10],
        table(*XYZ)[:-9] + "-",
        table(*XYZ)[8:],
        table(*XYZ) + "0.1,0.2\n",
        table(*XYZ, names="x,y,z\n") + "0.1,0",
        table(*XYZ).encode() + bytes(500),
        table(*XYZ).encode() + b"\x1a",
    ],
)
def test_first_and_last_lines_that_are_cut_are_left_out_with_a_note(tmp_path, text):
    samples, _, reading = read_table(write(tmp_path, text))
    assert min(np.abs(samples[:, :1] - AXES[:, first : first + 1]).max() for first in (0, 1)) < 1e-9
    assert samples.shape[1] in (COUNT - 1, COUNT)
    assert bool(reading.notes) == (isinstance(text, str))
    assert all("left out: '" in note for note in reading.notes)


ROWS = table(*XYZ)
REFUSED = {
    "four names": (table(*XYZ, names="x,y,z,more\n"), "has 4 names and 3 columns; give every"),
    "two names": (table(*XYZ, names="x,y\n"), "has 2 names and 3 columns"),
    "a remark that may be names": (table(*XYZ, *XYZ, names="MPU found, starts\n"), "2 names and 6"),
    "names of one column": (table(X, names="x;y\n"), "has 2 names and 1 columns"),
    "decimal commas beside commas": (table(X, Y, comma=True, names="x,y\n"), "2 names and 4 col"),
    "commas in doubt": (table(["1"] * 9, ["23"] * 9), "which cannot be told apart: write decimal"),
    "a short line": (table(*XYZ, names="x,y,z\n").replace(f"{X[50]},", ""), "'z' at sample 50"),
    "a long line": (
        ROWS.replace(X[50], f"{X[50]},1"),
        "has 4 columns in line 51 and 3 before; correct that line, or divide the file there if",
    ),
    "NaN": (ROWS.replace(X[7], "NaN"), "no number in the column '1' at sample 7"),
    "an empty cell": (table(*XYZ, names="x,y,z\n").replace(Y[7], ""), "column 'y' at sample 7"),
    "-9999": (
        ROWS.replace(X[7], "-9999.0"), "-9999 in place of a number in the column '1' at sample 7"
    ),
    "a unit of several": (
        table(times(1e4, "{:.0f}"), X, names="time_100us,x\n"), "'time_100us', whose unit has a num"
    ),
    "NaN of Windows": (ROWS.replace(X[7], "-1.#IND00"), "no number in the column '1' at sample 7"),
    "NULL": (ROWS.replace(Y[7], "NULL"), "column '2' at sample 7"),
    "-": (ROWS.replace(Y[7], "-"), "column '2' at sample 7"),
    "a word": (ROWS.replace(Y[7], "OVERFLOW"), "has 'OVERFLOW' at sample 7 in the column '2'"),
    "a broken number": (ROWS.replace(Y[7], "0.1.2"), "has '0.1.2' at sample 7 in the column '2'"),
    "names again": (table(*XYZ, names="x,y,z\n") * 2, f"has 'x' at sample {COUNT} in the col"),
    "hexadecimal": (
        table(["0x1F", "0x2A"] * (COUNT // 2), Y, names="a,b\n"), "has '0x1F' at sample 0 in the"
    ),
    "unknown unit": (
        table(times(), X, names="time (ticks),x\n"),
        r"'time \(ticks\)', whose unit 'ticks' is not known; give data.time_unit=ms",
    ),
    "two units": (
        table(times(1e3), X, names="t_ms,x\ns,g\n"),
        "'t_ms', whose units s and ms differ; give data.time_unit=ms",
    ),
    "no unit": (
        table(times(1e3), X, names="time,x\n"),
        "column of time 'time', which rises by 0.5 a sample, has no unit; give data.time_unit=ms",
    ),
    "times that fall": (table(times()[::-1], X, names="time,x\n"), "do not rise at sample 1"),
    "a time that is missing": (
        table(times(), X, names="time,x\n").replace(times()[9], ""), "column 'time' at sample 9"
    ),
    "one time": ("time_s,x\n0.1,0.2\n", "has times of one sample, too few for the rate; delete"),
    "one clock time": (
        table(["10:00:00"] * COUNT, X, names="time,x\n"),
        "has times that do not rise at all, too coarse for the rate; delete that column and give",
    ),
    "a moment that is none": (
        table(clock("%Y-%m-%dT%H:%M:%S.%f"), X, names="time,x\n").replace(":59.9510", ":79.9510"),
        "in the column 'time', and not all of its cells can be read as such times",
    ),
    "words": ("It was a dark night.\nRain fell, in torrents, of course.\n" * 9, "holds no numbers"),
    "nothing": ("\n \n\n", "holds no numbers"),
    "names alone": ("x,y,z\n", "holds no numbers"),
    "time alone": (table(times(), names="time\n"), "no column of measured numbers"),
    "of Parquet": (b"PAR1" + bytes(90), "is a Parquet file by its content and no text; export it"),
    "a workbook": (b"PK\x03\x04" + bytes(90), "is an Excel workbook .* no text; export it as CSV"),
    "NULs between": (ROWS.encode() + bytes(9) + ROWS.encode(), f"NUL bytes in line {COUNT + 1}"),
    "numbers of a computer": (AXES.tobytes(), "is no text by its content; export it as CSV"),
    "a compressed table": (gzip.compress(ROWS.encode()), "is compressed by its content and"),
    "random bytes": (RNG.bytes(5000), "."),
    "a broken formula": (
        table(*XYZ, names="x,y,z\n").replace(X[7], "#DIV/0!"), "has '#DIV/0!' at sample 7"
    ),
    "a cell that is not available": (
        table(*XYZ, names="x,y,z\n").replace(X[7], "#N/A"), "column 'x' at sample 7"
    ),
    "sensors in turn": (
        table(["1", "2"] * (COUNT // 2), *XYZ, names="sensor_id,x,y,z\n"),
        "rows of 2 kinds in turn by 'sensor_id'; write each kind into a file of its own",
    ),
    "sensors in turn, by number": (
        table(["1", "2"] * (COUNT // 2), *XYZ, names="sensor,x,y,z\n"), "2 kinds in turn"
    ),
    "axes in turn": (table(["x", "y", "z"] * (COUNT // 3), X), "3 kinds in turn by column 1"),
    "numbers within text": (
        table(Y, [f"acc {x}" for x in X], names="x,y\n"), "a number within text; write numbers"
    ),
    "numbers behind another separator than the others": (
        table([f"$ACC,{n}" for n in COUNTER], *XYZ, mark=";"),
        "ACC,0' in column 1, a number within text",
    ),
    "one column of decimal commas between blanks": (
        "".join(f"{n / 2:.1f} {n % 7} {n % 5} \n".replace(".", ",") for n in range(COUNT)),
        "a number within text; write numbers alone",
    ),
    "marks of thousands in one column": (
        "".join(f"{n % 7 + 1} {n % 600 + 100},{n % 90 + 10};\n" for n in range(COUNT)),
        "holds no numbers in columns",
    ),
    "times of few stamps": (
        table(clock("%H:%M:%S"), *XYZ, names="time,x,y,z\n"), "too coarse for the rate; delete"
    ),
    "sensors in turn, one of them seldom": (
        table(times(), ["a", *["b"] * 9] * (COUNT // 10), *XYZ, names="t,kind,x,y,z\n"), "2 kinds i"
    ),
    "samples over the lines": (f"{3 * COUNT} samples of X\n" + ROWS, "720 samples in lines of 3;"),
    "words beside named numbers": (
        "".join(f"x={x} y={y} state=on\n" for x, y in zip(X, Y, strict=True)), "2 names and 3 col"
    ),
    "samples with their number": (table([f"[{3 * i}]" for i in NUMBERS], *XYZ, mark=" "), "text"),
    "two sensors side by side": (
        table(times(), X, times(2), Y, names="Time (s),x,Time 2 (s),y\n"),
        r"has 0.239 s in 'Time 2 \(s\)' and 0.1195 s in 'Time \(s\)'; write each with its columns",
    ),
    "times that are none beside coarse ones": (
        table(column(np.array(NUMBERS) // 24, "10:00:{:02d}"), times(), *XYZ,
              names="Time,Time_ms,x,y,z\n"),
        r"has 9 s in 'Time' and 0.0001195 s in 'Time_ms'; write each with its columns",
    ),
    "a factor above": ("   1.0e+03 *\n\n" + table(*XYZ, mark=" "), "'1.0e[+]03 [*]' is to mult"),
    "units of some cells": (
        table(times(), [f"{float(x):.3f}" if n % 2 else f"{float(x) * 1e3:.1f}m"
                        for n, x in enumerate(X)], names="t,x\n"), "no number; correct it"
    ),
    "times that begin anew beside one that stays": (
        table(times()[:99] + times()[:141], ["2026-03-01T10:00:00Z"] * COUNT, X,
              names="time,start,x\n"), "do not rise at sample 99; divide it"
    ),
    "times that begin anew": (
        table(times()[:99] + times()[:141], *XYZ, names="t,x,y,z\n"),
        "do not rise at sample 99; divide it there if a recording begins anew",
    ),
    "names and times again": (
        table(times(), X, names="time,x\n") * 2,
        f"has 'time' at sample {COUNT} in the column 'time', and no number; correct it, divide",
    ),
    "a date in parts without names": (
        table(*([each] * COUNT for each in ("2026", "3", "1", "23", "59")), times(), *XYZ),
        "year, month and day in columns without names; write a line of names above them, such as",
    ),
    "binary numbers": (
        table(*([f"{n * k % 256:08b}" for n in NUMBERS] for k in (3, 5)), names="x,y\n"),
        "has binary numbers such as '.*'; write decimal ones",
    ),
    "as many settings as columns": (
        table(times(), *XYZ, names="t 0.5,gain 1.5,bias 2.5,c\n"), "names or settings: write names"
    ),
    "whole numbers behind text": (
        table(Y, [f"x: {x}" for x in COUNTER]), "has 'x: 0' in column 2, a number within text"
    ),
    "times before a blank": (
        table([f"{10 * n + 900} {500 + n % 97}" for n in NUMBERS], ["7", "8"] * (COUNT // 2)),
        "has '900 500' in column 1, a number within text; write numbers alone",
    ),
    "thousands or fractions": (
        table(["9,812", "10"] * (COUNT // 2), names="x\n"),
        "has '9,812' beside 10, whose comma may mark thousands or a fraction; write decimal points",
    ),
    "one signal, ten samples a line": (
        table(times()[:60], *(column(np.sin(np.arange(k, 600, 10) / 9)) for k in range(10)),
              names="time," + ",".join(f"s{k}" for k in range(10)) + "\n"),
        "has one signal in 's0' to 's9', 10 samples a line; write one a line, or choose by",
    ),
    "recordings side by side": (
        table(times(), *XYZ, names="t,trial_1,trial_2,trial_3\n"),
        "has several recordings in 'trial_1' to 'trial_3'; write each into a file of its own, or",
    ),
    **{
        f"recordings side by side, {first} and {last}": (
            table(times(), X, Y, names=f"t,{first},{last}\n"), f"'{first}' to '{last}'; write each"
        )
        for first, last in (
            ("acc_rep1", "acc_rep2"), ("Force Run #1", "Force Run #2"),
            ("Run 1: Force", "Latest: Force"), ("rec0", "rec1"),
        )
    },
    "one signal, ten samples a line, without names": (
        table(*(column(np.sin(np.arange(k, 600, 10) / 9)) for k in range(10))),
        "has one signal in column 1 to column 10, 10 samples a line; write one a line, or choose",
    ),
    **{
        f"recordings of a line, {form}": (
            "".join(form.format(n % 3, ",".join(X[40 * n : 40 * n + 40])) for n in range(6)),
            "has 6 recordings of a line by the label in each; write each into a file of its own",
        )
        for form in ("{0},{1}\n", "{1},{0}\n")
    },
    **{
        f"JSON, {what}": (text, "is JSON; write it as CSV, one sample a line below a line of names")
        for what, text in {
            "rows": json.dumps(AXES.T.tolist()),
            "rows over lines": json.dumps(AXES.T.tolist(), indent=1),
            "objects": json.dumps([{"x": x, "y": y} for x, y in AXES[:2, :20].T]),
            "objects over lines": json.dumps([{"x": x} for x in AXES[0]], indent=2),
            "an object": "\n" + json.dumps({"fs": RATE, "data": AXES[0].tolist()}),
            "lines": "".join(json.dumps({"t": t, "acc": row}) + "\n"
                             for t, row in zip(TIMES, AXES.T.tolist(), strict=True)),
        }.items()
    },
    "remarks above again": (
        ("# fs=2000\n# x y z\n" + table(*XYZ, mark=" ")) * 2,
        "has '# fs=2000' above the numbers and again between them; divide it there, since",
    ),
    "times in words": (table(["day 1"] * COUNT, *XYZ, names="time,x,y,z\n"), "'day 1' in the colu"),
}  # fmt: skip


def test_names_that_a_logger_writes_again_divide_no_times(tmp_path):
    rows = table(times(), *XYZ).splitlines(keepends=True)
    half, names = COUNT // 2, "# time,x,y,z\n"
    text = "".join([names, *rows[:half], names, *rows[half:]])
    samples, rate, reading = read_table(write(tmp_path, text))
    assert (samples.shape, rate) == ((3, COUNT), pytest.approx(RATE))
    assert reading.notes == (
        "1 commented line stands between the numbers, which are read as one recording",
    )


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_in_doubt_is_refused_in_one_sentence(tmp_path, name):
    text, message = REFUSED[name]
    with pytest.raises(TableError, match=message) as caught:
        read_table(write(tmp_path, text))
    said = str(caught.value)
    assert len(said) < 300
    assert "\n" not in said
    assert ". " not in said


def test_names_choose_the_axes_in_any_order(tmp_path):
    names = "time,packet,Acc X (g),Acc_Y,z\n"
    text = table(times(), COUNTER, *XYZ, names=names)
    path = write(tmp_path, text)
    for channels, expected in {
        ("z", "Acc X (g)"): AXES[[2, 0]],
        ("acc x", "acc_y"): AXES[:2],
        (2, "Acc_Y"): AXES[[2, 1]],
        ("packet", "z"): [NUMBERS, AXES[2]],
    }.items():
        samples, _, reading = read_table(path, channels)
        np.testing.assert_allclose(samples, expected, atol=1e-9)
        assert len(reading.axes) == len(channels)
    with pytest.raises(TableError, match=r"no column 'w' as data\.channels asks for, but time"):
        read_table(path, ["w"])
    with pytest.raises(TableError, match=r"3 channels beside 'packet' \(counter\), and"):
        read_table(path, [3])
    with pytest.raises(TableError, match="has 2 columns 'a'; give their numbers"):
        read_table(write(tmp_path, table(*XYZ, names="a,b,a\n")), ["a"])


def test_text_that_changes_is_left_out_where_others_are_chosen(tmp_path):
    rows = {
        "state": (["on", "off"] * (COUNT // 2), None),
        "mode": (["1.5", "1.6", "n/v"] * (COUNT // 3), None),
        "sensor": (["a", "b"] * (COUNT // 2), "2 kinds in turn by 'sensor'"),
    }
    for name, (cells, message) in rows.items():
        path = write(tmp_path, table(times(), *XYZ, cells, names=f"t,x,y,z,{name}\n"))
        with pytest.raises(TableError, match=message or "kinds in turn|'n/v' at sample 2"):
            read_table(path, ["x", "y", "z"] if message else None)
        if not message:
            samples, rate, _ = read_table(path, ["x", "y", "z"])
            np.testing.assert_allclose(samples, AXES, atol=1e-9)
            assert rate == pytest.approx(RATE)


def test_lines_without_numbers_in_the_axes_are_left_out_where_there_are_times(tmp_path):
    often = [cell if n % 4 == 0 else "" for n, cell in enumerate(Z)]
    path = write(tmp_path, table(times(), X, Y, often, names="t,x,y,z\n"))
    with pytest.raises(TableError, match="no number in the column 'z' at sample 1"):
        read_table(path)
    samples, rate, reading = read_table(path, ["z"])
    np.testing.assert_allclose(samples, AXES[2:, ::4], atol=1e-9)
    assert rate == pytest.approx(RATE / 4)
    assert reading.notes == (f"{COUNT * 3 // 4} lines without numbers in its axes are left out",)


def test_a_slower_sensor_that_ends_earlier_has_no_times_of_the_other(tmp_path):
    short = [[*cells[: COUNT // 4], *[""] * (COUNT * 3 // 4)] for cells in (times(4), Y)]
    path = write(tmp_path, table(times(), X, *short, names="x time (s),x,y time (s),y\n"))
    samples, rate, _ = read_table(path, ["x"])
    assert (samples.shape, rate) == ((1, COUNT), pytest.approx(RATE))
    with pytest.raises(
        TableError, match=r"has 0\.118 s in 'y time.*write each with its columns into"
    ):
        read_table(path, ["y"])


def test_marks_count_by_column(tmp_path):
    fractions = column(9 + AXES[0] / 4, "{:.3f}")
    text = table(column(np.array(NUMBERS) % 7 + 10, "{}"), fractions, mark=";", comma=True)
    np.testing.assert_allclose(read_table(write(tmp_path, text))[0][1], [*map(float, fractions)])
    counts = np.array(NUMBERS) * 77 + 12_345  # by the mark of the other column
    for comma in (False, True):
        cells = [c.replace(",", "." if comma else ",") for c in column(counts, "{:,}")]
        text = table(COMMAS[0] if comma else X, cells, mark=";")
        np.testing.assert_allclose(read_table(write(tmp_path, text))[0], [AXES[0], counts])
    rare = np.array(NUMBERS) + 300
    rare[3] = 12_345  # far from where the dialect is found
    text = table(column(rare, "{:,}"), column(rare % 97, "{}"), mark=";", names="x;y\n")
    np.testing.assert_array_equal(read_table(write(tmp_path, text))[0], [rare, rare % 97])


def test_a_line_that_is_cut_to_one_number_is_no_rate(tmp_path):
    counts = column(np.array(NUMBERS) % 97 + 400, "{}")
    for line, expected in (("27", None), ("450", None), ("8000", 8000), ("512", 512)):
        samples, rate, reading = read_table(write(tmp_path, f"{line}\n{table(counts, counts)}"))
        assert (samples.shape, rate, bool(reading.notes)) == ((2, COUNT), expected, not expected)
    samples, rate, _ = read_table(write(tmp_path, f"7392\n{table(X)}"))
    assert (samples.shape, rate) == ((1, COUNT), None)


def test_times_that_contradict_the_rate_above_are_told(tmp_path):
    for stated, told in ((RATE * 1.02, 0), (RATE / 2, 1)):
        text = f"# sampling rate: {stated} Hz\n" + table(times(), *XYZ, names="time,x,y,z\n")
        _, rate, reading = read_table(write(tmp_path, text))
        assert (rate, len(reading.notes)) == (pytest.approx(RATE), told)


TOLD = {
    "a state": (
        table(times(), *XYZ, ["0"] * 200 + ["1"] * 40, names="t,x,y,z,button\n"),
        "unlike a signal: 'button'; data.channels=[0,1,2] leaves them out",
    ),
    "units of slow quantities": (
        table(times(), X, column(25 + AXES[0] / 50, "{:.4f}"), column(99 + AXES[1] / 50, "{:.4f}"),
              names="t,x,imu_degC,output_Hz\n"),
        "unlike a signal: 'imu_degC', 'output_Hz'; data.channels=[0] leaves them out",
    ),
    "a slow quantity": (
        table(times(), X, column(25 + AXES[0] / 50, "{:.4f}"), Y, names="t,x,Temp_C,y\n"),
        "unlike a signal: 'Temp_C'; data.channels=[0,2] leaves them out",
    ),
    "a counter without a name": (
        table(column(np.array(NUMBERS) % 128, "{}"), *XYZ),
        "unlike a signal: column 1; data.channels=[1,2,3] leaves them out",
    ),
    "batches that are missing": (
        table(column(np.array(NUMBERS) // 10 * 5 + 10 * (np.array(NUMBERS) > 99), "{}"), *XYZ,
              names="time_ms,x,y,z\n"),
        "gaps in its times, the largest of 0.015 s after sample 99, are closed",
    ),
    "uneven times": (
        table(column(np.cumsum(RNG.exponential(0.003, COUNT)), "{:.9f}"), X, names="time (s),x\n"),
        "uneven steps of its times, ",
    ),
    "an index of fractions": (
        table(times(), *XYZ, names=",x,y,z\n"),
        "'' rises at every sample and is left out as an index; if it is time, call it time_s",
    ),
    "remarks behind rows": (
        table(X, Y, mark="\t").replace(f"{Y[7]}\n", f"{Y[7]}\t#* knock, 2\n"),
        "1 remark behind numbers is left out: '#* knock, 2'",
    ),
    "lines that are cut": (
        "21,0.5\n22,0.4\n" + ROWS, "2 incomplete lines of numbers are left out: '21,0.5'"
    ),
    "times that are not quite even": (
        table(column(TIMES + RNG.uniform(0, 1e-4, COUNT), "{:.6f}"), *XYZ),
        "column 1 rises at every sample and is read as an axis; if it is time, call it time_s",
    ),
    "times that repeat": (
        table(column(np.floor(TIMES * 500) / 500, "{:.3f}"), *XYZ),
        "column 1 never falls and is read as an axis; if it is time, call it time_s",
    ),
    "a divided rate": (
        "Sample Rate: 8000 Hz\nDecimation: 4\nx,y\n" + table(X, Y),
        "'Decimation: 4' may change the rate of 8,000 Hz; if it does, write fs=RATE in place of b",
    ),
    "two rates": ("Sampling rate: 2000 Hz\nOutput rate: 500 Hz\nx,y\n" + table(X, Y), "'Output ra"),
    "a rate of three digits behind its mark, beside decimal commas": (
        "Abtastrate: 20.000 Hz\nx;y;z\n" + table(*COMMAS, mark=";"),
        "'Abtastrate: 20.000 Hz' is read as 20 Hz; else write fs=RATE",
    ),
    "a lone number far above": (
        "Devices\n1000\n,Acc,\nFrame,x,y\n" + table(COUNTER, X, Y),
        "'1000' stands alone above the names; if it is the rate, give data.file_rate=1000",
    ),
    "a long footer": (
        ROWS + "".join(f"Mean {n},1,2\n" for n in range(20)), "20 lines below the numbers are left"
    ),
    "an empty line": (
        f"{ROWS}\n{ROWS}", "1 empty line stands between the numbers, which are read as one"
    ),
    "a clock beside that which is taken": (
        table(clock("%H:%M:%S.%f"), times(1e3), *XYZ, names="time,cts,x,y,z\n"),
        "unlike a signal: 'cts'; data.channels=[1,2,3] leaves them out",
    ),
    "what counts down": (
        table(column(COUNT - np.array(NUMBERS), "{}"), X, names="left,x\n"), "'left'; data.channels"
    ),
    "numbers of sensors without a name": (
        table(["1", "2"] * (COUNT // 2), *XYZ),
        "unlike a signal: column 1; data.channels=[1,2,3] leaves them out",
    ),
    "axes behind each other": (
        "".join(table([axis] * COUNT, cells) for axis, cells in zip("xyz", XYZ, strict=True)),
        f"column 1 changes at sample {COUNT}: what follows each other is read as one recording",
    ),
    "a remark": (f"{ROWS}# run 2\n{ROWS}", "1 commented line stands between the numbers, "),
    "lines that repeat": ("t,x,y,z\n" + TWICE, "1 line that repeats the one before is left out"),
    "a line with text and a number as below": (
        "boot,440\n" + table(column(np.array(NUMBERS) * 7 % 99, "{}"), column(
            np.array(NUMBERS) % 97 + 400, "{}")),
        "an incomplete line of numbers is left out: 'boot,440'",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", TOLD)
def test_what_may_be_no_axis_or_rate_is_told(tmp_path, name):
    text, told = TOLD[name]
    notes = read_table(write(tmp_path, text))[2].notes
    assert any(told in note for note in notes), notes


@pytest.mark.parametrize(
    "above",
    [
        "Excitation: sine\nFrequency: 50 Hz", "[Stimulus]\nFrequency=50", "Low-pass\nfreq: 50 Hz",
        "Frequency (excitation): 50 Hz", "Sample time: 1.5 s", "Sampling time (s): 10",
        "Sample time: 10:00:00", "Scan rate: 50 mm/s",
    ],
)  # fmt: skip
def test_what_is_no_rate_of_samples_is_not_taken_for_one(tmp_path, above):
    samples, rate, _ = read_table(write(tmp_path, f"{above}\nx,y,z\n" + table(*XYZ)))
    assert (samples.shape, rate) == ((3, COUNT), None)


def test_sensors_that_move_together_are_not_one_signal(tmp_path):
    common = np.sin(TIMES * 900)
    near = [column(common + AXES[k % 3] / 50 * (k + 1)) for k in range(5)]
    text = table(times(), *near, names="t,s0,s1,s2,s3,s4\n")
    assert len(read_table(write(tmp_path, text))[0]) == 5


def test_points_beside_whole_numbers_a_thousandth_as_large_are_fractions(tmp_path):
    samples = read_table(write(tmp_path, table(["9.812", "10"] * 9, names="x\n")))[0]
    np.testing.assert_allclose(samples[0], [9.812, 10] * 9)


@pytest.mark.parametrize(
    "line",
    ["[" + " " * 99_999, "[" * 99_999, '"' + "." * 50_000 + "," * 50_000 + '"', ";" * 99_999],
)
def test_hostile_lines_are_searched_in_time_that_grows_with_their_length(tmp_path, line):
    path, begin = write(tmp_path, f"{line}\n" * 3), process_time()
    with pytest.raises(TableError):
        read_table(path)
    path.write_text("x" + line.replace('"', "") + ",y,z\n" + table(*XYZ))
    with suppress(TableError):  # 50,000 names
        read_table(path)
    assert process_time() - begin < 5


def test_an_array_of_sensors_of_which_few_are_touched_is_no_state(tmp_path):
    path = write(tmp_path, table(times(), X, Y, ["0"] * COUNT, names="t,T1,T2,T3\n"))
    assert read_table(path)[2].notes == ()
    path = write(tmp_path, table(times(), *XYZ, names="t,hx,hy,hz\n"))  # and no rate
    assert read_table(path)[2].notes == ()


def test_axes_that_were_chosen_are_not_in_doubt(tmp_path):
    path = write(tmp_path, table(times(), X, ["0"] * 200 + ["1"] * 40, names="t,x,button\n"))
    assert read_table(path, ["x", "button"])[2].notes == ()


def test_recordings_that_follow_each_other_are_told(tmp_path):
    for counter, told in (([*range(80), *range(160)], 1), (np.array(NUMBERS) % 128, 0)):
        path = write(tmp_path, table(column(counter, "{}"), X, names="sample,x\n"))
        notes = read_table(path)[2].notes
        assert ["'sample' changes at sample 80" in note for note in notes] == [True] * told
    for first, second in ("12", "ab"):
        trial = [first] * 100 + [second] * (COUNT - 100)
        notes = read_table(write(tmp_path, table(trial, *XYZ, names="trial,x,y,z\n")))[2].notes
        assert [note.startswith("'trial' changes at sample 100") for note in notes] == [True]


@pytest.mark.parametrize(("rows", "columns"), [(2, 3), (30, 64), (30, 70)])
def test_columns_with_names_are_axes_however_few_samples_they_have(tmp_path, rows, columns):
    names = ",".join(f"a{number}" for number in range(columns))
    path = write(tmp_path, f"{names}\n" + f"{','.join(['0.5'] * columns)}\n" * rows)
    if columns > 64:
        with pytest.raises(UserError, match="1 to 64"):
            read_samples(path)
    else:
        assert read_samples(path).samples.shape == (columns, rows)


def test_a_unit_that_is_given_counts(tmp_path):
    path = write(tmp_path, table(times(1e3), *XYZ, names="time (ticks),x,y,z\n"))
    assert read_table(path, None, "ms")[1] == pytest.approx(RATE)


def test_day_numbers_of_matlab_are_times(tmp_path):
    days = column(738_000.5 + TIMES / 86_400, "{:.11f}")  # a hundredth of a ms apart
    rate = read_table(write(tmp_path, table(days, *XYZ, names="datenum,x,y,z\n")))[1]
    assert rate == pytest.approx(RATE, rel=1e-4)
    with pytest.raises(TableError, match="has no unit"):  # seconds of a scope
        read_table(write(tmp_path, table(times(1e-3, "{:.9f}"), X, names="time,x\n")))


def test_what_was_read_is_told(tmp_path):
    names = "packet,time (ms),x,y,z,label\n"
    text = table(COUNTER, times(1e3), *XYZ, WORDS, names=names)
    reading = read_table(write(tmp_path, text))[2]
    assert reading.axes == ("x", "y", "z")
    assert reading.rate_from == "times in 'time (ms)'"
    assert reading.left_out == ("'packet' (counter)", "'label' (label)")


def test_coarse_times_give_the_rate(tmp_path):
    for digits in (2, 3):
        text = table(times(1, f"{{:.{digits}f}}"), *XYZ, names="time,x,y,z\n")
        samples, rate, reading = read_table(write(tmp_path, text))
        np.testing.assert_allclose(samples, AXES)
        assert rate == pytest.approx(RATE, rel=0.02)
        assert "repeat within" in reading.rate_from


def test_samples_that_arrive_late_are_even(tmp_path):
    block = np.array(NUMBERS) % 12
    late = TIMES + np.where((block > 3) & (block < 8), (8 - block) * (1 / RATE - 2e-5), 0)
    text = table(column(late, "{:.6f}"), *XYZ, names="time,x,y,z\n")
    samples, rate, reading = read_table(write(tmp_path, text))
    np.testing.assert_allclose(samples, AXES)
    assert rate == pytest.approx(RATE, rel=0.01)
    assert reading.rate_from == "times in 'time', some of which are late"


def test_vectors_alone_need_no_quotes(tmp_path):
    rows = "".join(f"({x}, {y}) , [{z}, {x}]\n" for x, y, z in zip(*XYZ, strict=True))
    for above, names in ("acc,gyr\n", ("acc_1", "acc_2", "gyr_1", "gyr_2")), ("", ()):
        samples, _, reading = read_table(write(tmp_path, above + rows))
        np.testing.assert_allclose(samples, AXES[[0, 1, 2, 0]])
        assert reading.axes == names


def test_marks_at_the_ends_of_rows_divide_no_whole_numbers(tmp_path):
    text = table(*COUNTS[:2], end=";\n")
    np.testing.assert_array_equal(read_table(write(tmp_path, text))[0], np.trunc(AXES[:2] * 5e4))
    with pytest.raises(TableError, match="decimal commas or columns of whole numbers"):
        read_table(write(tmp_path, text.replace("-", "")))
    text = table(X, end=";\n", comma=True)
    np.testing.assert_allclose(read_table(write(tmp_path, text))[0], AXES[:1])


def test_a_number_of_a_device_in_all_names_is_no_measurement(tmp_path):
    names = "Time,imu-62.18:x,imu-62.18:y,imu-62.18:z\n"
    _, rate, reading = read_table(write(tmp_path, table(times(), *XYZ, names=names)))
    assert (reading.axes, rate) == (tuple(names[5:-1].split(",")), pytest.approx(RATE))
    with pytest.raises(TableError, match="may be names or settings"):
        read_table(write(tmp_path, table(*XYZ, names="span 2.0,gain 2.0,off\n")))


def test_settings_of_labview_that_are_numbers_are_no_names(tmp_path):
    above = (
        "Channels\t2\t\t\t\nX_Dimension\tTime\t\tTime\t\n"
        "X0\t0.0000000000000000E+0\t\t0.0000000000000000E+0\t\nDelta_X\t5.0E-4\t\t5.0E-4\t\n"
        "***End_of_Header***\t\t\t\t\nX_Value\tVoltage\tX_Value\tAcc\tComment\n"
    )
    text = above + table(times(), X, times(), Y, mark="\t")
    _, rate, reading = read_table(write(tmp_path, text))
    assert (reading.axes, rate) == (("Voltage", "Acc"), pytest.approx(RATE))


def test_numbers_with_an_exponent_of_one_digit_have_no_unit(tmp_path):
    cells = [cell if n % 3 else f"{float(cell) * 1e4:.4f}E-4" for n, cell in enumerate(X)]
    more = [f"{float(cell) / 10:.6f}E1" for cell in Y]
    samples, _, reading = read_table(write(tmp_path, table(cells, more, names="x,y\n")))
    np.testing.assert_allclose(samples, AXES[:2], atol=1e-9)
    assert not reading.notes


def test_an_axis_a_line(tmp_path):
    text = "\n".join(",".join(each) for each in XYZ)
    samples, _, reading = read_table(write(tmp_path, text))
    np.testing.assert_allclose(samples, AXES)
    assert reading.notes == (f"each of its 3 lines is read as an axis of {COUNT} samples",)


LONG = np.random.default_rng(0).standard_normal((3, 40_000)).round(5)  # of 300 kB a line


@pytest.mark.parametrize(
    ("separator", "decimal", "names"),
    [
        (",", ".", ""),
        (" ", ".", ""),
        ("\t", ",", ""),
        (";", ",", ""),
        (" ", ",", ""),
        (", ", ".", "xyz"),
    ],
)
def test_an_axis_a_line_of_any_length(tmp_path, separator, decimal, names):
    cells = [[f"{x:.5f}" for x in axis] for axis in LONG]
    if names:
        cells = [[name, *axis] for name, axis in zip(names, cells, strict=True)]
    lines = [separator.join(axis) for axis in cells]
    path = write(tmp_path, "\n".join(lines).replace(".", decimal) + "\n")
    samples, rate, reading = read_table(path)
    np.testing.assert_allclose(samples, LONG)
    assert (rate, reading.axes) == (None, tuple(names))
    assert "each of its 3 lines is read as an axis of 40000 samples" in reading.notes


def test_an_axis_a_line_as_numpy_writes_it(tmp_path):
    """Of 1.2 MiB a line."""
    axes = np.resize(LONG, (2, 50_000))
    np.savetxt(tmp_path / "a.txt", axes)
    np.testing.assert_allclose(read_table(tmp_path / "a.txt")[0], axes, rtol=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        "1" * (1 << 21),
        "1.5 " * (1 << 19) + "x",
        "1.5 " * (1 << 19) + "\n1.5 2.5",
        "1,2\n" + "a" * (1 << 21),
    ],
    ids=["one number", "text at the end", "lines of two lengths", "a short line first"],
)
def test_long_lines_that_are_no_axes_are_refused(tmp_path, text):
    with pytest.raises(TableError, match="has a line of more than 1 MiB; give one sample a line"):
        read_table(write(tmp_path, text))


def test_long_lines_of_text_or_too_many_numbers_are_refused_before_they_are_read(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(plain_text, "MAX_AXES", 3 << 20)
    check_size(write(tmp_path, "x,0.25,-1," + "0.25,-1," * (1 << 18)))
    for text in ("0.25,x," * (1 << 18), "0.25,-1," * (1 << 19)):
        with pytest.raises(TableError, match="has a line of more than 1 MiB; give one sample a"):
            check_size(write(tmp_path, text))


@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("label", ["first", "last"])
def test_long_lines_with_a_label_each_are_no_axes(tmp_path, label, decimal):
    lines = [";".join(f"{x:.5f}" for x in axis[:4000]) for axis in LONG] * 4
    lines = [f"{n % 3};{x}" if label == "first" else f"{x};{n % 3}" for n, x in enumerate(lines)]
    text = "\n".join(lines).replace(".", decimal)
    with pytest.raises(TableError, match="12 recordings of a line by the label"):
        read_table(write(tmp_path, text if decimal == "," else text.replace(";", ",")))


def test_long_lines_of_other_lengths_are_refused(tmp_path):
    lines = [",".join(f"{x:.5f}" for x in LONG[0][:count]) for count in (40_000, 39_000)]
    with pytest.raises(TableError, match="give one sample a line"):
        read_table(write(tmp_path, "\n".join(lines)))
    for form in ("0,{}\n", "{},0\n"):  # at rest, which is no label
        text = "".join(form.format(",".join(each)) for each in (*XYZ, *XYZ))
        assert read_table(write(tmp_path, text))[0].shape == (6, COUNT + 1)


@pytest.mark.parametrize("column", [
    0.7 * TIMES**1.1, np.floor(TIMES * 300) / 300, np.arange(len(TIMES)) % 120,
    np.arange(len(TIMES)) * 3 // len(TIMES), np.full(len(TIMES), 4),
])  # fmt: skip
@pytest.mark.parametrize("place", [0, 3])
def test_what_is_no_axis_of_an_array_is_told(tmp_path, column, place):
    np.save(tmp_path / "a.npy", np.insert(AXES, place, column, axis=0).T)
    (note,) = read_samples(tmp_path / "a.npy").reading.notes
    kept = "[1,2,3]" if place == 0 else "[0,1,2]"
    assert f"unlike a signal: column {place + 1}; data.channels={kept} leaves" in note


def test_a_time_in_an_array_is_told(tmp_path):
    for axes, told in ((AXES, False), ([TIMES, *AXES], True)):
        np.save(tmp_path / "a.npy", axes)
        notes = read_samples(tmp_path / "a.npy").reading.notes
        assert ["rises evenly; if it is time" in note for note in notes] == [True] * told
    assert read_samples(tmp_path / "a.npy", [1, 2, 3]).reading.notes == ()


@pytest.mark.skipif(not SHARED.exists(), reason="no shared data")
def test_exports_of_programs():
    with (SHARED / "expected.csv").open(newline="") as stream:
        for row in csv.DictReader(stream):
            samples, rate, _ = read_table(SHARED / row["file"])
            assert len(samples) == int(row["axes"] or 2), row["file"]
            assert rate is None or rate == pytest.approx(float(row["rate"]), rel=1e-3)
            assert (rate is None) <= bool(row["file_rate"])
            first = [float(value) for value in row["sample_1"].split()]
            np.testing.assert_allclose(samples[:, 1][: len(first)], first, err_msg=row["file"])
