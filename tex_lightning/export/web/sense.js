// What one sense looks like on the page: a file, microphone or camera, and what came of it.

import { canCapture, openCamera, readPhoto, recordSound } from "./capture.js";
import { readSignal, SIGNAL_FILES } from "./decode.js";

/**
 * For each of the files that are dropped together the input that takes it: none takes two while
 * another one is left, and what has no recording yet comes first.
 */
export function placed(files, inputs) {
  const left = new Set(inputs);
  return files.map((file) => {
    const able = inputs.filter((each) => each.takes(file));
    const free = able.filter((each) => left.has(each));
    const input = free.find((each) => each.recording === null) ?? free[0] ?? able[0];
    left.delete(input);
    return [file, input];
  });
}

/** The inputs of one modality. */
export class SenseInput {
  recording = null;
  #live = null;

  /**
   * @param {object} sense - Its entry of the model card.
   * @param {() => void} changed - Called when a recording came or went.
   * @param {(error: Error) => void} failed
   */
  constructor(sense, changed, failed) {
    this.sense = sense;
    this.photo = sense.medium === "photo";
    this.changed = changed;
    this.failed = failed;
    const part = document.getElementById("sense").content.cloneNode(true);
    this.element = part.firstElementChild;
    this.#fill();
    this.#listen();
  }

  find(selector) {
    return this.element.querySelector(selector);
  }

  #fill() {
    const { what } = this.sense;
    this.find("h2").textContent = what[0].toUpperCase() + what.slice(1);
    this.find(".file span").textContent = `Choose a ${what}`;
    this.find("input[type=file]").accept = this.photo ? "image/*" : SIGNAL_FILES;
    this.find(".remove").setAttribute("aria-label", `Remove the ${what}`);
    const record = this.find(".record");
    record.textContent = this.#idle;
    record.disabled = !canCapture();
    const secure = canCapture() ? "" : " Microphone and camera take https or localhost.";
    this.find(".about").textContent = (this.photo ? "JPEG, PNG or WebP." : "WAV, CSV, text or NPY.") + secure;
    this.find("video").hidden = !this.photo;
    this.find("meter").hidden = this.photo;
    if (!this.photo) this.#rate.value = this.sense.file_rate;
  }

  #listen() {
    const file = this.find("input[type=file]");
    file.addEventListener("change", () => {
      if (file.files.length) this.read(file.files[0]);
      file.value = ""; // so that the same file can be chosen again
    });
    this.find(".record").addEventListener("click", () => this.#record().catch(this.failed));
    this.find(".remove").addEventListener("click", () => {
      this.#set(null, "");
      this.find("input[type=file]").focus();
    });
    this.#rate.addEventListener("change", () => this.#rateChanged());
  }

  get #idle() {
    return this.photo ? "Use the camera" : "Use the microphone";
  }

  get #rate() {
    return this.find("input[type=number]");
  }

  /** Take a file. */
  async read(file) {
    this.#close();
    try {
      if (this.photo) return this.#set(await readPhoto(file, file.name), file.name);
      this.#set(readSignal(file.name, await file.arrayBuffer(), this.sense), file.name);
    } catch (error) {
      this.#set(null, "");
      this.failed(error);
    }
  }

  /** Whether a dropped file is for this sense. */
  takes(file) {
    return this.photo === file.type.startsWith("image/");
  }

  /** The recording as the network takes it, with the rate that the person says. */
  get given() {
    if (this.recording === null || this.photo) return this.recording;
    return { ...this.recording, rate: this.recording.rate ?? Number(this.#rate.value) };
  }

  #rateChanged() {
    if (this.recording !== null && this.recording.rate === null) this.changed();
  }

  #set(recording, name) {
    this.recording = recording;
    this.find(".name").textContent = name;
    this.find(".given").hidden = recording === null;
    this.find(".rate").hidden = recording === null || recording.rate !== null;
    this.changed();
  }

  async #record() {
    if (this.#live !== null) return this.#finish();
    const live = this.find(".live");
    live.hidden = false;
    try {
      this.#live = this.photo
        ? await openCamera(this.find("video"))
        : await recordSound((level, seconds) => {
            this.find("meter").value = level;
            this.find(".seconds").textContent = `${seconds.toFixed(1)} s`;
          });
    } catch (error) {
      live.hidden = true;
      throw error;
    }
    this.find(".record").textContent = this.photo ? "Take the photo" : "Stop";
  }

  #finish() {
    try {
      this.#set(this.#live.take(), this.photo ? "From the camera" : "From the microphone");
    } finally {
      this.#close();
    }
  }

  #close() {
    this.#live?.close();
    this.#live = null;
    this.find(".live").hidden = true;
    this.find(".record").textContent = this.#idle;
  }
}
