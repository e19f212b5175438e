// One file, or what microphone and camera gave, to what the network reads.

import { InputError } from "./errors.js";
import { parseNpy } from "./npy.js";
import { resample } from "./resample.js";
import { parseTable } from "./table.js";
import { parseWav } from "./wav.js";

const LARGEST = 1e9; // no unit of acceleration comes near; squares still fit float32
const MOST_AXES = 64;
const TEXT = /\.(csv|txt)$/i;
const WAV = /\.wav$/i;
const NPY = /\.npy$/i;
export const SIGNAL_FILES = ".wav,.csv,.txt,.npy";

/**
 * Read a signal from a file.
 *
 * @param {string} name - Of the file; its ending says how it is read.
 * @param {ArrayBuffer} buffer - The file.
 * @param {object} sense - Its entry of the model card.
 * @returns {{axes: (Float32Array | Float64Array)[], rate: number | null}} The axes; their
 *   rate in Hz where the file says it.
 */
export function readSignal(name, buffer, sense) {
  try {
    const { channels, rate } = readChannels(name, buffer, sense.channels);
    return { axes: checked(TEXT.test(name) ? channels : choose(channels, sense.channels)), rate };
  } catch (error) {
    if (error instanceof InputError) throw new InputError(`${name} cannot be read: ${error.message}.`);
    throw error;
  }
}

function readChannels(name, buffer, chosen) {
  if (WAV.test(name)) return parseWav(buffer);
  if (NPY.test(name)) return { channels: parseNpy(buffer), rate: null };
  if (TEXT.test(name)) return readText(buffer, chosen);
  throw new InputError("its type is unknown; give WAV, CSV, text or NPY");
}

function readText(buffer, chosen) {
  const { channels, rate } = parseTable(buffer, chosen);
  const length = channels[0].length;
  if (length > channels.length || rate !== null) return { channels, rate };
  const rows = Array.from({ length }, (_, i) => Float64Array.from(channels, (column) => column[i]));
  return { channels: rows, rate }; // few lines, with a sample a column
}

/** Keep the numbered channels, counted from 0; null keeps all, and names are those of as many. */
function choose(channels, numbers) {
  const named = numbers?.some((each) => typeof each === "string");
  if (numbers === null || (named && numbers.length === channels.length)) return channels;
  const last = named ? numbers.join(", ") : Math.max(...numbers);
  if (last < channels.length) return numbers.map((number) => channels[number]);
  throw new InputError(
    `it has ${channels.length} channels, and the network reads channel ${last}, counted from 0`,
  );
}

function checked(axes) {
  if (axes.length === 0 || axes.length > MOST_AXES) {
    throw new InputError(`it has ${axes.length} channels, and a signal has 1 to ${MOST_AXES} axes`);
  }
  if (axes[0].length === 0) throw new InputError("it holds no samples");
  for (const axis of axes) {
    const place = axis.findIndex((x) => !(Math.abs(x) < LARGEST));
    if (place >= 0) {
      throw new InputError(`it holds NaN, infinity or a number beyond 1e9 at sample ${place}`);
    }
  }
  return axes;
}

/**
 * Bring a signal to the network's rate.
 *
 * @param {{axes: (Float32Array | Float64Array)[], rate: number | null}} signal - A rate of null
 *   is the sense's ``file_rate``.
 * @param {object} sense - Its entry of the model card.
 * @returns {Float32Array[]}
 */
export function decodeSignal({ axes, rate }, sense) {
  return axes.map((axis) => resample(axis, rate ?? sense.file_rate, sense.rate));
}

/** Whether a file begins as a PNG of greys with 16 bits, of which only the package looks for white. */
export function isDeepGrey(bytes) {
  const png = [0x89, 80, 78, 71].every((each, i) => each === bytes[i]);
  return png && bytes[24] === 16 && bytes[25] === 0; // depth and kind of colours
}

/**
 * Drop the fourth channel of pixels, as a canvas gives them.
 *
 * @param {Uint8ClampedArray} rgba
 * @returns {Uint8Array}
 */
export function toRgb(rgba) {
  const rgb = new Uint8Array((rgba.length / 4) * 3);
  for (let i = 0, j = 0; i < rgba.length; i += 4) {
    rgb[j++] = rgba[i];
    rgb[j++] = rgba[i + 1];
    rgb[j++] = rgba[i + 2];
  }
  return rgb;
}

/**
 * Halve a photo: each pixel is the rounded mean of 2 x 2.
 *
 * @param {{pixels: Uint8Array, width: number, height: number}} photo - RGB.
 * @returns {{pixels: Uint8Array, width: number, height: number}}
 */
export function halve({ pixels, width, height }) {
  const half = { width: width >> 1, height: height >> 1 };
  half.pixels = new Uint8Array(half.width * half.height * 3);
  const row = 3 * width;
  for (let y = 0, to = 0; y < half.height; y++) {
    for (let x = 0; x < half.width; x++) {
      for (let colour = 0; colour < 3; colour++) {
        const at = 2 * y * row + 6 * x + colour;
        const sum = pixels[at] + pixels[at + 3] + pixels[at + row] + pixels[at + row + 3];
        half.pixels[to++] = (sum + 2) >> 2;
      }
    }
  }
  return half;
}
