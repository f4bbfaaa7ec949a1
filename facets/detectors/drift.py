"""Slow noise of a bench: 1/f noise of the amplifiers, air, the beam's pointing, the temperature.

With the amplitudes a of `Drift` these are power laws of the one-sided density: flicker noise,
a^2 / f, of each reading, and random walks, a^2 / f^2, of the beam's position and the temperature.
"""

from __future__ import annotations

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from .noise import ELECTRIC, variances
from .temperature import PLACES


def flicker_densities(sensor: Sensor, reading: Floats) -> Floats:
    """Densities of the 1/f noise of readings (..., 9) at 1 Hz: (..., 9), mm^2/Hz and mW^2/Hz."""
    density = np.zeros(reading.shape)
    electronics, drift = sensor.electronics, sensor.drift
    if electronics is not None:
        amplifier = variances(sensor, reading)[..., ELECTRIC.index("amplifier")]
        density += drift.flicker_corner * amplifier / electronics.bandwidth
    density[..., PLACES] += drift.air**2
    return density


def draw_flicker(density: Floats, count: int, step: float, rng: np.random.Generator) -> Floats:
    """Draw noise (count, m) of densities (m,) / f, from its first value on.

    density: at 1 Hz.  step: between samples, s.
    """
    size = 2 * count  # the draw repeats itself after that, and lacks what is slower
    frequency = np.fft.rfftfreq(size, step)[1:, None]
    parts = rng.standard_normal((2, len(frequency), len(density)))
    scale = np.sqrt(density / frequency * size / (4 * step))
    spectrum = np.concatenate([np.zeros((1, len(density))), scale * (parts[0] + 1j * parts[1])])
    drawn: Floats = np.fft.irfft(spectrum, size, axis=0)[:count]
    drawn -= drawn[:1].copy()
    return drawn


def draw_walk(density: Floats, count: int, step: float, rng: np.random.Generator) -> Floats:
    """Draw random walks (count, m) of densities (m,) / f^2, from 0 on.

    After the time t the variance is 2 pi^2 density t, over the whole record. For 1 / f^2, samples
    have (pi step / sin(pi f step))^2: what is above half their rate is folded below it.
    """
    walks = np.zeros((count, len(density)))
    steps = rng.standard_normal((count - 1, len(density)))
    np.cumsum(np.pi * np.sqrt(2 * density * step) * steps, axis=0, out=walks[1:])
    return walks


def draw_beam_and_temperature(
    sensor: Sensor, count: int, step: float, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Draw the shift of the beam (count, 2), mm, and of the temperature (count,), K."""
    drift = sensor.drift
    amplitude = np.array([drift.pointing, drift.pointing, drift.temperature])
    walks = draw_walk(amplitude**2, count, step, rng)
    return walks[:, :2] + np.outer(walks[:, 2], sensor.thermal.beam), walks[:, 2]


def draw_readings(
    sensor: Sensor, exact: Floats, warmer: Floats, step: float, rng: np.random.Generator
) -> Floats:
    """Draw the slow noise of readings (n, 9).  warmer: (n,) shift of the temperature, K."""
    mean = exact[np.isfinite(exact).all(axis=1)].mean(axis=0)
    drawn = draw_flicker(flicker_densities(sensor, mean), len(exact), step, rng)
    drawn[:, PLACES] += np.outer(warmer, sensor.thermal.places)
    return drawn
