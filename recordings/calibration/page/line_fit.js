// The line of a calibration, estimate = level + slope (mass - centre), through the means of runs,
// with every effect that scatters them. Masses and estimates in kg, variances in kg².
// Sources: ISO/TS 28037:2010 (errors in both variables), Patterson and Thompson 1971 (REML).

const REPEATABILITY = "repeatability", RUN = "run to run", DAY = "day to day";
const LACK_OF_FIT = "lack of fit", REFERENCES = "references";
/** Of the largest estimate: a variance of rounding, so that exact points have one at all. */
const ROUNDING_SHARE = 1e-10;
/** A ratio less likely than this is taken for a lack of fit. */
const LACK_LEVEL = 0.05;
/** With fewer days their scatter has a Student factor of its own. */
const DAYS_ENOUGH = 5;

/** Straight line with errors in both variables, of any covariance: Gauss-Newton to the best one. */
const distanceRegression = (xs, ys, xCovariance, yCovariance) => {
  const x0 = meanOf(xs), y0 = meanOf(ys);
  const spread = Math.max(...xs) - Math.min(...xs);
  if (!(spread > 0)) throw new Fault("the points have one mass only");
  const unit = 16 * Number.EPSILON * Math.max(...ys.map(Math.abs));
  const rounding = [unit, unit / spread];
  const x = xs.map((value) => value - x0), y = ys.map((value) => value - y0);
  let slope = dot(x, y) / dot(x, x), level = 0;
  for (let round = 0; round < 100; round += 1) {
    const left = y.map((value, k) => value - level - slope * x[k]);
    const whole = plus(yCovariance, scaled(slope ** 2, xCovariance));
    if (!isPositive(whole)) throw new Fault("a covariance is not positive definite");
    const weight = inverse(whole);
    const pull = apply(xCovariance, apply(weight, left));
    const adjusted = x.map((value, k) => value + slope * pull[k]);
    const design = adjusted.map((value) => [1, value]);
    const weighted = times(weight, design);
    const covariance = inverse(times(transposed(design), weighted));
    const step = apply(covariance, apply(transposed(weighted), left));
    level += step[0];
    slope += step[1];
    if (step.every((part, k) => Math.abs(part) <= Math.max(1e-8 * Math.sqrt(covariance[k][k]), rounding[k]))) {
      const rest = y.map((value, k) => value - level - slope * x[k]);
      const shift = [[1, -x0], [0, 1]];
      return {
        intercept: y0 + level - slope * x0,
        slope,
        covariance: times(times(shift, covariance), transposed(shift)),
        chi2: dot(rest, apply(weight, rest)),
        adjusted: adjusted.map((value) => value + x0),
        residual: rest,
      };
    }
  }
  throw new Fault("the fit does not settle");
};

/** Variances of random effects by restricted maximum likelihood, by Fisher's scoring. */
const restrictedLikelihood = (observed, design, effects, known, within, start) => {
  const size = observed.length;
  let value = start ?? firstVariances(observed, design, effects, within);
  const floor = 1e-6 * Math.max(...value, Math.min(...known.map((row, k) => row[k])));
  value = value.map((each) => Math.max(each, floor));
  let information = identity(value.length);
  for (let round = 0; round < 60; round += 1) {
    const weight = inverse(plus(combined(value, effects, size), known));
    const weighted = times(weight, design);
    const taken = times(times(weighted, inverse(times(transposed(design), weighted))), transposed(weighted));
    const projection = minus(weight, taken);
    const projected = apply(projection, observed);
    const through = effects.map((effect) => times(projection, effect));
    const score = effects.map((effect, k) => 0.5 * (dot(projected, apply(effect, projected)) - trace(through[k])));
    information = through.map((one) => through.map((other) => 0.5 * trace(times(one, other))));
    if (within.freedom) {
      score[0] += (0.5 * (within.squares / value[0] - within.freedom)) / value[0];
      information[0][0] += (0.5 * within.freedom) / value[0] ** 2;
    }
    const column = score.map((each) => [each]);
    const step = solved(information, column) ?? times(pseudoInverse(information), column);
    const stepped = value.map((each, k) => Math.max(each + step[k][0], 0.1 * each, floor));
    const moved = Math.max(...stepped.map((each, k) => Math.abs(each - value[k])));
    value = stepped;
    if (moved <= 1e-7 * Math.max(sumOf(value), 1e-300)) break;
  }
  return { value, covariance: pseudoInverse(information) };
};

/** To begin with: equal parts of what plain least squares leaves; the readings' own as they say it. */
const firstVariances = (observed, design, effects, within) => {
  const normal = times(transposed(design), design);
  const theta = apply(inverse(normal), apply(transposed(design), observed));
  const left = observed.map((value, k) => value - dot(design[k], theta));
  const spread = Math.max(dot(left, left) / Math.max(observed.length - theta.length, 1), 1e-300);
  const value = effects.map(() => spread / effects.length);
  if (within.freedom) value[0] = Math.max(within.squares / within.freedom, 1e-300);
  return value;
};

/** Covariance of the points for a variance of 1 of an effect. */
const effectOf = (points, name) => {
  if (name === REPEATABILITY) return diagonal(points.readings.map((count) => 1 / count));
  if (name === RUN) return identity(points.y.length);
  const group = name === DAY ? points.day : points.load;
  return group.map((one) => group.map((other) => (one === other ? 1 : 0)));
};

/** The effects whose variance the points can tell, with so many parameters fitted to them. */
const effectNames = (points, parameters, dayKnown) => {
  const names = [], count = points.y.length;
  if (points.within.freedom) names.push(REPEATABILITY);
  if (count > parameters) {
    names.push(RUN);
    if (points.days > 1 && points.days < count && dayKnown === null && count - parameters - (points.days - 1) > 0) {
      names.push(DAY);
    }
  }
  return names;
};

/** How the effects scatter the points; variances are estimated as mean squares, which are positive. */
const scatterOf = (points, names, dayKnown) => {
  const size = points.y.length, squares = identity(names.length);
  const place = (name) => names.indexOf(name);
  if (names.includes(REPEATABILITY) && names.includes(RUN)) {
    squares[place(RUN)][place(REPEATABILITY)] = -1 / Math.max(...points.readings);
  }
  if (names.includes(DAY)) {
    const counts = points.day.map((day) => points.day.filter((other) => other === day).length);
    squares[place(DAY)][place(RUN)] = -1 / Math.max(...counts);
  }
  const each = names.map((name) => effectOf(points, name));
  const tiny = (ROUNDING_SHARE * Math.max(...points.y.map(Math.abs))) ** 2;
  const day = effectOf(points, DAY);
  let known = scaled(tiny, identity(size));
  if (dayKnown !== null) known = plus(known, scaled(dayKnown ** 2, day));
  const bySquares = transposed(squares).map((row) => combined(row, each, size));
  const covariance = (variances) => plus(combined(variances, each, size), known);
  const estimated = (residual, design, more, start) => {
    const found = restrictedLikelihood(residual, design, bySquares, plus(known, more), points.within, start);
    return {
      start: found.value,
      value: apply(squares, found.value),
      covariance: times(times(squares, found.covariance), transposed(squares)),
    };
  };
  return { names, each, day, known, covariance, estimated };
};

/** F test of the loads' means about the line, against the scatter of runs with one load. */
const lackOfFit = (points, dayKnown) => {
  const loads = [...new Set(points.load)].sort((a, b) => a - b);
  const design = points.load.map((load) => loads.map((other) => (load === other ? 1 : 0)));
  const names = effectNames(points, loads.length, dayKnown);
  const above = loads.length - 2;
  const separate = names.includes(RUN);
  const below = separate
    ? points.y.length - loads.length - (names.includes(DAY) ? points.days - 1 : 0)
    : points.within.freedom;
  if (above < 1 || below < 1 || !names.length) return { F: null, p: null, separate: false };
  const scatter = scatterOf(points, names, dayKnown);
  const none = zeros(points.y.length, points.y.length);
  const yCovariance = scatter.covariance(scatter.estimated(points.y, design, none).value);
  const line = distanceRegression(points.x, points.y, points.xCovariance, yCovariance);
  const weight = inverse(plus(yCovariance, scaled(line.slope ** 2, points.xCovariance)));
  const normal = times(times(transposed(design), weight), design);
  const means = apply(inverse(normal), apply(transposed(design), apply(weight, points.y)));
  const left = points.y.map((value, k) => value - dot(design[k], means));
  const ratio = Math.max(line.chi2 - dot(left, apply(weight, left)), 0) / above;
  return { F: ratio, p: beyondF(above, below, ratio), separate };
};

/** Line and variances together, with what each effect gives the line's level and slope. */
const fitLine = (points, dayKnown) => {
  if (new Set(points.x).size < 3) throw new Fault("the readings are of fewer than three different loads");
  const test = lackOfFit(points, dayKnown);
  const lacking = test.separate && test.p !== null && test.p < LACK_LEVEL;
  const names = effectNames(points, 2, dayKnown);
  const scatter = scatterOf(points, lacking ? [...names, LACK_OF_FIT] : names, dayKnown);
  const centre = meanOf(points.x), away = points.x.map((x) => x - centre);
  const exact = points.xCovariance.flat().every((value) => value === 0);
  const yMean = meanOf(points.y);
  let slope = dot(away, points.y.map((y) => y - yMean)) / dot(away, away);
  let design = away.map((x) => [1, x]), residual = points.y, variances, line, start;
  for (let round = 1; ; round += 1) {
    variances = scatter.estimated(residual, design, scaled(slope ** 2, points.xCovariance), start);
    start = variances.start;
    line = distanceRegression(away, points.y, points.xCovariance, scatter.covariance(variances.value));
    const moved = Math.abs(line.slope - slope);
    slope = line.slope;
    design = line.adjusted.map((x) => [1, x]);
    residual = line.residual;
    if (moved <= 1e-4 * Math.sqrt(line.covariance[1][1]) || round === 20 || exact) break;
  }
  if (slope === 0) throw new Fault("the estimates do not follow the loads");
  const whole = plus(scatter.covariance(variances.value), scaled(slope ** 2, points.xCovariance));
  const weighted = transposed(solved(whole, design));
  const gain = solved(times(weighted, design), weighted);
  const onLine = (matrix) => times(times(gain, matrix), transposed(gain));
  const effects = scatter.names.map((name, k) => (
    { name, variance: variances.value[k], onLine: onLine(scatter.each[k]), estimated: true, scatters: true }));
  if (dayKnown !== null) {
    effects.push({ name: DAY, variance: dayKnown ** 2, onLine: onLine(scatter.day), estimated: false, scatters: true });
  }
  const ofReferences = onLine(scaled(slope ** 2, points.xCovariance));
  effects.push({ name: REFERENCES, variance: 1, onLine: ofReferences, estimated: false, scatters: false });
  return {
    centre, slope, effects, test,
    level: line.intercept,
    variances,
    chi2: line.chi2,
    freedom: points.y.length - 2,
    pointCovariance: whole,
    fewDays: names.includes(DAY) && points.days < DAYS_ENOUGH ? points.days - 1 : null,
    mostReadings: Math.max(...points.readings),
  };
};
