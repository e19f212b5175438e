// A spectrogram to look at, where the network reads none: bands even in the logarithm of frequency.

const FRAMES = 300; // at most
const BANDS = 40;
const SECONDS = 0.05; // of a window
const FLOOR = 1e-9; // of the mean power

/**
 * Compute logarithms of power.
 *
 * @param {ArrayLike<number>[]} axes - Their powers are added.
 * @param {number} rate - Hz.
 * @returns {{data: Float32Array, bands: number, frames: number, hop: number, start: number,
 *   frequencies: number[]}} data row by row, the lowest band first; hop and start in seconds.
 */
export function spectrogram(axes, rate) {
  const count = axes[0].length;
  const length = Math.max(8, Math.min(count, Math.round(SECONDS * rate)));
  const frames = Math.max(1, Math.min(FRAMES, count - length + 1));
  const step = frames > 1 ? (count - length) / (frames - 1) : 0;
  const lowest = (2 * rate) / length;
  const frequencies = Array.from({ length: BANDS }, (_, i) => lowest * (rate / 2 / lowest) ** (i / BANDS));
  const power = new Float64Array(BANDS * frames);
  for (let band = 0; band < BANDS; band++) {
    const waves = wave(frequencies[band] / rate, length);
    for (let frame = 0; frame < frames; frame++) {
      const from = Math.round(frame * step);
      for (const samples of axes) power[band * frames + frame] += powerOf(samples, from, waves);
    }
  }
  const mean = power.reduce((sum, each) => sum + each, 0) / power.length || 1;
  const data = Float32Array.from(power, (each) => Math.log(each / mean + FLOOR));
  return { data, bands: BANDS, frames, hop: Math.max(step, 1) / rate, start: length / 2 / rate, frequencies };
}

/** Cosine and sine of a frequency in periods a sample, under Hann's window. */
function wave(frequency, length) {
  const [cosine, sine] = [new Float64Array(length), new Float64Array(length)];
  for (let i = 0; i < length; i++) {
    const weight = 0.5 - 0.5 * Math.cos((2 * Math.PI * (i + 0.5)) / length);
    cosine[i] = weight * Math.cos(2 * Math.PI * frequency * i);
    sine[i] = weight * Math.sin(2 * Math.PI * frequency * i);
  }
  return { cosine, sine, length };
}

function powerOf(samples, from, { cosine, sine, length }) {
  let mean = 0;
  for (let i = 0; i < length; i++) mean += (samples[from + i] ?? 0) / length;
  let [real, imaginary] = [0, 0];
  for (let i = 0; i < length; i++) {
    const value = (samples[from + i] ?? 0) - mean;
    real += value * cosine[i];
    imaginary += value * sine[i];
  }
  return real * real + imaginary * imaginary;
}
