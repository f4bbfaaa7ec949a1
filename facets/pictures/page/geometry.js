// The sensor's main numbers by sliders, and the result as a configuration.
//
//   Geometry.yaml()   the configuration's text, as `facets` reads it

const Geometry = (() => {
  const $ = (id) => document.getElementById(id);
  const DEGREE = Math.PI / 180, nominal = Model.nominal, [psd] = nominal.psds, LETTERS = ["a", "b", "c"];
  const steep = nominal.facets[0].inclination / DEGREE;
  // Values of the first of three parts; the other two keep their differences from it.
  const VARIABLES = [
    {key: "radius_mm", words: "Detector distance", unit: "mm", value: psd.radius, low: 0.3, high: 2},
    {key: "inclination_deg", words: "Inclination", unit: "°", value: steep,
      low: Math.max(steep - 12, 10) / steep, high: Math.min(steep + 12, 80) / steep},
    {key: "diameter_mm", words: "Beam diameter", unit: "mm", value: nominal.beam.diameter_x, low: 0.3, high: 3},
    {key: "power_mw", words: "Laser power", unit: "mW", value: nominal.beam.power, low: 0.1, high: 5},
    {key: "size_mm", words: "Detector size", unit: "mm", value: psd.size_y, low: 0.2, high: 3},
  ];
  const values = Object.fromEntries(VARIABLES.map(({key, value}) => [key, value]));
  const rows = [], nine = (x) => +x.toPrecision(9);
  let waiting = 0;

  // Detectors go up and down with the sub-beams; ellipses and rectangles keep their shape.
  function sensorOf({radius_mm, inclination_deg, diameter_mm, power_mw, size_mm}) {
    const facets = nominal.facets.map((facet) => ({
      ...facet, inclination: facet.inclination + inclination_deg * DEGREE - nominal.facets[0].inclination}));
    const wide = diameter_mm / nominal.beam.diameter_x, large = size_mm / psd.size_y;
    const psds = nominal.psds.map((one, k) => {
      const radius = one.radius + radius_mm - psd.radius;
      const rise = Model.height(radius, facets[k].inclination) - Model.height(one.radius, nominal.facets[k].inclination);
      return {...one, radius, height: +(one.height + rise).toFixed(9), size_y: nine(large * one.size_y), size_z: nine(large * one.size_z)};
    });
    const beam = {...nominal.beam, power: power_mw,
      diameter_x: diameter_mm, diameter_y: nine(wide * nominal.beam.diameter_y)};
    return {...nominal, beam, facets, psds};
  }

  function fault(sensor) {
    const {radius, size_y} = sensor.psds.reduce((a, b) => (a.radius < b.radius ? a : b));
    if (!(radius > 0)) return "The detectors’ distance must be above 0 mm.";
    if (sensor.facets.some(({inclination}) => !(inclination > 0 && inclination < Math.PI / 2))) {
      return "The inclination must be between 0° and 90°.";
    }
    if (!(sensor.beam.diameter_x > 0 && sensor.beam.power > 0 && size_y > 0)) {
      return "Diameter, power and size must be above 0.";
    }
    return "";
  }

  function apply() {
    const sensor = sensorOf(values), wrong = fault(sensor);
    page.say("geometry-said", wrong, true);
    if (wrong) return;
    Model.change(isChanged() ? sensor : nominal);
    Object.assign(RIG, Model.bodies());
    show();
    page.refresh();
    clearTimeout(waiting);
    waiting = setTimeout(() => page.rebuild(), 300);
  }

  function isChanged() {
    return VARIABLES.some(({key, value}) => values[key] !== value);
  }

  function show() {
    VARIABLES.forEach(({key}, n) => {
      const {range, number} = rows[n];
      if (document.activeElement !== number) number.value = +values[key].toPrecision(6);
      if (document.activeElement !== range) range.value = values[key];
    });
    $("geometry-reset").disabled = !isChanged();
  }

  function row({key, words, unit, value, low, high}) {
    const line = Object.assign(document.createElement("div"), {className: "slider wide"});
    const label = Object.assign(document.createElement("label"), {htmlFor: key, textContent: words});
    const range = Object.assign(document.createElement("input"), {
      type: "range", id: key, step: "any", min: low * value, max: high * value});
    const number = Object.assign(document.createElement("input"), {type: "number", step: "any", id: `${key}-number`});
    number.setAttribute("aria-label", `${words}, ${unit}`);
    range.setAttribute("aria-label", `${words}, ${unit}`);
    for (const [field, digits] of [[range, 4], [number, 15]]) {
      field.addEventListener("input", () => {
        if (field.value === "" || !Number.isFinite(+field.value)) return;
        values[key] = +(+field.value).toPrecision(digits);
        apply();
      });
    }
    range.addEventListener("dblclick", () => { values[key] = value; apply(); });
    number.addEventListener("blur", show);
    line.append(label, range, number, Object.assign(document.createElement("span"), {textContent: unit}));
    rows.push({range, number});
    return line;
  }

  // A key of the three parts: once where all are equal, else of each.
  function put(block, key, three) {
    LETTERS.forEach((letter) => { delete (block[letter] || {})[key]; });
    delete block[key];
    const texts = three.map((value) => JSON.stringify(value));
    if (texts.every((text) => text === texts[0])) block[key] = three[0];
    else LETTERS.forEach((letter, k) => { block[letter] = {...block[letter], [key]: three[k]}; });
  }

  // The keys of the configuration that differ from what `facets` takes without them.
  function keys() {
    const tree = structuredClone(PAGE.keys), {beam, facets, psds} = Model.sensor;
    const tidy = (x) => +x.toPrecision(15), same = (key) => values[key] === VARIABLES.find((each) => each.key === key).value;
    const sensor = tree.sensor = {beam: {}, mirror: {}, psd: {}, ...tree.sensor};
    if (!same("power_mw")) sensor.beam.power_mw = beam.power;
    if (!same("diameter_mm")) sensor.beam.diameter_mm = [beam.diameter_x, beam.diameter_y].map(tidy);
    if (!same("inclination_deg")) {
      put(sensor.mirror, "inclination_deg", facets.map(({inclination}) => tidy(inclination / DEGREE)));
    }
    if (!same("size_mm")) put(sensor.psd, "size_mm", psds.map(({size_y, size_z}) => [size_y, size_z].map(tidy)));
    if (!same("radius_mm")) put(sensor.psd, "radius_mm", psds.map(({radius}) => tidy(radius)));
    if (!same("radius_mm") || !same("inclination_deg")) {
      put(sensor.psd, "height_mm", psds.map(({height}) => tidy(height)));
    }
    return tree;
  }

  // A number with a point before its exponent, without which YAML reads a word.
  function scalar(value) {
    if (Array.isArray(value)) return `[${value.map(scalar).join(", ")}]`;
    const text = JSON.stringify(value);
    return typeof value === "number" ? text.replace(/^(-?\d+)e/, "$1.0e") : text;
  }

  function lines(tree, depth = 0) {
    return Object.entries(tree).flatMap(([key, value]) => {
      const name = `${"  ".repeat(depth)}${key}:`;
      if (value === null || typeof value !== "object" || Array.isArray(value)) return [`${name} ${scalar(value)}`];
      return Object.keys(value).length ? [name, ...lines(value, depth + 1)] : [];
    });
  }

  function yaml() {
    const head = [`# The sensor ${PAGE.name}, changed on its page (facets ${PAGE.version}).`, ...PAGE.omitted.map((text) => `# ${text}`)];
    return `${[...head, ...lines(keys())].join("\n")}\n`;
  }

  function save() {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([yaml()], {type: "text/yaml"}));
    link.download = `${PAGE.name}-changed.yaml`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
  }

  $("geometry-rows").append(...VARIABLES.map(row));
  $("geometry-reset").addEventListener("click", () => {
    for (const {key, value} of VARIABLES) values[key] = value;
    apply();
  });
  $("geometry-save").hidden = !PAGE.keys;
  $("geometry-save").addEventListener("click", save);
  show();
  return {yaml};
})();
