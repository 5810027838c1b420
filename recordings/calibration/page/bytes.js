// Bytes and texts: hexadecimal digits, base64, UTF-8. Every reader refuses what it does not know.

/** A fault of what is looked at, in words for whoever looks. */
class Fault extends Error {}

const utf8 = (text) => new TextEncoder().encode(text);

const textOf = (bytes, what) => {
  try {
    return new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(bytes);
  } catch {
    throw new Fault(`${what} is not text in UTF-8`);
  }
};

const hex = (bytes) => Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");

const unhex = (digits) => Uint8Array.from(digits.match(/../g) ?? [], (two) => parseInt(two, 16));

const base64 = (bytes) => btoa(String.fromCharCode(...bytes));

/** Several texts decode alike; only the one that encodes back is taken. */
const unbase64 = (text, what) => {
  let bytes;
  try {
    bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  } catch {
    throw new Fault(`${what} is no base64`);
  }
  let back = "";
  for (const byte of bytes) back += String.fromCharCode(byte);
  if (btoa(back) !== text) throw new Fault(`${what} is not canonical base64; copy it again from the original file`);
  return bytes;
};

const sameBytes = (a, b) => a.length === b.length && a.every((byte, at) => byte === b[at]);

const joined = (...parts) => {
  const whole = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    whole.set(part, at);
    at += part.length;
  }
  return whole;
};

/** The number that little-endian bytes are. */
const littleEndian = (bytes) => {
  let value = 0n;
  for (let at = bytes.length - 1; at >= 0; at -= 1) value = (value << 8n) | BigInt(bytes[at]);
  return value;
};
