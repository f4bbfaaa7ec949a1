// Strips over time: a pose's components with their uncertainty, of the mirror and of the object, and
// auxiliary channels.

const { decimals, fine, minus, signed } = Digits;

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// Around a strip, px: half of a label's height, and half of the width of the last time below it.
const PAD = 8, RIGHT = 30;

export class Strips {
  // hooks: zoom(from, to), wheel(factor, at), follow(), hover(time or null)
  // kind: whose pose is shown: that of the mirror, the object, its displacement, or all.
  constructor(root, { components: states, channels, extras }, hooks, kind = "all") {
    this.root = root;
    this.hooks = hooks;
    const objects = ["object", "displacement"].flatMap((kind) => states.map((one) => (
      { ...one, name: `${kind} ${one.name}`, kind, shown: true, extra: extras.indexOf(`${kind}_${one.name}_${one.unit}`),
        u: extras.indexOf(`u_${kind}_${one.name}_${one.unit}`) }))).filter(({ extra }) => extra >= 0);
    const components = [...states.map((one) => ({ ...one, kind: "mirror" })), ...objects,
      ...channels.map(({ name, unit }, n) => (
        { name, unit: unit === "1" ? "" : unit, shown: true, channel: objects.length + n }))];
    this.kinds = [...new Set(components.map(({ kind }) => kind).filter(Boolean))];
    this.plots = [];
    root.replaceChildren();
    components.forEach((one, i) => {
      if (one.shown && (kind === "all" || [undefined, kind].includes(one.kind))) this.plots.push(this.strip(one, i));
    });
    const last = this.plots.at(-1);
    last.box.classList.add("last");
    this.plots.forEach((plot) => this.draw(plot, plot === last));
    this.resizing = new ResizeObserver(() => this.fit());
    this.resizing.observe(root);
  }

  strip(component, i) {
    const box = document.createElement("div");
    box.className = "strip";
    box.innerHTML = '<div class="value"><div class="head"><b></b><span class="scale"></span></div><div class="number"></div><div class="u"></div></div><div class="plot"></div>';
    box.dataset.name = component.name;
    box.querySelector("b").textContent = component.name;
    this.root.append(box);
    return { component, i, box, base: null, view: null };
  }

  draw(plot, last) {
    const place = plot.box.querySelector(".plot");
    const line = (more) => ({ points: { show: false }, ...more });
    const axis = { stroke: () => css("--quiet"), grid: { stroke: () => css("--grid"), width: 1 },
      ticks: { stroke: () => css("--grid"), width: 1, size: 4 }, font: "11px system-ui, sans-serif" };
    plot.u = new uPlot({
      width: Math.max(100, place.clientWidth), height: Math.max(40, place.clientHeight),
      padding: [PAD, RIGHT, last ? 0 : PAD, 0], legend: { show: false },
      cursor: { sync: { key: "strips", setSeries: false }, y: false, points: { show: false },
        drag: { x: true, y: false, setScale: false }, bind: { dblclick: () => () => this.hooks.follow() } },
      scales: { x: { time: false, auto: false }, y: { auto: false } },
      series: [{},
        line({ stroke: null, width: 0 }), line({ stroke: null, width: 0 }),
        line({ stroke: null, width: 0 }), line({ stroke: null, width: 0 }),
        line({ stroke: () => css("--trace"), width: 1.25 })],
      bands: [{ series: [1, 2], fill: () => css("--range") }, { series: [3, 4], fill: () => css("--sigma") }],
      axes: [{ ...axis, show: last, size: 26, values: (_, at) => at.map((t) => `${+t.toFixed(4)} s`) },
        { ...axis, size: 58, space: 18, values: (u, at) => this.ticks(plot, u, at) }],
      hooks: {
        setSelect: [(u) => this.select(u)],
        setCursor: [(u) => this.hover(u)],
        draw: [(u) => this.mark(plot, u)],
      },
    }, [[0], [null], [null], [null], [null], [null]], place);
    plot.u.over.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.hooks.wheel(Math.exp(event.deltaY / 400), plot.u.posToVal(event.offsetX, "x"));
    }, { passive: false });
    plot.u.over.addEventListener("mouseleave", () => this.hooks.hover(null));
  }

  close() {
    this.resizing.disconnect();
    for (const { u } of this.plots) u.destroy();
  }

  fit() {
    for (const { box, u } of this.plots) {
      const place = box.querySelector(".plot");
      u.setSize({ width: Math.max(100, place.clientWidth), height: Math.max(40, place.clientHeight) });
    }
  }

  get pixels() {
    return this.plots[0].u.over.clientWidth || 600;
  }

  // Labels in mm or mrad; of a narrow strip in um or urad from a round number, which is said beside.
  ticks(plot, u, at) {
    const { min, max } = u.scales.y, { unit, fine: small } = plot.component, span = max - min;
    const note = plot.box.querySelector(".scale");
    if (plot.component.channel !== undefined) {
      note.textContent = unit;
      return at.map((v) => String(+v.toPrecision(6)).replace("-", "−"));
    }
    if (span > 0.02 * 1.5 || !at.length) {
      note.textContent = unit;
      return at.map((v) => minus(String(+v.toFixed(4))));
    }
    const digits = Math.max(2, Math.ceil(-Math.log10(span)));
    const base = +((min + max) / 2).toFixed(digits);
    note.textContent = base === 0 ? small : `${small} from ${signed(base, digits)} ${unit}`;
    return at.map((v) => minus(String(+(1e3 * (v - base)).toFixed(4))));
  }

  select(u) {
    const { left, width } = u.select;
    if (width < 4) return;
    this.hooks.zoom(u.posToVal(left, "x"), u.posToVal(left + width, "x"));
    u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
  }

  hover(u) {
    const { left } = u.cursor;
    if (u.cursor.event && left >= 0) this.hooks.hover(u.posToVal(left, "x"));
  }

  // Where samples had no pose: a bar at the bottom; and the time that is looked at.
  mark(plot, u) {
    const { ctx, bbox } = u, view = plot.view;
    if (!view) return;
    ctx.save();
    ctx.fillStyle = css("--bad");
    const high = 4 * devicePixelRatio, bars = plot.component.channel === undefined ? view.t.length : 0;
    for (let k = 0; k < bars; k++) {
      if (view.samples[k] <= view.poses[k]) continue;
      const x0 = u.valToPos(view.t[k] - view.width / 2, "x", true), x1 = u.valToPos(view.t[k] + view.width / 2, "x", true);
      ctx.fillRect(Math.max(x0, bbox.left), bbox.top + bbox.height - high, Math.max(1, x1 - Math.max(x0, bbox.left)), high);
    }
    if (plot.at !== null && plot.at !== undefined) {
      const x = u.valToPos(plot.at, "x", true);
      if (x >= bbox.left && x <= bbox.left + bbox.width) {
        ctx.fillStyle = css("--quiet");
        ctx.fillRect(x, bbox.top, devicePixelRatio, bbox.height);
      }
    }
    ctx.restore();
  }

  // Draws what there is between two times. at: the time that is looked at, null for the newest.
  show(view, from, to, at) {
    for (const plot of this.plots) {
      const i = plot.i, mean = view.mean[i], u = view.u[i];
      plot.view = view;
      plot.at = at;
      const [min, max] = extent(view.least[i], view.most[i], mean, u, plot.component.channel === undefined ? 0 : 1e-3);
      plot.u.batch(() => {
        plot.u.setData([view.t, view.most[i], view.least[i],
          mean.map((m, k) => (m === null || u[k] === null ? null : m + u[k])),
          mean.map((m, k) => (m === null || u[k] === null ? null : m - u[k])), mean], false);
        plot.u.setScale("x", { min: from, max: to });
        plot.u.setScale("y", { min, max });
      });
    }
  }

  // The numbers beside the strips: of a sample, or why there are none.
  write(sample, why) {
    for (const { component, i, box } of this.plots) {
      if (component.channel !== undefined) {
        this.write_channel(component, box, sample?.channels[component.channel] ?? null, sample ? "" : why);
        continue;
      }
      const [value, u] = value_of(sample, component, i);
      const number = box.querySelector(".number"), below = box.querySelector(".u");
      number.classList.toggle("why", value === null);
      number.textContent = value === null ? "no pose" : `${signed(value, decimals(u))} ${component.unit}`;
      number.dataset.value = value === null ? "" : value;
      below.textContent = value === null ? why : u === null ? "u unknown" : `u ${fine(u, component.unit)}`;
      for (const [part, sizes] of Object.entries(value === null || component.kind !== "mirror" ? {} : sample.parts ?? {}))
        if (sizes[i] !== null) below.textContent += ` · ${part} ${fine(sizes[i], component.unit)}`;
      below.title = below.textContent;
    }
  }

  write_channel(component, box, value, why) {
    const number = box.querySelector(".number");
    number.classList.toggle("why", value === null);
    number.textContent = value === null ? "no value" : `${String(+value.toPrecision(5)).replace("-", "−")} ${component.unit}`;
    number.dataset.value = value === null ? "" : value;
    box.querySelector(".u").textContent = why;
  }
}

// The value of a component in a sample, and its uncertainty; null for unknown.
function value_of(sample, { kind, extra, u }, i) {
  if (!sample?.pose) return [null, null];
  return kind === "mirror" ? [sample.state[i], sample.u[i]] : [sample.channels[extra], sample.channels[u]];
}

// The ends of a strip. smallest: room above and below, as a share of the values.
function extent(least, most, mean, u, smallest) {
  let low = Infinity, high = -Infinity, widest = 0;
  for (let k = 0; k < least.length; k++) {
    if (least[k] === null) continue;
    low = Math.min(low, least[k], mean[k] - (u[k] ?? 0));
    high = Math.max(high, most[k], mean[k] + (u[k] ?? 0));
    widest = Math.max(widest, u[k] ?? 0);
  }
  if (low > high) return [-1, 1];
  const room = Math.max(0.06 * (high - low), widest, smallest * Math.max(Math.abs(low), Math.abs(high)), 1e-9);
  return [low - room, high + room];
}
