// Small dense matrices as arrays of rows: those of a line through some tens of points.

const zeros = (rows, columns) => Array.from({ length: rows }, () => new Array(columns).fill(0));
const diagonal = (values) => values.map((value, k) => values.map((_, l) => (k === l ? value : 0)));
const identity = (size) => diagonal(new Array(size).fill(1));
const transposed = (a) => a[0].map((_, k) => a.map((row) => row[k]));
const dot = (a, b) => a.reduce((sum, value, k) => sum + value * b[k], 0);
const times = (a, b) => { const columns = transposed(b); return a.map((row) => columns.map((column) => dot(row, column))); };
const apply = (a, vector) => a.map((row) => dot(row, vector));
const plus = (a, b) => a.map((row, k) => row.map((value, l) => value + b[k][l]));
const minus = (a, b) => a.map((row, k) => row.map((value, l) => value - b[k][l]));
const scaled = (factor, a) => a.map((row) => row.map((value) => factor * value));
const trace = (a) => a.reduce((sum, row, k) => sum + row[k], 0);
const sumOf = (values) => values.reduce((sum, value) => sum + value, 0);
const meanOf = (values) => sumOf(values) / values.length;
/** Σ factor_k matrix_k. */
const combined = (factors, matrices, size) =>
  matrices.reduce((sum, matrix, k) => plus(sum, scaled(factors[k], matrix)), zeros(size, size));

/** The solution of a x = b for each column of b, by elimination with row pivots; null if singular. */
const solved = (a, b) => {
  const size = a.length;
  const rows = a.map((row, k) => [...row, ...b[k]]);
  for (let k = 0; k < size; k += 1) {
    let pivot = k;
    for (let r = k + 1; r < size; r += 1) if (Math.abs(rows[r][k]) > Math.abs(rows[pivot][k])) pivot = r;
    if (!(Math.abs(rows[pivot][k]) > 0)) return null;
    [rows[k], rows[pivot]] = [rows[pivot], rows[k]];
    for (let r = k + 1; r < size; r += 1) {
      const factor = rows[r][k] / rows[k][k];
      for (let c = k; c < rows[r].length; c += 1) rows[r][c] -= factor * rows[k][c];
    }
  }
  for (let k = size - 1; k >= 0; k -= 1) {
    for (let c = size; c < rows[k].length; c += 1) {
      for (let r = k + 1; r < size; r += 1) rows[k][c] -= rows[k][r] * rows[r][c];
      rows[k][c] /= rows[k][k];
    }
  }
  return rows.map((row) => row.slice(size));
};

const inverse = (a) => {
  const found = solved(a, identity(a.length));
  if (found === null || !found.flat().every(Number.isFinite)) throw new Fault("a covariance cannot be inverted");
  return found;
};

/** Whether a symmetric matrix is positive definite (Cholesky). */
const isPositive = (a) => {
  const lower = zeros(a.length, a.length);
  for (let k = 0; k < a.length; k += 1) {
    for (let l = 0; l <= k; l += 1) {
      const left = a[k][l] - dot(lower[k].slice(0, l), lower[l].slice(0, l));
      if (k !== l) lower[k][l] = left / lower[l][l];
      else if (left > 0) lower[k][k] = Math.sqrt(left);
      else return false;
    }
  }
  return true;
};

/** Pseudo-inverse of a small symmetric matrix, by its eigenvectors (Jacobi rotations). */
const pseudoInverse = (a) => {
  const size = a.length;
  let rest = a, vectors = identity(size);
  for (let sweep = 0; sweep < 60; sweep += 1) {
    for (let p = 0; p < size; p += 1) {
      for (let q = p + 1; q < size; q += 1) {
        if (rest[p][q] === 0) continue;
        const theta = (rest[q][q] - rest[p][p]) / (2 * rest[p][q]);
        const t = (theta < 0 ? -1 : 1) / (Math.abs(theta) + Math.hypot(theta, 1));
        const c = 1 / Math.hypot(t, 1);
        const turn = identity(size);
        turn[p][p] = turn[q][q] = c;
        turn[p][q] = t * c;
        turn[q][p] = -t * c;
        rest = times(times(transposed(turn), rest), turn);
        rest[p][q] = rest[q][p] = 0;
        vectors = times(vectors, turn);
      }
    }
  }
  const most = Math.max(...rest.map((row, k) => Math.abs(row[k])));
  const turned = rest.map((row, k) => (Math.abs(row[k]) > 1e-15 * most ? 1 / row[k] : 0));
  return times(times(vectors, diagonal(turned)), transposed(vectors));
};
