// The random tuples of FusionNet, seeded by the content of the recordings.

const TABLE = Uint32Array.from({ length: 256 }, (_, byte) => {
  let value = byte;
  for (let bit = 0; bit < 8; bit++) value = (value >>> 1) ^ (value & 1 ? 0xedb88320 : 0);
  return value;
});

/**
 * CRC-32 as zlib has it.
 *
 * @param {Uint8Array} bytes
 * @param {number} seed - The value to go on from.
 * @returns {number} 32 bits, not negative.
 */
export function crc32(bytes, seed = 0) {
  let value = ~seed;
  for (let i = 0; i < bytes.length; i++) value = TABLE[(value ^ bytes[i]) & 255] ^ (value >>> 8);
  return ~value >>> 0;
}

/**
 * Seed of one sample.
 *
 * @param {number} seed - Of the network's decision.
 * @param {(Float32Array | Uint8Array)[]} recordings - Decoded, in the order of the modalities.
 * @returns {number}
 */
export function contentSeed(seed, recordings) {
  return recordings.reduce(
    (value, each) => crc32(new Uint8Array(each.buffer, each.byteOffset, each.byteLength), value),
    seed >>> 0,
  );
}

const SIZE = 624;
const SHIFT = 397;

/**
 * Words of the Mersenne Twister MT19937 (Matsumoto and Nishimura 1998).
 *
 * @param {number} seed - 32 bits.
 * @param {number} count
 * @returns {Uint32Array}
 */
export function mersenneTwister(seed, count) {
  const state = new Uint32Array(SIZE);
  state[0] = seed;
  for (let i = 1; i < SIZE; i++) {
    state[i] = Math.imul(1812433253, state[i - 1] ^ (state[i - 1] >>> 30)) + i;
  }
  const words = new Uint32Array(count);
  for (let i = 0; i < count; i++) {
    if (i % SIZE === 0) twist(state);
    words[i] = temper(state[i % SIZE]);
  }
  return words;
}

function twist(state) {
  for (let i = 0; i < SIZE; i++) {
    const y = (state[i] & 0x80000000) | (state[(i + 1) % SIZE] & 0x7fffffff);
    state[i] = state[(i + SHIFT) % SIZE] ^ (y >>> 1) ^ (y & 1 ? 0x9908b0df : 0);
  }
}

function temper(y) {
  y ^= y >>> 11;
  y ^= (y << 7) & 0x9d2c5680;
  y ^= (y << 15) & 0xefc60000;
  return y ^ (y >>> 18);
}

/**
 * What the graph's input ``draws`` takes.
 *
 * @param {number} seed - Of the sample.
 * @param {number} count - Of tuples, K.
 * @param {number} senses
 * @returns {BigInt64Array} (count, senses), row by row.
 */
export function draws(seed, count, senses) {
  const words = mersenneTwister(seed, count * senses); // sense after sense
  return BigInt64Array.from({ length: count * senses }, (_, i) =>
    BigInt(words[(i % senses) * count + Math.floor(i / senses)]),
  );
}
