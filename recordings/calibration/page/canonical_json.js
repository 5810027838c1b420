// JSON in canonical form (RFC 8785): names sorted, nothing between, numbers as JavaScript has them.

const MOST_JSON_BYTES = 16 * 2 ** 20;
const MOST_JSON_DEPTH = 32;
const LONE_SURROGATE = /[\ud800-\udbff](?![\udc00-\udfff])|(?:^|[^\ud800-\udbff])[\udc00-\udfff]/;

const canonicalText = (value) => {
  if (Array.isArray(value)) return `[${value.map(canonicalText).join(",")}]`;
  if (value === null || typeof value !== "object") return JSON.stringify(value);
  const names = Object.keys(value).sort();
  return `{${names.map((name) => `${JSON.stringify(name)}:${canonicalText(value[name])}`).join(",")}}`;
};

const depthOf = (text) => {
  let depth = 0, most = 0, quoted = false;
  for (let at = 0; at < text.length; at += 1) {
    const character = text[at];
    if (quoted) {
      if (character === "\\") at += 1;
      else if (character === '"') quoted = false;
    } else if (character === '"') quoted = true;
    else if (character === "{" || character === "[") most = Math.max(most, (depth += 1));
    else if (character === "}" || character === "]") depth -= 1;
  }
  return most;
};

/** Parse canonical JSON of a stranger: a name that comes twice is not canonical, and refused. */
const parseCanonical = (bytes, what) => {
  if (bytes.length > MOST_JSON_BYTES) throw new Fault(`${what} is larger than ${MOST_JSON_BYTES} bytes`);
  const text = textOf(bytes, what);
  if (depthOf(text) > MOST_JSON_DEPTH) throw new Fault(`${what} is nested deeper than ${MOST_JSON_DEPTH}`);
  let value;
  try {
    value = JSON.parse(text);
  } catch {
    throw new Fault(`${what} is no JSON`);
  }
  const again = canonicalText(value);
  if (again !== text || LONE_SURROGATE.test(again)) {
    throw new Fault(`${what} is not in the canonical form of RFC 8785`);
  }
  return value;
};
