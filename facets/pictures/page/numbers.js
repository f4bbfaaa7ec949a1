// The elementary functions that the generated texts call, and mathematics that JavaScript lacks.

const {exp, sqrt, log, sin, cos, atan2, abs: fabs} = Math;

// erf and erfc to some units of the last place: a series of positive terms near zero, a continued
// fraction in the tail.
function erf(x) {
  if (Math.abs(x) > 1) return x > 0 ? 1 - erfc(x) : erfc(-x) - 1;
  let term = x, sum = x;
  for (let n = 1; Math.abs(term) > 1e-18 * Math.abs(sum); n++) {
    term *= 2 * x * x / (2 * n + 1);
    sum += term;
  }
  return 2 / Math.sqrt(Math.PI) * Math.exp(-x * x) * sum;
}

function erfc(x) {
  if (!(x > 1)) return x < -1 ? 2 - erfc(-x) : 1 - erf(x);
  if (x > 27) return 0;
  let fraction = x;
  for (let n = 120; n > 0; n--) fraction = x + n / 2 / fraction;
  return gauss(x) / Math.sqrt(Math.PI) / fraction;
}

// exp(-x^2) without the rounding of the square: x is taken apart into a short number and a rest.
function gauss(x) {
  const short = Math.fround(x), rest = x - short;
  return Math.exp(-short * short) * Math.exp(-rest * (short + x));
}

function range(count) { return Array.from({length: count}, (_, n) => n); }

// Of a matrix, row by row: its singular values, and the roots of the sums of squares of the rows of
// its pseudo-inverse. One-sided Jacobi rotations make its columns orthogonal.
function decompose(rows) {
  const count = rows[0].length, columns = range(count).map((c) => rows.map((row) => row[c]));
  const turns = range(count).map((c) => range(count).map((r) => (r === c ? 1 : 0)));
  const dot = (a, b) => {
    let sum = 0;
    for (let n = 0; n < a.length; n++) sum += a[n] * b[n];
    return sum;
  };
  for (let sweep = 0, large = true; large && sweep < 60; sweep++) {
    large = false;
    for (let i = 0; i < count; i++) {
      for (let j = i + 1; j < count; j++) {
        const [a, b, c] = [dot(columns[i], columns[i]), dot(columns[j], columns[j]), dot(columns[i], columns[j])];
        if (!(Math.abs(c) > 1e-15 * Math.sqrt(a * b))) continue;
        large = true;
        const z = (b - a) / (2 * c), t = (z < 0 ? -1 : 1) / (Math.abs(z) + Math.hypot(1, z));
        const cosine = 1 / Math.hypot(1, t), sine = cosine * t;
        for (const [x, y] of [[columns[i], columns[j]], [turns[i], turns[j]]]) {
          for (let n = 0; n < x.length; n++) {
            [x[n], y[n]] = [cosine * x[n] - sine * y[n], sine * x[n] + cosine * y[n]];
          }
        }
      }
    }
  }
  const singular = columns.map((column) => Math.sqrt(dot(column, column)));
  return {
    singular, deviations: range(count).map((r) => Math.hypot(...turns.map((turn, n) => turn[r] / singular[n]))),
  };
}
