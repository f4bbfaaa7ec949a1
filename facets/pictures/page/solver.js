// From nine readings to the mirror's pose: the package's own estimate, for one reading at a time.
//
//   const solver = Solver.create(sensor, geometry, readings);
//   solver.solve(values, {beam: "free" | "known", power: "known" | "unknown", place: [x, y]})
//     place: where the beam is known to be, mm; the origin by default
//     -> {status, converged, ok, state, power, used, steps, residual, checks, limit, covariance,
//         uncertainty}; lengths in mm, angles in rad, power in mW; NaN where there is no pose.
//   solver.refusal({beam, power})   why this page cannot solve so; "" where it can
//
// ESTIMATORS has the functions of facets.estimation.step, made from the package's text. Here are the
// loop, their arguments, as facets.estimation.plan makes them, and their results in words.

const Solver = (() => {
  const nothing = (...shape) => (shape.length === 1 ? Array(shape[0]).fill(NaN)
    : Array.from({length: shape[0]}, () => nothing(...shape.slice(1))));

  // By elimination, in place.
  function signOfDeterminant(rows) {
    let sign = 1;
    for (let j = 0; j < rows.length; j++) {
      for (let i = j + 1; i < rows.length; i++) {
        if (!(Math.abs(rows[i][j]) > Math.abs(rows[j][j]))) continue;
        [rows[i], rows[j]] = [rows[j], rows[i]];
        sign = -sign;
      }
      const pivot = rows[j][j];
      sign *= Math.sign(pivot);
      if (!sign) return 0;
      for (let i = j + 1; i < rows.length; i++) {
        const share = rows[i][j] / pivot;
        for (let k = j; k < rows.length; k++) rows[i][k] -= share * rows[j][k];
      }
    }
    return sign;
  }

  function create(sensor, geometry) {
    const limits = screeningLimits();

    // As plan.make_limits.
    function screeningLimits() {
      const {floor, light, rounding} = SOLVER.limits, {noise, psds, beam, apertures} = sensor;
      const width = apertures.detectors ? Math.max(beam.diameter_x, beam.diameter_y) / 2 : 0;
      return {
        noise: [noise.position, noise.at_power, floor], light, eight: false,
        usable: psds.map(({size_y, size_z, usable: [lowY, highY, lowZ, highZ]}) => {
          const [y, z] = [size_y / 2 - width, size_z / 2 - width];
          return [Math.max(-y, lowY), Math.min(y, highY), Math.max(-z, lowZ), Math.min(z, highZ)];
        }),
        rounding: [rounding * distance(), rounding * beam.power],
      };
    }

    function distance() {
      return Math.max(...sensor.psds.map(({radius, height}) => Math.hypot(radius, height)));
    }

    // As doubts.sample_sizes.
    function sampleSizes() {
      const half = Math.min(...sensor.psds.flatMap(({size_y, size_z}) => [size_y, size_z])) / 2;
      const across = SOLVER.offset * Math.min(sensor.beam.diameter_x, sensor.beam.diameter_y);
      const turn = half / (2 * distance());
      return [across, across, half, turn, turn, turn, across, across];
    }

    function start(plan, values, place) {
      const means = [...place || plan.means.slice(0, 2), sensor.beam.power];
      const seen = values.filter((value, n) => n % 3 === 2 && !Number.isNaN(value))
        .reduce((sum, value) => sum + value, 0);
      const unknown = plan.weights[2] === 0 && plan.free.at(-1) === 8;
      const power = unknown && Number.isFinite(seen) && seen > 0 ? seen : means[2];
      return {means, first: [means[0], means[1], 0, 0, 0, 0, means[0], means[1], power]};
    }

    // Whether the determinant of the first eight readings has both signs, as doubts.has_fold.
    let folds = null;
    function hasFold() {
      if (folds !== null) return folds;
      const sizes = sampleSizes(), seen = new Set();
      for (const sample of SOLVER.samples) {
        const state = sample.map((x, n) => x * sizes[n]);
        state[0] += state[6];
        state[1] += state[7];
        const rows = lineariseIdeal(geometry, state).flatMap(([, each]) => each).slice(0, 8);
        if (!rows.flat().every(Number.isFinite)) continue;
        seen.add(signOfDeterminant(rows));
      }
      folds = seen.has(1) && seen.has(-1);
      return folds;
    }

    function refusal({beam = "free"} = {}) {
      return SOLVER.refusal || (beam === "free" && hasFold() ? SOLVER.fold : "");
    }

    // Whether a used spot reaches past its detector's edge, where it is cut: doubts.cut_spots.
    function isCut(state, used) {
      if (!sensor.apertures.detectors) return false;
      return footprints(geometry, state).some(([left, right, low, high], k) => {
        const {size_y, size_z} = sensor.psds[k];
        return used[k] && !(Math.min(size_y / 2 + left, size_y / 2 - right, size_z / 2 + low, size_z / 2 - high) >= 0);
      });
    }

    function solve(values, {beam = "free", power = "known", start: near, place} = {}) {
      const plan = SOLVER.plans[`${beam} ${power}`];
      const {means, first} = start(plan, values, beam === "known" && place);
      if (near) first.splice(0, 6, ...near.slice(0, 6));
      const weighed = sensor.electronics !== null;
      const scales = {
        ...limits, weight: plan.weights, weighed, checks: plan.none, accepts: false, damped: true, most_steps: 50,
        least_redundancy: 0,
      };
      const weights = weighed ? Noise.deviations(sensor, values).map((sigma) => 1 / sigma) : values;
      const {ask, begin, step, results} = ESTIMATORS[plan.free.slice(6).join("")];
      const [question, status, used] = ask(values, weights, means, scales);
      const estimate = (derivatives) => {
        let state = begin(first, status);
        while (state.status < 0) {
          state = step(state, question, geometry,
            (x) => derivatives({...geometry, power: x[8]}, x.slice(0, 8)));
        }
        return state;
      };
      let end = estimate(linearise);
      if (lineariseExactly && SOLVER.statuses[end.status] === "stalled") end = estimate(lineariseExactly);
      return told(plan, end, results(end), used.map(Boolean));
    }

    function told(plan, end, [residual, ofState], used) {
      const count = used.filter(Boolean).length, ended = SOLVER.statuses[end.status];
      const cut = ended === "converged" && isCut(end.trial, used);
      const status = cut ? "out of range" : ended, converged = status === "converged";
      const checks = Math.max(3 * count + plan.none, 0), limit = plan.limits[checks];
      const covariance = converged ? ofState : nothing(8, 8);
      return {
        status, converged, ok: converged && !(residual > limit),
        state: converged ? end.trial.slice(0, 8) : nothing(8),
        power: converged ? end.trial[8] : NaN, used, steps: end.steps,
        residual: converged ? residual : NaN, checks, limit, covariance,
        uncertainty: covariance.map((row, n) => Math.sqrt(row[n])),
      };
    }

    return {solve, refusal};
  }

  return {create};
})();
