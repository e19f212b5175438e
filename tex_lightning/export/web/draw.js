// Waveform, spectrogram, strip of labels and the map of labels over a photo.

// Okabe and Ito's colours, which colour-blind readers tell apart, the lightest left out
const PALETTE = ["#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#56b4e9", "#f0e442"];
const OTHER = "#8a8a8a"; // of classes beyond them
const HEAT = [ // dark to bright, even in lightness
  [9, 8, 32], [61, 18, 96], [122, 32, 110], [186, 54, 85], [236, 105, 37], [251, 180, 32],
  [248, 252, 165],
]; // prettier-ignore
const MARGIN = { left: 52, right: 8, bottom: 22 }; // CSS pixels around what has axes
const FONT = "12px system-ui, sans-serif";

/**
 * A colour for each class that positions voted for, most frequent first.
 *
 * @param {number[][]} senses - Labels of all positions of each sense; the senses count alike.
 * @returns {Map<number, string>}
 */
export function colours(senses) {
  const shares = new Map();
  for (const labels of senses) {
    for (const each of labels) shares.set(each, (shares.get(each) ?? 0) + 1 / labels.length);
  }
  const ranked = [...shares].sort((a, b) => b[1] - a[1] || a[0] - b[0]);
  return new Map(ranked.map(([label], i) => [label, PALETTE[i] ?? OTHER]));
}

/**
 * Draw the envelope of a signal over time.
 *
 * @param {HTMLCanvasElement} canvas
 * @param {{axes: ArrayLike<number>[], rate: number, start: number | null}} signal - rate in Hz;
 *   start of steady movement in seconds.
 */
export function drawWaveform(canvas, { axes, rate, start }) {
  const { context, width, height, ink, faint, accent } = prepare(canvas);
  const seconds = axes[0].length / rate;
  const plot = { x: MARGIN.left, width: width - MARGIN.left - MARGIN.right, height: height - MARGIN.bottom };
  const tints = [accent, ...PALETTE.slice(1)];
  const each = axes.length > 1 ? axes : [axes[0]];
  const most = Math.max(1e-12, ...each.map(magnitude));
  context.fillStyle = faint;
  if (start !== null) context.fillRect(plot.x, 0, (plot.width * start) / seconds, plot.height);
  const lane = plot.height / each.length;
  each.forEach((samples, axis) => {
    context.fillStyle = tints[axis % tints.length];
    const middle = lane * (axis + 0.5);
    for (let x = 0; x < plot.width; x++) {
      const from = Math.floor((x / plot.width) * samples.length);
      const to = Math.max(from + 1, Math.floor(((x + 1) / plot.width) * samples.length));
      const [low, high] = range(samples, from, to);
      const top = middle - (high / most) * lane * 0.47;
      context.fillRect(plot.x + x, top, 1, Math.max(1, ((high - low) / most) * lane * 0.47));
    }
  });
  context.fillStyle = ink;
  context.textAlign = "right";
  each.forEach((_, axis) => {
    context.fillText(axisName(axis, each.length), MARGIN.left - 8, lane * (axis + 0.5) + 4);
  });
  if (each.length === 1) {
    context.fillText(short(most), MARGIN.left - 6, 12);
    context.fillText(short(-most), MARGIN.left - 6, plot.height - 2);
  }
  timeAxis(context, plot, seconds, ink);
}

/** What stands beside an axis: nothing beside a single one, X, Y and Z beside three, else its number. */
export function axisName(axis, count) {
  if (count === 1) return "";
  return count > 3 ? String(axis + 1) : "XYZ"[axis];
}

/**
 * Draw a spectrogram over the time of its signal, and below it the class of every position.
 *
 * @param {HTMLCanvasElement} canvas
 * @param {object} what - data (bands, frames) row by row, bands, frames, start and seconds of the
 *   signal, hop in seconds, frequencies in Hz or null, labels, stride and receptiveField in
 *   frames, tints by class.
 */
export function drawSpectrogram(canvas, what) {
  const { context, width, height, ink } = prepare(canvas);
  const strip = 18;
  const plot = { x: MARGIN.left, width: width - MARGIN.left - MARGIN.right, height: height - MARGIN.bottom };
  const tall = plot.height - strip - 4;
  const scale = plot.width / what.seconds;
  const left = plot.x + what.start * scale;
  context.imageSmoothingEnabled = false;
  context.drawImage(heatMap(what), left, 0, what.frames * what.hop * scale, tall);
  const count = what.labels.length;
  const stride = what.stride ?? what.frames / count;
  const offset = (what.frames - (count - 1) * stride) / 2; // centre of the first position
  what.labels.forEach((label, i) => {
    context.fillStyle = what.tints.get(label);
    const x = left + (offset + (i - 0.5) * stride) * what.hop * scale;
    context.fillRect(x, tall + 4, stride * what.hop * scale + 0.5, strip);
  });
  context.fillStyle = ink;
  context.textAlign = "right";
  for (const band of bandTicks(what)) {
    const y = tall * (1 - (band + 0.5) / what.bands);
    context.fillText(hertz(what.frequencies?.[band], band), MARGIN.left - 6, Math.min(tall, Math.max(10, y + 4)));
  }
  context.fillText("class", MARGIN.left - 6, tall + 4 + 13);
  timeAxis(context, plot, what.seconds, ink);
}

/**
 * Draw a photo and over it the class of every position.
 *
 * @param {HTMLCanvasElement} canvas - Becomes as large as the photo.
 * @param {{pixels: Uint8Array, width: number, height: number}} photo - RGB.
 * @param {object | null} map - rows, columns, labels row by row, stride in pixels or null, tints
 *   by class, opacity 0 to 1; null draws the photo alone.
 */
export function drawPhoto(canvas, { pixels, width, height }, map) {
  [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d");
  const image = context.createImageData(width, height);
  for (let i = 0, j = 0; j < pixels.length; i += 4) {
    image.data[i] = pixels[j++];
    image.data[i + 1] = pixels[j++];
    image.data[i + 2] = pixels[j++];
    image.data[i + 3] = 255;
  }
  context.putImageData(image, 0, 0);
  if (map === null) return;
  const stride = [map.stride ?? width / map.columns, map.stride ?? height / map.rows];
  const left = (width - map.columns * stride[0]) / 2;
  const top = (height - map.rows * stride[1]) / 2;
  context.globalAlpha = map.opacity;
  map.labels.forEach((label, i) => {
    context.fillStyle = map.tints.get(label);
    const [x, y] = [left + (i % map.columns) * stride[0], top + Math.floor(i / map.columns) * stride[1]];
    context.fillRect(Math.floor(x), Math.floor(y), Math.ceil(stride[0]), Math.ceil(stride[1]));
  });
  context.globalAlpha = 1;
}

/** A context in CSS pixels, cleared, and the colours of the page. */
function prepare(canvas) {
  const { width, height } = canvas.getBoundingClientRect();
  const ratio = window.devicePixelRatio || 1;
  [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  context.font = FONT;
  const style = getComputedStyle(canvas);
  const colour = (name) => style.getPropertyValue(name).trim();
  return { context, width, height, ink: colour("--muted"), faint: colour("--line"), accent: colour("--accent") };
}

function heatMap({ data, bands, frames }) {
  const [low, high] = range(data, 0, data.length);
  const image = new ImageData(frames, bands);
  for (let band = 0; band < bands; band++) {
    for (let frame = 0; frame < frames; frame++) {
      const value = (data[band * frames + frame] - low) / (high - low || 1);
      image.data.set([...heat(value), 255], 4 * ((bands - 1 - band) * frames + frame));
    }
  }
  const canvas = new OffscreenCanvas(frames, bands);
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}

function heat(value) {
  const place = value * (HEAT.length - 1);
  const i = Math.min(HEAT.length - 2, Math.floor(place));
  return HEAT[i].map((from, c) => from + (HEAT[i + 1][c] - from) * (place - i));
}

function timeAxis(context, plot, seconds, ink) {
  context.fillStyle = ink;
  context.textAlign = "center";
  for (const time of ticks(seconds, plot.width / 60)) {
    const x = plot.x + (plot.width * time) / seconds;
    context.fillRect(x, plot.height, 1, 4);
    if (x > plot.x + plot.width - 14) context.textAlign = "right"; // the last one
    context.fillText(`${Number(time.toFixed(2))} s`, x, plot.height + 17);
  }
}

/** Round times of a signal, some ``most`` at most; none of one without an end, as at a rate of 0. */
export function ticks(seconds, most) {
  const steps = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60];
  const step = steps.find((each) => seconds / each <= most) ?? 120 * Math.ceil(seconds / most / 120);
  const count = Number.isFinite(step) ? Math.floor(seconds / step) + 1 : 0;
  return Array.from({ length: count }, (_, i) => i * step);
}

function bandTicks({ bands }) {
  return [0, 0.25, 0.5, 0.75, 1].map((share) => Math.round(share * (bands - 1)));
}

function hertz(frequency, band) {
  if (frequency === undefined) return String(band);
  return frequency < 1000 ? `${Math.round(frequency)} Hz` : `${(frequency / 1000).toFixed(1)} kHz`;
}

function short(value) {
  return String(Number(value.toPrecision(2)));
}

function magnitude(samples) {
  const [low, high] = range(samples, 0, samples.length);
  return Math.max(-low, high);
}

function range(samples, from, to) {
  let [low, high] = [samples[from], samples[from]];
  for (let i = from + 1; i < to; i++) {
    if (samples[i] < low) low = samples[i];
    if (samples[i] > high) high = samples[i];
  }
  return [low, high];
}
