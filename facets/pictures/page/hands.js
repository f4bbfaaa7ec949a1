// Hands on the rig: keys, modes of dragging, the apex on the flat picture, help, and the picture to
// keep. It works on `page` of panel.js.

(() => {
  const $ = (id) => document.getElementById(id);
  const VIEWS = ["rig", "mirror", "A", "B", "C"], TURN = 0.06;  // rad of the camera a key
  const HINTS = {
    view: "Drags and arrow keys turn the view; scroll or pinch to come closer.",
    move: "Drag the mirror to move it (with Shift: to turn it); drag beside it to turn the view.",
    turn: "Drag the mirror to turn it (with Shift: to move it); drag beside it to turn the view.",
  };
  // What help lists: keys, and what they do.
  const KEYS = [
    ["Drag the mirror", "moves it in the plane of the picture, or turns it in the mode Turn or with Shift; half the picture’s height is half a slider"],
    ["Drag beside it, scroll or pinch", "turns the view, comes closer"],
    ["Drag in “The mirror’s point”", "shifts the mirror under the beam, to scale"],
    ["Click a part", "shows its name and numbers"],
    ["1, 2, 3, 4, 5", "view of the rig, the mirror, detector A, B, C"],
    ["V, M, T", "arrow keys and drags turn the view, move or turn the mirror"],
    ["Arrow keys, Page up, Page down", "on the rig: along x, along y, up and down; or about x, y, z; with Shift a tenth"],
    ["+, −", "closer, farther"],
    ["Space", "plays and pauses"],
    ["R", "back to the first state"],
    ["O", "opens a table; it can also be dropped onto the page"],
    ["P", "saves a picture"],
    ["L", "light or dark theme"],
    ["?", "this help; Esc closes it"],
  ];
  // The components that a pair of keys changes, by mode; the first of a pair lowers it.
  const AXES = {
    ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowDown: [1, -1], ArrowUp: [1, 1], PageDown: [2, -1], PageUp: [2, 1],
  };
  let mode = "move";

  function choose(name) {
    mode = name;
    if (page.scene) page.scene.mode = name;
    for (const button of document.querySelectorAll("#modes button")) {
      button.setAttribute("aria-pressed", button.dataset.mode === name);
    }
    $("hint").textContent = page.scene ? HINTS[name] : "";
  }

  // An arrow key on the rig: a fiftieth of a slider's half, or a tenth of that.
  function arrow(key, fine) {
    const [axis, sign] = AXES[key];
    if (mode === "view") {
      if (page.scene && axis < 2) page.scene.orbit(...(axis ? [0, sign * TURN] : [sign * TURN, 0]));
      return;
    }
    const state = page.state(), n = mode === "turn" ? 3 + axis : axis, {end, factor} = page.components[n];
    state[n] += sign * end * factor / (fine ? 500 : 50);
    page.settle(state);
  }

  function closer(factor) {
    if (page.scene) page.scene.orbit(0, 0, factor);
  }

  const ACTS = {
    v: () => choose("view"), m: () => choose("move"), t: () => choose("turn"),
    r: () => $("reset").click(), o: () => $("open").click(), p: () => $("picture").click(), l: () => $("theme").click(),
    "?": () => $("help").showModal(), "+": () => closer(1.15), "=": () => closer(1.15), "-": () => closer(1 / 1.15),
    "\u2212": () => closer(1 / 1.15),
    " ": () => ($("player").hidden ? $("play") : $("run")).click(),
  };
  VIEWS.forEach((name, n) => { ACTS[n + 1] = () => page.scene && page.scene.look(name); });

  function key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || $("help").open) return;
    const typing = event.target.closest("input:not([type=range]), textarea, select");
    if (event.key === "Escape" && !typing) page.card.close();
    if (typing || (event.key === " " && event.target.closest("button, input"))) return;
    const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (name in AXES && event.target === $("rig")) arrow(name, event.shiftKey);
    else if (name in ACTS && $("letters").checked) ACTS[name]();
    else return;
    event.preventDefault();
  }

  // The apex follows the pointer under the beam, as far as the pointer goes: the picture is to scale.
  function dragPoint() {
    const canvas = $("point");
    let from = null;
    canvas.addEventListener("pointerdown", ({clientX, clientY, pointerId, isPrimary}) => {
      if (!isPrimary) return;
      canvas.setPointerCapture(pointerId);
      from = [clientX, clientY];
    });
    canvas.addEventListener("pointermove", ({clientX, clientY}) => {
      if (!from) return;
      const state = page.state(), {scale} = page.point;
      state[0] += (clientX - from[0]) / scale;
      state[1] -= (clientY - from[1]) / scale;
      from = [clientX, clientY];
      page.settle(state);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { from = null; });
  }

  // The rig as it is seen, the flat pictures below it, and the numbers in words: a canvas.
  function picture() {
    const wide = 1600, high = page.scene ? Math.round(wide * $("rig").clientHeight / $("rig").clientWidth) : 0;
    const side = wide / 4, foot = 150, canvas = document.createElement("canvas");
    Object.assign(canvas, {width: wide, height: high + side + foot});
    const pen = canvas.getContext("2d"), style = getComputedStyle(document.body);
    pen.fillStyle = style.backgroundColor;
    pen.fillRect(0, 0, wide, canvas.height);
    if (page.scene) page.scene.copy(pen, wide);
    ["point", "face-a", "face-b", "face-c"].forEach((id, n) => {
      const {width, height} = $(id), scale = (side - 24) / Math.max(width, height);
      pen.drawImage($(id), n * side + (side - width * scale) / 2, high + (side - height * scale) / 2,
        width * scale, height * scale);
    });
    pen.fillStyle = style.color;
    pen.textAlign = "left";
    pen.textBaseline = "alphabetic";
    pen.font = `20px ${style.fontFamily}`;
    const readings = page.measured() || page.readings();
    const write = (n, places, unit) =>
      (Number.isFinite(readings[n]) ? `${Digits.fixed(readings[n], places, Digits.PICOMETRE_MM)} ${unit}` : "lost");
    const lines = [
      `${PAGE.name}${Model.sensor === Model.nominal ? "" : " with another geometry"}: ${$("source").textContent}`,
      page.components.map(({symbol, unit, factor}, n) => `${symbol} ${Digits.short(page.state()[n] / factor)} ${unit}`).join("   "),
      [0, 1, 2].map((k) => `${"ABC"[k]}: ψ ${write(3 * k, 4, "mm")}, ζ ${write(3 * k + 1, 4, "mm")}, ${write(3 * k + 2, 5, "mW")}`).join("     "),
    ];
    lines.forEach((line, n) => pen.fillText(line, 16, high + side + 34 + 40 * n, wide - 32));
    return canvas;
  }

  function save() {
    picture().toBlob((blob) => {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(blob);
      link.download = `${PAGE.name}.png`;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 60000);
    }, "image/png");
  }

  $("help").querySelector("tbody").append(...KEYS.map(([name, does]) => {
    const row = document.createElement("tr");
    row.append(Object.assign(document.createElement("th"), {textContent: name, scope: "row"}),
      Object.assign(document.createElement("td"), {textContent: does}));
    return row;
  }));
  $("keys").addEventListener("click", () => $("help").showModal());
  $("picture").addEventListener("click", save);
  for (const button of document.querySelectorAll("#modes button")) {
    button.addEventListener("click", () => choose(button.dataset.mode));
  }
  addEventListener("keydown", key);
  dragPoint();
  choose(mode);
  page.picture = picture;
})();
