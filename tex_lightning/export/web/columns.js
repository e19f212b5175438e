// What the columns of a table mean by their names, as tex_lightning_runtime/columns.py has it.

const TIMES = new Set(
  ("time times timestamp timestamps datetime zeit zeiten zeitstempel uhrzeit temps tiempo tempo " +
    "tijd czas epoch epoc elapsed").split(" "),
);
const OF_TIME = new Set("t clock stamp unix ts since start boot system relative local in".split(" "));
const COUNTERS = new Set(
  ("index idx counter cnt seq sequence packet packets packetcounter sample samples number num no nr " +
    "count counts n i row rows line frame frames record step point measurement of").split(" "),
);
const LABELS = new Set("label labels class target activity category id ids uid uuid".split(" "));
const HOUSEKEEPING = new Set("rssi snr battery batt vbat crc checksum chksum cksum chk xor".split(" "));
const FLAGS = new Set("status state flag flags valid validity quality accuracy alarm trigger".split(" "));
const UNITS = [
  [1, "s sec secs second seconds"],
  [1e-3, "ms msec msecs millis millisecond milliseconds"],
  [1e-6, "us \u03bcs usec usecs micros microsecond microseconds"],
  [1e-9, "ns nsec nsecs nanos nanosecond nanoseconds"],
  [60, "min mins minute minutes"],
];
const SECONDS = new Map(UNITS.flatMap(([unit, names]) => names.split(" ").map((name) => [name, unit])));

/** The words of a name in small letters, and its numbers. */
export function words(name) {
  const letters = name.replaceAll("\u00b5", "\u03bc").replace(/([a-z\u03bc])([A-Z])/g, "$1 $2");
  return letters.toLowerCase().match(/\p{L}+|\d+/gu) ?? [];
}

/** Whether a name is one of time. */
export function isTime(name, values) {
  const said = words(name);
  if (said.some((word) => TIMES.has(word))) return true;
  const known = said.length > 0 && said.every((word) => OF_TIME.has(word) || SECONDS.has(word));
  const short = said.every((word) => word === "s" || word === "min");
  return known && !short && values.every((value, i) => i === 0 || value >= values[i - 1]);
}

/** Seconds of a unit of time; null if none is stated. */
export function secondsOf(name, unit) {
  const said = [...words(name), ...words(unit)].filter((word) => SECONDS.has(word));
  return said.length > 0 ? SECONDS.get(said.at(-1)) : null;
}

/** Why a column is no axis, by its name and values; null if it is one. */
export function reasonAgainst(name, values, index) {
  const said = words(name);
  if (said.some((word) => LABELS.has(word))) return "label";
  if (said.some((word) => HOUSEKEEPING.has(word))) return "housekeeping";
  const whole = values.every(Number.isInteger);
  const few = new Set(values).size <= Math.max(1, Math.floor(values.length / 10));
  if (whole && few && said.some((word) => FLAGS.has(word))) return "state";
  const rises = whole && values.every((value, i) => i === 0 || value >= values[i - 1]);
  if (rises && (said.length > 0 ? said.every((word) => COUNTERS.has(word)) : index === 0)) return "counter";
  return null;
}
