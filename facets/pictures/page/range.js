// How far the mirror may go from rest, and what ends its range there: the limits of
// facets.characterization.ranges for one pose at a time, with the readings, derivatives and
// footprints of the package's text.
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

    // The least margin of a spot, as ranges.spot_clearances.
    function spotClearance(ends, reading) {
      const margins = reading.flatMap(([psi, zeta], k) => {
        const {size_y, size_z} = sensor.psds[k], [y, z] = [size_y / 2, size_z / 2], {rim} = sensor.apertures;
        let sides = ends[k];
        const bare = Number.isNaN(sides[0]) && !Number.isNaN(psi);
        if (bare || !rules.whole_spot) {
          sides = [psi, psi, zeta, zeta, bare && rules.whole_spot ? -Infinity : sides[4]];
        }
        const [left, right, low, high, out] = sides;
        return [(y + left) / y, (y - right) / y, (z + low) / z, (z - high) / z, rim - out];
      });
      return margins.some(Number.isNaN) ? -1 : Math.max(Math.min(...margins), -1);
    }

    // The margin of light, as ranges.light_clearances.
    function lightClearance(reading) {
      const light = reading.map(([, , power], k) => (power - other[k]) / (needed[k] - other[k]));
      return Math.log(light.some(Number.isNaN) ? 1e-300 : Math.max(Math.min(...light), 1e-300));
    }

    // The margin of the amplifiers, as ranges.saturation_clearances.
    function saturationClearance(reading) {
      return -Math.log(Math.max(1e-300, ...Noise.fullness(sensor, reading).filter((share) => share > 0)));
    }

    function clearances(pose) {
      const state = stateOf(pose), values = readings(state), ends = footprints(geometry, state);
      const nested = [0, 1, 2].map((k) => values.slice(3 * k, 3 * k + 3));
      const spot = spotClearance(ends, nested);
      const light = lightClearance(nested);
      const lit = spot > -1 && light > RANGE.no_light, ask = rules.condition < Infinity
        || rules.coarsest.some((limit) => limit < Infinity);
      const saturation = full < Infinity ? saturationClearance(nested) : Infinity;
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
