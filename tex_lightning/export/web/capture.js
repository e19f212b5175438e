// Recordings from microphone and camera.

import { isDeepGrey, toRgb } from "./decode.js";
import { InputError } from "./errors.js";

const RAW = { echoCancellation: false, noiseSuppression: false, autoGainControl: false };
const CAMERA = { facingMode: "environment", width: { ideal: 1920 }, height: { ideal: 1440 } };

/** Whether the browser lets this page ask for microphone and camera at all. */
export function canCapture() {
  return Boolean(window.isSecureContext && navigator.mediaDevices?.getUserMedia);
}

/**
 * Begin to record sound, as it comes and without any enhancement.
 *
 * @param {(level: number, seconds: number) => void} heard - Called with the largest magnitude of
 *   each piece, 0 to 1, and how long the recording is.
 * @returns {Promise<{take: () => object, close: () => void}>} ``take`` gives the signal ``{axes,
 *   rate}`` so far.
 */
export async function recordSound(heard) {
  const stream = await ask({ audio: { ...RAW, channelCount: 1 } }, "microphone");
  const context = new AudioContext();
  const pieces = [];
  let count = 0;
  try {
    await context.audioWorklet.addModule(new URL("./recorder.js", import.meta.url));
  } catch (error) {
    release(stream);
    throw error;
  }
  const recorder = new AudioWorkletNode(context, "recorder", { numberOfOutputs: 0 });
  recorder.port.onmessage = ({ data }) => {
    pieces.push(data);
    count += data.length;
    heard(data.reduce((most, x) => Math.max(most, Math.abs(x)), 0), count / context.sampleRate);
  };
  context.createMediaStreamSource(stream).connect(recorder);
  const take = () => {
    const samples = new Float32Array(count);
    pieces.reduce((at, piece) => (samples.set(piece, at), at + piece.length), 0);
    if (count === 0) throw new InputError("The microphone gave no samples; check it and record again.");
    return { axes: [samples], rate: context.sampleRate };
  };
  const close = () => {
    recorder.port.onmessage = null;
    release(stream);
    context.close();
  };
  return { take, close };
}

/**
 * Show the camera.
 *
 * @param {HTMLVideoElement} video
 * @returns {Promise<{take: () => object, close: () => void}>} ``take`` gives a photo ``{pixels,
 *   width, height}``.
 */
export async function openCamera(video) {
  const stream = await ask({ video: CAMERA }, "camera");
  video.srcObject = stream;
  await video.play();
  return {
    take: () => readPixels(video, video.videoWidth, video.videoHeight),
    close: () => {
      release(stream);
      video.srcObject = null;
    },
  };
}

/**
 * Read a photo: upright, with the numbers of its file and no colour management.
 *
 * @param {Blob} file
 * @param {string} name
 * @returns {Promise<{pixels: Uint8Array, width: number, height: number}>}
 */
export async function readPhoto(file, name) {
  if (isDeepGrey(new Uint8Array(await file.slice(0, 26).arrayBuffer()))) {
    throw new InputError(`${name} has greys of 16 bits, which browsers darken or round; save it with 8.`);
  }
  const plain = { imageOrientation: "from-image", colorSpaceConversion: "none", premultiplyAlpha: "none" };
  const bitmap = await createImageBitmap(file, plain).catch(() => {
    throw new InputError(`${name} is in no image format that this browser reads; give JPEG or PNG.`);
  });
  const { opaque, ...photo } = readPixels(bitmap, bitmap.width, bitmap.height);
  bitmap.close();
  if (opaque) return photo;
  throw new InputError(`${name} is transparent in places; save it without transparency.`);
}

function readPixels(source, width, height) {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d", { willReadFrequently: true }); // never on a graphics card
  context.drawImage(source, 0, 0);
  const { data } = context.getImageData(0, 0, width, height);
  const opaque = data.every((value, i) => i % 4 !== 3 || value === 255); // else colours are lost
  return { pixels: toRgb(data), width, height, opaque };
}

async function ask(constraints, what) {
  try {
    return await navigator.mediaDevices.getUserMedia(constraints);
  } catch (error) {
    const denied = error.name === "NotAllowedError";
    throw new InputError(
      denied
        ? `The browser was not allowed to use the ${what}; allow it in the browser's settings.`
        : `There is no ${what} that can be used; choose a file instead.`,
    );
  }
}

function release(stream) {
  for (const track of stream.getTracks()) track.stop();
}
