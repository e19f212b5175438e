// WAV files, sample by sample as libsndfile reads them (an AudioContext would resample them).

import { InputError } from "./errors.js";

const PCM = 1;
const FLOAT = 3;
const EXTENSIBLE = 0xfffe; // the true format stands further back
const UNKNOWN_LENGTH = 0x7fff0000; // written by programs that stream

const CHUNKS = new Set( // that programs write behind samples
  ("list info id3 fact cue smpl inst bext ixml junk pad fllr peak disp acid plst axml chna cart " +
    "levl afsp").split(" "),
);

const READERS = {
  [`${PCM}:1`]: (view, at) => (view.getUint8(at) - 128) / 128,
  [`${PCM}:2`]: (view, at) => view.getInt16(at, true) / 2 ** 15,
  [`${PCM}:3`]: (view, at) =>
    ((view.getInt8(at + 2) << 16) | view.getUint16(at, true)) / 2 ** 23,
  [`${PCM}:4`]: (view, at) => view.getInt32(at, true) / 2 ** 31,
  [`${FLOAT}:4`]: (view, at) => view.getFloat32(at, true),
  [`${FLOAT}:8`]: (view, at) => view.getFloat64(at, true),
};

/**
 * Read a WAV file.
 *
 * @param {ArrayBuffer} buffer - The file.
 * @returns {{channels: Float32Array[], rate: number}} Samples of each channel, integers scaled to
 *   [-1, 1), and their rate in Hz.
 */
export function parseWav(buffer) {
  const view = new DataView(buffer);
  if (name(view, 0) !== "RIFF" || name(view, 8) !== "WAVE") {
    throw new InputError("it does not begin as a WAV file does");
  }
  let format = null;
  for (let at = 12; at + 8 <= view.byteLength; ) {
    const length = view.getUint32(at + 4, true);
    if (name(view, at) === "fmt ") format = readFormat(view, at + 8, length);
    if (name(view, at) === "data") return readData(view, at + 8, length, format);
    at += 8 + length + (length % 2);
  }
  throw new InputError("it holds no samples");
}

function name(view, at) {
  if (at + 4 > view.byteLength) return "";
  return String.fromCharCode(...new Uint8Array(view.buffer, view.byteOffset + at, 4));
}

function readFormat(view, at, length) {
  const tag = view.getUint16(at, true);
  const channels = view.getUint16(at + 2, true);
  return {
    tag: tag === EXTENSIBLE && length >= 26 ? view.getUint16(at + 24, true) : tag,
    channels,
    rate: view.getUint32(at + 4, true),
    width: view.getUint16(at + 12, true) / channels, // bytes of a sample
  };
}

/** Whether nothing but chunks stands from a place on: of known names, or whole ones. */
function areChunks(view, at) {
  while (at + 8 <= view.byteLength) {
    const title = name(view, at);
    const length = view.getUint32(at + 4, true);
    at += 8 + length + (length % 2);
    const named = /^[ -~]{4}$/.test(title) && at <= view.byteLength + 1;
    if (!named && !CHUNKS.has(title.trim().toLowerCase())) return false;
  }
  return true;
}

function readData(view, at, length, format) {
  if (format === null) throw new InputError("its samples come before their format");
  const read = READERS[`${format.tag}:${format.width}`];
  if (read === undefined || !(format.rate > 0)) {
    throw new InputError("its samples are compressed; save them as PCM or floating point");
  }
  // a program that was killed has written no size, or that of before: all that is there are samples
  if (!areChunks(view, at + length + (length % 2))) length = view.byteLength - at;
  const missing = at + length - view.byteLength;
  if (missing > 0 && length < UNKNOWN_LENGTH) {
    throw new InputError(`truncated: ${missing} of ${length} bytes are missing`);
  }
  const frame = format.width * format.channels;
  const frames = Math.floor(Math.min(length, view.byteLength - at) / frame);
  const channels = Array.from({ length: format.channels }, (_, channel) => {
    const samples = new Float32Array(frames);
    const first = at + channel * format.width;
    for (let i = 0; i < frames; i++) samples[i] = read(view, first + i * frame);
    return samples;
  });
  return { channels, rate: format.rate };
}
