// How far the mirror may go from rest, and what ends its range there: the limits of
// facets.characterization.ranges, by the package's text (clearance.py and the optics).
//
//   const ranges = Ranges.create(sensor, geometry, readings);
//   ranges.axes()          six of {low, high, lowCause, highCause}; mm and rad
//   ranges.exit(way, tolerance)  {distance, cause} along a direction (6) of the pose, in units of it;
//                          distance up to 1
//   ranges.clearances(pose)  the margins of one pose (6), in the order of `Ranges.causes`
//
// A cause is a number of `Ranges.causes`, or -1 where no limit is met. Under the light of a bench,
// conditioning and resolution are those of the derivatives with which the solver steps.

const Ranges = (() => {
  const {causes, farthest, units, rules, needed, other, full} = RANGE;
  // Shares of the farthest distance that are looked at, as ranges.STEP_SHARES.
  const shares = Array.from({length: 28}, (_, n) => 1e-3 ** (1 - n / 27));

  function create(sensor, geometry, readings) {
    function stateOf(pose) {
      return rules.tracking ? [...pose, pose[0], pose[1]] : [...pose, 0, 0];
    }

    // Conditioning, and the coarsest axis of the pose over its limit; as logarithms.
    function information(state, values) {
      const sigma = Noise.deviations(sensor, values), rows = linearise(geometry, state).flatMap(([, each]) => each);
      const scaled = rows.map((row, n) => row.map((x, c) => x * units[c] / sigma[n]));
      if (!scaled.flat().every(Number.isFinite)) return [-1, -1];
      const {singular, deviations} = decompose(scaled);
      const ratio = rules.condition * Math.min(...singular) / Math.max(...singular);
      const finest = rules.coarsest.map((limit, c) => Math.log(limit / (deviations[c] * units[c])));
      return [Math.log(ratio), Math.min(...finest)];
    }

    function clearances(pose) {
      const state = stateOf(pose), values = readings(state), ends = footprint_footprints(geometry, state);
      const nested = [0, 1, 2].map((k) => values.slice(3 * k, 3 * k + 3));
      const spot = clearance_spot_clearance(sensor, ends, nested, rules.whole_spot);
      const light = clearance_light_clearance(nested, needed, other);
      const lit = spot > -1 && light > RANGE.no_light, ask = rules.condition < Infinity
        || rules.coarsest.some((limit) => limit < Infinity);
      const saturation = full < Infinity ? clearance_saturation_clearance(sensor, nested, full) : Infinity;
      return [spot, light, saturation, ...(lit && ask ? information(state, values) : [Infinity, Infinity])];
    }

    function exit(way, tolerance = 1e-9) {
      const margins = (share) => clearances(way.map((x) => share * x));
      const inside = (share) => Math.min(...margins(share)) > 0;
      if (!inside(0)) return {distance: NaN, cause: least_of(margins(0))};
      const first = shares.findIndex((share) => !inside(share));
      if (first < 0) return {distance: 1, cause: -1};
      let [low, high] = [first ? shares[first - 1] : 0, shares[first]];
      while (high - low > tolerance / 4) {
        const middle = (low + high) / 2;
        if (inside(middle)) low = middle; else high = middle;
      }
      return {distance: low, cause: least_of(margins(high + tolerance))};
    }

    function axes() {
      return farthest.map((far, n) => {
        const [low, high] = [-far, far].map((end) => exit(farthest.map((_, c) => (c === n ? end : 0))));
        return {
          low: -far * low.distance, high: far * high.distance, lowCause: low.cause, highCause: high.cause,
        };
      });
    }

    return {axes, exit, clearances};
  }

  function least_of(values) {
    return values.indexOf(Math.min(...values));
  }

  return {create, causes};
})();
