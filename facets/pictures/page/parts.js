// The card of a part of the rig: its name and its numbers.
//
//   const card = Parts.card(element, RIG);
//   card.open("mirror" | "A" | "B" | "C" | "laser" | ...); card.update(state, readings); card.close();

const Parts = (() => {
  const DRAWN = "Drawn as such a part usually is: the optics does not fix its size.";
  const NAMES = {mirror: "Mirror", laser: "Laser", plate: "Base plate", post: "Detector’s post",
    pillar: "Laser’s pillar", stage: "Mirror’s stage"};
  const degrees = (angle) => `${Digits.short(angle * 180 / Math.PI, 3)}°`;
  const mm = (value, places = 4) => `${Digits.short(value, places)} mm`;
  const mrad = (value) => `${Digits.short(1e3 * value)} mrad`;
  const three = (values, write) => {
    const texts = values.map((value) => write(value));
    return texts.every((text) => text === texts[0]) ? texts[0] : texts.join(", ");
  };

  function mirror({mirror: {normals, rim}}, [tx, ty, tz, roll, pitch, yaw]) {
    return [
      ["Facets’ inclination to the plate", three(normals.map((n) => Math.acos(n[2])), degrees)],
      ["Radius of the rim", mm(rim)],
      ["Apex x, y, z", [tx, ty, tz].map((value) => mm(value)).join(", ")],
      ["Roll, pitch, yaw", [roll, pitch, yaw].map(mrad).join(", ")],
    ];
  }

  function detector({detectors, beam}, k, readings) {
    const {centre: [x, y, z], axes, half} = detectors[k], [psi, zeta, power] = readings.slice(3 * k, 3 * k + 3);
    const known = (value, write) => (Number.isFinite(value) ? write(value) : "lost");
    return [
      ["Sensitive area, ψ × ζ", `${Digits.short(2 * half[0])} × ${mm(2 * half[1])}`],
      ["Distance from the axis", mm(Math.hypot(x, y))],
      ["Height of its centre", mm(z)],
      ["Inclination of its face", degrees(Math.asin(Math.min(Math.max(axes[0][2], -1), 1)))],
      ["Spot ψ, ζ", `${known(psi, mm)}, ${known(zeta, mm)}`],
      ["Power", known(power, (mw) => `${Digits.fixed(mw, 5)} mW`)],
      ["Share of the beam", known(power, (mw) => `${Digits.fixed(100 * mw / beam.power, 2)} %`)],
    ];
  }

  function laser({beam}, state) {
    const [x, y] = beam.direction, tilt = Math.hypot(x, y);
    return [
      ["Power", `${Digits.short(beam.power, 5)} mW`],
      ["Beam diameter, 1/e²", three(beam.diameter, mm)],
      ["Tilt from the vertical", mrad(Math.asin(Math.min(tilt, 1)))],
      ["Offset x, y", state.slice(6).map((value) => mm(value)).join(", ")],
    ];
  }

  function rows(name, rig, state, readings) {
    if (name === "mirror") return mirror(rig, state);
    if (name === "laser") return laser(rig, state);
    if (name.length === 1) return detector(rig, "ABC".indexOf(name), readings);
    return name === "plate" ? [["Distance of its holes", "25 mm"]] : [];
  }

  function made(tag, more) {
    return Object.assign(document.createElement(tag), more);
  }

  function card(element, rig) {
    let shown = null, state = new Array(8).fill(0), readings = new Array(9).fill(NaN);
    const title = made("h2"), list = made("dl"), note = made("p", {textContent: DRAWN});
    const button = made("button", {type: "button", textContent: "×", title: "Close"});
    button.setAttribute("aria-label", "Close the card");
    element.append(button, title, list, note);
    function write() {
      if (!shown) return;
      title.textContent = NAMES[shown] || `Detector ${shown}`;
      list.replaceChildren(...rows(shown, rig, state, readings).map(([name, value]) => {
        const pair = made("div");
        pair.append(made("dt", {textContent: name}), made("dd", {textContent: value}));
        return pair;
      }));
      note.hidden = shown.length === 1 || shown === "mirror" || shown === "laser";
    }
    function open(name) {
      shown = name;
      element.hidden = !name;
      write();
    }
    button.addEventListener("click", () => open(null));
    open(null);
    return {open, close: () => open(null), update(...now) {
      [state, readings] = now;
      write();
    }};
  }

  return {card};
})();
