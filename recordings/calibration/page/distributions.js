// Student's t and Fisher's F, by the regularised incomplete beta function.

/** ln Γ(x) for x > 0: Stirling's series, from 15 on. */
const logGamma = (x) => {
  let shift = 0;
  while (x < 15) {
    shift -= Math.log(x);
    x += 1;
  }
  const z = 1 / (x * x);
  const series = (1 / 12 - z * (1 / 360 - z * (1 / 1260 - z * (1 / 1680 - z * (1 / 1188 - z * 691 / 360360))))) / x;
  return shift + (x - 0.5) * Math.log(x) - x + 0.5 * Math.log(2 * Math.PI) + series;
};

/** I_x(a, b) with y = 1 - x given as well: near 1 it has the digits that 1 - x would lose. */
const incompleteBeta = (a, b, x, y = 1 - x) => {
  if (x <= 0) return 0;
  if (y <= 0) return 1;
  if (x > (a + 1) / (a + b + 2)) return 1 - incompleteBeta(b, a, y, x);
  const front = Math.exp(logGamma(a + b) - logGamma(a) - logGamma(b) + a * Math.log(x) + b * Math.log(y)) / a;
  // the continued fraction, by Lentz's method
  const tiny = 1e-300;
  const away = (value) => (Math.abs(value) < tiny ? tiny : value);
  let c = 1, d = 1 / away(1 - ((a + b) * x) / (a + 1)), f = d;
  for (let m = 1; m < 10000; m += 1) {
    const even = (m * (b - m) * x) / ((a + 2 * m - 1) * (a + 2 * m));
    d = 1 / away(1 + even * d);
    c = away(1 + even / c);
    f *= d * c;
    const odd = (-(a + m) * (a + b + m) * x) / ((a + 2 * m) * (a + 2 * m + 1));
    d = 1 / away(1 + odd * d);
    c = away(1 + odd / c);
    f *= d * c;
    if (Math.abs(d * c - 1) < 1e-16) break;
  }
  return front * f;
};

/** Probability of a ratio of mean squares above this one. */
const beyondF = (above, below, ratio) => {
  const whole = below + above * ratio;
  return incompleteBeta(below / 2, above / 2, below / whole, (above * ratio) / whole);
};

/** Probability of a Student's t above t ≥ 0. */
const beyondT = (freedom, t) => 0.5 * incompleteBeta(freedom / 2, 0.5, freedom / (freedom + t * t), (t * t) / (freedom + t * t));

/** Probability of a normal deviate above z ≥ 0, by the series of its integral. */
const beyondNormal = (z) => {
  let term = z, sum = z;
  for (let k = 3; term > 1e-18 * sum && k < 2000; k += 2) sum += (term *= (z * z) / k);
  return 0.5 - (sum * Math.exp((-z * z) / 2)) / Math.sqrt(2 * Math.PI);
};

/** Factor of a two-sided interval, by bisection: Student's, or with infinite freedom the normal one. */
const studentFactor = (confidence, freedom) => {
  const tail = (1 - confidence) / 2;
  const beyond = Number.isFinite(freedom) ? (t) => beyondT(freedom, t) : beyondNormal;
  let low = 0, high = 1;
  while (beyond(high) > tail && high < 1e300) high *= 2;
  for (let step = 0; step < 200 && high - low > 1e-15 * high; step += 1) {
    const middle = (low + high) / 2;
    if (beyond(middle) > tail) low = middle;
    else high = middle;
  }
  return (low + high) / 2;
};
