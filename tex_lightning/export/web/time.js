// The column of time of a table: it gives the rate and never becomes an axis (data/time_column.py).

import { InputError } from "./errors.js";

const NAMES = ["time", "t", "timestamp", "zeit"];
const UNITS = [
  [1, ["s", "sec", "secs", "second", "seconds"]],
  [1e-3, ["ms", "msec", "millisecond", "milliseconds"]],
  [1e-6, ["us", "\u03bcs", "usec", "microsecond", "microseconds"]],
];
const SECONDS = new Map(UNITS.flatMap(([unit, names]) => names.map((name) => [name, unit])));
const MIN_SAMPLES = 8; // fewer numbers may rise evenly by chance
const MIN_RATE = 250; // Hz without a unit; what is slower is in ms or us, or counts samples
const JITTER = 0.01; // of a step, up to which samples are taken as even
const EVEN = 1.75; // steps, up to which a column without a name may be one of time
const MAX_GAP = 10; // steps, up to which lost samples are interpolated

/**
 * Take the column of time out of a table and derive the rate from it.
 *
 * @param {Float64Array[]} columns
 * @param {string[] | null} names - Of the columns.
 * @param {string[] | null} units - Of the columns.
 * @param {number | null} channel - The one column beside the time that is kept; null keeps all.
 * @returns {{channels: Float64Array[], rate: number | null}}
 */
export function separateTime(columns, names, units, channel) {
  const found =
    (names && namedTime(names, units)) ?? unnamedTime(columns, names ? names[0] : "");
  if (found === null) return { channels: chooseChannel(columns, channel), rate: null };
  const times = columns[found.index];
  const others = columns.filter((_, index) => index !== found.index);
  const [step, even] = meanStep(times, found.unit);
  const axes = chooseChannel(others, channel);
  const inTable = step / (found.unit ?? 1);
  const channels = even ? axes : axes.map((axis) => interpolate(times, axis, inTable));
  return { channels, rate: 1 / step };
}

/**
 * Keep one channel, or all of them if ``channel`` is null.
 *
 * @template T
 * @param {T[]} channels
 * @param {number | null} channel - Counted from 0.
 * @returns {T[]}
 */
export function chooseChannel(channels, channel) {
  if (channel === null) return channels;
  if (channel < channels.length) return [channels[channel]];
  throw new InputError(
    `it has ${channels.length} channels, and the network reads channel ${channel}, counted from 0`,
  );
}

function namedTime(names, units) {
  const found = names.flatMap((name, index) => {
    const said = words(name);
    if (said.length === 1 && said[0].length > 2 && SECONDS.has(said[0])) {
      return [{ index, unit: SECONDS.get(said[0]) }]; // "seconds"
    }
    if (!NAMES.includes(said[0])) return [];
    const unit = said.length > 1 ? said.slice(1) : words(units?.[index] ?? "");
    if (unit.length === 0) return [{ index, unit: null }];
    if (unit.length === 1 && SECONDS.has(unit[0])) return [{ index, unit: SECONDS.get(unit[0]) }];
    if (said[0] === "t") return []; // which may be a temperature
    throw new InputError(
      `it has a column ${JSON.stringify(name)} of unknown unit; call it time_s, time_ms or time_us`,
    );
  });
  if (found.length > 1) {
    throw new InputError(`it has ${found.length} columns of time; keep one`);
  }
  return found[0] ?? null;
}

function words(name) {
  const letters = name.toLowerCase().replaceAll("\u00b5", "\u03bc"); // micro sign, Greek mu
  return (letters.match(/\p{L}+/gu) ?? []).filter((word) => word !== "in");
}

/** The first column, if it has no name, rises evenly and stands before one or three others. */
function unnamedTime(columns, name) {
  const times = columns[0];
  if (![2, 3, 4].includes(columns.length) || times.length < MIN_SAMPLES) return null;
  const steps = differences(times);
  if (!steps.every((step) => step > 0) || Math.max(...extremes(steps)) > EVEN * median(steps)) {
    return null;
  }
  if (columns.length === 3) {
    throw new InputError(
      "it has three columns, of which the first rises evenly as time does; a signal has one or " +
        "three axes beside a column of time",
    );
  }
  return name ? null : { index: 0, unit: null };
}

/** Mean step in seconds, and whether the steps are even. */
function meanStep(times, unit) {
  const steps = differences(times);
  const fall = steps.findIndex((step) => !(step > 0));
  if (steps.length === 0 || fall >= 0) {
    throw new InputError(`its times do not rise at sample ${fall + 1}`);
  }
  const middle = median(steps);
  const [, widest] = extremes(steps);
  if (widest > MAX_GAP * middle) {
    const place = steps.indexOf(widest);
    throw new InputError(`its column of time has a gap after sample ${place}; cut the file there`);
  }
  const step = (times.at(-1) - times[0]) / steps.length;
  if (unit === null && 1 / step < MIN_RATE) {
    throw new InputError(
      `it has ${(1 / step).toPrecision(3)} samples a second if its column of time is in seconds; ` +
        "call it time_ms or time_us, or delete it if it counts samples",
    );
  }
  const even = steps.every((each) => Math.abs(each - middle) <= JITTER * middle);
  return [step * (unit ?? 1), even];
}

/** Samples at even times, linearly between those of the table. */
function interpolate(times, values, step) {
  let j = 0;
  return values.map((_, i) => {
    const time = times[0] + i * step;
    while (j < times.length - 2 && times[j + 1] <= time) j += 1;
    if (time >= times.at(-1)) return values.at(-1);
    const slope = (values[j + 1] - values[j]) / (times[j + 1] - times[j]);
    return slope * (time - times[j]) + values[j];
  });
}

function differences(values) {
  return values.slice(1).map((value, i) => value - values[i]);
}

function extremes(values) {
  return values.reduce(
    ([low, high], value) => [Math.min(low, value), Math.max(high, value)],
    [Infinity, -Infinity],
  );
}

function median(values) {
  const sorted = values.slice().sort();
  const half = sorted.length >> 1;
  return sorted.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
}
