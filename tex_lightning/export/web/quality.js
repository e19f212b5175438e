// What is wrong with a recording that can be read (quality.py of the runtime has the same rules).

// factors beyond training
const TOLERANCES = { constant: 1, clipped: 3, level: 3, rate: 1.5, brightness: 3, contrast: 3 };
const FLAT_SHARE = 0.01; // of the samples, from which on a signal counts as clipped
const MIN_FLAT = 10; // samples; a few at the extremes of a slow signal are none
const FINE_VALUES = 32; // fewer values are coarse digits and not a limit
const SAME = 2e-6; // of a constant, by which resampling may change it
const UNIFORM = 0.5; // standard deviation in grey levels, below which a photo shows nothing
const PHOTO_SIDE = 256; // pixels of a photo that are looked at, along each side
const REMEDIES = {
  level: "check the sensor, its unit and gain",
  rate: "check the rate that was given, or record as for the training",
  brightness: "check lens and light",
  contrast: "check lens and light",
};

/**
 * Say what is wrong with a signal.
 *
 * @param {ArrayLike<number>[]} axes - As recorded.
 * @param {Float32Array[]} decoded - At the network's rate.
 * @param {{rate: number, sense: object, ranges: object}} about - Its own rate in Hz, the sense's
 *   entry of the model card, and what was measured in training.
 * @returns {{warnings: string[], empty: boolean}}
 */
export function signalQuality(axes, decoded, { rate, sense, ranges }) {
  const measured = axes.map(measure);
  const what = sense.what;
  const constant = measured.map(({ low, high }) => high - low <= SAME * Math.abs(high));
  if (constant.every(Boolean)) {
    const how = measured.some((each) => each.high !== 0) ? "constant" : "silent";
    const warning = `The ${what} is ${how}, so nothing was measured; check the sensor.`;
    return { warnings: [warning], empty: true };
  }
  const most = (fault) => TOLERANCES[fault] * (ranges?.[fault]?.[1] ?? 0);
  const warnings = [];
  if (constant.filter(Boolean).length > most("constant")) {
    constant.forEach((same, axis) => {
      if (same) warnings.push(`Axis ${axis + 1} of the ${what} is constant; check the sensor.`);
    });
  }
  const flat = Math.max(...measured.map((each, axis) => (constant[axis] ? 0 : each.flat)));
  const clipped = flat / axes[0].length;
  if (flat >= MIN_FLAT && clipped >= FLAT_SHARE && clipped > most("clipped")) {
    warnings.push(
      `The ${what} is clipped, ${Math.round(clipped * 100)}% of it at its largest or smallest ` +
        "value; lower the sensor's gain.",
    );
  }
  const level = Math.sqrt(decoded.reduce((sum, axis) => sum + variance(axis), 0));
  const measures = { level, rate: Math.min(rate, sense.rate) };
  return { warnings: [...warnings, ...unlike(measures, ranges, what)], empty: false };
}

/**
 * Say what is wrong with a decoded photo.
 *
 * @param {{pixels: Uint8Array, width: number, height: number}} photo - RGB.
 * @param {{sense: object, ranges: object}} about - As for :func:`signalQuality`.
 * @returns {{warnings: string[], empty: boolean}}
 */
export function photoQuality({ pixels, width, height }, { sense, ranges }) {
  const step = Math.max(1, Math.floor(Math.min(width, height) / PHOTO_SIDE));
  const grey = [];
  for (let y = 0; y < height; y += step) {
    for (let x = 0; x < width; x += step) {
      const at = 3 * (y * width + x);
      grey.push((pixels[at] + pixels[at + 1] + pixels[at + 2]) / 3);
    }
  }
  const contrast = Math.sqrt(variance(grey));
  if (contrast < UNIFORM) {
    const warning = `The ${sense.what} is uniform, so it shows nothing; check the camera.`;
    return { warnings: [warning], empty: true };
  }
  const brightness = grey.reduce((sum, each) => sum + each, 0) / grey.length;
  return { warnings: unlike({ brightness, contrast }, ranges, sense.what), empty: false };
}

function measure(samples) {
  let [low, high] = [Infinity, -Infinity];
  for (const x of samples) {
    if (x < low) low = x;
    if (x > high) high = x;
  }
  let flat = 0;
  for (let i = 1; i < samples.length; i++) {
    const x = samples[i];
    if ((x === low || x === high) && x === samples[i - 1]) flat += 1;
  }
  return { low, high, flat: flat && new Set(samples).size < FINE_VALUES ? 0 : flat };
}

function variance(samples) {
  const first = samples[0];
  let [sum, squares] = [0, 0];
  for (const x of samples) {
    sum += x - first; // else gravity would cost digits
    squares += (x - first) ** 2;
  }
  return Math.max(0, squares / samples.length - (sum / samples.length) ** 2);
}

function unlike(measures, ranges, what) {
  return Object.entries(measures).flatMap(([name, value]) => {
    const [low, high] = ranges?.[name] ?? [0, Infinity];
    const factor = TOLERANCES[name];
    if (low / factor <= value && value <= high * factor) return [];
    return [
      `The ${what} has a ${name} of ${general(value)} and the training had ${general(low)} to ` +
        `${general(high)}; ${REMEDIES[name]}.`,
    ];
  });
}

/** Five significant digits, as Python writes them with ``.5g``. */
export function general(value) {
  if (value === 0) return "0";
  const exponent = Math.floor(Math.log10(Math.abs(Number(value.toPrecision(5)))));
  if (exponent >= -4 && exponent < 5) return String(Number(value.toPrecision(5)));
  const [digits, power] = Number(value.toPrecision(5)).toExponential().split("e");
  return `${digits}e${power[0]}${power.slice(1).padStart(2, "0")}`;
}
