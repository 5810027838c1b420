// Numbers as report.html prints them, to the last digit; and whether two numbers agree.

/** So many decimals; a tie goes to the even digit, as the report rounds it. */
const decimals = (value, digits) => {
  const exact = Math.abs(value).toFixed(100), point = exact.indexOf(".");
  let text = exact.slice(0, digits ? point + 1 + digits : point);
  const rest = exact.slice(point + 1 + digits);
  const tie = /^50*$/.test(rest);
  if (rest[0] >= "5" && (!tie || Number(text.at(-1)) % 2 === 1)) {
    text = ((BigInt(text.replace(".", "")) + 1n).toString()).padStart(digits + 1, "0");
    if (digits) text = `${text.slice(0, -digits)}.${text.slice(-digits)}`;
  }
  return (value < 0 || Object.is(value, -0) ? "-" : "") + text;
};

const grouped = (value, digits) => {
  const [whole, rest] = decimals(value, digits).split(".");
  return whole.replace(/\B(?=(\d{3})+$)/g, ",") + (rest ? `.${rest}` : "");
};

const kilograms = (value, digits = 1) => (value === null ? "–" : grouped(value, digits));

const withInterval = (value, [low, high], shape) =>
  low === null || high === null ? `${shape(value)} (no bounded interval)` : `${shape(value)} (${shape(low)} to ${shape(high)})`;

/** The lines of the report that say what the calibration is, by their heading there. */
const printedFacts = (found, confidence) => {
  const of = (value) => kilograms(value / Math.abs(found.c1_1));
  return {
    "α": withInterval(found.alpha_1, found.alpha_interval_1, (value) => decimals(value, 4)),
    "β": `${withInterval(found.beta_kg, found.beta_interval_kg, (value) => grouped(value, 1))} kg`,
    "valid for": `${found.range_kg.map((value) => grouped(value, 1)).join(" to ")} kg`,
    "expanded uncertainty":
      `${grouped(found.coverage_k_1 * found.u_kg, 1)} kg at ${grouped(found.budget_at[0], 0)} kg (k = ` +
      `${decimals(found.coverage_k_1, 2)}, ${decimals(confidence * 100, 0)}%, mean of ${found.budget_at[1]} readings)`,
    "error, in the fit / load left out": `${kilograms(found.rms_error_kg)} / ${kilograms(found.rms_error_left_out_kg)} kg r.m.s.`,
    "repeatability of a reading": found.repeatability_kg === null ? "unknown" : `${of(found.repeatability_kg)} kg`,
    "day to day": found.day_kg === null ? "unknown" : `${of(found.day_kg)} kg`,
  };
};

/** Two programs sum in another order, and end an iteration at another last digit. */
const RELATIVE_TOLERANCE = 1e-6;
/** Of a number near 0, such as the error of a point on the line: a tenth of a milligram. */
const ABSOLUTE_TOLERANCE = 1e-7;

const agree = (a, b) => a === b || (typeof a === "number" && typeof b === "number" &&
  Math.abs(a - b) <= ABSOLUTE_TOLERANCE + RELATIVE_TOLERANCE * Math.max(Math.abs(a), Math.abs(b)));

/** Places at which what was computed is not what is stored; more may be stored. */
const differences = (stored, computed, place) => {
  if (Array.isArray(computed)) {
    if (!Array.isArray(stored) || stored.length !== computed.length) return [place];
    return computed.flatMap((value, k) => differences(stored[k], value, `${place}.${k}`));
  }
  if (computed !== null && typeof computed === "object") {
    if (stored === null || typeof stored !== "object") return [place];
    return Object.keys(computed).flatMap((name) => differences(stored[name], computed[name], `${place}.${name}`));
  }
  return agree(stored, computed) ? [] : [place];
};
