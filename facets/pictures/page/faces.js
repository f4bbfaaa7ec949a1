// The three detectors' faces with their spots, and the beam on the mirror's point: flat pictures on
// canvases, which need no WebGL.
//
//   const face = Faces.detector(canvas, RIG, 0, {bar: true});      // detector A
//   const point = Faces.point(canvas, RIG);                        // seen along the beam
//   face.update(Model.drawing(state), readings); face.theme("light");
//
// The irradiance is that of the model, at every pixel: the place is followed back into the beam.
// drawing may be null where no pose is known; then only what is measured is drawn. A third argument
// of a face's update may have a trail, places (psi, zeta) before with the newest last, and a trouble in
// words. Option bar: whether the share of the beam's power is drawn below.

const Faces = (() => {
  const THEMES = {
    dark: {face: "#12161d", edge: "#596270", grid: "#2a313b", ink: "#e6ebf1", quiet: "#9aa5b1", ground: "#161a20", bad: "#ff8a80"},
    light: {face: "#f3f5f7", edge: "#8a929c", grid: "#dde1e6", ink: "#1c2128", quiet: "#5d6671", ground: "#ffffff", bad: "#b3261e"},
  };
  const rgb = (hue) => [1, 3, 5].map((n) => parseInt(hue.slice(n, n + 2), 16));

  class Picture {
    constructor(canvas, rig) {
      Object.assign(this, {canvas, rig, name: "dark"});
      this.watcher = new ResizeObserver(() => this.draw());
      this.watcher.observe(canvas);
    }

    theme(name) {
      this.name = name;
      this.draw();
    }

    update(drawing, readings, more = {}) {
      Object.assign(this, {drawing, readings, ...more});
      this.draw();
    }

    // A pen in units of CSS pixels; null while the canvas is not shown.
    pen() {
      const ratio = window.devicePixelRatio || 1, {clientWidth: wide, clientHeight: high} = this.canvas;
      if (!wide || !high) return null;
      this.canvas.width = Math.round(wide * ratio);
      this.canvas.height = Math.round(high * ratio);
      const pen = this.canvas.getContext("2d");
      pen.scale(ratio, ratio);
      return Object.assign(pen, {wide, high, ratio});
    }

    // Paints `light(x, y)` -> [hue, 0..1] or null over a rectangle of the picture, in its pixels.
    shine(pen, left, top, wide, high, light) {
      const {ratio} = pen, columns = Math.round(wide * ratio), rows = Math.round(high * ratio);
      if (columns < 1 || rows < 1) return;
      const image = new ImageData(columns, rows);
      for (let r = 0; r < rows; r++) {
        for (let c = 0; c < columns; c++) {
          const found = light(left + (c + 0.5) / ratio, top + (r + 0.5) / ratio);
          if (found) image.data.set(this.colour(...found), 4 * (r * columns + c));
        }
      }
      const part = document.createElement("canvas");
      Object.assign(part, {width: columns, height: rows});
      part.getContext("2d").putImageData(image, 0, 0);
      pen.drawImage(part, left, top, columns / ratio, rows / ratio);
    }

    // From the face through the detector's hue to white light, or to a deep hue on paper.
    colour(hue, share) {
      const [r, g, b] = rgb(hue), s = Math.min(Math.max(share, 0), 1);
      if (this.name === "light") return [r, g, b, 255 * Math.min(1.05 * s ** 0.8, 1)];
      const white = Math.max(s - 0.45, 0) / 0.55 * 0.75;
      return [r + (255 - r) * white, g + (255 - g) * white, b + (255 - b) * white,
        255 * Math.min(1.5 * s ** 0.8, 1)];
    }
  }

  class DetectorFace extends Picture {
    constructor(canvas, rig, k, options) {
      super(canvas, rig);
      Object.assign(this, {k, bar: options.bar, trail: [], trouble: ""});
      this.draw();
    }

    // (psi, zeta) where both were measured.
    spot() {
      const found = this.readings && this.readings.slice(3 * this.k, 3 * this.k + 2);
      return found && found.every(Number.isFinite) ? found : null;
    }

    draw() {
      const pen = this.pen();
      if (!pen) return;
      const [y, z] = this.rig.detectors[this.k].half, room = 1.12 * Math.max(y, z);
      const size = Math.min(pen.wide, pen.high), scale = size / 2 / room;
      const view = {
        x: (psi) => pen.wide / 2 + scale * psi, y: (zeta) => pen.high / 2 - scale * zeta, scale,
        psi: (x) => (x - pen.wide / 2) / scale, zeta: (at) => (pen.high / 2 - at) / scale};
      const box = [view.x(-y), view.y(z), 2 * y * scale, 2 * z * scale];
      this.ground(pen, view, box, y, z);
      pen.save();
      pen.beginPath();
      pen.rect(...box);
      pen.clip();
      this.path(pen, view);
      this.irradiance(pen, view, box);
      pen.restore();
      const spot = this.spot();
      if (spot) this.centroid(pen, view, spot, Math.abs(spot[0]) <= y && Math.abs(spot[1]) <= z, y, z);
      if (this.bar) this.share(pen);
      if (!this.trouble) return;
      pen.fillStyle = THEMES[this.name].bad;
      pen.font = "600 13px system-ui, sans-serif";
      pen.textAlign = "center";
      pen.fillText(this.trouble, pen.wide / 2, view.y(0.45 * z));
    }

    // The detector's share of the beam's power: a third where the mirror is centred.
    share(pen) {
      const power = this.readings ? this.readings[3 * this.k + 2] : NaN;
      if (Number.isNaN(power)) return;
      pen.fillStyle = THEMES[this.name].edge;
      pen.fillRect(0, pen.high - 4, pen.wide, 4);
      pen.fillStyle = this.rig.hues[this.name][this.k];
      pen.fillRect(0, pen.high - 4, pen.wide * Math.min(Math.max(power / this.rig.beam.power, 0), 1), 4);
    }

    ground(pen, view, box, y, z) {
      const colours = THEMES[this.name];
      pen.fillStyle = colours.face;
      pen.fillRect(...box);
      pen.strokeStyle = colours.grid;
      pen.lineWidth = 1;
      const step = y > 4 ? 2 : y > 1.5 ? 1 : 0.25;
      pen.beginPath();
      for (let n = -Math.floor(y / step); n <= y / step; n++) {
        pen.moveTo(view.x(n * step), box[1]);
        pen.lineTo(view.x(n * step), box[1] + box[3]);
      }
      for (let n = -Math.floor(z / step); n <= z / step; n++) {
        pen.moveTo(box[0], view.y(n * step));
        pen.lineTo(box[0] + box[2], view.y(n * step));
      }
      pen.stroke();
      pen.strokeStyle = colours.edge;
      pen.beginPath();
      pen.moveTo(box[0], view.y(0));
      pen.lineTo(box[0] + box[2], view.y(0));
      pen.moveTo(view.x(0), box[1]);
      pen.lineTo(view.x(0), box[1] + box[3]);
      pen.stroke();
      pen.lineWidth = 1.5;
      pen.strokeRect(...box);
      pen.fillStyle = colours.quiet;
      pen.font = "11px system-ui, sans-serif";
      pen.textAlign = "right";
      pen.fillText("ψ", box[0] + box[2] - 4, view.y(0) - 4);
      pen.textAlign = "left";
      pen.fillText("ζ", view.x(0) + 4, box[1] + 12);
      this.scaleBar(pen, box, view.scale, step, this.corner(y, z));
    }

    // Where there is room for the spot drawn large: away from the spot.
    corner(y, z) {
      const spot = this.spot() || [0, 0];
      return [spot[0] > 0.1 * y ? -1 : 1, spot[1] > 0.1 * z ? -1 : 1];
    }

    scaleBar(pen, box, scale, step, [taken, low]) {
      const colours = THEMES[this.name], beside = low < 0 && taken < 0;
      const x = beside ? box[0] + box[2] - step * scale - 44 : box[0] + 8, y = box[1] + box[3] - 9;
      pen.strokeStyle = colours.ink;
      pen.lineWidth = 2;
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x + step * scale, y);
      pen.stroke();
      pen.fillStyle = colours.ink;
      pen.fillText(`${step} mm`, x + step * scale + 5, y + 4);
    }

    path(pen, view) {
      if (this.trail.length < 2) return;
      pen.strokeStyle = this.rig.hues[this.name][this.k];
      pen.lineWidth = 1.2;
      this.trail.slice(1).forEach((spot, n) => {
        const before = this.trail[n];
        if (!Number.isFinite(before[0] + before[1] + spot[0] + spot[1])) return;
        pen.globalAlpha = 0.08 + 0.6 * (n + 1) / this.trail.length;
        pen.beginPath();
        pen.moveTo(view.x(before[0]), view.y(before[1]));
        pen.lineTo(view.x(spot[0]), view.y(spot[1]));
        pen.stroke();
      });
      pen.globalAlpha = 1;
    }

    // The spot's light, within a box of the face's pixels.
    irradiance(pen, view, box) {
      const facet = this.drawing && this.drawing.facets[this.k];
      if (!facet || !facet.lit || !facet.toBeam) return;
      const hue = this.rig.hues[this.name][this.k];
      const all = facet.spots.flat(), margin = 0.3;
      const bounds = (n) => [Math.min(...all.map((s) => s[n])) - margin,
        Math.max(...all.map((s) => s[n])) + margin];
      const [[low, high], [under, over]] = [bounds(0), bounds(1)];
      const left = Math.max(view.x(low), box[0]), right = Math.min(view.x(high), box[0] + box[2]);
      const top = Math.max(view.y(over), box[1]), bottom = Math.min(view.y(under), box[1] + box[3]);
      const light = this.light(facet);
      this.shine(pen, left, top, right - left, bottom - top, (x, y) => {
        const share = light(view.psi(x), view.zeta(y));
        return share > 0.004 ? [hue, share] : null;
      });
    }

    // (psi, zeta) -> irradiance over the beam's largest.
    light(facet) {
      const {drawing, k} = this, end = this.rig.beam.aperture;
      return (psi, zeta) => {
        const x = facet.toBeam(psi, zeta), square = x[0] * x[0] + x[1] * x[1];
        if (square > end * end || square > 14 || !Model.onFacet(drawing, k, x)) return 0;
        return facet.reflects(x) ? Math.exp(-square / 2) : 0;
      };
    }

    // A cross at the centroid and, in the corner away from it, the spot large.
    centroid(pen, view, spot, inside, y, z) {
      const colours = THEMES[this.name], hue = this.rig.hues[this.name][this.k];
      const x = Math.min(Math.max(view.x(spot[0]), 5), pen.wide - 5);
      const at = Math.min(Math.max(view.y(spot[1]), 5), pen.high - 5);
      if (!inside) {
        // an arrow at the edge, towards where the spot has gone
        const angle = Math.atan2(-(spot[1]), spot[0]);
        pen.save();
        pen.translate(view.x(Math.min(Math.max(spot[0], -y), y)), view.y(Math.min(Math.max(spot[1], -z), z)));
        pen.rotate(angle);
        pen.fillStyle = hue;
        pen.beginPath();
        pen.moveTo(2, 0);
        pen.lineTo(-10, 6);
        pen.lineTo(-10, -6);
        pen.fill();
        pen.restore();
        return;
      }
      this.lens(pen, view, spot, x, at, y, z);
      pen.strokeStyle = colours.ink;
      pen.lineWidth = 1.4;
      cross(pen, x, at, 5);
    }

    lens(pen, view, spot, x, at, y, z) {
      const facet = this.drawing && this.drawing.facets[this.k];
      if (!facet || !facet.lit || pen.wide < 130) return;
      const colours = THEMES[this.name], hue = this.rig.hues[this.name][this.k];
      const all = facet.spots.flat();
      const reach = 1.15 * Math.max(...all.map((s) => Math.hypot(s[0] - spot[0], s[1] - spot[1])));
      const radius = 0.2 * Math.min(pen.wide, pen.high);
      const [sy, sz] = this.corner(y, z);
      const middle = [view.x(sy * y) - sy * (radius + 7), view.y(sz * z) + sz * (radius + 7)];
      pen.strokeStyle = colours.quiet;
      pen.lineWidth = 1;
      const ring = Math.max(reach * view.scale, 6), far = Math.hypot(middle[0] - x, middle[1] - at);
      const u = [(middle[0] - x) / far, (middle[1] - at) / far];
      pen.beginPath();
      pen.arc(x, at, ring, 0, 7);
      pen.moveTo(x + ring * u[0], at + ring * u[1]);
      pen.lineTo(middle[0] - radius * u[0], middle[1] - radius * u[1]);
      pen.stroke();
      pen.save();
      pen.beginPath();
      pen.arc(...middle, radius, 0, 7);
      pen.fillStyle = this.name === "dark" ? "#070a0e" : "#ffffff";
      pen.fill();
      pen.clip();
      const scale = radius / reach, light = this.light(facet);
      this.shine(pen, middle[0] - radius, middle[1] - radius, 2 * radius, 2 * radius, (px, py) => {
        const share = light(spot[0] + (px - middle[0]) / scale, spot[1] - (py - middle[1]) / scale);
        return share > 0.004 ? [hue, share] : null;
      });
      pen.strokeStyle = colours.ink;
      pen.lineWidth = 1.4;
      cross(pen, ...middle, 5);
      pen.restore();
      pen.strokeStyle = colours.edge;
      pen.beginPath();
      pen.arc(...middle, radius, 0, 7);
      pen.stroke();
      pen.fillStyle = colours.ink;
      pen.font = "10.5px system-ui, sans-serif";
      pen.textAlign = "center";
      pen.fillText(`${+(2 * reach).toPrecision(2)} mm`, middle[0], middle[1] + radius - 5);
    }
  }

  // The beam as it comes down on the mirror's point, seen along it, in mm.
  class Point extends Picture {
    constructor(canvas, rig) {
      super(canvas, rig);
      this.draw();
    }

    draw() {
      const pen = this.pen(), {drawing, rig} = this;
      if (!pen || !drawing) return;
      const colours = THEMES[this.name], hues = rig.hues[this.name];
      const [sx, sy] = rig.beam.sigma, reach = 1.55 * Math.max(sx, sy) * 2;
      const half = Math.min(pen.wide, pen.high) / 2, scale = this.scale = half / reach;  // pixels a mm
      const middle = [pen.wide / 2, pen.high / 2];
      // pixels to sigmas: the beam's own axes turn against the world's
      const [c, s] = [Math.cos(rig.beam.rotation), Math.sin(rig.beam.rotation)];
      const toBeam = (x, y) => {
        const [dx, dy] = [(x - middle[0]) / scale, (middle[1] - y) / scale];
        return [(c * dx + s * dy) / sx, (c * dy - s * dx) / sy];
      };
      const toPixel = ([a, b]) => {
        const [dx, dy] = [c * a * sx - s * b * sy, s * a * sx + c * b * sy];
        return [middle[0] + scale * dx, middle[1] - scale * dy];
      };
      pen.save();
      pen.beginPath();
      pen.arc(...middle, half - 2, 0, 7);
      pen.fillStyle = colours.face;
      pen.fill();
      pen.clip();
      const side = 2 * half;
      this.shine(pen, middle[0] - half, middle[1] - half, side, side, (x, y) => {
        const place = toBeam(x, y), square = place[0] * place[0] + place[1] * place[1];
        if (square > 14 || square > rig.beam.aperture ** 2) return null;
        const k = [0, 1, 2].find((n) => drawing.facets[n].meets && Model.onFacet(drawing, n, place));
        if (k === undefined || !drawing.facets[k].reflects(place)) return null;
        return [hues[k], Math.exp(-square / 2)];
      });
      const apex = toPixel(drawing.q);
      pen.strokeStyle = colours.ink;
      pen.lineWidth = 1.4;
      pen.beginPath();
      for (const u of drawing.sides) {
        const far = toPixel([drawing.q[0] + 30 * u[0], drawing.q[1] + 30 * u[1]]);
        pen.moveTo(...apex);
        pen.lineTo(...far);
      }
      pen.stroke();
      pen.setLineDash([4, 3]);
      pen.strokeStyle = colours.quiet;
      pen.beginPath();
      pen.ellipse(...middle, 2 * sx * scale, 2 * sy * scale, -rig.beam.rotation, 0, 7);
      pen.stroke();
      pen.setLineDash([]);
      cross(pen, ...middle, 5);
      pen.restore();
      pen.strokeStyle = colours.edge;
      pen.lineWidth = 1.5;
      pen.beginPath();
      pen.arc(...middle, half - 2, 0, 7);
      pen.stroke();
      this.letters(pen, toPixel, half, middle);
      this.bar(pen, scale, middle, half);
    }

    letters(pen, toPixel, half, middle) {
      const {drawing, rig} = this;
      pen.font = "600 13px system-ui, sans-serif";
      pen.textAlign = "center";
      drawing.facets.forEach((facet, k) => {
        if (!(facet.facing > 0)) return;
        const u = drawing.sides[k], v = drawing.sides[(k + 1) % 3], between = [u[0] + v[0], u[1] + v[1]];
        const far = toPixel(between), from = toPixel([0, 0]);
        const size = Math.hypot(far[0] - from[0], far[1] - from[1]) || 1;
        const at = [0, 1].map((n) => middle[n] + 0.82 * half * (far[n] - from[n]) / size);
        pen.fillStyle = rig.hues[this.name][k];
        pen.fillText("ABC"[k], at[0], at[1] + 5);
      });
    }

    bar(pen, scale, middle, half) {
      const colours = THEMES[this.name], length = [2, 1, 0.5, 0.2, 0.1, 0.05, 0.02].find(
        (mm) => mm * scale < 0.5 * half) || 0.01;
      const x = middle[0] + half - 2 - length * scale, y = middle[1] + half - 5;
      pen.strokeStyle = pen.fillStyle = colours.ink;
      pen.lineWidth = 2;
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x + length * scale, y);
      pen.stroke();
      pen.font = "11px system-ui, sans-serif";
      pen.textAlign = "right";
      pen.strokeStyle = colours.ground;
      pen.lineWidth = 4;
      pen.strokeText(`${length} mm`, x + length * scale, y - 5);
      pen.fillText(`${length} mm`, x + length * scale, y - 5);
    }
  }

  function cross(pen, x, y, size) {
    pen.beginPath();
    pen.moveTo(x - size, y);
    pen.lineTo(x + size, y);
    pen.moveTo(x, y - size);
    pen.lineTo(x, y + size);
    pen.stroke();
  }

  return {
    detector: (canvas, rig, k, options = {}) => new DetectorFace(canvas, rig, k, options),
    point: (canvas, rig) => new Point(canvas, rig),
  };
})();
