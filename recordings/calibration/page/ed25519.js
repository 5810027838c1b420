// Ed25519 (RFC 8032, 5.1), verification alone. It has no secret, so it need not take constant time.
// Where the browser has Ed25519 as well, both have to agree.

const P = 2n ** 255n - 19n;
/** The order of the base point. */
const L = 2n ** 252n + 27742317777372353535851937790883648493n;

const modulo = (x, m = P) => { const rest = x % m; return rest < 0n ? rest + m : rest; };

const power = (base, exponent) => {
  let result = 1n;
  for (let b = modulo(base), e = exponent; e > 0n; e >>= 1n, b = (b * b) % P) {
    if (e & 1n) result = (result * b) % P;
  }
  return result;
};

const inverseOf = (x) => power(x, P - 2n);
const D = modulo(-121665n * inverseOf(121666n));
const ROOT_OF_MINUS_1 = power(2n, (P - 1n) / 4n);

/** Extended coordinates: x = X/Z, y = Y/Z, xy = T/Z. */
const NEUTRAL = { X: 0n, Y: 1n, Z: 1n, T: 0n };

const addPoints = (p, q) => {
  const a = modulo((p.Y - p.X) * (q.Y - q.X)), b = modulo((p.Y + p.X) * (q.Y + q.X));
  const c = modulo(2n * D * p.T * q.T), d = modulo(2n * p.Z * q.Z);
  const e = b - a, f = d - c, g = d + c, h = b + a;
  return { X: modulo(e * f), Y: modulo(g * h), Z: modulo(f * g), T: modulo(e * h) };
};

const timesPoint = (scalar, point) => {
  let result = NEUTRAL;
  for (let s = scalar, p = point; s > 0n; s >>= 1n, p = addPoints(p, p)) {
    if (s & 1n) result = addPoints(result, p);
  }
  return result;
};

/** The point of 32 bytes; null if there is none, or not in its one canonical form. */
const decodePoint = (bytes) => {
  const all = littleEndian(bytes);
  const y = all & (2n ** 255n - 1n), sign = all >> 255n;
  if (bytes.length !== 32 || y >= P) return null;
  const u = modulo(y * y - 1n), v = modulo(D * y * y + 1n);
  let x = modulo(u * power(v, 3n) * power(u * power(v, 7n), (P - 5n) / 8n));
  const square = modulo(v * x * x);
  if (square === modulo(-u)) x = modulo(x * ROOT_OF_MINUS_1);
  else if (square !== u) return null;
  if (x === 0n && sign === 1n) return null;
  if ((x & 1n) !== sign) x = P - x;
  return { X: x, Y: y, Z: 1n, T: modulo(x * y) };
};

const encodePoint = (p) => {
  const z = inverseOf(p.Z);
  let all = modulo(p.Y * z) | ((modulo(p.X * z) & 1n) << 255n);
  return Uint8Array.from({ length: 32 }, () => { const byte = Number(all & 255n); all >>= 8n; return byte; });
};

/** The base point: y = 4/5, x even. */
const BASE = decodePoint(unhex("58" + "66".repeat(31)));

/** Whether the 64 bytes are this key's signature of the message, by this page's own arithmetic. */
const ownVerify = (key, signature, message) => {
  if (signature.length !== 64) return false;
  const s = littleEndian(signature.subarray(32));
  // S and S + L are the same point: only one of them is a signature
  if (s >= L) return false;
  const a = decodePoint(key);
  if (a === null) return false;
  const r = signature.subarray(0, 32);
  const h = littleEndian(sha512(joined(r, key, message))) % L;
  const negative = { X: modulo(-a.X), Y: a.Y, Z: 1n, T: modulo(-a.T) };
  const found = addPoints(timesPoint(s, BASE), timesPoint(h, negative));
  return sameBytes(encodePoint(found), r);
};

/** Whether the browser says so; null where it has no Ed25519. */
const browserVerify = async (key, signature, message) => {
  try {
    const imported = await crypto.subtle.importKey("raw", key, "Ed25519", false, ["verify"]);
    return await crypto.subtle.verify("Ed25519", imported, signature, message);
  } catch {
    return null;
  }
};

/** Whether the key signed the message; which implementations said so. */
const verifySignature = async (key, signature, message) => {
  const own = ownVerify(key, signature, message), browser = await browserVerify(key, signature, message);
  return {
    valid: own && browser !== false,
    by: browser === null ? "this page's own Ed25519" : "this page's own Ed25519 and the browser's",
  };
};
