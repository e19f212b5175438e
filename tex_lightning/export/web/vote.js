// From the class scores of fragments to one label (decision/voting.py has the same rules).

/**
 * Decide on one sample.
 *
 * @param {ArrayLike<number>} scores - (classes, fragments) before softmax, row by row.
 * @param {number} classes
 * @param {{rule: string, temperature: number}} decision
 * @returns {{label: number, shares: number[], probabilities: number[]}}
 */
export function decide(scores, classes, { rule, temperature }) {
  const count = scores.length / classes;
  const votes = new Array(classes).fill(0);
  const sums = new Array(classes).fill(0);
  const means = new Array(classes).fill(0);
  for (let i = 0; i < count; i++) {
    const column = Array.from({ length: classes }, (_, k) => scores[k * count + i]);
    votes[largest(column)] += 1;
    softmax(column, temperature).forEach((p, k) => (sums[k] += p));
    column.forEach((score, k) => (means[k] += score / count));
  }
  const shares = votes.map((each) => each / count);
  const probabilities =
    rule === "score" ? softmax(means, temperature) : sums.map((each) => each / count);
  const label = rule === "vote" ? winner(votes, sums) : largest(probabilities);
  return { label, shares, probabilities };
}

/** The most probable class of every position: scores (classes, positions), row by row. */
export function labels(scores, classes) {
  const count = scores.length / classes;
  return Array.from({ length: count }, (_, i) =>
    largest(Array.from({ length: classes }, (_, k) => scores[k * count + i])),
  );
}

/**
 * The scores of tuples of positions, one of each sense, as FusionNet adds them up.
 *
 * @param {ArrayLike<number>[]} summands - Of each sense (classes, positions), row by row.
 * @param {number} classes
 * @param {Uint32Array} words - Random bits: ``count`` of the first sense, then of the next.
 * @param {number} count - Of tuples.
 * @returns {Float32Array} (classes, count).
 */
export function join(summands, classes, words, count) {
  const found = new Float32Array(classes * count);
  summands.forEach((each, sense) => {
    const positions = each.length / classes;
    for (let i = 0; i < count; i++) {
      const position = words[sense * count + i] % positions;
      for (let k = 0; k < classes; k++) found[k * count + i] += each[k * positions + position];
    }
  });
  return found;
}

/** Votes or probabilities with a part of them spread evenly, where the input has a warning. */
export function doubted(values, share) {
  return values.map((each) => each * (1 - share) + share / values.length);
}

function largest(values) {
  return values.reduce((best, value, i) => (value > values[best] ? i : best), 0);
}

/** Most votes; then the larger probability; then the lower index. */
function winner(votes, sums) {
  const better = (k, best) =>
    votes[k] > votes[best] || (votes[k] === votes[best] && sums[k] > sums[best]);
  return votes.reduce((best, _, k) => (better(k, best) ? k : best), 0);
}

function softmax(scores, temperature) {
  const most = Math.max(...scores);
  const powers = scores.map((each) => Math.exp((each - most) / temperature));
  const sum = powers.reduce((total, each) => total + each, 0);
  return powers.map((each) => each / sum);
}
