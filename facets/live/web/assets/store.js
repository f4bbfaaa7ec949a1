// What a page holds of a run: bins of two widths, which the server sends as they change.

const HEAD = 24;

export class Level {
  constructor({ width, count }, columns) {
    this.width = width;
    this.count = count;
    this.columns = columns;
    this.clear(width);
  }

  clear(width) {
    this.width = width;
    this.numbers = new Int32Array(this.count).fill(-1);
    this.values = new Float32Array(this.count * this.columns);
    this.newest = -1;
    this.oldest = Infinity;
  }

  put(numbers, values) {
    for (let i = 0; i < numbers.length; i++) {
      const place = numbers[i] % this.count;
      this.numbers[place] = numbers[i];
      this.values.set(values.subarray(i * this.columns, (i + 1) * this.columns), place * this.columns);
      if (numbers[i] > this.newest) this.newest = numbers[i];
      if (numbers[i] < this.oldest) this.oldest = numbers[i];
    }
    this.oldest = Math.max(this.oldest, this.newest - this.count + 1);
  }

  // The offset of a bin's values, -1 where it is not held.
  offset(number) {
    if (number < 0) return -1;
    const place = number % this.count;
    return this.numbers[place] === number ? place * this.columns : -1;
  }
}

export class Store {
  constructor(hello) {
    this.columns = hello.columns;
    this.index = Object.fromEntries(hello.columns.map((name, i) => [name, i]));
    this.states = hello.states;
    this.extras = hello.extras;
    this.levels = hello.levels.map((level) => new Level(level, hello.columns.length));
  }

  // Takes in a message of the server; the order of its parts is that of hub.py.
  take(buffer) {
    const head = new DataView(buffer);
    const level = this.levels[head.getUint32(0, true)];
    const width = head.getFloat64(8, true), count = head.getUint32(16, true);
    if (head.getUint32(4, true) || width !== level.width) level.clear(width);
    const numbers = new Int32Array(buffer, HEAD, count);
    level.put(numbers, new Float32Array(buffer, HEAD + 4 * count, count * level.columns));
  }

  // From when to when there is anything, s; null where there is nothing.
  range() {
    const all = this.levels[1];
    if (all.newest < 0) return null;
    return [all.oldest * all.width, this.end()];
  }

  end() {
    return Math.min(...this.levels.filter((one) => one.newest >= 0).map((one) => (one.newest + 1) * one.width));
  }

  // The finest bins that there are from a time on.
  level(from) {
    const [near, all] = this.levels;
    if (near.newest < 0 || all.width <= near.width) return all;
    return from >= near.oldest * near.width ? near : all;
  }

  // What strips of so many pixels show between two times: for each group of bins its middle (s), the
  // samples in it, those with a pose, and by component least, most, mean and u; null for unknown.
  // After the components of the state come the extras: the object's poses, then auxiliary channels.
  view(from, to, pixels) {
    const level = this.level(from), w = level.width;
    const step = Math.max(1, Math.ceil((to - from) / w / Math.max(50, pixels)));
    const first = Math.max(0, Math.floor(from / w / step) * step);
    const last = Math.min(Math.ceil(to / w), level.newest);
    const names = [...this.states, ...this.extras], n = names.length, v = level.values;
    const at = ["least_", "most_", "mean_", "u_"].map((part) => names.map((name) => this.index[part + name] ?? this.index[`most_${part}${name}`]));
    const found = { t: [], samples: [], poses: [], width: w * step,
      least: names.map(() => []), most: names.map(() => []), mean: names.map(() => []), u: names.map(() => []) };
    const least = new Array(n), most = new Array(n), sum = new Array(n), u = new Array(n), count = new Array(n);
    for (let start = first; start <= last; start += step) {
      let samples = 0, poses = 0;
      least.fill(Infinity); most.fill(-Infinity); sum.fill(0); u.fill(-Infinity); count.fill(0);
      for (let k = start; k < start + step; k++) {
        const o = level.offset(k);
        if (o < 0) continue;
        samples += v[o];
        poses += v[o + 1];
        for (let i = 0; i < n; i++) {
          const known = i < this.states.length ? v[o + 1] : v[o], mean = v[o + at[2][i]];
          if (!known || Number.isNaN(mean)) continue;
          count[i] += known;
          least[i] = Math.min(least[i], v[o + at[0][i]]);
          most[i] = Math.max(most[i], v[o + at[1][i]]);
          sum[i] += known * mean;
          if (at[3][i] !== undefined) u[i] = Math.max(u[i], v[o + at[3][i]]);
        }
      }
      found.t.push((start + step / 2) * w);
      found.samples.push(samples);
      found.poses.push(poses);
      for (let i = 0; i < n; i++) {
        found.least[i].push(count[i] ? least[i] : null);
        found.most[i].push(count[i] ? most[i] : null);
        found.mean[i].push(count[i] ? sum[i] / count[i] : null);
        found.u[i].push(count[i] && isFinite(u[i]) ? u[i] : null);
      }
    }
    return found;
  }

  // The bin at a time as a sample; null where there is none.
  at(time) {
    const level = this.level(time);
    const number = Math.floor(time / level.width);
    const o = level.offset(number);
    if (o < 0) return null;
    const number_of = (x) => (Number.isFinite(x) ? x : null);
    const part = (name, n) => Array.from(level.values.subarray(o + this.index[name], o + this.index[name] + n), number_of);
    const n = this.states.length, samples = level.values[o], poses = level.values[o + 1];
    return {
      t: (number + 0.5) * level.width, width: level.width, samples, poses, pose: poses > 0, flags: 0,
      status: poses > 0 ? `mean of ${poses} poses` : "no sample then has a pose",
      state: part("mean_" + this.states[0], n), u: part("u_" + this.states[0], n),
      channels: this.extras.map((name) => number_of(level.values[o + this.index["mean_" + name]])),
      reading: part(this.columns[3], 9), residual: number_of(level.values[o + 2]), utc: null, bin: true,
    };
  }

  // Mean readings of bins until a time, the newest last: where the spots were.
  trail(until, seconds) {
    const level = this.level(until - seconds);
    const last = Math.floor(until / level.width), found = [];
    const step = Math.max(1, Math.round(seconds / level.width / 100));
    for (let k = Math.max(0, last - Math.round(seconds / level.width)); k <= last; k += step) {
      const o = level.offset(k);
      if (o >= 0) found.push(level.values.subarray(o + 3, o + 12));
    }
    return found;
  }
}
