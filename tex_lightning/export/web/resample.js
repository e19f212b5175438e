// Signals as networks take them: without spikes, and at their rate, as resample_poly of the Python
// package: they go on with their first and last value.

import { InputError } from "./errors.js";

const REACH = 10; // samples of the lower rate that the filter sees on each side
const BETA = 5; // of its Kaiser window
const [MIN_RATE, MAX_RATE] = [19, 210000]; // Hz: 20 Hz to 200 kHz, by clocks that are not exact
const SAME_RATE = 0.005; // by which clocks of the same rate may differ; such samples stay as they are
const MAX_DENOMINATOR = 10000n;
// As without_spikes of the Python package: two samples at most, far outside of those on both sides.
const [NEXT, AROUND, OUTSIDE] = [2, 8, 3];
const [FEW, RECENT_SECONDS] = [5, 4]; // more in so short a time are impacts

/**
 * Take the spikes out of a signal and bring it to another rate.
 *
 * The arithmetic has the precision of the samples, in scipy's order, so that float32 samples come
 * out as they do there.
 *
 * @param {Float32Array | Float64Array} samples
 * @param {number} source - Their rate in Hz.
 * @param {number} target - The rate to bring them to.
 * @returns {Float32Array}
 */
export function resample(samples, source, target) {
  const [up, down] = rateRatio(source, target);
  samples = withoutSpikes(samples, source);
  if (up === down) return Float32Array.from(samples);
  const half = REACH * Math.max(up, down);
  const filter = lowPass(half, Math.max(up, down), up, samples.constructor);
  const single = samples instanceof Float32Array;
  const round = single ? Math.fround : (x) => x;
  const found = new Float32Array(Math.ceil((samples.length * up) / down));
  for (let i = 0; i < found.length; i++) {
    const centre = i * down; // in samples of the common multiple of the rates
    const last = Math.floor((centre + half) / up);
    let sum = 0;
    for (let k = Math.ceil((centre - half) / up); k <= last; k++) {
      const sample = samples[Math.min(Math.max(k, 0), samples.length - 1)];
      sum = round(sum + round(sample * filter[centre - k * up + half]));
    }
    found[i] = sum;
  }
  return found;
}

/** A signal whose spikes are means of the samples around them. */
function withoutSpikes(samples, rate) {
  const [found, places] = [samples.slice(), []];
  for (let i = AROUND; i < samples.length - AROUND; i++) {
    let [low, high] = [Infinity, -Infinity];
    for (let k = NEXT; k <= AROUND; k++) {
      low = Math.min(low, samples[i - k], samples[i + k]);
      high = Math.max(high, samples[i - k], samples[i + k]);
    }
    const outside = Math.max(samples[i] - high, low - samples[i]);
    if (high > low && outside > OUTSIDE * (high - low)) {
      const earlier = places[places.push(i) - 1 - FEW];
      if (earlier !== undefined && i - earlier <= RECENT_SECONDS * rate) continue;
      found[i] = (samples[i - NEXT] + samples[i + NEXT]) / 2;
    }
  }
  return found;
}

/**
 * By how much samples become more, as a fraction in lowest terms.
 *
 * @param {number} source - Rate in Hz.
 * @param {number} target - Rate in Hz.
 * @returns {[number, number]} Numerator and denominator, the latter up to 10,000.
 */
export function rateRatio(source, target) {
  if (!(source >= MIN_RATE && source <= MAX_RATE)) {
    throw new InputError(`Its sampling rate is ${source} Hz; rates are 20 Hz to 200 kHz.`);
  }
  const same = Math.abs(source - target) <= SAME_RATE * Math.max(source, target);
  return limitDenominator(...exactFraction(same ? 1 : target / source));
}

/** A double as the fraction that it is. */
function exactFraction(value) {
  let denominator = 1n;
  for (; !Number.isInteger(value); value *= 2) denominator *= 2n;
  return [BigInt(value), denominator];
}

/** The nearest fraction with a small denominator (Python's Fraction.limit_denominator). */
function limitDenominator(n, d) {
  const [value, whole] = [n, d];
  let [p0, q0, p1, q1] = [0n, 1n, 1n, 0n];
  while (d !== 0n) {
    const a = n / d;
    if (q0 + a * q1 > MAX_DENOMINATOR) break;
    [p0, q0, p1, q1] = [p1, q1, p0 + a * p1, q0 + a * q1];
    [n, d] = [d, n - a * d];
  }
  if (d === 0n) return [Number(p1), Number(q1)];
  const k = (MAX_DENOMINATOR - q0) / q1;
  const [p2, q2] = [p0 + k * p1, q0 + k * q1];
  const near = (p, q) => abs(p * whole - value * q); // times q * whole
  return near(p1, q1) * q2 <= near(p2, q2) * q1
    ? [Number(p1), Number(q1)]
    : [Number(p2), Number(q2)];
}

function abs(x) {
  return x < 0n ? -x : x;
}

/** Windowed sinc of 2 * half + 1 taps; those of each new sample sum to 1. */
function lowPass(half, widest, up, Samples) {
  const taps = Float64Array.from({ length: 2 * half + 1 }, (_, i) => {
    const x = Math.PI * ((i - half) / widest);
    const sinc = x === 0 ? 1 : Math.sin(x) / x;
    return sinc * kaiser((i - half) / half);
  });
  const sums = new Float64Array(up);
  taps.forEach((tap, i) => (sums[i % up] += tap));
  const scaled = Samples.from(taps, (tap, i) => tap / (up * sums[i % up]));
  return scaled.map((tap) => tap * up);
}

function kaiser(x) {
  return bessel(BETA * Math.sqrt(Math.max(0, 1 - x * x))) / bessel(BETA);
}

/** Modified Bessel function of the first kind and order zero, by its power series. */
function bessel(x) {
  let [sum, term] = [1, 1];
  for (let k = 1; term > sum * 1e-18; k++) {
    term *= (x / (2 * k)) ** 2;
    sum += term;
  }
  return sum;
}
