// The files of a bundle: what was dropped or picked, a folder, single files or a zip of them.
// Nothing of a bundle is run or shown as a page; every byte stays in this window.

const REQUIRED_FILES = ["evidence.json", "readings.parquet", "points.parquet", "calibration.rrd", "report.html"];
const SUMS = "SHA256SUMS", STATEMENT = "statement.dsse.json";
/** Not in SHA256SUMS: itself, the statement, which has its digest, and the time stamp of that. */
const UNLISTED_FILES = [SUMS, STATEMENT, "timestamp.tsr"];
const KNOWN_FILES = [...REQUIRED_FILES, ...UNLISTED_FILES, "report.pdf", "notary.jsonl"];
const RUN_FILE = /^runs\/[A-Za-z0-9][A-Za-z0-9._-]{0,80}\.rrd$/;
const MOST_FILES = 4096;
/** Bytes of all files together: they are held in memory. */
const MOST_BUNDLE_BYTES = 2 ** 30;

const isKnown = (name) => KNOWN_FILES.includes(name) || RUN_FILE.test(name);

/** Files of a zip by name: stored or deflated, no encryption, no names that come twice. */
const unzipped = async (bytes) => {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  let end = bytes.length - 22;
  while (end >= 0 && end > bytes.length - 66000 && view.getUint32(end, true) !== 0x06054b50) end -= 1;
  if (end < 0 || view.getUint32(end, true) !== 0x06054b50) throw new Fault("the zip has no directory at its end");
  const count = view.getUint16(end + 10, true);
  if (count > MOST_FILES) throw new Fault(`more than ${MOST_FILES} files are no bundle`);
  const found = [];
  let at = view.getUint32(end + 16, true), left = MOST_BUNDLE_BYTES;
  for (let k = 0; k < count; k += 1) {
    if (view.getUint32(at, true) !== 0x02014b50) throw new Fault("the zip's directory is damaged");
    const flags = view.getUint16(at + 8, true), method = view.getUint16(at + 10, true);
    const packed = view.getUint32(at + 20, true), size = view.getUint32(at + 24, true);
    const length = view.getUint16(at + 28, true), start = view.getUint32(at + 42, true);
    const name = textOf(bytes.subarray(at + 46, at + 46 + length), "a name in the zip");
    at += 46 + length + view.getUint16(at + 30, true) + view.getUint16(at + 32, true);
    if (name.endsWith("/")) continue;
    left -= size;
    if (flags & 1 || ![0, 8].includes(method) || left < 0) throw new Fault(`the zip holds ${name} in a form that is not read here`);
    const from = start + 30 + view.getUint16(start + 26, true) + view.getUint16(start + 28, true);
    const data = bytes.subarray(from, from + packed);
    const whole = method === 0 ? data : await inflated(data, size);
    if (whole.length !== size) throw new Fault(`the zip's ${name} is damaged`);
    found.push([name, whole]);
  }
  return found;
};

/** Inflate to so many bytes, and no more: a bomb is stopped at the size that it admits. */
const inflated = async (data, size) => {
  const whole = new Uint8Array(size);
  let at = 0;
  const reader = new Blob([data]).stream().pipeThrough(new DecompressionStream("deflate-raw")).getReader();
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return whole.subarray(0, at);
    if (at + value.length > size) throw new Fault("a file of the zip is larger than its directory says");
    whole.set(value, at);
    at += value.length;
  }
};

/** Every file below what was dropped, with its path. */
const walkEntries = async (entry, path, found) => {
  if (found.length > MOST_FILES) throw new Fault(`more than ${MOST_FILES} files are no bundle`);
  if (entry.isFile) {
    found.push([path + entry.name, await new Promise((resolve, reject) => entry.file(resolve, reject))]);
    return;
  }
  const reader = entry.createReader();
  for (;;) {
    const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (!some.length) return;
    for (const each of some) await walkEntries(each, `${path}${entry.name}/`, found);
  }
};

/** Names below the one folder that has evidence.json or SHA256SUMS; all others are no part of it. */
const belowBundle = (files) => {
  const roots = new Set(files.flatMap(([name]) => {
    const match = /^(.*?)(?:evidence\.json|SHA256SUMS)$/.exec(name);
    return match && (match[1] === "" || match[1].endsWith("/")) ? [match[1]] : [];
  }));
  if (roots.size === 0) throw new Fault("no evidence in it: a bundle has evidence.json and SHA256SUMS");
  if (roots.size > 1) throw new Fault("several bundles: this page checks one at a time, and no chain; payscope verify FIRST SECOND does");
  const [root] = roots;
  return files.map(([name, data]) => [name.startsWith(root) ? name.slice(root.length) : `../${name}`, data]);
};

/** Bytes by name of the bundle in what was given: [[name, File], …]. */
const bundleOf = async (given) => {
  let files = given;
  if (given.length === 1 && given[0][0].toLowerCase().endsWith(".zip")) {
    files = await unzipped(new Uint8Array(await given[0][1].arrayBuffer()));
  }
  if (files.length > MOST_FILES) throw new Fault(`more than ${MOST_FILES} files are no bundle`);
  const held = new Map();
  let left = MOST_BUNDLE_BYTES;
  for (const [name, file] of belowBundle(files)) {
    left -= file.size ?? file.length;
    if (left < 0) throw new Fault("the files are larger than a gigabyte together, which this page does not hold");
    const bytes = file instanceof Uint8Array ? file : new Uint8Array(await file.arrayBuffer());
    if (held.has(name)) throw new Fault(`two files are called ${name}`);
    held.set(name, bytes);
  }
  return held;
};
