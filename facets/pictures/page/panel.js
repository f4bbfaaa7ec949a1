// The page about the pictures: sliders, readings, theme, and the state as text. Other scripts of the
// page work on `page`:
//
//   page.state(); page.readings();        // (8,) mm, rad; the model's nine readings, mm, mW
//   page.moveTo(state, {measured, source, posed});  // a state from elsewhere, beside readings that
//                                         // were measured there, and where these come from; posed:
//                                         // false where the readings have no pose
//   page.listen(({state, drawing, readings, measured}) => ...);  // now, and at each change
//   page.rebuild();                       // after RIG or Model have changed
//   page.say(id, text, wrong);            // a message in an element

const page = (() => {
  const $ = (id) => document.getElementById(id);
  const parts = PAGE.components;
  const first = PAGE.state.slice();
  // in the units that are shown, so that a number that was typed stays as it is
  let shown = first.map((x, n) => tidy(x / parts[n].factor));
  const sliders = [], listeners = [];
  // page.html?theme=light&view=mirror, for those who show the page inside another
  const asked = new URLSearchParams(location.search);
  let chosen = ["dark", "light"].find((name) => name === asked.get("theme"));

  function tidy(x) {
    return +x.toPrecision(15);
  }

  function state() {
    return shown.map((x, n) => x * parts[n].factor);
  }

  // What there is to say where a detector's values are lost, or not to be believed; else nothing.
  function remark(drawing, readings, k) {
    const facet = drawing.facets[k], name = "ABC"[k], [psi, zeta, power] = readings.slice(3 * k, 3 * k + 3);
    const lost = [psi, zeta, power].some(Number.isNaN);
    if (lost && !(facet.facing > 0)) return `Facet ${name} is turned away from the beam.`;
    if (lost && !(facet.towards > 0 && facet.length > 0)) {
      return `The sub-beam of facet ${name} never meets the plane of its detector.`;
    }
    if (lost && !(power > 0)) return `No light gets from facet ${name} to its detector.`;
    if (lost) return `So little light gets from facet ${name} to its detector that its place is lost.`;
    if (Model.saturated(readings)[k]) {
      return `Detector ${name} is saturated, and reads nothing: the numbers say where its light goes.`;
    }
    return power > 0 ? "" : `There is no light on detector ${name}.`;
  }

  // The letters of the detectors that their spots have left.
  function left(readings) {
    return [0, 1, 2].filter((k) => {
      const [y, z] = RIG.detectors[k].half;
      return Math.abs(readings[3 * k]) > y || Math.abs(readings[3 * k + 1]) > z;
    }).map((k) => "ABC"[k]);
  }

  function beside(names) {
    const end = "the numbers say where the light goes.";
    if (names.length === 1) return `Spot ${names} lies beside its detector, which reads nothing: ${end}`;
    const all = `${names.slice(0, -1).join(", ")} and ${names.at(-1)}`;
    return names.length ? `Spots ${all} lie beside their detectors, which read nothing: ${end}` : "";
  }

  // Readings that were measured, at the state that is shown; null where the model's are meant.
  let measured = null, posed = true;
  const card = Parts.card($("card"), RIG);
  let scene = space();
  const point = Faces.point($("point"), RIG);
  const faces = ["a", "b", "c"].map((letter, k) => Faces.detector($(`face-${letter}`), RIG, k));
  $("flat").hidden = Boolean(scene);

  function space() {
    return Rig.create($("rig"), RIG, {theme: theme(), onPick: card.open, onDrag: drag, below});
  }

  // How far hints and, in a narrow page, buttons reach up from the lower edge of the view.
  function below() {
    const view = $("view").getBoundingClientRect();
    const tops = ["hint", "modes"].map((id) => $(id).getBoundingClientRect().top);
    return view.bottom - Math.min(view.bottom, ...tops.filter((top) => top > (view.top + view.bottom) / 2));
  }

  // The bodies anew, seen from the same place.
  function rebuild() {
    if (scene) {
      const {camera: {position}, controls: {target}, mode, view, own} = scene;
      scene.dispose();
      scene = space();
      scene.mode = mode;
      scene.look(view, false);
      if (own) {
        scene.camera.position.copy(position);
        scene.controls.target.copy(target);
        scene.orbit(0, 0);
      }
    }
    refresh();
  }

  // The mirror dragged along a vector of the world, or turned about it; half the picture's height is
  // half a slider.
  function drag(vector, turning) {
    const end = (n) => parts[n].end * parts[n].factor, now = state();
    if (turning) turn(now, vector.map((x) => x * end(3)));
    else vector.forEach((x, n) => { now[n] += x * end(0); });
    settle(now);
  }

  // A further turn about an axis of the world, by its length; exact, also of a mirror that is turned.
  function turn(now, vector) {
    const angle = Math.hypot(...vector) || 1e-300, axis = new THREE.Vector3(...vector).divideScalar(angle);
    const before = new THREE.Matrix4().makeRotationFromEuler(new THREE.Euler(...now.slice(3, 6), "ZYX"));
    const after = new THREE.Matrix4().makeRotationAxis(axis, angle).multiply(before);
    now.splice(3, 3, ...new THREE.Euler().setFromRotationMatrix(after, "ZYX").toArray().slice(0, 3));
  }

  // A state that a hand gave: of six digits.
  function settle(state_) {
    stop();
    forget();
    shown = state_.map((x, n) => +(x / parts[n].factor).toPrecision(6));
    shown = shown.map((x) => (Math.abs(x) < Digits.PICOMETRE_MM ? 0 : x));
    refresh();
  }

  function forget() {
    measured = null;
    posed = true;
    $("source").textContent = "what the detectors say";
  }

  function moveTo(state_, more = {}) {
    stop();
    forget();
    shown = state_.map((x, n) => tidy(x / parts[n].factor));
    measured = more.measured || null;
    posed = more.posed !== false;
    if (more.source) $("source").textContent = more.source;
    refresh();
  }

  function refresh() {
    const now = state(), drawing = Model.drawing(now), readings = Model.readings(now);
    const seen = measured || readings;
    if (scene) scene.update(drawing, posed ? seen : readings);
    for (const picture of [point, ...faces]) picture.update(posed || picture === point ? drawing : null, seen);
    card.update(now, seen);
    tell(drawing, seen);
    for (const listener of listeners) listener({state: now, drawing, readings, measured});
    sliders.forEach(({range, number}, n) => {
      if (document.activeElement !== number) number.value = handy(shown[n]);
      if (document.activeElement !== range || +range.value !== shown[n]) range.value = shown[n];
    });
    if (document.activeElement !== $("text")) $("text").value = words();
    link();
  }

  function tell(drawing, readings) {
    const remarks = measured ? [] : [0, 1, 2].map((k) => remark(drawing, readings, k)), off = left(readings);
    $("notes").hidden = Boolean(measured);
    readings.forEach((value, n) => {
      const cell = document.querySelector(`td[data-reading="${n}"]`), lost = Number.isNaN(value);
      cell.dataset.value = String(value);
      cell.textContent = lost ? "lost"
        : n % 3 === 2 ? Digits.fixed(value, 5) : Digits.fixed(value, 4, Digits.PICOMETRE_MM);
      cell.className = lost || off.includes("ABC"[Math.floor(n / 3)]) ? "lost" : "";
    });
    share(readings);
    $("why").replaceChildren(...[...remarks, beside(off)].filter(Boolean).map((text) => {
      const item = document.createElement("li");
      item.textContent = text;
      return item;
    }));
  }

  // How the detectors share the beam's power.
  function share(readings) {
    const powers = [2, 5, 8].map((n) => Math.max(readings[n] || 0, 0));
    document.querySelectorAll("#shares i").forEach((bar, k) => {
      bar.style.width = `${100 * Math.min(powers[k] / RIG.beam.power, 1)}%`;
    });
    const sum = powers.reduce((a, b) => a + b);
    $("sum").textContent = `The three share ${Digits.fixed(sum, 5)} mW of the beam’s ` +
      `${Digits.short(RIG.beam.power, 5)} mW.`;
  }

  // A number in a narrow field; the field that is typed into has all digits.
  function handy(x) {
    if (Math.abs(x) < Digits.PICOMETRE_MM) return 0;
    return Math.abs(x) < 1e-4 ? +x.toPrecision(2) : +x.toFixed(4);
  }

  function words() {
    const given = parts.map((part, n) => [part.key, +shown[n].toPrecision(12)])
      .filter(([, x]) => Math.abs(x) >= Digits.PICOMETRE_MM);
    return given.map(([key, x]) => `${key}=${x}`).join(",");
  }

  // The page's address follows once a slider rests: browsers take only so many changes of it.
  let waiting = 0;
  function link() {
    clearTimeout(waiting);
    waiting = setTimeout(address, 250);
  }

  function address() {
    const hash = words().replace(/,/g, "&");
    try {
      history.replaceState(null, "", location.pathname + location.search + (hash && `#${hash}`));
    } catch { /* a frame that may not change its address */ }
    return location.href.split("#")[0] + (hash && `#${hash}`);
  }

  // A state from text: tx_mm=0.1,yaw_mrad=5 as facets render --at takes it, a link's end, or JSON.
  // What is not named is zero. Throws an error that says what is wrong.
  function read(text) {
    const trimmed = text.trim().replace(/^.*#/, "");
    let pairs;
    if (trimmed.startsWith("{")) {
      try {
        pairs = Object.entries(JSON.parse(trimmed));
      } catch {
        throw new Error("This is not JSON.");
      }
    } else {
      pairs = trimmed.split(/[,&\s]+/).filter(Boolean).map((pair) => pair.split("="));
    }
    const found = parts.map(() => 0);
    for (const [key, value] of pairs) {
      const n = parts.findIndex((part) => part.key === key);
      if (n < 0) throw new Error(`“${key}” is not a component of a state. Give any of ` +
        `${parts.map((part) => part.key).join(", ")}.`);
      if (value === undefined || value === "" || !Number.isFinite(+value)) {
        throw new Error(`The value of ${key} is not a number that is finite, with a point as the decimal mark.`);
      }
      found[n] = +value;
    }
    return found;
  }

  function accept(text) {
    try {
      shown = read(text);
      stop();
      forget();
      say("said", "");
    } catch (error) {
      say("said", error.message, true);
      return;
    }
    refresh();
  }

  function say(id, text, wrong = false) {
    $(id).textContent = text;
    $(id).classList.toggle("wrong", wrong);
  }

  async function copy(text, what) {
    try {
      await navigator.clipboard.writeText(text);
      say("said", `${what} is on the clipboard.`);
    } catch {
      const field = document.createElement("textarea");
      field.value = text;
      document.body.append(field);
      field.select();
      const done = document.execCommand("copy");
      field.remove();
      say("said", done ? `${what} is on the clipboard.` : `This browser keeps its clipboard to itself: ${text}`,
        !done);
    }
  }

  function slider(part, n) {
    const row = document.createElement("div");
    row.className = n === 3 || n === 6 ? "slider group" : "slider";
    const name = Object.assign(document.createElement("label"), {htmlFor: part.key});
    name.append(Object.assign(document.createElement("b"), {textContent: part.symbol}),
      Object.assign(document.createElement("small"), {textContent: part.words}));
    const range = Object.assign(document.createElement("input"), {
      type: "range", min: -part.end, max: part.end, step: "any", id: part.key});
    const number = Object.assign(document.createElement("input"), {
      type: "number", step: "any", id: `${part.key}-number`});
    range.setAttribute("aria-label", `${part.words}, ${part.unit}`);
    number.setAttribute("aria-label", `${part.words}, ${part.unit}`);
    const unit = Object.assign(document.createElement("span"), {textContent: part.unit});
    range.addEventListener("input", () => move(n, +(+range.value).toPrecision(6)));
    number.addEventListener("input", () => {
      if (number.value !== "" && Number.isFinite(+number.value)) move(n, +number.value);
    });
    number.addEventListener("focus", () => { number.value = +shown[n].toPrecision(12); });
    number.addEventListener("blur", refresh);
    range.addEventListener("dblclick", () => move(n, 0));
    row.append(name, range, number, unit);
    sliders.push({range, number});
    return row;
  }

  function move(n, value) {
    stop();
    forget();
    shown[n] = value;
    refresh();
  }

  // One component alone, half way to where its slider ends.
  function attempt(symbol) {
    stop();
    forget();
    shown = parts.map((part) => (part.symbol === symbol ? part.end / 2 : 0));
    refresh();
  }

  // A motion of all components, each at its own pace, until something else moves the state.
  let playing = 0;
  function play() {
    forget();
    const paces = [3, 4, 5, 2, 3, 1, 0, 0], begin = performance.now();
    const step = (now) => {
      const turn = (now - begin) / 12000 * 2 * Math.PI;
      shown = parts.map((part, n) => +(0.45 * part.end * Math.sin(paces[n] * turn)).toPrecision(4));
      refresh();
      playing = requestAnimationFrame(step);
    };
    playing = requestAnimationFrame(step);
    pressed();
  }

  function stop() {
    cancelAnimationFrame(playing);
    playing = 0;
    pressed();
  }

  function pressed() {
    $("play").textContent = playing ? "Pause" : "Play";
    $("play").setAttribute("aria-pressed", Boolean(playing));
  }

  function rows() {
    return [0, 1, 2].map((k) => {
      const row = document.createElement("tr");
      row.className = "abc"[k];
      const head = Object.assign(document.createElement("th"), {textContent: "ABC"[k], scope: "row"});
      row.append(head, ...[0, 1, 2].map((i) => {
        const cell = document.createElement("td");
        cell.dataset.reading = 3 * k + i;
        return cell;
      }));
      return row;
    });
  }

  function theme() {
    return chosen || (matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark");
  }

  function dress() {
    const name = theme();
    document.documentElement.dataset.theme = name;
    $("theme").textContent = name === "dark" ? "Light theme" : "Dark theme";
    for (const picture of [scene, point, ...faces]) if (picture) picture.theme(name);
  }

  $("sliders").append(...parts.map(slider));
  document.querySelector("tbody").append(...rows());
  $("notes").append(...PAGE.sentences.map((text) =>
    Object.assign(document.createElement("p"), {textContent: text})));
  $("text").addEventListener("input", () => accept($("text").value));
  $("text").addEventListener("blur", refresh);
  $("text").placeholder = "all zero";
  $("play").addEventListener("click", () => (playing ? stop() : play()));
  for (const button of document.querySelectorAll("#try button")) {
    button.addEventListener("click", () => attempt(button.dataset.try));
  }
  $("reset").addEventListener("click", () => {
    moveTo(first);
    say("said", "");
    if (scene) scene.look("rig");
  });
  $("theme").addEventListener("click", () => {
    chosen = theme() === "dark" ? "light" : "dark";
    dress();
  });
  $("copy-state").addEventListener("click", () => copy(words(), "The state"));
  $("copy-json").addEventListener("click", () => copy(
    JSON.stringify(Object.fromEntries(parts.map((part, n) => [part.key, shown[n]]))), "The state"));
  $("copy-link").addEventListener("click", () => copy(address(), "The link"));
  for (const button of document.querySelectorAll("[data-part]")) {
    button.addEventListener("click", () => card.open(button.dataset.part));
  }
  matchMedia("(prefers-color-scheme: light)").addEventListener("change", dress);
  addEventListener("hashchange", () => accept(location.hash));
  if (location.hash.length > 1) {
    try {
      shown = read(location.hash);
    } catch (error) {
      say("said", error.message, true);
    }
  }
  dress();
  refresh();
  const view = asked.get("view") || PAGE.view;
  if (scene && ["mirror", "A", "B", "C"].includes(view)) scene.look(view, false);
  return {
    point, faces, card, accept, state, refresh, rebuild, turn, settle, say, theme, moveTo, components: parts,
    get scene() { return scene; },
    readings: () => Model.readings(state()),
    measured: () => measured,
    isPlaying: () => Boolean(playing),
    listen(listener) {
      listeners.push(listener);
      refresh();
    },
  };
})();
