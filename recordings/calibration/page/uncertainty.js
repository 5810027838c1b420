// What a line is worth: intervals of α and β (Fieller), the expanded uncertainty of a calibrated
// mass, and its budget (JCGM 100). Student factors by Welch and Satterthwaite.

/** Variance of a sum of effects with these weights, times its Student factors squared. */
const expandedVariance = (line, weights, more, confidence) => {
  const apart = line.effects.map((effect) =>
    effect.name === DAY && line.fewDays !== null && effect.variance > 0);
  const rest = weights.map((weight, k) => (apart[k] ? 0 : weight));
  const total = sumOf(rest.map((weight, k) => weight * line.effects[k].variance)) + more;
  const estimated = rest.filter((_, k) => line.effects[k].estimated);
  const uncertain = estimated.length ? dot(estimated, apply(line.variances.covariance, estimated)) : 0;
  const freedom = uncertain > 0 ? Math.max((2 * total ** 2) / uncertain, 1) : Infinity;
  const common = studentFactor(confidence, freedom) ** 2;
  const few = apart.some(Boolean) ? studentFactor(confidence, line.fewDays) ** 2 : 0;
  return { squared: apart.map((own) => (own ? few : common)), ofMore: common };
};

/** Weights of the effects in a later mean of so many readings. */
const newWeights = (line, readings) => {
  const run = line.effects.find((effect) => effect.name === RUN) ?? line.effects[0];
  const count = run.variance < 0 ? Math.min(readings, line.mostReadings) : readings;
  return line.effects.map((effect) => {
    if (!effect.scatters) return 0;
    return effect.name === REPEATABILITY ? 1 / count : 1;
  });
};

const atDistance = (onLine, h) => onLine[0][0] + 2 * h * onLine[0][1] + h * h * onLine[1][1];

/** Standard uncertainty and half of the interval of a calibrated mass, in kg of mass. */
const massUncertainty = (line, mass, readings, extra, confidence) => {
  const anew = newWeights(line, readings);
  const weights = line.effects.map((effect, k) => anew[k] + atDistance(effect.onLine, mass - line.centre));
  const { squared, ofMore } = expandedVariance(line, weights, extra, confidence);
  const sum = (factors) => sumOf(weights.map((weight, k) => factors[k] * weight * line.effects[k].variance));
  const size = Math.abs(line.slope);
  return {
    u: Math.sqrt(sum(weights.map(() => 1)) + extra) / size,
    half: Math.sqrt(sum(squared) + ofMore * extra) / size,
  };
};

const alphaInterval = (line, confidence) => {
  const weights = line.effects.map((effect) => effect.onLine[1][1]);
  const { squared } = expandedVariance(line, weights, 0, confidence);
  const half = Math.sqrt(sumOf(weights.map((weight, k) => squared[k] * weight * line.effects[k].variance)));
  const low = line.slope - half, high = line.slope + half;
  return low * high > 0 ? [1 / high, 1 / low] : [null, null];
};

/** The mass at which the line is 0 is β: where (d - s h)² is below its expanded variance. */
const betaInterval = (line, confidence) => {
  const away = -line.level / line.slope;
  const weights = line.effects.map((effect) => atDistance(effect.onLine, away));
  const { squared } = expandedVariance(line, weights, 0, confidence);
  const part = (k, l) => sumOf(line.effects.map((e, at) => squared[at] * e.variance * e.onLine[k][l]));
  const a = line.slope ** 2 - part(1, 1), b = -line.level * line.slope + part(0, 1), c = line.level ** 2 - part(0, 0);
  if (!(a > 0)) return [null, null];
  const half = Math.sqrt(Math.max(b * b - a * c, 0)) / a;
  return [line.centre + b / a - half, line.centre + b / a + half];
};

/** Components of the uncertainty of a calibrated mass: [name, u in kg of mass or null]. */
const budgetOf = (line, mass, readings, common, stated) => {
  const size = Math.abs(line.slope), effects = line.effects;
  const parts = newWeights(line, readings).map((weight, k) => (weight * effects[k].variance) / line.slope ** 2);
  const place = (name) => effects.findIndex((effect) => effect.name === name);
  // what days or runs scatter too little is taken off the next finer
  for (const [coarse, fine] of [[DAY, RUN], [RUN, REPEATABILITY]]) {
    if (place(coarse) >= 0 && place(fine) >= 0) {
      const over = Math.min(parts[place(coarse)], 0);
      parts[place(coarse)] -= over;
      parts[place(fine)] += over;
    }
  }
  const rows = effects.flatMap((effect, k) => (effect.scatters ? [[effect.name, Math.sqrt(Math.max(parts[k], 0))]] : []));
  if (place(DAY) < 0) rows.push([DAY, null]);
  if (place(LACK_OF_FIT) < 0) rows.push([LACK_OF_FIT, 0]);
  const sum = (scatters) => combined(
    effects.map((effect) => (effect.scatters === scatters ? effect.variance : 0)), effects.map((e) => e.onLine), 2);
  const own = sum(true), h = mass - line.centre;
  const across = own[1][1] > 0 ? own[0][1] / own[1][1] : 0;
  rows.push(["level", Math.sqrt(Math.max(own[0][0] - across * own[0][1], 0)) / size]);
  rows.push(["slope", Math.sqrt(own[1][1] * (h + across) ** 2) / size]);
  rows.push([REFERENCES, Math.sqrt(Math.max(atDistance(sum(false), h), 0)) / size]);
  rows.push(["common error", common === null ? 0 : common / size]);
  for (const one of stated) {
    rows.push([one.component, one.absorbed ? 0 : one.u_kg === null ? null : one.u_kg / size]);
  }
  for (const name of ["wheel radius", "force share", "local gravity", "tare"]) {
    if (!stated.some((one) => one.component === name)) rows.push([name, null]);
  }
  return rows;
};

const rootMeanSquare = (values) => Math.sqrt(meanOf(values.map((value) => value ** 2)));

/** Error of each run under the line through the other loads; null where they give none. */
const errorsLeftOut = (points, line) => {
  const whole = minus(line.pointCovariance, scaled(line.slope ** 2, points.xCovariance));
  const found = points.y.map(() => null);
  for (const load of new Set(points.load)) {
    const rest = points.load.flatMap((other, k) => (other === load ? [] : [k]));
    if (new Set(rest.map((k) => points.x[k])).size < 2) continue;
    const part = (matrix) => rest.map((k) => rest.map((l) => matrix[k][l]));
    const other = distanceRegression(rest.map((k) => points.x[k]), rest.map((k) => points.y[k]), part(points.xCovariance), part(whole));
    points.load.forEach((own, k) => {
      if (own === load && other.slope) found[k] = (points.y[k] - other.intercept) / other.slope - points.x[k];
    });
  }
  return found;
};

/** Everything of a calibration that follows from its readings, named as evidence.json names it. */
const calibrationOf = (evidence, readings) => {
  const references = referencesOf(evidence);
  const points = pointsOf(readings, references);
  const options = evidence.options, confidence = options.confidence_1;
  const line = fitLine(points, options.day_known_kg);
  const common = options.day_known_kg === null && points.days === 1 ? points.common : null;
  const anew = options.stated.filter((one) => !one.absorbed && one.u_kg !== null);
  const extra = (common ?? 0) ** 2 + sumOf(anew.map((one) => one.u_kg ** 2));
  const low = Math.min(...points.x), high = Math.max(...points.x);
  const margin = options.margin_1 * (high - low);
  const sorted = [...points.readings].sort((a, b) => a - b), half = sorted.length / 2;
  const median = Math.trunc((sorted[Math.ceil(half) - 1] + sorted[Math.floor(half)]) / 2);
  const at = [high + margin, median];
  const worth = massUncertainty(line, ...at, extra, confidence);
  const c0 = line.level - line.slope * line.centre;
  const onLine = combined(line.effects.map((e) => e.variance), line.effects.map((e) => e.onLine), 2);
  const shift = [[1, -line.centre], [0, 1]];
  const covariance = times(times(shift, onLine), transposed(shift));
  const std = (name) => { const e = line.effects.find((each) => each.name === name); return e ? Math.sqrt(Math.max(e.variance, 0)) : null; };
  const calibrated = points.y.map((y) => (y - line.level) / line.slope + line.centre);
  const errors = calibrated.map((mass, k) => mass - points.x[k]), leftOut = errorsLeftOut(points, line);
  const known = leftOut.filter((each) => each !== null);
  return {
    alpha_1: 1 / line.slope,
    alpha_interval_1: alphaInterval(line, confidence),
    beta_kg: -c0 / line.slope,
    beta_interval_kg: betaInterval(line, confidence),
    c0_kg: c0,
    c1_1: line.slope,
    covariance: [covariance[0][0], covariance[0][1], covariance[1][1]],
    chi2_1: line.chi2,
    freedom: line.freedom,
    repeatability_kg: std(REPEATABILITY),
    run_kg: std(RUN),
    day_kg: std(DAY),
    lack_of_fit: { F_1: line.test.F, p_1: line.test.p },
    range_kg: [low - margin, high + margin],
    budget: budgetOf(line, ...at, common, options.stated).map(([component, u_kg]) => ({ component, u_kg })),
    budget_at: at,
    coverage_k_1: worth.half / worth.u,
    u_kg: worth.u,
    rms_error_kg: rootMeanSquare(errors),
    rms_error_left_out_kg: known.length ? rootMeanSquare(known) : null,
    points: points.runs.map((run) => {
      const k = points.used.indexOf(run);
      return {
        run_id: run.id, load_id: run.load, reference_kg: run.reference, readings: run.masses.length,
        rejected: run.rejected, mean_kg: run.mean, std_kg: run.std, calibrated_kg: calibrated[k] ?? null,
        error_kg: errors[k] ?? null, error_left_out_kg: leftOut[k] ?? null,
      };
    }),
  };
};
