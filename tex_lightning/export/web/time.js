// The column of time of a table: it gives the rate and never becomes an axis.

import { isTime, secondsOf } from "./columns.js";
import { InputError } from "./errors.js";

const EVEN = 0.01; // of a step, up to which samples stay as they are
const MISSING = 2.5; // steps, above which samples are missing
const SELDOM = 0.1; // of the steps, which are several where samples were lost
const MAX_FILLED = 2; // times as many samples, beyond which most would be made up
const RATES = [19, 210_000]; // Hz, that a signal may have
const EPOCHS = [1, 1e-3, 1e-6, 1e-9]; // seconds of one, since 1970

/**
 * Take the axes out of a table and derive the rate from its column of time.
 *
 * @param {Float64Array[]} columns
 * @param {string[][]} rows - Names of the columns, and perhaps units; none without names.
 * @param {(number | string)[] | null} chosen - Numbers of axes or names; null is all.
 * @param {(name: string, values: Float64Array, index: number) => string | null} reasonAgainst
 * @returns {{channels: Float64Array[], rate: number | null}}
 */
export function separateTime(columns, rows, chosen, reasonAgainst) {
  const [names, units] = [rows[0] ?? null, rows[1] ?? []];
  const numbers = [...columns.keys()];
  const time = names === null ? undefined : numbers.find((i) => isTime(names[i], columns[i]));
  const others = numbers.filter(
    (i) =>
      names === null ||
      chosen?.includes(names[i]) ||
      (!isTime(names[i], columns[i]) && reasonAgainst(names[i], columns[i], i) === null),
  );
  const axes = choose(columns, others, names, chosen);
  if (time === undefined) return { channels: axes, rate: null };
  return evenSamples(seconds(columns[time], names[time], units[time] ?? ""), axes);
}

function choose(columns, others, names, chosen) {
  if (others.length === 0) throw new InputError("it has no column of measured numbers");
  if (chosen === null) return others.map((index) => columns[index]);
  return chosen.map((each) => {
    const index = typeof each === "number" ? others[each] : (names ?? []).indexOf(each);
    if (index >= 0) return columns[index];
    throw new InputError(`it has no channel ${each}, which the network reads`);
  });
}

/** Times in seconds since the first. */
function seconds(values, name, unit) {
  const moment = EPOCHS.find((each) => values[0] * each > 9e8 && values[0] * each < 4.2e9);
  const known = secondsOf(name, unit) ?? moment ?? null;
  const span = values.at(-1) - values[0];
  const rate = (values.length - 1) / Math.abs(span);
  if (known === null && (/[([/]/.test(name) || rate < RATES[0] || rate > RATES[1])) {
    throw new InputError(`its column of time ${JSON.stringify(name)} has no known unit; call it time_ms`);
  }
  return values.map((value) => (value - values[0]) * (known ?? 1));
}

/** Bring samples to even steps, of the mean length of all that are no gaps. */
function evenSamples(times, axes) {
  const steps = differences(times);
  const fall = steps.findIndex((step) => !(step > 0));
  if (steps.length === 0 || fall >= 0) {
    throw new InputError(`its times do not rise at sample ${fall + 1}`);
  }
  const middle = median(steps);
  const gaps = gapsOf(steps, middle);
  const span = times.at(-1) - times[0];
  const step = (span - gaps.reduce((sum, each) => sum + each, 0)) / (steps.length - gaps.length);
  const rate = 1 / step;
  if (steps.every((each) => Math.abs(each - middle) <= EVEN * middle)) {
    return { channels: axes, rate };
  }
  const count = Math.round(span / step) + 1;
  if (count > MAX_FILLED * times.length) {
    throw new InputError("its times have gaps, so that most samples are missing");
  }
  return { channels: axes.map((axis) => interpolate(times, axis, step, count)), rate };
}

/** Steps that are gaps: if all are multiples of one, those of more than this one. */
function gapsOf(steps, middle) {
  const even = steps.every(
    (each) => Math.abs(each - Math.round(each / middle) * middle) < EVEN * middle,
  );
  const several = steps.filter((each) => Math.round(each / middle) > 1);
  const lost = even && several.length < SELDOM * steps.length;
  return lost ? several : steps.filter((each) => each > MISSING * middle);
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
