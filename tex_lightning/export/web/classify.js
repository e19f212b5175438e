// One sample: from decoded recordings to what a person is told (predictor.py and prediction.py).

import { decodeSignal, halve } from "./decode.js";
import { InputError } from "./errors.js";
import { photoQuality, signalQuality } from "./quality.js";
import { contentSeed, draws } from "./seed.js";
import { doubted, labels } from "./vote.js";

const UNLIKE = 0.5; // of votes and probabilities that is spread where an input has a warning

/**
 * Classify one sample.
 *
 * @param {object} card - The model card, model.json.
 * @param {Record<string, object>} recordings - By modality. A signal is ``{axes, rate}``, a photo
 *   ``{pixels, width, height}`` as it comes out of its file.
 * @param {(feeds: object) => Promise<Record<string, {data: ArrayLike<number>, dims: number[]}>>}
 *   run - Runs the graph on ``{name: {type, data, dims}}``.
 * @returns {Promise<object>} label, rejected, probability, confidence, top, fragments, warnings,
 *   senses, outputs, decoded recordings and, by sense, the class of every position.
 */
export async function classify(card, recordings, run) {
  const present = card.senses.filter((sense) => sense.modality in recordings);
  checkPresent(card, present);
  const decoded = {};
  const found = [];
  for (const sense of present) {
    if (sense.modality in decoded) continue;
    const [recording, quality] = decode(sense, recordings[sense.modality], card.ranges ?? {});
    decoded[sense.modality] = recording;
    found.push(quality);
  }
  const seed = seedOf(card, present, decoded);
  const feeds = makeFeeds(card, recordings, decoded, seed);
  const outputs = await run(feeds).catch((error) => {
    throw explain(error, present);
  });
  if (present.some(({ name }) => outputs[`${name}_scores`].data.length === 0)) {
    throw explain(new Error("no fragment of this size"), present);
  }
  const vote = voteOf(outputs);
  const scoresOf = ({ name }) => outputs[`${name}_scores`].data;
  const positions = Object.fromEntries(
    present.map((sense) => [sense.name, labels(scoresOf(sense), card.classes.length)]),
  );
  return { ...describe(card, vote, found), outputs, decoded, positions, senses: present };
}

/** Whether there is enough to classify. */
export function isComplete(card, modalities) {
  return card.senses.every((sense) => modalities.includes(sense.modality));
}

function checkPresent(card, present) {
  if (isComplete(card, present.map((sense) => sense.modality))) return;
  const absent = card.senses.find((sense) => !present.includes(sense));
  throw new InputError(`The network needs a ${absent.what} too; choose one.`);
}

function decode(sense, recording, every) {
  const ranges = every[sense.modality] ?? {};
  if (sense.medium === "photo") {
    const photo = sense.half_scale ? halve(recording) : recording;
    const { width, height } = photo;
    if (Math.min(width, height) < Math.max(1, sense.least ?? 1)) {
      throw new InputError(
        `The ${sense.what} has ${width} x ${height} pixels after decoding, and the network needs ` +
          `${sense.least ?? 1} on each side; use a larger one.`,
      );
    }
    return [photo, photoQuality(photo, { sense, ranges })];
  }
  if (sense.axes && !sense.axes.includes(recording.axes.length)) {
    throw new InputError(
      `The ${sense.what} has ${recording.axes.length} axes, and the network reads ` +
        `${sense.axes.join(" or ")}; give a file with as many columns or channels.`,
    );
  }
  const axes = decodeSignal(recording, sense);
  if (axes[0].length < (sense.least ?? 1)) throw tooShort(sense, axes[0].length);
  const rate = recording.rate ?? sense.file_rate;
  return [{ axes }, signalQuality(recording.axes, axes, { rate, sense, ranges })];
}

function tooShort(sense, samples) {
  const seconds = (count) => (count / sense.rate).toFixed(2);
  return new InputError(
    `The ${sense.what} lasts ${seconds(samples)} s, and the network needs ` +
      `${seconds(sense.least)} s of steady movement for one fragment; record a longer stroke.`,
  );
}

/** What went wrong in the graph: mostly a stroke of which too little is steady movement. */
function explain(error, present) {
  const detail = String(error?.message ?? error);
  if (/memory|alloc|out of bounds/i.test(detail)) {
    return new InputError("The browser has too little memory for it; give a smaller photo.");
  }
  const signal = present.find((sense) => sense.medium === "signal");
  if (signal === undefined || !/shape|dimension|kernel|size|range|index/i.test(detail)) return error;
  return new InputError(signal.too_short);
}

function seedOf(card, present, decoded) {
  const modalities = [...new Set(present.map((sense) => sense.modality))];
  const contents = modalities.map((name) => decoded[name].pixels ?? flat(decoded[name].axes));
  return contentSeed(card.decision.seed, contents);
}

function makeFeeds(card, recordings, decoded, seed) {
  const feeds = {};
  for (const sense of card.senses) {
    const name = sense.modality;
    if (sense.medium === "photo") {
      const { pixels, width, height } = recordings[name];
      feeds[name] = { type: "uint8", data: pixels, dims: [height, width, 3] };
    } else {
      const { axes } = decoded[name];
      const dims = [axes.length, axes[0].length];
      feeds[name] = { type: "float32", data: flat(axes), dims };
    }
  }
  if (card.senses.length > 1) {
    const { pairs } = card.decision;
    const dims = [pairs, card.senses.length];
    feeds.draws = { type: "int64", data: draws(seed, pairs, dims[1]), dims };
  }
  return feeds;
}

function flat(axes) {
  if (axes.length === 1) return axes[0];
  const joined = new Float32Array(axes.length * axes[0].length);
  axes.forEach((axis, i) => joined.set(axis, i * axis.length));
  return joined;
}

/** The graph's vote, by the senses that are there. */
function voteOf(outputs) {
  return {
    label: Number(outputs.label.data[0]),
    shares: Array.from(outputs.shares.data),
    probabilities: Array.from(outputs.probabilities.data),
    fragments: outputs.scores.dims[1],
    novelty: outputs.novelty?.data[0] ?? null,
    unknown: Boolean(outputs.unknown?.data[0]),
  };
}

function describe(card, vote, found) {
  const warnings = found.flatMap((each) => each.warnings);
  const empty = found.every((each) => each.empty);
  const doubt = empty ? 1 : warnings.length ? UNLIKE : 0;
  const shares = doubted(vote.shares, doubt);
  const probabilities = doubted(vote.probabilities, doubt);
  const support = card.decision.rule === "vote" ? shares : probabilities; // what has decided
  const unknown = card.unknown !== null && (empty || vote.unknown);
  const first = (i) => (i === vote.label ? 0 : 1);
  const order = [...card.classes.keys()].sort(
    (a, b) =>
      first(a) - first(b) || support[b] - support[a] || probabilities[b] - probabilities[a] || a - b,
  );
  return {
    label: unknown ? "unknown" : card.classes[vote.label],
    rejected: unknown,
    best: card.classes[vote.label],
    probability: probabilities[vote.label],
    confidence: support[vote.label],
    votes: shares[vote.label],
    top: order.map((i) => ({
      label: card.classes[i], share: support[i], votes: shares[i], probability: probabilities[i],
    })),
    fragments: vote.fragments,
    novelty: vote.novelty,
    warnings,
  };
}
