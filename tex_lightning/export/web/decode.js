// One file, or what microphone and camera gave, to what the network reads.

import { InputError } from "./errors.js";
import { parseNpy } from "./npy.js";
import { resample } from "./resample.js";
import { parseTable } from "./table.js";
import { chooseChannel } from "./time.js";
import { parseWav } from "./wav.js";

const LARGEST = 1e9; // no unit of acceleration comes near; squares still fit float32
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
 * @returns {{axes: (Float32Array | Float64Array)[], rate: number | null}} One or three axes; their
 *   rate in Hz where the file says it.
 */
export function readSignal(name, buffer, sense) {
  try {
    if (WAV.test(name)) return readWav(buffer, sense.channel);
    if (NPY.test(name)) return readArray(buffer, sense.channel);
    if (TEXT.test(name)) return readText(buffer, sense.channel);
  } catch (error) {
    if (error instanceof InputError) throw new InputError(`${name} cannot be read: ${error.message}.`);
    throw error;
  }
  throw new InputError(`${name} is of an unknown type; give WAV, CSV, text or NPY.`);
}

function readWav(buffer, channel) {
  const { channels, rate } = parseWav(buffer);
  return { axes: checked(chooseChannel(channels, channel)), rate };
}

function readArray(buffer, channel) {
  return { axes: checked(chooseChannel(parseNpy(buffer), channel)), rate: null };
}

function readText(buffer, channel) {
  const { channels, rate } = parseTable(buffer, channel);
  const length = channels[0].length;
  if ([1, 3].includes(length) && rate === null) { // one line, or three, with a sample a column
    const rows = Array.from({ length }, (_, i) => Float64Array.from(channels, (each) => each[i]));
    return { axes: checked(rows), rate };
  }
  return { axes: checked(channels), rate };
}

function checked(axes) {
  if (axes.length !== 1 && axes.length !== 3) {
    throw new InputError(`it has ${axes.length} channels, and a signal has one or three axes`);
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
