"""Slow noise of a bench: 1/f noise of the amplifiers, air, the beam's pointing, the temperature.

Each has an amplitude a in `Drift`. Its one-sided spectral density is a^2 / f for the flicker noise
of readings, a^2 / f^2 for the random walks of the beam's position and of the temperature.
"""

from __future__ import annotations

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from .noise import ELECTRIC, variances
from .temperature import PLACES


def flicker_densities(sensor: Sensor, reading: Floats) -> Floats:
    """Densities (..., 9) of the 1/f noise of readings (..., 9) at 1 Hz, mm^2/Hz and mW^2/Hz."""
    density = np.zeros(reading.shape)
    electronics, drift = sensor.electronics, sensor.drift
    if electronics is not None:
        amplifier = variances(sensor, reading)[..., ELECTRIC.index("amplifier")]
        density += drift.flicker_corner * amplifier / electronics.bandwidth
    density[..., PLACES] += drift.air**2
    return density


def draw_flicker(density: Floats, count: int, step: float, rng: np.random.Generator) -> Floats:
    """Draw flicker noise (count, m), shifted to begin at 0.

    density: (m,) its spectral densities at 1 Hz.  step: time between samples, s.
    """
    size = 2 * count  # The draw is periodic in this length, and lacks slower noise.
    frequency = np.fft.rfftfreq(size, step)[1:, None]
    parts = rng.standard_normal((2, len(frequency), len(density)))
    scale = np.sqrt(density / frequency * size / (4 * step))
    spectrum = np.concatenate([np.zeros((1, len(density))), scale * (parts[0] + 1j * parts[1])])
    drawn: Floats = np.fft.irfft(spectrum, size, axis=0)[:count]
    drawn -= drawn[:1].copy()
    return drawn


def draw_walk(density: Floats, count: int, step: float, rng: np.random.Generator) -> Floats:
    """Draw random walks (count, m) that begin at 0.

    density: (m,) their spectral densities at 1 Hz.  step: time between samples, s. After a time t
    the variance is 2 pi^2 density t. Sampling folds frequencies above half the rate below it, so
    that the samples' density is (pi step / sin(pi f step))^2 instead of 1 / f^2.
    """
    walks = np.zeros((count, len(density)))
    steps = rng.standard_normal((count - 1, len(density)))
    np.cumsum(np.pi * np.sqrt(2 * density * step) * steps, axis=0, out=walks[1:])
    return walks


def draw_beam_and_temperature(
    sensor: Sensor, count: int, step: float, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Draw shifts of the beam's position (count, 2), mm, and of the temperature (count,), K."""
    drift = sensor.drift
    amplitude = np.array([drift.pointing, drift.pointing, drift.temperature])
    walks = draw_walk(amplitude**2, count, step, rng)
    return walks[:, :2] + np.outer(walks[:, 2], sensor.thermal.beam), walks[:, 2]


def draw_readings(
    sensor: Sensor, exact: Floats, warmer: Floats, step: float, rng: np.random.Generator
) -> Floats:
    """Draw the slow noise (n, 9) of readings `exact` (n, 9).

    warmer: (n,) shift of the temperature, K.  step: time between samples, s.
    """
    mean = exact[np.isfinite(exact).all(axis=1)].mean(axis=0)
    drawn = draw_flicker(flicker_densities(sensor, mean), len(exact), step, rng)
    drawn[:, PLACES] += np.outer(warmer, sensor.thermal.places)
    return drawn
