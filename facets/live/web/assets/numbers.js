// How numbers are written: with the digits that their uncertainty leaves, never as a guess.

export function signed(value, digits) {
  return (value < 0 ? "−" : "+") + Math.abs(value).toFixed(digits);
}

// Decimals of a value with an uncertainty: to a tenth of it.
export function decimals(u) {
  return u > 0 ? Math.min(7, Math.max(2, Math.ceil(-Math.log10(u)) + 1)) : 4;
}

export function three(value) {
  return value === 0 ? "0" : Math.abs(value) >= 1e5 || Math.abs(value) < 1e-3 ? value.toExponential(2) : value.toPrecision(3);
}

// An uncertainty in mm or mrad, in the unit in which it is a handy number.
export function fine(u, unit) {
  const [micro, nano] = unit === "mrad" ? ["µrad", "nrad"] : ["µm", "nm"];
  if (u >= 1) return `${three(u)} ${unit}`;
  return u >= 1e-4 ? `${three(1e3 * u)} ${micro}` : `${three(1e6 * u)} ${nano}`;
}

export function seconds(t) {
  if (t === null || t === undefined) return "time unknown";
  if (t < 600) return `${t.toFixed(3)} s`;
  const h = Math.floor(t / 3600), m = Math.floor((t % 3600) / 60);
  return `${h}:${String(m).padStart(2, "0")}:${(t % 60).toFixed(2).padStart(5, "0")}`;
}

export function utc(s) {
  return s === null || s === undefined ? "UTC not known" : new Date(1000 * s).toISOString().replace("T", " ").replace("Z", " UTC");
}

export function grouped(n) {
  return String(n).replace(/\B(?=(\d{3})+(?!\d))/g, " ");
}
