// The page: recordings come, the network runs, a person reads the result.

import { classify, isComplete } from "./classify.js";
import { colours } from "./draw.js";
import { Engine } from "./engine.js";
import { InputError } from "./errors.js";
import { SenseFigures } from "./figures.js";
import { placed, SenseInput } from "./sense.js";

const SHOWN = 5; // classes in the table
const element = (id) => document.getElementById(id);

class Page {
  #latest = 0; // number of the last run; older ones are not shown

  constructor(card) {
    this.card = card;
    this.engine = new Engine();
    const senses = card.senses.filter(
      (sense, i) => card.senses.findIndex((each) => each.modality === sense.modality) === i,
    );
    this.inputs = senses.map(
      (sense) => new SenseInput(sense, () => this.update(), (error) => this.fail(error)),
    );
    this.figures = senses.map((sense) => new SenseFigures(sense, card.classes));
    element("senses").append(...this.inputs.map((each) => each.element));
    element("figures").append(...this.figures.map((each) => each.element));
    this.#listen();
  }

  async start() {
    const name = encodeURIComponent(`${this.card.kind}.onnx`);
    const url = (file) => new URL(file, document.baseURI).href;
    this.ready = this.engine.load(url(name), url("onnxruntime/ort-wasm-simd-threaded.wasm"));
    const { classes, senses } = this.card;
    const whats = [...new Set(senses.map((sense) => `a ${sense.what}`))].join(" and ");
    const about = `Classifies ${classes.length} surface materials from ${whats}.`;
    element("about").textContent = `${about} Loading the network …`;
    await this.ready;
    element("about").textContent = about;
    document.body.dataset.state = "ready";
  }

  #listen() {
    const body = document.body;
    const show = (dropping) => body.classList.toggle("dropping", dropping);
    for (const kind of ["dragenter", "dragover"]) {
      body.addEventListener(kind, (event) => (event.preventDefault(), show(true)));
    }
    body.addEventListener("dragleave", (event) => event.relatedTarget === null && show(false));
    body.addEventListener("drop", (event) => {
      event.preventDefault();
      show(false);
      this.#take([...event.dataTransfer.files]);
    });
    const draw = () => this.figures.forEach((each) => each.draw());
    window.addEventListener("resize", draw);
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  }

  #take(files) {
    for (const [file, input] of placed(files, this.inputs)) {
      if (input) input.read(file);
      else this.fail(new InputError(`The network takes no file such as ${file.name}.`));
    }
  }

  /** Classify what there is, and show it. */
  async update() {
    const run = ++this.#latest;
    element("problem").textContent = "";
    const given = this.inputs.filter((each) => each.given !== null);
    const recordings = Object.fromEntries(given.map((each) => [each.sense.modality, each.given]));
    this.#draw(recordings, null);
    if (!isComplete(this.card, Object.keys(recordings))) return this.#wait(given);
    this.#busy(true);
    try {
      await this.ready;
      const begin = performance.now();
      const result = await classify(this.card, recordings, (feeds) => this.engine.run(feeds));
      if (run !== this.#latest) return;
      result.tints = colours(Object.values(result.positions));
      this.#draw(recordings, result);
      this.#say(result, (performance.now() - begin) / 1000);
    } catch (error) {
      if (run === this.#latest) this.fail(error);
    } finally {
      if (run === this.#latest) this.#busy(false);
    }
  }

  #busy(busy) {
    element("verdict").setAttribute("aria-busy", busy);
    if (busy) element("how").textContent = "Computing …";
    document.body.dataset.state = busy ? "busy" : "ready";
  }

  #draw(recordings, result) {
    this.figures.forEach((each) => each.show(recordings[each.sense.modality] ?? null, result));
    element("empty").hidden = Object.keys(recordings).length > 0;
  }

  #wait(given) {
    this.#clear();
    const absent = this.inputs.find((each) => !given.includes(each));
    element("how").textContent = given.length
      ? `The network needs a ${absent.sense.what} too; choose one.`
      : "Choose a recording to begin.";
  }

  #clear() {
    for (const id of ["label", "how", "time"]) element(id).textContent = "";
    element("warnings").replaceChildren();
    element("classes").hidden = true;
  }

  /** Say in one sentence what a person can mend; what is wrong in the page goes to the console. */
  fail(error) {
    this.#clear();
    if (!(error instanceof InputError)) console.error(error);
    element("problem").textContent =
      error instanceof InputError ? error.message : `The network could not run (${error.message}).`;
  }

  #say(result, seconds) {
    const percent = (share) => `${(100 * share).toFixed(share < 0.9995 && share > 0 ? 1 : 0)}\u00a0%`;
    element("label").replaceChildren(...breakable(result.label ?? "No class"));
    element("how").textContent = sentence(result, percent);
    element("warnings").replaceChildren(...result.warnings.map((text) => tagged("li", text)));
    element("classes").tBodies[0].replaceChildren(
      ...result.top.slice(0, SHOWN).map(({ label, votes, probability }) => {
        const row = document.createElement("tr");
        const head = document.createElement("th");
        head.scope = "row";
        const bar = document.createElement("progress");
        bar.value = votes;
        bar.setAttribute("aria-hidden", "true"); // the number stands beside it
        head.append(...breakable(label), bar);
        row.append(head, tagged("td", percent(votes)), tagged("td", percent(probability)));
        return row;
      }),
    );
    element("classes").hidden = false;
    const whats = [...new Set(result.senses.map((sense) => sense.what))].join(" and ");
    const fragments = result.fragments.toLocaleString("en");
    element("time").textContent =
      `${seconds.toFixed(2)} s from decoded ${whats} to label, ${fragments} fragments.`;
  }
}

function sentence(result, percent) {
  const share = `${percent(result.votes)} of the votes, mean probability ${percent(result.probability)}`;
  if (result.label === "unknown") {
    return `Unlike every class of the training; the closest is ${result.best} (${share}).`;
  }
  return `${share}.`;
}

function tagged(tag, text) {
  const found = document.createElement(tag);
  found.textContent = text;
  return found;
}

/** A name that may be broken into lines between its words. */
function breakable(name) {
  const words = name.split(/(?<=[_+.-])|(?<=[a-z])(?=[A-Z])/);
  return words.flatMap((word) => [word, document.createElement("wbr")]);
}

async function main() {
  try {
    const response = await fetch("model.json");
    if (!response.ok) throw new Error(`model.json cannot be fetched (${response.status})`);
    const card = await response.json();
    element("made").textContent = `Network ${card.kind}, tex_lightning ${card.version}; ONNX Runtime Web.`;
    await new Page(card).start();
  } catch (error) {
    console.error(error);
    element("about").textContent = `This page could not start (${error.message}). Reload it to try again.`;
  }
}

main();
