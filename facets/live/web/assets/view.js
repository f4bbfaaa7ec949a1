// The rig in three dimensions and the detectors' faces, by the scripts of the rig's own page (`Rig`,
// `Faces`, `Parts`, `Model`, `RIG`, `Digits`), which the run gives along.

const LEAST = 66; // ms between drawings
const SHARE = 4; // a drawing that takes long is followed by a pause of so many times that

export class View {
  // root: for the rig in three dimensions; faces: for the detectors; card: for a part's numbers.
  constructor(root, faces, card, about) {
    Object.assign(this, { root, about, next: 0, begun: false, drawn: false, stale: false });
    this.units = about.components.map(({ unit }) => (unit === "mrad" ? 1e-3 : 1));
    this.card = Parts.card(card, RIG);
    root.replaceChildren();
    this.rig = Rig.create(root, RIG, { onPick: this.card.open });
    this.words = document.createElement("p");
    this.words.className = this.rig ? "over" : "why";
    this.words.textContent = this.rig ? "" : "There is no drawing: this browser has no WebGL.";
    root.append(this.words);
    faces.replaceChildren();
    this.faces = about.detectors.map((one, k) => this.face(faces, one, k));
  }

  face(root, one, k) {
    const box = document.createElement("div");
    box.className = "face";
    box.dataset.name = one.name;
    box.innerHTML = "<h3><span></span><span class='light'></span></h3><canvas role='img'></canvas><p></p>";
    box.querySelector("span").textContent = one.name;
    box.querySelector("span").style.color = `var(--${one.name.toLowerCase()})`;
    const canvas = box.querySelector("canvas");
    canvas.setAttribute("aria-label", `The spot on detector ${one.name}`);
    canvas.onclick = () => this.card.open(one.name);
    root.append(box);
    return { ...one, k, box, picture: Faces.detector(canvas, RIG, k, { bar: true }) };
  }

  theme(name) {
    for (const part of [this.rig, ...this.faces.map(({ picture }) => picture)]) part?.theme(name);
  }

  // The sample that is shown; why: said where there is no pose of it; trail: readings before, the
  // newest last.
  show(sample, why, trail) {
    Object.assign(this, { sample, why, trail, stale: true });
    for (const face of this.faces) {
      const [y, z, power] = this.reading(face);
      face.trouble = this.trouble(face, y, z, power);
      face.box.querySelector(".light").textContent = power === null ? "unknown" : `${Digits.three(1e3 * power)} µW`;
      face.box.querySelector("p").textContent = y === null || z === null ? face.trouble || "no place" : `${Digits.signed(y, 3)}, ${Digits.signed(z, 3)} mm`;
      face.box.dataset.trouble = face.trouble;
    }
  }

  reading({ k }) {
    return this.sample ? this.sample.reading.slice(3 * k, 3 * k + 3) : [null, null, null];
  }

  trouble(face, y, z, power) {
    if (!this.sample) return "no sample yet";
    if (this.sample.bin && (y === null || power === null)) return "no reading then";
    if (power === null) return this.sample.flags & this.about.saturated ? "saturated" : "no light";
    if (power <= face.least) return "no light";
    if (y === null || z === null) return "no place";
    return Math.abs(y) > face.half[0] || Math.abs(z) > face.half[1] ? "off its area" : "";
  }

  // Called often: draws where there is something new, and not too often for a slow machine.
  frame(now) {
    if (!this.stale || now < this.next || document.hidden) return;
    this.stale = false;
    const begin = performance.now(), { sample } = this;
    const known = Boolean(sample?.pose && sample.state.every((value) => value !== null));
    const state = known ? sample.state.map((value, i) => value * this.units[i]) : new Array(8).fill(0);
    const readings = sample ? sample.reading.map((value) => value ?? NaN) : new Array(9).fill(NaN);
    const drawing = known || !this.drawn ? Model.drawing(state) : null;
    if (this.rig) this.space(known, drawing, readings);
    for (const { k, picture, trouble } of this.faces) {
      const seen = trouble === "no light" ? new Array(9).fill(NaN) : readings;
      picture.update(known ? drawing : null, seen, { trouble, trail: this.trail.map((reading) => reading.slice(3 * k, 3 * k + 2)) });
    }
    if (known) this.card.update(state, readings);
    this.next = now + Math.max(LEAST, SHARE * (performance.now() - begin));
  }

  space(known, drawing, readings) {
    this.words.textContent = known ? "" : `${this.drawn ? "The last known pose is drawn; now: " : ""}${this.why || "no pose"}`;
    this.root.classList.toggle("old", !known);
    if (!drawing) return;
    this.rig.update(drawing, known ? readings : new Array(9).fill(NaN));
    if (!this.begun) this.rig.look("rig", false);
    this.begun = true;
    this.drawn ||= known;
  }
}
