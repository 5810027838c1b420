// From the campaign's masses and the readings to the points of the line: a point a run.

/** Names of masses on board by load: "a+b", "empty", as the campaign file's runs have them. */
const loadOf = (run) => (run.loads.length ? [...run.loads].sort().join("+") : "empty");

/** Reference of each load, and the covariance of their errors: what masses share, loads share. */
const referencesOf = (evidence) => {
  const { campaign } = evidence, machine = evidence.machine.machine;
  const masses = campaign.masses;
  const onBoard = new Map();
  for (const run of campaign.runs) onBoard.set(loadOf(run), run.loads);
  const loads = evidence.references.map((each) => each.load_id);
  const whole = campaign.method.estimator !== "joint_payload";
  const empty = machine.empty_mass_kg, emptyU = machine.empty_mass_u_kg;
  if (whole && (empty == null || emptyU == null)) throw new Fault("evidence.json: the empty mass is not stated");
  const has = loads.map((load) => {
    if (!onBoard.has(load)) throw new Fault(`evidence.json: reference '${load}' is of no run`);
    return masses.map((mass) => (onBoard.get(load).includes(mass.id) ? 1 : 0));
  });
  const shared = masses.map((one, k) => masses.map((other, l) => {
    if (k === l) return one.u_kg ** 2;
    return one.source && one.source === other.source ? one.shared_u_kg * other.shared_u_kg : 0;
  }));
  const values = masses.map((mass) => mass.value_kg);
  const of = has.map((row) => dot(row, values) + (whole ? empty : 0));
  const covariance = has.map((row) => has.map((other) =>
    row.reduce((sum, one, k) => sum + one * dot(shared[k], other), 0) + (whole ? emptyU ** 2 : 0)));
  return { loads, mass: of, covariance };
};

/** What of the readings contradicts the campaign: each belongs to a run, and to no other load. */
const faultsOfReadings = (evidence, readings) => {
  const runs = new Map(evidence.campaign.runs.map((run) => [run.id, run]));
  const weighs = new Map(evidence.logs.map((log) => [log.log, log.can_weigh]));
  const found = [], seen = new Map();
  for (const row of readings) {
    const at = `run '${row.run_id}', reading ${row.reading}`;
    const run = runs.get(row.run_id);
    const number = (seen.get(row.run_id) ?? 0) + 1;
    seen.set(row.run_id, number);
    if (!run) found.push(`${at} is of no run of the campaign`);
    else if (row.load_id !== loadOf(run) || row.day !== run.day || row.log !== run.log) {
      found.push(`${at} is of another load, day or log than its run`);
    }
    if (row.reading !== number) found.push(`${at} should be number ${number}`);
    if (row.used && row.reason) found.push(`${at} is used, but has a reason for its exclusion`);
    if (!row.used && !row.reason) found.push(`${at} is left out without a reason`);
    if (row.used && row.mass_kg === null) found.push(`${at} is used, but has no mass`);
    if (row.used && (run?.excluded || !weighs.get(row.log))) {
      found.push(`${at} is used, although its run is excluded or its log cannot weigh`);
    }
  }
  for (const id of runs.keys()) if (!seen.has(id)) found.push(`run '${id}' has no reading`);
  return found;
};

/** Means of the used readings of each run, in the order of the table. */
const pointsOf = (readings, references) => {
  const runs = new Map();
  for (const row of readings) {
    if (!runs.has(row.run_id)) runs.set(row.run_id, { id: row.run_id, load: row.load_id, day: row.day, masses: [], rejected: 0, common: 0 });
    const run = runs.get(row.run_id);
    if (row.used && row.mass_kg !== null) run.masses.push(row.mass_kg);
    else run.rejected += 1;
    if (row.used) run.common = Math.max(run.common, row.common_u_kg ?? 0);
  }
  const all = [...runs.values()];
  for (const run of all) {
    const place = references.loads.indexOf(run.load);
    if (place < 0) throw new Fault(`readings.parquet: no reference for load '${run.load}'`);
    run.reference = references.mass[place];
    run.mean = run.masses.length ? meanOf(run.masses) : null;
    run.squares = sumOf(run.masses.map((mass) => (mass - run.mean) ** 2));
    run.std = run.masses.length > 1 ? Math.sqrt(run.squares / (run.masses.length - 1)) : null;
  }
  const used = all.filter((run) => run.masses.length);
  const load = used.map((run) => references.loads.indexOf(run.load));
  const days = [...new Set(used.map((run) => run.day))];
  return {
    runs: all,
    used,
    load,
    day: used.map((run) => days.indexOf(run.day)),
    days: days.length,
    x: used.map((run) => run.reference),
    y: used.map((run) => run.mean),
    readings: used.map((run) => run.masses.length),
    xCovariance: load.map((k) => load.map((l) => references.covariance[k][l])),
    within: { squares: sumOf(used.map((run) => run.squares)), freedom: sumOf(used.map((run) => run.masses.length - 1)) },
    common: Math.max(0, ...all.map((run) => run.common)),
  };
};
