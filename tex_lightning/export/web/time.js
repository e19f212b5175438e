// The column of time of a table: it gives the rate and never becomes an axis (data/traces.py).

import { InputError } from "./errors.js";

const TIMES = ["time", "timestamp", "t", "zeit", "sec", "seconds", "milliseconds"];
const UNITS = [
  [1, ["s", "sec", "secs", "second", "seconds", ...TIMES.slice(0, 4)]],
  [1e-3, ["ms", "msec", "millisecond", "milliseconds"]],
  [1e-6, ["us", "\u03bcs", "usec", "microsecond", "microseconds"]],
];
const SECONDS = new Map(UNITS.flatMap(([unit, names]) => names.map((name) => [name, unit])));
const MIN_RISING = 8; // samples; fewer numbers may rise by chance
const EVEN = 0.01; // of a step, up to which samples stay as they are
const MISSING = 2.5; // steps, above which samples are missing
const MAX_FILLED = 2; // times as many samples, beyond which most would be made up

/**
 * Take the column of time out of a table and derive the rate from it.
 *
 * @param {Float64Array[]} columns
 * @param {string[][]} names - Rows of names and units of the columns.
 * @returns {{channels: Float64Array[], rate: number | null}}
 */
export function separateTime(columns, names) {
  const found = findTime(names, columns);
  if (found === null) return { channels: columns, rate: null };
  const others = columns.filter((_, index) => index !== found.index);
  return evenSamples(columns[found.index], others, found.unit);
}

/** Index and unit in seconds of the column of time; units may stand below the names. */
function findTime(names, columns) {
  for (const [place, row] of names.entries()) {
    const said = row.map(words);
    const found = said.flatMap((each, index) => (TIMES.includes(each[0]) ? [index] : []));
    if (found.length > 1) throw new InputError(`it has ${found.length} columns of time; keep one`);
    for (const index of found) {
      const below = words(names[place + 1]?.[index] ?? "");
      const unit = [said[index].slice(1), below, said[index]].find((each) => each.length).at(-1);
      if (!SECONDS.has(unit)) {
        throw new InputError(
          `its column ${JSON.stringify(row[index])} has an unknown unit; call it time_s, ` +
            "time_ms or time_us",
        );
      }
      return { index, unit: SECONDS.get(unit) };
    }
  }
  if (columns.length < 2 || columns[0].length < MIN_RISING) return null;
  return differences(columns[0]).every((step) => step > 0) ? { index: 0, unit: 1 } : null;
}

function words(name) {
  const letters = name.toLowerCase().replaceAll("\u00b5", "\u03bc"); // micro sign, Greek mu
  return letters.match(/\p{L}+/gu) ?? [];
}

/** Bring samples to even steps, of the mean length of all that are no gaps. */
function evenSamples(times, axes, unit) {
  const steps = differences(times);
  const fall = steps.findIndex((step) => !(step > 0));
  if (steps.length === 0 || fall >= 0) {
    throw new InputError(`its times do not rise at sample ${fall + 1}`);
  }
  const middle = median(steps);
  const gaps = steps.filter((each) => each > MISSING * middle);
  const span = times.at(-1) - times[0];
  const step = (span - gaps.reduce((sum, each) => sum + each, 0)) / (steps.length - gaps.length);
  const rate = 1 / (step * unit);
  if (steps.every((each) => Math.abs(each - middle) <= EVEN * middle)) {
    return { channels: axes, rate };
  }
  const count = Math.round(span / step) + 1;
  if (count > MAX_FILLED * times.length) {
    throw new InputError("its times have gaps, so that most samples are missing");
  }
  return { channels: axes.map((axis) => interpolate(times, axis, step, count)), rate };
}

/** Samples at even times, linearly between those of the table. */
function interpolate(times, values, step, count) {
  let j = 0;
  return Float64Array.from({ length: count }, (_, i) => {
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

function median(values) {
  const sorted = values.slice().sort();
  const half = sorted.length >> 1;
  return sorted.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
}
