// Public keys that no signature may rely on: anyone can sign for them.

/** Private keys printed in RFC 8032, and bytes that count up. */
const PUBLISHED_SEEDS = [
  "9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60",
  "4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb",
  "c5aa8df43f9f837bedb7442f31dcb7b166d38535076f094b85ce3a2e0b4458f7",
  "f5e5767cf153317519630f226876b86c8160cc583bc013744c6bf255f5cc0ee5",
  "833fe62409237b9d62ec77587520911e9a759cec1d19755b7da901b96dca3d42",
  hex(Uint8Array.from({ length: 32 }, (_, k) => k)),
  hex(Uint8Array.from({ length: 32 }, (_, k) => k + 1)),
];

/** 2^k times the base point: all private keys below need the same. */
const doubledBases = () => {
  const found = [BASE];
  while (found.length < 255) found.push(addPoints(found.at(-1), found.at(-1)));
  return found;
};

/** Whether the private half of this point is one that everybody knows. */
const isPublished = (point) => {
  const bases = doubledBases();
  const seeds = PUBLISHED_SEEDS.map(unhex);
  for (let value = 0; value < 256; value += 1) seeds.push(new Uint8Array(32).fill(value));
  return seeds.some((seed) => {
    const half = sha512(seed).slice(0, 32);
    half[0] &= 248;
    half[31] = (half[31] & 127) | 64;
    const scalar = littleEndian(half);
    let found = NEUTRAL;
    for (let k = 0; k < 255; k += 1) if ((scalar >> BigInt(k)) & 1n) found = addPoints(found, bases[k]);
    return modulo(point.X * found.Z) === found.X && modulo(point.Y * found.Z) === found.Y;
  });
};

/** Why no signature by this key may be relied on; "" if nothing is known against it. */
const weakness = (key) => {
  if (key.length !== 32) return `has ${key.length} bytes; an Ed25519 key has 32`;
  if ((littleEndian(key) & (2n ** 255n - 1n)) >= P) return "is not in canonical form";
  const point = decodePoint(key);
  if (point === null) return "is not a point of the curve";
  const eightfold = timesPoint(8n, point);
  if (eightfold.X === 0n && eightfold.Y === eightfold.Z) return "is of small order: anyone can sign for it";
  if (isPublished(point)) return "has a private half that is published: anyone can sign for it";
  return "";
};
