// How numbers are written on every page: with a true minus sign, with the digits that they deserve,
// and with powers of ten as a person writes them.

const Digits = (() => {
  // A place below this is the rounding of lengths of some hundred mm.
  const PICOMETRE_MM = 1e-9;

  function minus(text) {
    return (Number(text) === 0 ? text.replace("-", "") : text).replace(/-/g, "\u2212");
  }

  // 6.2 × 10⁻¹⁷
  function powerOfTen(value, places = 1) {
    const [number, exponent] = value.toExponential(places).split("e");
    const raised = [...String(+exponent)].map((sign) => sign === "-" ? "\u207b" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[+sign]);
    return `${number.replace("-", "\u2212")} × 10${raised.join("")}`;
  }

  // With this number of decimals. What is below `nothing` is zero; what is not zero never looks like it.
  function fixed(value, places, nothing = 0) {
    if (Math.abs(value) < nothing) value = 0;
    if (value !== 0 && Math.abs(value) < 0.5 * 10 ** -places) return powerOfTen(value);
    return minus(value.toFixed(places));
  }

  // A place or a pose: a number below a picometre is zero, and no more digits than mean something.
  function short(value, places = 4) {
    return fixed(value, places, PICOMETRE_MM).replace(/(\.\d*?)0+$/, "$1").replace(/\.$/, "");
  }

  function signed(value, places) {
    const text = minus(value.toFixed(places));
    return Number(text) > 0 ? `+${text}` : text;
  }

  // Decimals of a value with an uncertainty: to a tenth of it.
  function decimals(u) {
    return u > 0 ? Math.min(7, Math.max(2, Math.ceil(-Math.log10(u)) + 1)) : 4;
  }

  // Three digits.
  function three(value) {
    if (value === 0) return "0";
    const size = Math.abs(value);
    return size >= 1e5 || size < 1e-3 ? powerOfTen(value, 2) : minus(value.toPrecision(3));
  }

  // An uncertainty in mm or mrad, in the unit in which it is a handy number.
  function fine(u, unit) {
    const [micro, nano] = unit === "mrad" ? ["µrad", "nrad"] : ["µm", "nm"];
    if (u >= 1) return `${three(u)} ${unit}`;
    return u >= 1e-4 ? `${three(1e3 * u)} ${micro}` : `${three(1e6 * u)} ${nano}`;
  }

  function seconds(t) {
    if (t === null || t === undefined) return "time unknown";
    if (t < 600) return `${fixed(t, 3, 5e-4)} s`;
    const h = Math.floor(t / 3600), m = Math.floor((t % 3600) / 60);
    return `${h}:${String(m).padStart(2, "0")}:${(t % 60).toFixed(2).padStart(5, "0")}`;
  }

  function utc(s) {
    if (s === null || s === undefined) return "UTC not known";
    return new Date(1000 * s).toISOString().replace("T", " ").replace("Z", " UTC");
  }

  // 1 234 567
  function grouped(n) {
    return minus(String(n).replace(/\B(?=(\d{3})+(?!\d))/g, "\u202f"));
  }

  // A count, or a number of four digits.
  function written(value) {
    if (Number.isInteger(value)) return grouped(value);
    return Math.abs(value) >= 1000 ? grouped(Math.round(value)) : minus(String(+value.toPrecision(4)));
  }

  return {PICOMETRE_MM, minus, fixed, short, signed, decimals, three, fine, seconds, utc, grouped, written};
})();
