// The noise of nine readings: its size by the package's text (facets.detectors.noise), and samples.
//
//   Noise.deviations(sensor, values)    standard deviations (9) of readings (9); mm, mW
//   Noise.sample(sensor, values, seed)  the readings with noise; the same seed gives the same
//   Noise.saturated(sensor, values)     whether each detector is saturated (3)

const Noise = (() => {
  function variance(sensor, k, [psi, zeta, power]) {
    if (!sensor.electronics) {
      const place = simplePlaceVariance(sensor.noise, power);
      return [place, place, simplePowerVariance(sensor.noise, power)];
    }
    const {size_y, size_z} = sensor.psds[k], light = SOLVER.noise.gain * power;
    return [
      twoLayerPlaceVariance(psi / (size_y / 2), size_y / 2, light, SOLVER.noise),
      twoLayerPlaceVariance(zeta / (size_z / 2), size_z / 2, light, SOLVER.noise),
      twoLayerPowerVariance(light, SOLVER.noise),
    ];
  }

  function deviations(sensor, values) {
    return [0, 1, 2].flatMap((k) => variance(sensor, k, values.slice(3 * k, 3 * k + 3)))
      .map(Math.sqrt);
  }

  // Uniform numbers between 0 and 1 by a seed (mulberry32).
  function uniform(seed) {
    let word = seed >>> 0;
    return () => {
      word = (word + 0x6d2b79f5) >>> 0;
      let mixed = Math.imul(word ^ (word >>> 15), 1 | word);
      mixed = (mixed + Math.imul(mixed ^ (mixed >>> 7), 61 | mixed)) ^ mixed;
      return (((mixed ^ (mixed >>> 14)) >>> 0) + 0.5) / 4294967296;
    };
  }

  // Standard normal numbers, by Box and Muller.
  function normal(seed) {
    const next = uniform(seed);
    return () => Math.sqrt(-2 * Math.log(next())) * Math.cos(2 * Math.PI * next());
  }

  // The largest currents of duo-lateral detectors over the end of their range (3), as noise.fullness.
  function fullness(sensor, reading) {
    return reading.map(([psi, zeta, power], k) => {
      const {size_y, size_z} = sensor.psds[k];
      const off = Math.min(Math.max(Math.abs(psi) / (size_y / 2), Math.abs(zeta) / (size_z / 2)), 1);
      return power * (0.5 + off / 2) / RANGE.full;
    });
  }

  // Whether the light on each detector drives an amplifier past the end of its range.
  function saturated(sensor, values) {
    const nested = [0, 1, 2].map((k) => values.slice(3 * k, 3 * k + 3));
    return fullness(sensor, nested).map((share) => share > 1);
  }

  // A detector that its spot misses reads nothing, and neither does one that is saturated.
  function sample(sensor, values, seed) {
    const full = saturated(sensor, values), next = normal(seed), noisy = deviations(sensor, values).map((s, n) => values[n] + s * next());
    sensor.psds.forEach(({size_y, size_z}, k) => {
      const inside = Math.abs(values[3 * k]) <= size_y / 2 && Math.abs(values[3 * k + 1]) <= size_z / 2;
      if (!inside || full[k]) noisy.fill(NaN, 3 * k, 3 * k + 3);
    });
    return noisy;
  }

  return {deviations, fullness, sample, saturated};
})();
