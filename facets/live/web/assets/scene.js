// The rig in three dimensions, by the scripts that the run gives along (`Rig`, `Model`, `RIG`).

const LEAST = 66; // ms between drawings
const SHARE = 4; // a drawing that takes long is followed by a pause of so many times that

function load(path) {
  return new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = path;
    script.onload = resolve;
    script.onerror = () => reject(new Error(`${path} does not load`));
    document.head.append(script);
  });
}

export class Scene {
  constructor(root, about) {
    this.root = root;
    this.about = about;
    this.next = 0;
    this.view = null;
    this.units = about.components.map(({ unit }) => (unit === "mrad" ? 1e-3 : 1));
    this.begin().catch((error) => this.refuse(`There is no drawing: ${error.message}.`));
  }

  async begin() {
    if (!this.about.scripts.length) throw new Error("the run gives no scripts for it");
    for (const path of this.about.scripts) await load(path);
    this.root.replaceChildren();
    this.view = Rig.create(this.root, RIG, { theme: this.name });
    if (!this.view) throw new Error("this browser has no WebGL");
    this.theme(this.name);
    this.buttons();
    this.words = document.createElement("p");
    this.words.className = "over";
    this.root.append(this.words);
    this.show(this.sample, this.why);
  }

  buttons() {
    const row = document.createElement("div");
    row.className = "views";
    for (const name of ["rig", "mirror", "A", "B", "C"]) {
      const button = document.createElement("button");
      button.textContent = name;
      button.title = `Look at ${name === "rig" || name === "mirror" ? `the ${name}` : `detector ${name}`}`;
      button.onclick = () => this.view.look(name);
      row.append(button);
    }
    this.root.append(row);
  }

  refuse(text) {
    this.root.replaceChildren();
    const p = document.createElement("p");
    p.className = "why";
    p.textContent = text;
    this.root.append(p);
  }

  theme(name) {
    this.name = name;
    this.view?.theme(name);
  }

  // The sample that is shown; why: said where there is no pose of it.
  show(sample, why) {
    this.sample = sample;
    this.why = why;
    this.stale = true;
  }

  // Called often: draws where there is something new, and not too often for a slow machine.
  frame(now) {
    if (!this.view || !this.stale || now < this.next || document.hidden) return;
    this.stale = false;
    const begin = performance.now(), sample = this.sample;
    const known = sample?.pose && sample.state.every((value) => value !== null);
    this.words.textContent = known ? "" : `${this.drawn ? "The last known pose is drawn; now: " : ""}${this.why || "no pose"}`;
    this.root.classList.toggle("old", !known);
    if (known || !this.drawn) {
      const state = known ? sample.state.map((value, i) => value * this.units[i]) : new Array(8).fill(0);
      this.view.update(Model.drawing(state), known ? sample.reading.map((value) => value ?? NaN) : new Array(9).fill(NaN));
      if (!this.begun) this.view.look("rig", false);
      this.begun = true;
      this.drawn ||= known;
    }
    this.next = now + Math.max(LEAST, SHARE * (performance.now() - begin));
  }
}
