// Numbers that carry their derivatives by several variables, as facets.scalars.dual: for texts that
// javascript.py writes with `carrying`. A slope is a list of numbers, or the number 0.

class Dual {
  constructor(real, imag) {
    this.real = real;
    this.imag = imag;
  }
}
const realOf = (x) => (x instanceof Dual ? x.real : x);
const imagOf = (x) => (x instanceof Dual ? x.imag : 0);
const valueAndSlope = (x) => [realOf(x), imagOf(x)];

// A function of two numbers, over the elements of slopes too.
function each(formula, a, b) {
  if (Array.isArray(a)) return a.map((x, n) => formula(x, Array.isArray(b) ? b[n] : b));
  return Array.isArray(b) ? b.map((x) => formula(a, x)) : formula(a, b);
}
const add = (a, b) => each((x, y) => x + y, a, b);
const multiply = (a, b) => each((x, y) => x * y, a, b);
const areDual = (a, b) => a instanceof Dual || b instanceof Dual;

function plus(a, b) {
  return areDual(a, b) ? new Dual(realOf(a) + realOf(b), add(imagOf(a), imagOf(b))) : add(a, b);
}

function negative(a) { return times(-1, a); }
function minus(a, b) { return plus(a, negative(b)); }

function times(a, b) {
  if (!areDual(a, b)) return multiply(a, b);
  const [x, y] = [realOf(a), realOf(b)];
  return new Dual(x * y, add(multiply(imagOf(b), x), multiply(imagOf(a), y)));
}

function over(a, b) {
  if (!areDual(a, b)) return multiply(a, 1 / b);
  const inverse = 1 / realOf(b), value = realOf(a) * inverse;
  return new Dual(value, multiply(add(imagOf(a), multiply(imagOf(b), -value)), inverse));
}

// A function of one number, from its value and its derivative there.
function chain(x, value, slope) {
  return x instanceof Dual ? new Dual(value, multiply(x.imag, slope)) : value;
}

function carriedSqrt(x) {
  const root = Math.sqrt(realOf(x));
  return chain(x, root, 1 / (2 * root));
}
function carriedLog(x) { return chain(x, Math.log(realOf(x)), 1 / realOf(x)); }
function carriedSin(x) { return chain(x, Math.sin(realOf(x)), Math.cos(realOf(x))); }
function carriedCos(x) { return chain(x, Math.cos(realOf(x)), -Math.sin(realOf(x))); }

function carriedAtan2(y, x) {
  const [up, ofUp] = valueAndSlope(y), [right, ofRight] = valueAndSlope(x);
  const inverse = 1 / (right * right + up * up);
  const slope = multiply(add(multiply(ofUp, right), multiply(ofRight, -up)), inverse);
  return new Dual(Math.atan2(up, right), slope);
}

function carriedLarger(a, b) { return realOf(a) > realOf(b) ? a : b; }
function carriedDefined(value, a, b, c) {
  return realOf(a) > 0 && realOf(b) > 0 && realOf(c) > 0 ? value : times(value, NaN);
}
