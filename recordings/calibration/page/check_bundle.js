// Check a bundle: digests, signature, and every number that this page computes anew.

const READING_COLUMNS = [["run_id", "string"], ["load_id", "string"], ["day", "string"], ["log", "string"],
  ["reading", "int64"], ["start_s", "double"], ["end_s", "double"], ["mass_kg", "double"], ["std_kg", "double"],
  ["common_u_kg", "double"], ["used", "bool"], ["reason", "string"]];
const POINT_COLUMNS = [["run_id", "string"], ["load_id", "string"], ["day", "string"], ["reference_kg", "double"],
  ["readings", "int64"], ["rejected", "int64"], ["mean_kg", "double"], ["std_kg", "double"],
  ["calibrated_kg", "double"], ["error_kg", "double"], ["error_left_out_kg", "double"], ["studentised_1", "double"]];
/** Of many differences so many are named. */
const MOST_NAMED = 8;

const sumsOf = (bytes) => {
  const found = new Map();
  for (const line of textOf(bytes, SUMS).split("\n").slice(0, -1)) {
    const match = /^([0-9a-f]{64})  (\S+)$/.exec(line);
    if (!match || !isKnown(match[2]) || UNLISTED_FILES.includes(match[2])) throw new Fault("has a line that is no digest of a file of a bundle");
    found.set(match[2], match[1]);
  }
  const lines = [...found.keys()].sort().map((name) => `${found.get(name)}  ${name}\n`);
  if (!sameBytes(utf8(lines.join("")), bytes)) throw new Fault("is not as it was written: sorted, each file once");
  return found;
};

/** SHA-256 of each file, and what of them is wrong: a row a file. */
const checkFiles = async (held, add) => {
  const digests = new Map(), states = new Map();
  const say = (kind, name, what) => { add(kind, name, what); states.set(name, what); };
  for (const [name, bytes] of held) {
    if (isKnown(name)) digests.set(name, hex(await sha256(bytes)));
    else say("tampered", name, "does not belong to a bundle");
  }
  for (const name of [...REQUIRED_FILES, SUMS]) if (!held.has(name)) say("incomplete", name, "is missing");
  if (held.has(SUMS)) {
    try {
      const listed = sumsOf(held.get(SUMS));
      for (const [name, digest] of listed) {
        if (!digests.has(name)) { if (!states.has(name)) say("incomplete", name, `is missing, although ${SUMS} lists it`); }
        else if (digests.get(name) !== digest) say("tampered", name, `is not the file whose digest ${SUMS} has`);
      }
      for (const name of digests.keys()) {
        if (!listed.has(name) && !UNLISTED_FILES.includes(name)) say("tampered", name, `is not listed in ${SUMS}`);
      }
    } catch (fault) {
      if (!(fault instanceof Fault)) throw fault;
      say("tampered", SUMS, fault.message);
    }
  }
  const names = [...new Set([...held.keys(), ...states.keys()])].sort();
  const unlisted = (name) => (UNLISTED_FILES.includes(name) ? "not in the list itself" : "as listed");
  return { digests, rows: names.map((name) => [name, digests.get(name) ?? "–", states.get(name) ?? unlisted(name)]) };
};

const addDays = (day, count) => {
  const moved = new Date(`${day}T00:00:00Z`);
  moved.setUTCDate(moved.getUTCDate() + count);
  return moved.toISOString().slice(0, 10);
};

const tableOf = (held, name, columns, add) => {
  if (!held.has(name)) return null;
  try {
    return parquetRows(held.get(name), columns);
  } catch (fault) {
    add("tampered", name, fault instanceof Fault ? fault.message : "is damaged");
    return null;
  }
};

/** What the report prints: its lines by heading, the budget by component. Read as text, never run. */
const reportOf = (bytes) => {
  // its style is of no use here, and this page's policy would complain of it
  const text = textOf(bytes, "report.html").replace(/<style[\s\S]*?<\/style>/g, "");
  const page = new DOMParser().parseFromString(text, "text/html");
  const facts = {};
  for (const term of page.querySelectorAll("dt")) facts[term.textContent] ??= term.nextElementSibling?.textContent ?? "";
  const rows = (label) => [...page.querySelectorAll(`[aria-label="${label}"] tbody tr`)].map((row) => (
    [...row.cells].map((cell) => cell.textContent)));
  return { facts, text: page.body.textContent, budget: rows("Uncertainty budget"), points: rows("Points") };
};

/** Evidence without a line: how far the estimates of each load are from its reference. */
const checkWithoutLine = (held, evidence, readings, add) => {
  const references = referencesOf(evidence), points = pointsOf(readings, references);
  const stored = tableOf(held, "points.parquet", POINT_COLUMNS, add) ?? [];
  const plain = points.runs.map((run) => ({
    run_id: run.id, reference_kg: run.reference, readings: run.masses.length, rejected: run.rejected, mean_kg: run.mean, std_kg: run.std }));
  if (differences(stored, plain, "points").length) add("irreproducible", "points.parquet", "does not follow from the readings");
  const text = held.has("report.html") ? reportOf(held.get("report.html")).text : "";
  const facts = references.loads.flatMap((load, k) => {
    const own = points.used.filter((run) => run.load === load);
    if (!own.length) return [];
    const signed = (value) => (value < 0 ? "" : "+") + grouped(value, 2);
    const off = meanOf(own.map((run) => run.mean)) - references.mass[k];
    const masses = own.flatMap((run) => run.masses), mean = meanOf(masses);
    let said = `the estimate is ${signed(off)} kg off`;
    if (masses.length > 1) {
      const std = Math.sqrt(sumOf(masses.map((mass) => (mass - mean) ** 2)) / (masses.length - 1));
      const common = Math.max(0, ...own.map((run) => run.common));
      const u = Math.hypot(std / Math.sqrt(masses.length), common, Math.sqrt(references.covariance[k][k]));
      said += `; ${masses.length} readings scatter by ${grouped(std, 2)} kg, and the difference has a standard uncertainty of ` +
        `${grouped(u, 2)} kg by scatter, priors and reference`;
    }
    const line = `Load '${load}', reference ${grouped(references.mass[k], 2)} kg: ${said}.`;
    const printed = text.includes(line);
    if (!printed) add("tampered", "report.html", `does not print what the readings give: “${line}”`);
    return [[`load ${load}`, said, "not in it", printed ? said : "not printed"]];
  });
  return { none: `There is no calibration line: ${evidence.no_fit}.`, facts };
};

/** What the readings come to, beside evidence.json, points.parquet and report.html. */
const checkNumbers = (held, evidence, readings, add) => {
  const stored = evidence.calibration;
  for (const what of faultsOfReadings(evidence, readings).slice(0, MOST_NAMED)) add("irreproducible", "readings.parquet", what);
  if (evidence.kind === "check") return { none: "A check against one known mass: its line is that of the evidence before. Drop that bundle to have the line computed anew." };
  let computed;
  try {
    computed = calibrationOf(evidence, readings);
  } catch (fault) {
    if (stored === null) return checkWithoutLine(held, evidence, readings, add);
    add("irreproducible", "evidence.json: calibration", `cannot be computed anew: ${fault.message}`);
    return { none: "No line could be computed from these readings." };
  }
  if (stored === null) {
    add("irreproducible", "evidence.json: calibration", "is missing, and the readings determine a line");
    return { none: "evidence.json has no line." };
  }
  const references = referencesOf(evidence);
  const apart = [
    ...differences(stored, computed, "calibration"),
    ...differences(evidence.references, references.loads.map((load_id, k) => ({
      load_id, reference_kg: references.mass[k], u_kg: Math.sqrt(references.covariance[k][k]) })), "references"),
    ...differences(evidence.reference_covariance_kg2, references.covariance, "reference_covariance_kg2"),
  ];
  for (const place of apart.slice(0, MOST_NAMED)) add("irreproducible", `evidence.json: ${place}`, "does not follow from the readings and masses");
  if (apart.length > MOST_NAMED) add("irreproducible", "evidence.json", `and ${apart.length - MOST_NAMED} more numbers`);
  const points = tableOf(held, "points.parquet", POINT_COLUMNS, add);
  if (points && differences(points, computed.points, "points").length) add("irreproducible", "points.parquet", "does not follow from the readings");
  const report = held.has("report.html") ? reportOf(held.get("report.html")) : { facts: {}, budget: [], points: [] };
  const confidence = evidence.options.confidence_1;
  const ours = printedFacts(computed, confidence), theirs = printedFacts(stored, confidence);
  const facts = Object.keys(ours).map((name) => [name, ours[name], theirs[name], report.facts[name] ?? "not printed"]);
  for (const [name, own, , page] of facts) {
    if (own !== page) add("tampered", `report.html: ${name}`, `prints “${page}”, and the readings give “${own}”`);
  }
  const budget = computed.budget.map(({ component, u_kg }, k) => (
    [component, kilograms(u_kg, 2), kilograms(stored.budget?.[k]?.u_kg ?? null, 2), report.budget[k]?.[2] ?? "not printed"]));
  for (const [name, own, , page] of budget) {
    if (own !== page) add("tampered", `report.html: budget, ${name}`, `prints ${page}, and the readings give ${own}`);
  }
  computed.points.forEach((point, k) => {
    const own = [point.run_id, point.load_id, kilograms(point.reference_kg), String(point.readings), String(point.rejected),
      ...["mean_kg", "std_kg", "calibrated_kg"].map((name) => kilograms(point[name])),
      ...["error_kg", "error_left_out_kg"].map((name) => kilograms(point[name], 2))];
    if (own.join("|") !== (report.points[k] ?? []).join("|")) add("tampered", `report.html: point of ${point.run_id}`, "is not what the readings give");
  });
  return { computed, facts, budget };
};

const KINDS = ["tampered", "incomplete", "irreproducible", "expired"];

/** Check a bundle; key: the 32 bytes that the user gave, or null; day: YYYY-MM-DD. */
const checkBundle = async (held, key, day) => {
  const findings = [];
  const add = (kind, item, what) => findings.push({ kind, item, what });
  const files = await checkFiles(held, add);
  let evidence = null, readings = null, numbers = { none: "There are no readings to compute from." };
  if (held.has("evidence.json")) {
    try {
      evidence = parseCanonical(held.get("evidence.json"), "it");
      if (!/^payscope-calibration-evidence\/\d+$/.test(evidence?.format)) throw new Fault("is no calibration evidence of payscope");
    } catch (fault) {
      if (!(fault instanceof Fault)) throw fault;
      add("tampered", "evidence.json", fault.message);
      evidence = null;
    }
  }
  let signature;
  try {
    signature = await checkSignature(held, files.digests, evidence, key, add);
    readings = tableOf(held, "readings.parquet", READING_COLUMNS, add);
    if (evidence) {
      for (const name of ["readings", "points"]) {
        const file = `${name}.parquet`;
        if (files.digests.has(file) && files.digests.get(file) !== evidence.tables[`${name}_sha256`]) {
          add("tampered", file, "is not the table whose digest evidence.json has");
        }
      }
      if (readings) numbers = checkNumbers(held, evidence, readings, add);
      const last = evidence.campaign.runs.map((run) => run.day).sort().at(-1);
      if (evidence.kind === "calibration" && evidence.expires !== addDays(last, evidence.campaign.campaign.valid_days)) {
        add("irreproducible", "evidence.json: expires", "does not follow from the runs' days");
      }
      if (evidence.expires < day) add("expired", "evidence.json", `on ${evidence.expires}`);
    }
  } catch (fault) {
    // a stranger chose what stands in evidence.json
    add("tampered", "evidence.json", `has another form than such evidence: ${fault.message}`);
    signature ??= { trusted: false, text: "Signature not checked" };
  }
  if (findings.some(({ kind }) => kind === "tampered" || kind === "incomplete") && signature.trusted) {
    signature = { trusted: false, text: "Signature not valid for what is here" };
  }
  const worst = KINDS.find((kind) => findings.some((each) => each.kind === kind)) ?? "";
  return { worst, findings, files: files.rows, signature, evidence, numbers };
};
