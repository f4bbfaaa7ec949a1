// The range of each axis from rest, what ends it, and the range of the mirror's place as a solid
// around it in the scene.

(() => {
  const $ = (id) => document.getElementById(id);
  const NAMES = ["tx", "ty", "tz", "roll", "pitch", "yaw"], UNITS = ["mm", "mm", "mm", "mrad", "mrad", "mrad"];
  // A colour for each cause and for no limit, as in `facets render --view range`.
  const COLOURS = [...PAGE.range.colours], NONE = Model.causes.length;
  const AROUND = 24, DOWN = 16, FARTHEST_MM = 30;
  let sensor = null, waiting = 0, solid = null, owner = null, label = null;

  const words = (cause) => (cause < 0 ? "farther than is looked" : Model.causes[cause]);
  const hue = (cause) => COLOURS[cause < 0 ? NONE : cause];

  function cell(tag, text, more = {}) {
    return Object.assign(document.createElement(tag), {textContent: text, ...more});
  }

  function table() {
    const axes = Model.axisRanges();
    $("range-rows").replaceChildren(...axes.map(({low, high, lowCause, highCause}, n) => {
      const factor = n < 3 ? 1 : 1e3, line = document.createElement("tr");
      const write = (end, cause) => (cause < 0 ? "no limit" : Digits.fixed(factor * end, n < 2 ? 4 : 3, Digits.PICOMETRE_MM));
      const why = [...new Set([lowCause, highCause])].map((cause) => {
        const mark = cell("i", "", {className: "dot"});
        mark.style.background = hue(cause);
        return [mark, words(cause)];
      });
      const reason = cell("td", "", {className: "cause"});
      reason.append(...why.flatMap((each, m) => (m ? [", then up ", ...each] : each)));
      line.append(cell("th", `${NAMES[n]}, ${UNITS[n]}`, {scope: "row"}), cell("td", write(low, lowCause)), cell("td", write(high, highCause)), reason);
      return line;
    }));
    const outside = axes.some(({low}) => Number.isNaN(low));
    page.say("range-said", outside ? `The mirror at rest is outside the range: ${words(axes[0].lowCause)}.` : "", true);
  }

  // Points on the boundary along rays, and the cause there.
  function shell() {
    const reach = [0, 1, 2].map((n) => Math.max(...[-1, 1].map((sign) =>
      Model.exit([0, 1, 2, 3, 4, 5].map((c) => (c === n ? sign * FARTHEST_MM : 0)), 1e-5).distance)));
    return Array.from({length: DOWN + 1}, (_, r) => Array.from({length: AROUND}, (_, c) => {
      const [polar, turn] = [Math.PI * r / DOWN, 2 * Math.PI * c / AROUND], level = Math.sin(polar);
      const way = [level * Math.cos(turn), level * Math.sin(turn), Math.cos(polar)].map((x, n) => x * reach[n]);
      const size = FARTHEST_MM / Math.hypot(...way), ray = way.map((x) => x * size);
      const {distance, cause} = Model.exit([...ray, 0, 0, 0], 1e-5);
      return {point: ray.map((x) => x * distance), cause};
    }));
  }

  function body(rows) {
    const group = new THREE.Group(), faces = new Map();
    rows.slice(1).forEach((row, r) => row.forEach((corner, c) => {
      const [a, b, d] = [rows[r][c], rows[r][(c + 1) % AROUND], row[(c + 1) % AROUND]];
      const {cause} = [a, b, corner, d].reduce((best, each, _, all) => {
        const count = ({cause: own}) => all.filter((one) => one.cause === own).length;
        return count(each) > count(best) ? each : best;
      });
      if (!faces.has(cause)) faces.set(cause, []);
      faces.get(cause).push(...a.point, ...corner.point, ...b.point, ...b.point, ...corner.point, ...d.point);
    }));
    for (const [cause, points] of faces) {
      const made = new THREE.BufferGeometry();
      made.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
      made.computeVertexNormals();
      group.add(new THREE.Mesh(made, new THREE.MeshStandardMaterial({
        color: hue(cause), transparent: true, opacity: 0.4, depthWrite: false, depthTest: false, side: THREE.DoubleSide, roughness: 0.8})));
    }
    return group;
  }

  // Most ranges are narrow columns: drawn wider, about as the mirror is.
  function stretch(rows) {
    const wide = Math.max(...rows.flat().map(({point: [x, y]}) => Math.hypot(x, y)));
    const wanted = RIG.mirror.rim / wide, power = 10 ** Math.floor(Math.log10(wanted));
    return wanted < 2 || !Number.isFinite(wanted) ? 1 : [5, 2, 1].find((each) => each * power <= wanted) * power;
  }

  function draw() {
    if (owner && solid) owner.scene.remove(solid.group);
    if (label) label.kind = "part hidden";
    owner = page.scene;
    if ($("range-solid").checked && owner) {
      if (!solid) {
        const rows = shell();
        solid = {group: body(rows), wider: stretch(rows), top: Math.max(...rows.flat().map(({point}) => point[2]))};
      }
      solid.group.scale.set(solid.wider, solid.wider, 1);
      owner.scene.add(solid.group);
      if (!owner.labels.includes(label)) {
        owner.label("", [0, 0, 0], "part");
        label = owner.labels.at(-1);
      }
      Object.assign(label, {kind: "range", place: [0, 0, 0.6 * solid.top]});
      label.element.textContent = `range of the apex${solid.wider > 1 ? `, sideways × ${Digits.grouped(solid.wider)}` : ""}`;
    }
    if (owner) owner.ask();
  }

  function update() {
    if (Model.sensor === sensor) {
      if (owner !== page.scene) draw();
      return;
    }
    sensor = Model.sensor;
    clearTimeout(waiting);
    waiting = setTimeout(() => {
      if (owner && solid) owner.scene.remove(solid.group);
      solid = null;
      table();
      draw();
    }, 250);
  }

  if (Model.rangeRefusal) {
    $("range-table").hidden = $("range-solid").parentElement.hidden = true;
    page.say("range-said", Model.rangeRefusal, true);
    return;
  }
  $("range-solid").parentElement.hidden = !page.scene;
  $("range-solid").addEventListener("change", () => {
    draw();
    if (!$("range-solid").checked || !page.scene) return;
    page.scene.look("mirror", false);
    page.scene.orbit(0, 0, 0.45);
  });
  page.listen(update);
})();
