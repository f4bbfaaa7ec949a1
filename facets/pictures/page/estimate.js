// The inverse problem: readings with noise, the pose that is solved from them beside the true one,
// and many such poses with the stated ellipses over them.

(() => {
  const $ = (id) => document.getElementById(id);
  const parts = page.components, MOST = 300, UNITS = {mm: "µm", mrad: "µrad"};
  // Radius, in standard uncertainties, of 95 % of a normal distribution in two dimensions and in three.
  const TWO = 2.4477, THREE_D = 2.7955;
  const PAIRS = [[0, 1], [0, 2], [3, 4], [3, 5]];
  const range = (count) => Array.from({length: count}, (_, n) => n);
  let waiting = 0, last = null, drawn = null;

  // What is known; place: where a known beam is, mm.
  const asked = () => ({beam: $("estimate-beam").value, power: $("estimate-power").value, place: PAGE.offset});
  const seed = () => Math.trunc(+$("estimate-seed").value) || 0;

  function cells(...texts) {
    return texts.map((text, n) => Object.assign(document.createElement(n ? "td" : "th"), n ? {textContent: text}
      : {textContent: text, scope: "row"}));
  }

  function row(...texts) {
    const made = document.createElement("tr");
    made.append(...cells(...texts));
    return made;
  }

  function update({state, readings}) {
    const options = asked(), refusal = Model.refusal(options);
    $("estimate-results").hidden = Boolean(refusal);
    page.say("estimate-said", refusal, true);
    last = null;
    clearTimeout(waiting);
    clear();
    if (refusal) return;
    const noisy = Model.noisy(readings, seed()), found = Model.solve(noisy, options);
    tell(state, readings, noisy, found);
    last = {state, readings, options, found};
    waiting = setTimeout(cloud, page.isPlaying() ? 1000 : 120);
  }

  function tell(state, readings, noisy, found) {
    const sigma = Model.deviations(readings);
    const write = (n, places, of) => (Number.isFinite(of[n]) ? Digits.fixed(of[n], places, Digits.PICOMETRE_MM) : "lost");
    $("noisy-rows").replaceChildren(...[0, 1, 2].map((k) => row("ABC"[k], write(3 * k, 4, noisy), write(3 * k + 1, 4, noisy),
      write(3 * k + 2, 5, noisy), Number.isFinite(sigma[3 * k]) ? Digits.fine(sigma[3 * k], "mm") : "lost")));
    $("pose-rows").replaceChildren(...parts.map(({symbol, unit, factor}, n) => {
      const [truth, solved, u] = [state, found.state, found.uncertainty].map((each) => each[n] / factor);
      const places = Digits.decimals(u), lost = !found.converged;
      const name = `${symbol}, ${unit}`, number = (x) => Digits.fixed(x, places, 0.5 * 10 ** -places);
      if (lost) return row(name, Digits.short(truth), "none", "", "");
      return row(name, number(truth), number(solved), Digits.fine(Math.abs(solved - truth), unit), u > 0 ? Digits.fine(u, unit) : "known");
    }));
    const steps = `${found.steps} ${found.steps === 1 ? "step" : "steps"}`;
    const check = Number.isFinite(found.limit)
      ? `residual ${Digits.fixed(found.residual, 2)} (noise alone leaves up to ${Digits.fixed(found.limit, 2)})`
      : "nothing checks this pose";
    const {beam, place} = asked(), off = beam === "known" && place.some((x, n) => x !== state[6 + n]);
    const warning = off ? ` The beam is not at ${place.map((x) => Digits.short(x)).join(", ")}, where the solver takes it to be: the pose is off by about as much.` : "";
    page.say("estimate-said", found.converged ? `Converged after ${steps}; ${check}.${warning}`
      : `No pose: ${found.status}, after ${steps}.${warning}`, off || !found.ok);
  }

  // Many samples of the same pose, solved, less the true pose; µm and µrad.
  function cloud() {
    const {state, readings, options, found} = last, expected = Model.solve(readings, options);
    const covariance = expected.covariance.map((line, r) =>
      line.map((x, c) => 1e6 * x / parts[r].factor / parts[c].factor));
    drawn = {points: [], covariance, apex: state.slice(0, 3), found, state};
    grow(1);
  }

  // The cloud from its n-th sample on, a part at a time, so that the page answers meanwhile.
  function grow(n) {
    const {state, readings, options} = last, begin = performance.now();
    for (; n <= MOST && performance.now() - begin < 40; n++) {
      const found = Model.solve(Model.noisy(readings, 7919 * (seed() + 1) + n), options);
      if (found.converged) drawn.points.push(found.state.map((x, c) => 1e3 * (x - state[c]) / parts[c].factor));
    }
    flats();
    if (n <= MOST) waiting = setTimeout(() => grow(n), 0);
    else space();
  }

  function flats() {
    if (drawn) PAIRS.forEach((pair, n) => flat($(`cloud-${n}`), pair));
  }

  function clear() {
    drawn = null;
    for (const n of range(PAIRS.length)) {
      const canvas = $(`cloud-${n}`);
      canvas.getContext("2d").clearRect(0, 0, canvas.width, canvas.height);
    }
    space();
  }

  // One pair of components: the solved poses, the ellipse of 95 %, and the pose of the table.
  function flat(canvas, [i, j]) {
    const {points, covariance, found, state} = drawn, pen = canvas.getContext("2d"), style = getComputedStyle(canvas);
    const size = canvas.clientWidth * Math.min(devicePixelRatio || 1, 2);
    Object.assign(canvas, {width: size, height: size});
    const [a, b, c] = [covariance[i][i], covariance[i][j], covariance[j][j]];
    const half = [a, c].map((variance) => 3.6 * Math.sqrt(variance)), middle = size / 2;
    const name = [i, j].map((n) => `${parts[n].symbol} in ${UNITS[parts[n].unit]}`);
    if (!(half[0] > 0 && half[1] > 0) || !points.length) {
      canvas.setAttribute("aria-label", `${name.join(" and ")}: no solved poses`);
      return;
    }
    const x = (value) => middle + middle * value / half[0], y = (value) => middle - middle * value / half[1];
    const size_ = a * c - b * b, inside = points.filter((point) => {
      const [dx, dy] = [point[i], point[j]];
      return (c * dx * dx - 2 * b * dx * dy + a * dy * dy) / size_ < TWO * TWO;
    }).length;
    const colour = (word) => style.getPropertyValue(`--${word}`);
    pen.strokeStyle = colour("line");
    pen.strokeRect(0.5, 0.5, size - 1, size - 1);
    pen.beginPath();
    pen.moveTo(middle, 0); pen.lineTo(middle, size); pen.moveTo(0, middle); pen.lineTo(size, middle);
    pen.stroke();
    pen.fillStyle = colour("mark");
    for (const point of points) pen.fillRect(x(point[i]) - size / 200, y(point[j]) - size / 200, size / 100, size / 100);
    pen.strokeStyle = pen.fillStyle = colour("ink");
    pen.lineWidth = size / 150;
    pen.beginPath();
    const [l, m] = [Math.sqrt(a), b / Math.sqrt(a)], n = Math.sqrt(Math.max(c - m * m, 0));
    for (let k = 0; k <= 90; k++) {
      const [p, q] = [TWO * Math.cos(k * Math.PI / 45), TWO * Math.sin(k * Math.PI / 45)];
      pen.lineTo(x(l * p), y(m * p + n * q));
    }
    pen.stroke();
    if (found.converged) {
      pen.fillStyle = colour("warn");
      pen.beginPath();
      pen.arc(...[i, j].map((c_, k) => [x, y][k](1e3 * (found.state[c_] - state[c_]) / parts[c_].factor)), size / 50, 0, 7);
      pen.fill();
    }
    pen.fillStyle = colour("quiet");
    const high = Math.max(size / 18, 11 * size / canvas.clientWidth);
    pen.font = `${high}px ${style.fontFamily}`;
    pen.fillText(`${parts[j].symbol} ± ${Digits.three(half[1])} ${UNITS[parts[j].unit]}`, 0.4 * high, 1.2 * high);
    pen.textAlign = "right";
    pen.fillText(`${parts[i].symbol} ± ${Digits.three(half[0])} ${UNITS[parts[i].unit]}`, size - 0.4 * high, size - 0.5 * high);
    canvas.setAttribute("aria-label", `${name.join(" and ")}: ${points.length} solved poses about the true one; `
      + `${inside} lie in the ellipse of 95 %`);
    $("cloud-said").textContent = `${points.length} solved poses about the true one, which is in the middle of each picture; `
      + "the ellipses are to hold 95 % of them. The marked one is that of the table.";
  }

  // In the scene, enlarged: the cloud of places with the ellipsoid of 95 %, and the mirror as solved.
  let owner = null, group = null, label = null;
  function space() {
    if (owner && group) owner.scene.remove(group);
    if (label) label.kind = "part hidden";
    group = null;
    owner = page.scene;
    if (owner && drawn && $("estimate-space").checked && drawn.covariance[0][0] > 0) enlarge();
    if (owner) owner.ask();
  }

  function enlarge() {
    const {points, covariance, apex, found, state} = drawn, rim = RIG.mirror.rim;
    const longest = THREE_D * Math.sqrt(Math.max(...[0, 1, 2].map((n) => covariance[n][n])));
    const tilted = THREE_D * Math.sqrt(Math.max(...[3, 4, 5].map((n) => covariance[n][n])));
    const handy = (x) => 10 ** Math.floor(Math.log10(x)) * [5, 2, 1].find((each) => each * 10 ** Math.floor(Math.log10(x)) <= x);
    const larger = handy(1e3 * rim / longest), steeper = handy(0.25e6 / tilted);
    group = new THREE.Group();
    const corners = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]].map((each) => each.map((x) => x * rim / 60));
    const faces = [0, 1, 2, 0, 3, 1, 0, 2, 3, 1, 3, 2];
    const at = (point) => point.slice(0, 3).map((x) => 1e-3 * larger * x);
    add(points.flatMap((point) => faces.flatMap((k) => corners[k].map((x, n) => x + at(point)[n]))), page.theme() === "dark" ? "#8fc7ff" : "#0b5cad", 1);
    const root = cholesky(covariance), ball = (r, c) => {
      const [polar, turn] = [Math.PI * r / 24, Math.PI * c / 24];
      const unit = [Math.sin(polar) * Math.cos(turn), Math.sin(polar) * Math.sin(turn), Math.cos(polar)];
      return at(root.map((line) => THREE_D * line.reduce((sum, x, n) => sum + x * unit[n], 0)));
    };
    add(range(24).flatMap((r) => range(48).flatMap((c) => [
      ...ball(r, c), ...ball(r + 1, c), ...ball(r, c + 1), ...ball(r, c + 1), ...ball(r + 1, c), ...ball(r + 1, c + 1)])), "#ffffff", 0.22);
    group.position.set(...apex);
    if (found.converged) ghost(found.state, state, larger, steeper);
    owner.scene.add(group);
    const text = `solved pose and cloud: places × ${Digits.grouped(larger)}, angles × ${Digits.grouped(steeper)}`;
    if (!owner.labels.includes(label)) {
      owner.label(text, apex, "part");
      label = owner.labels.at(-1);
    }
    Object.assign(label, {kind: "cloud", place: [apex[0], apex[1], apex[2] + 0.55 * rim]});
    label.element.textContent = text;
  }

  function add(points, colour, opacity) {
    const made = new THREE.BufferGeometry();
    made.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
    made.computeVertexNormals();
    group.add(new THREE.Mesh(made, new THREE.MeshStandardMaterial({
      color: colour, transparent: opacity < 1, opacity, depthWrite: opacity === 1, side: THREE.DoubleSide})));
  }

  // The mirror's head as it would stand with its error enlarged.
  function ghost(solved, state, larger, steeper) {
    const head = owner.head.clone(true), pose = solved.map((x, n) => state[n] + (n < 3 ? larger : steeper) * (x - state[n]));
    const skin = new THREE.MeshStandardMaterial({color: "#ffcf5c", transparent: true, opacity: 0.3, depthWrite: false});
    head.traverse((part) => { if (part.isMesh) Object.assign(part, {material: skin, castShadow: false}); });
    const {turn} = Model.drawing(pose), [a, b, c] = turn, t = pose.map((x, n) => x - state[n]);
    head.matrix.set(...a, t[0], ...b, t[1], ...c, t[2], 0, 0, 0, 1);
    group.add(head);
  }

  // The lower triangular root of the first three rows and columns.
  function cholesky(m) {
    const l = range(3).map(() => [0, 0, 0]);
    for (const i of range(3)) {
      for (const j of range(i + 1)) {
        const rest = m[i][j] - range(j).reduce((sum, k) => sum + l[i][k] * l[j][k], 0);
        l[i][j] = i === j ? Math.sqrt(Math.max(rest, 0)) : l[j][j] > 0 ? rest / l[j][j] : 0;
      }
    }
    return l;
  }

  for (const [name, value] of Object.entries(PAGE.knowledge)) $(`estimate-${name}`).value = value;
  for (const id of ["estimate-beam", "estimate-power", "estimate-seed"]) {
    $(id).addEventListener("input", page.refresh);
  }
  $("estimate-again").addEventListener("click", () => {
    $("estimate-seed").value = seed() + 1;
    page.refresh();
  });
  $("estimate-space").parentElement.hidden = !page.scene;
  $("estimate-space").addEventListener("change", () => {
    space();
    if ($("estimate-space").checked && page.scene) page.scene.look("mirror");
  });
  addEventListener("resize", flats);
  new MutationObserver(flats).observe(document.documentElement, {attributeFilter: ["data-theme"]});
  $("estimate-notes").textContent = PAGE.estimate.join(" ");
  $("estimate-notes").hidden = !PAGE.estimate.length;
  page.knowledge = asked;  // own readings and tables are solved with the same knowledge
  page.listen(update);
})();
