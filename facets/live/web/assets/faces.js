// The three detectors' faces with their spots: psi to the right, zeta up.

import { signed, three } from "./numbers.js";

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export class Faces {
  constructor(root, about) {
    this.about = about;
    root.replaceChildren();
    this.faces = about.detectors.map((one, k) => {
      const box = document.createElement("div");
      box.className = "face";
      box.dataset.name = one.name;
      box.innerHTML = "<h3><span></span><span class='light'></span></h3><canvas></canvas><p></p>";
      box.querySelector("span").textContent = one.name;
      box.querySelector("span").style.color = `var(--${one.name.toLowerCase()})`;
      root.append(box);
      return { ...one, k, box, canvas: box.querySelector("canvas") };
    });
  }

  // trail: readings before, the newest last.
  show(sample, trail) {
    for (const face of this.faces) {
      const [y, z, power] = sample ? sample.reading.slice(3 * face.k, 3 * face.k + 3) : [null, null, null];
      const trouble = this.trouble(sample, face, y, z, power);
      face.box.querySelector(".light").textContent = power === null ? "unknown" : `${three(1e3 * power)} µW`;
      face.box.querySelector("p").textContent = y === null || z === null ? trouble || "no place" : `${signed(y, 3)}, ${signed(z, 3)} mm`;
      face.box.dataset.trouble = trouble;
      this.draw(face, y, z, power, trouble, trail);
    }
  }

  trouble(sample, face, y, z, power) {
    if (!sample) return "no sample yet";
    if (sample.bin && (y === null || power === null)) return "no reading then";
    if (power === null) return sample.flags & this.about.saturated ? "saturated" : "no light";
    if (power <= face.least) return "no light";
    if (y === null || z === null) return "no place";
    return Math.abs(y) > face.half[0] || Math.abs(z) > face.half[1] ? "off its area" : "";
  }

  draw(face, y, z, power, trouble, trail) {
    const { canvas } = face, ratio = devicePixelRatio || 1;
    const size = Math.max(40, canvas.clientWidth) * ratio;
    if (canvas.width !== Math.round(size)) canvas.width = canvas.height = Math.round(size);
    const ctx = canvas.getContext("2d"), middle = size / 2;
    const scale = (0.44 * size) / Math.max(...face.half);
    const px = (v) => middle + v * scale, py = (v) => middle - v * scale;
    const hue = css(`--${face.name.toLowerCase()}`);
    ctx.clearRect(0, 0, size, size);
    ctx.lineWidth = ratio;
    ctx.strokeStyle = css("--edge");
    ctx.beginPath();
    ctx.moveTo(px(-face.half[0]), middle); ctx.lineTo(px(face.half[0]), middle);
    ctx.moveTo(middle, py(-face.half[1])); ctx.lineTo(middle, py(face.half[1]));
    ctx.stroke();
    ctx.strokeStyle = css("--soft");
    ctx.strokeRect(px(-face.half[0]), py(face.half[1]), 2 * face.half[0] * scale, 2 * face.half[1] * scale);
    ctx.fillStyle = hue;
    trail.forEach((reading, i) => {
      const ty = reading[3 * face.k], tz = reading[3 * face.k + 1];
      if (!Number.isFinite(ty) || !Number.isFinite(tz)) return;
      ctx.globalAlpha = 0.08 + (0.35 * i) / trail.length;
      ctx.fillRect(px(ty) - ratio, py(tz) - ratio, 2 * ratio, 2 * ratio);
    });
    ctx.globalAlpha = 1;
    this.bar(ctx, size, ratio, power, hue);
    if (y !== null && z !== null && power > face.least) {
      const x = Math.min(size - 6 * ratio, Math.max(6 * ratio, px(y))), up = Math.min(size - 6 * ratio, Math.max(6 * ratio, py(z)));
      ctx.beginPath();
      ctx.arc(x, up, 5 * ratio, 0, 2 * Math.PI);
      if (trouble) { ctx.strokeStyle = css("--bad"); ctx.lineWidth = 2 * ratio; ctx.stroke(); } else ctx.fill();
    }
    if (trouble) {
      ctx.fillStyle = css("--bad");
      ctx.font = `600 ${13 * ratio}px system-ui, sans-serif`;
      ctx.textAlign = "center";
      ctx.fillText(trouble, middle, 0.3 * size);
    }
  }

  // The share of the beam's power that this detector has; a third each where the mirror is centred.
  bar(ctx, size, ratio, power, hue) {
    if (power === null) return;
    const share = Math.min(1, Math.max(0, power / this.about.power));
    ctx.fillStyle = css("--edge");
    ctx.fillRect(0, size - 4 * ratio, size, 4 * ratio);
    ctx.fillStyle = hue;
    ctx.fillRect(0, size - 4 * ratio, size * share, 4 * ratio);
  }
}
