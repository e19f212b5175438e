// What a person is told of scores and votes.

/** The most probable class of every position: scores (classes, positions), row by row. */
export function labels(scores, classes) {
  const count = scores.length / classes;
  return Array.from({ length: count }, (_, i) =>
    largest(Array.from({ length: classes }, (_, k) => scores[k * count + i])),
  );
}

/** Votes or probabilities with a part of them spread evenly, where the input has a warning. */
export function doubted(values, share) {
  return values.map((each) => each * (1 - share) + share / values.length);
}

function largest(values) {
  return values.reduce((best, value, i) => (value > values[best] ? i : best), 0);
}
