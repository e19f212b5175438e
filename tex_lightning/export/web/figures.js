// The figures of one sense: what was recorded, what the network made of it, where it says what.

import { drawPhoto, drawSpectrogram, drawWaveform } from "./draw.js";
import { spectrogram } from "./spectrum.js";

const SVG = "http://www.w3.org/2000/svg";

/** The figures of one modality; drawn again when the size or the theme of the page changes. */
export class SenseFigures {
  #recording = null;
  #result = null;

  /**
   * @param {object} sense - Its entry of the model card.
   * @param {string[]} classes
   */
  constructor(sense, classes) {
    this.sense = sense;
    this.classes = classes;
    this.photo = sense.medium === "photo";
    const template = document.getElementById(this.photo ? "photo-figures" : "signal-figures");
    this.element = document.createElement("div");
    this.element.className = "column";
    this.element.hidden = true;
    this.element.append(template.content.cloneNode(true));
    if (this.photo) this.find("input").addEventListener("input", () => this.draw());
  }

  find(selector) {
    return this.element.querySelector(selector);
  }

  /**
   * Show a recording, and what a network said of it.
   *
   * @param {object | null} recording - As read; null shows nothing.
   * @param {object | null} result - Of :func:`classify`.
   */
  show(recording, result) {
    this.#recording = recording;
    this.#result = result;
    this.element.hidden = recording === null;
    this.draw();
  }

  /** Draw everything. */
  draw() {
    if (this.#recording === null) return;
    const map = this.#map();
    if (this.photo) this.#drawPhoto(map);
    else this.#drawSignal(map);
    this.#legend(map);
  }

  #map() {
    const labels = this.#result?.positions[this.sense.name];
    if (labels === undefined) return null;
    const [, rows, columns] = this.#output("scores").dims;
    return { rows, columns, labels, tints: this.#result.tints };
  }

  #drawPhoto(map) {
    const shown = this.#result?.decoded[this.sense.modality] ?? this.#recording;
    const opacity = this.find("input").value / 100;
    const { stride } = this.sense;
    drawPhoto(this.find("canvas"), shown, map && { ...map, stride, opacity });
    this.find(".opacity").hidden = map === null;
    const size = `${this.#recording.width} x ${this.#recording.height} pixels`;
    const classes = map ? " Colours: the class of every position by this modality alone." : "";
    this.#describe(".map", `Photo, ${size}.${classes}`, map);
  }

  #drawSignal(map) {
    const { axes, rate } = this.#recording;
    const seconds = axes[0].length / rate;
    const start = this.#result && this.#output("start");
    const begin = start ? Number(start.data[0]) / this.sense.rate : null;
    drawWaveform(this.find(".waveform"), { axes, rate, start: begin });
    const { what } = this.sense;
    const moving = begin ? ` What comes before steady movement, at ${begin.toFixed(2)} s, is left out.` : "";
    const length = `${seconds.toFixed(2)} s at ${Math.round(rate).toLocaleString("en")} Hz`;
    this.#describe(".wave", `Waveform of the ${what}, ${length}.${moving}`, null);
    const input = this.#result && this.#output("input");
    this.find(".heat").hidden = map === null;
    if (map === null) return;
    if (!input) return this.#drawBands(map, { axes, rate, seconds });
    const [bands, frames] = input.dims;
    drawSpectrogram(this.find(".spectrogram"), {
      ...map, data: input.data, bands, frames, seconds, start: begin ?? 0,
      hop: this.sense.hop_seconds, frequencies: this.sense.frequencies, stride: this.sense.stride,
    }); // prettier-ignore
    const text = `Spectrogram as the network reads it, ${bands} bands, and the class of every position by this modality alone.`;
    this.#describe(".heat", text, map);
  }

  /** Of a network that reads no spectrogram: one to look at, and the classes of its fragments. */
  #drawBands(map, { axes, rate, seconds }) {
    const drawn = spectrogram(axes, rate);
    drawSpectrogram(this.find(".spectrogram"), { ...drawn, ...map, seconds, stride: null }); // prettier-ignore
    const text = "Spectrogram, and the classes of the movement, half second by half second: where rests are left out, not below their time.";
    this.#describe(".heat", text, map);
  }

  #output(name) {
    return this.#result.outputs[`${this.sense.name}_${name}`];
  }

  #describe(selector, text, map) {
    const figure = this.find(selector);
    const [best] = map ? this.#counts(map) : [];
    const said = best ? ` Most positions say ${best[0]}.` : "";
    figure.querySelector("figcaption").textContent = text;
    figure.querySelector("canvas").setAttribute("aria-label", text + said);
  }

  /** Class names with their shares of positions and colours, most frequent first. */
  #counts(map) {
    const counts = new Map();
    for (const each of map.labels) counts.set(each, (counts.get(each) ?? 0) + 1);
    return [...counts]
      .sort((a, b) => b[1] - a[1])
      .map(([each, count]) => [this.classes[each], count / map.labels.length, map.tints.get(each)]);
  }

  #legend(map) {
    const legend = this.find(".legend");
    const entries = map ? this.#counts(map) : [];
    legend.replaceChildren(
      ...entries.map(([name, share, tint]) => {
        const item = document.createElement("li");
        const percent = share < 0.005 ? "<1" : Math.round(share * 100);
        item.append(swatch(tint), `${name} ${percent}\u00a0%`);
        return item;
      }),
    );
  }
}

/** A coloured square; an attribute of SVG, since the page's policy allows no inline styles. */
function swatch(tint) {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 10 10");
  svg.setAttribute("aria-hidden", "true");
  const square = document.createElementNS(SVG, "rect");
  for (const [key, value] of Object.entries({ width: 10, height: 10, rx: 2, fill: tint })) {
    square.setAttribute(key, value);
  }
  svg.append(square);
  return svg;
}
