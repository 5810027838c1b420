// SHA-256 and SHA-512 (FIPS 180-4). The browser's own SHA-256 is used where there is one, since a
// recording may have many megabytes; SHA-512 hashes a few kilobytes for Ed25519.

/** The first primes; FIPS 180-4 makes its constants of their roots. */
const PRIMES = (() => {
  const found = [];
  for (let n = 2; found.length < 80; n += 1) if (found.every((p) => n % p)) found.push(n);
  return found;
})();

/** The first 64 bits of the fractional part of the k-th root of n. */
const rootBits = (n, k) => {
  // the integer root of n · 2^(64 k) has them as its last 64 bits
  const target = BigInt(n) << BigInt(64 * k);
  let low = 0n, high = 1n << 70n;
  while (high - low > 1n) {
    const middle = (low + high) / 2n;
    if (middle ** BigInt(k) <= target) low = middle;
    else high = middle;
  }
  return low & 0xffffffffffffffffn;
};

const SHA512_START = PRIMES.slice(0, 8).map((p) => rootBits(p, 2));
const SHA512_ROUNDS = PRIMES.map((p) => rootBits(p, 3));
const SHA256_START = SHA512_START.map((bits) => Number(bits >> 32n));
const SHA256_ROUNDS = SHA512_ROUNDS.slice(0, 64).map((bits) => Number(bits >> 32n));

/** The message with a 1, zeros, and its length in bits at the end of the last block. */
const padded = (bytes, block) => {
  const room = block / 8;
  const whole = new Uint8Array(Math.ceil((bytes.length + 1 + room) / block) * block);
  whole.set(bytes);
  whole[bytes.length] = 0x80;
  new DataView(whole.buffer).setBigUint64(whole.length - 8, BigInt(bytes.length) * 8n);
  return new DataView(whole.buffer);
};

const ownSha256 = (bytes) => {
  const data = padded(bytes, 64);
  const state = Int32Array.from(SHA256_START);
  const w = new Int32Array(64);
  const turn = (x, n) => (x >>> n) | (x << (32 - n));
  for (let at = 0; at < data.byteLength; at += 64) {
    for (let t = 0; t < 16; t += 1) w[t] = data.getInt32(at + 4 * t);
    for (let t = 16; t < 64; t += 1) {
      const x = w[t - 15], y = w[t - 2];
      const s0 = turn(x, 7) ^ turn(x, 18) ^ (x >>> 3);
      const s1 = turn(y, 17) ^ turn(y, 19) ^ (y >>> 10);
      w[t] = w[t - 16] + s0 + w[t - 7] + s1;
    }
    let [a, b, c, d, e, f, g, h] = state;
    for (let t = 0; t < 64; t += 1) {
      const s1 = turn(e, 6) ^ turn(e, 11) ^ turn(e, 25);
      const one = (h + s1 + ((e & f) ^ (~e & g)) + SHA256_ROUNDS[t] + w[t]) | 0;
      const s0 = turn(a, 2) ^ turn(a, 13) ^ turn(a, 22);
      const two = (s0 + ((a & b) ^ (a & c) ^ (b & c))) | 0;
      [h, g, f, e, d, c, b, a] = [g, f, e, (d + one) | 0, c, b, a, (one + two) | 0];
    }
    [a, b, c, d, e, f, g, h].forEach((word, k) => { state[k] += word; });
  }
  const out = new DataView(new ArrayBuffer(32));
  state.forEach((word, k) => out.setInt32(4 * k, word));
  return new Uint8Array(out.buffer);
};

const sha256 = async (bytes) =>
  globalThis.crypto?.subtle
    ? new Uint8Array(await crypto.subtle.digest("SHA-256", bytes))
    : ownSha256(bytes);

const sha512 = (bytes) => {
  const data = padded(bytes, 128);
  const mask = 0xffffffffffffffffn;
  const turn = (x, n) => ((x >> n) | (x << (64n - n))) & mask;
  const state = [...SHA512_START];
  for (let at = 0; at < data.byteLength; at += 128) {
    const w = [];
    for (let t = 0; t < 16; t += 1) w.push(data.getBigUint64(at + 8 * t));
    for (let t = 16; t < 80; t += 1) {
      const x = w[t - 15], y = w[t - 2];
      const s0 = turn(x, 1n) ^ turn(x, 8n) ^ (x >> 7n);
      const s1 = turn(y, 19n) ^ turn(y, 61n) ^ (y >> 6n);
      w.push((w[t - 16] + s0 + w[t - 7] + s1) & mask);
    }
    let [a, b, c, d, e, f, g, h] = state;
    for (let t = 0; t < 80; t += 1) {
      const s1 = turn(e, 14n) ^ turn(e, 18n) ^ turn(e, 41n);
      const one = h + s1 + ((e & f) ^ (~e & mask & g)) + SHA512_ROUNDS[t] + w[t];
      const s0 = turn(a, 28n) ^ turn(a, 34n) ^ turn(a, 39n);
      const two = s0 + ((a & b) ^ (a & c) ^ (b & c));
      [h, g, f, e, d, c, b, a] = [g, f, e, (d + one) & mask, c, b, a, (one + two) & mask];
    }
    [a, b, c, d, e, f, g, h].forEach((word, k) => { state[k] = (state[k] + word) & mask; });
  }
  const out = new DataView(new ArrayBuffer(64));
  state.forEach((word, k) => out.setBigUint64(8 * k, word));
  return new Uint8Array(out.buffer);
};
