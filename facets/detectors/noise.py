"""Noise of readings: its size by source, and random samples in the electrodes' currents.

In the simple form, a position's noise is stated at one power and is proportional to 1/power, and a
power's noise is constant. With `Sensor.electronics`, noise arises in the electrodes' currents I_k
(A) with the variances, at a bandwidth B,

    shot         2 q I_k B, of light, dark current and ambient light
    resistance   4 k T B / R between electrodes
    amplifier    (e_n^2 / R^2 + i_n^2 + 4 k T / R_f) B, R_f its transimpedance
    ADC          (full scale / 2^bits / R_f)^2 / 12

independent between electrodes, and is propagated to position and power by the formulas of
`electrodes`. The laser's power noise and the beam's jitter are common to the three detectors and
therefore not part of a reading's noise: `simulate` draws them, and the solver uses them as priors.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.arguments import check_arguments
from ..core.sensor import Electronics, Noise, Sensor
from ..core.units import Floats
from ..model.arrays import as_vectors, half_sizes, mask_missed_spots
from ..scalars.dispatch import select
from . import electrodes

#: Elementary charge, C, and Boltzmann's constant, J/K: exact in the SI.
CHARGE, BOLTZMANN = 1.602176634e-19, 1.380649e-23
SIMPLE = ("places", "powers")
ELECTRIC = ("shot noise", "dark and ambient", "resistance", "amplifier", "ADC")


def sources(sensor: Sensor) -> tuple[str, ...]:
    """The names of the sources of a reading's noise."""
    return SIMPLE if sensor.electronics is None else ELECTRIC


@check_arguments
def standard_deviations(sensor: Sensor, reading: ArrayLike) -> Floats:
    """Compute the standard deviation of the noise of each number of readings.

    Parameters
    ----------
    sensor
        The noise follows `Sensor.electronics` where the sensor has them, else `Sensor.noise`.
    reading
        Readings without noise, (..., 9), in the order of Eq. (2): psi and zeta in mm, in the
        detector's frame, and the power in mW, of A, B and C.

    Returns
    -------
    ndarray
        One standard deviation of each number, (..., 9), mm and mW; NaN where the reading is NaN.

    Raises
    ------
    InputError
        If the last dimension of `reading` is not 9.

    Examples
    --------
    >>> import numpy as np, facets
    >>> sensor = facets.Sensor()
    >>> sigma = facets.standard_deviations(sensor, facets.readings(sensor, np.zeros(8)))
    >>> f"{1e3 * sigma[0]:.1f} um, {1e6 * sigma[2]:.0f} nW"
    '2.6 um, 40 nW'
    """
    exact, electronics = as_vectors(reading, 9, "reading"), sensor.electronics
    if electronics is None:
        var = variances(sensor, exact).sum(axis=-1)
    else:
        half, parts = half_sizes(sensor), split_detectors(exact)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            if has_two_layers(electronics):
                var = two_layer_variances(electronics, half, parts)
            else:
                var = electric_variances(electronics, half, parts, together=True)
    root: Floats = np.sqrt(var.reshape(exact.shape))
    return root


def split_detectors(exact: Floats) -> Floats:
    """Reshape readings (..., 9) to psi, zeta and power of each detector (..., 3, 3)."""
    return exact.reshape(*exact.shape[:-1], 3, 3)


def power_floor(sensor: Sensor) -> float:
    """The standard deviation of a power reading without light, mW."""
    if sensor.electronics is None:
        return sensor.noise.power
    var = current_variances(sensor.electronics, np.zeros(4)).sum()
    var /= 4 if has_two_layers(sensor.electronics) else 1
    return float(np.sqrt(var) / (1e-3 * sensor.electronics.responsivity))


#: A detector with less light than this, in standard deviations of its power, is excluded: the noise
#: of its spot's position is then not Gaussian.
FAINTEST = 10.0
#: A detector whose spot has less than this fraction of the background light is also excluded: it
#: measures the background's position, which several poses fit.
LEAST_FRACTION = 0.05


def least_light(sensor: Sensor, ratio: float = FAINTEST) -> Floats:
    """Least power (3,), mW, background included, at which each detector is used.

    ratio: least power of the spot over the standard deviation of a power reading without light.
    """
    other = other_light(sensor)
    return other + np.maximum(ratio * power_floor(sensor), LEAST_FRACTION * other)


def other_light(sensor: Sensor) -> Floats:
    """Power of the background light on each detector (3,), mW."""
    return np.array([power for power, _, _ in sensor.light.background])


@np.errstate(divide="ignore", invalid="ignore", over="ignore")  # A reading can be any number.
def variances(sensor: Sensor, reading: ArrayLike) -> Floats:
    """Noise variances of readings (..., 9), by source: (..., 9, n), mm^2 and mW^2; `sources` has
    the n names."""
    exact = np.asarray(reading, dtype=float)
    if sensor.electronics is None:
        out = np.zeros((*exact.shape, 2))
        place = simple_place_variance(sensor.noise, exact[..., 2::3])
        out[..., 0::3, 0] = out[..., 1::3, 0] = place
        out[..., 2::3, 1] = simple_power_variance(sensor.noise, exact[..., 2::3])
        return out
    parts = electric_variances(sensor.electronics, half_sizes(sensor), split_detectors(exact))
    return parts.reshape(*exact.shape, len(ELECTRIC))


def simple_place_variance(noise: Noise, power: Any) -> Any:
    """The variance of a position, mm^2, at a power, mW; floats, or arrays of one shape."""
    return (noise.position * noise.at_power / power) ** 2


def simple_power_variance(noise: Noise, power: Any) -> Any:
    """The variance of a power reading, mW^2; NaN where the power, mW, is NaN."""
    return noise.power**2 + 0 * power


def current_variances(electronics: Electronics, currents: Floats, together: bool = False) -> Floats:
    """Noise variances of the electrodes' currents (..., 4), A^2: by source (..., 4, 5), or with
    `together` their sum (..., 4, 1)."""
    e, band = electronics, electronics.bandwidth
    steady = (e.dark_current + 1e-3 * e.responsivity * e.ambient) / (2 if has_two_layers(e) else 4)
    thermal = 4 * BOLTZMANN * e.temperature * band
    amplifier = (e.voltage_noise / e.resistance) ** 2 + e.current_noise**2
    step = step_current(e)
    even = [
        2 * CHARGE * steady * band,
        thermal / e.resistance,
        amplifier * band + thermal / e.transimpedance,
        step**2 / 12,
    ]
    shot: Floats = 2 * CHARGE * band * np.abs(currents)
    if together:
        summed: Floats = shot + sum(even)
        return summed[..., None]
    out = np.empty((*currents.shape, len(ELECTRIC)))
    out[..., 0] = shot
    out[..., 1:] = even
    return out


def has_two_layers(electronics: Electronics) -> bool:
    return electronics.kind == "duo-lateral"


def electrode_currents(electronics: Electronics, half: Floats, exact: Floats) -> Floats:
    """Electrode currents (..., 3, 4), A, that readings (..., 3, 3) correspond to.

    A position past a detector's edge is moved to the edge, so that its noise is defined; callers
    that simulate readings exclude such spots by `mask_missed_spots`.  half: (3, 2) half sizes, mm.
    """
    place = np.clip(exact[..., :2] / half, -1, 1)
    light = 1e-3 * electronics.responsivity * exact[..., 2]
    if electronics.kind == "tetra-lateral":  # Each detector has its own shape.
        fraction = np.stack([
            electrodes.fractions(electronics.kind, place[..., k, 0], place[..., k, 1], tall)
            for k, tall in enumerate(half[:, 1] / half[:, 0])
        ], axis=-2)  # fmt: skip
    else:
        fraction = electrodes.fractions(electronics.kind, place[..., 0], place[..., 1])
    currents: Floats = light[..., None] * fraction
    return currents


def electric_variances(
    electronics: Electronics, half: Floats, exact: Floats, together: bool = False
) -> Floats:
    """Noise variances of psi, zeta and power of each detector, mm^2, mm^2 and mW^2, at readings
    (..., 3, 3): by source (..., 3, 3, 5), or with `together` their sum (..., 3, 3, 1)."""
    currents = electrode_currents(electronics, half, exact)
    var = current_variances(electronics, currents, together)
    return reading_variances(electronics, half, exact, currents, var)


def reading_variances(
    electronics: Electronics, half: Floats, exact: Floats, currents: Floats, var: Floats
) -> Floats:
    """Propagate m variances of electrode currents, `var` (..., 3, 4, m), to psi, zeta and power of
    each detector: (..., 3, 3, m), mm^2, mm^2 and mW^2."""
    kind, out = electronics.kind, np.empty((*exact.shape, var.shape[-1]))
    flow, noise = (electrodes.end_sums(kind, parts) for parts in (currents[..., None], var))
    below, above = flow[..., 0, :], flow[..., 1, :]
    square = above**2 * noise[..., 0, :] + below**2 * noise[..., 1, :]
    square_sum = (below + above) ** 2
    out[..., :2, :] = 4 * half[..., None] ** 2 / (square_sum * square_sum) * square
    if kind == "tetra-lateral":
        for k, tall in enumerate(half[:, 1] / half[:, 0]):
            place = np.clip(exact[..., k, :2] / half[k], -0.97, 0.97)
            slope = electrodes.slopes(place, tall)
            out[..., k, :2, :] /= np.diagonal(slope, axis1=-2, axis2=-1)[..., None] ** 2
    of_sum = var.sum(axis=-2) / (4 if has_two_layers(electronics) else 1)
    out[..., 2, :] = of_sum / (1e-3 * electronics.responsivity) ** 2
    return out


def step_variances(sensor: Sensor, reading: ArrayLike, ratio: ArrayLike = 1.0) -> Floats:
    """Variance (..., 9) of a mean of many readings at one state that the converter's steps cause,
    mm^2 and mW^2; 0 without electronics.

    With noise of standard deviation s and steps q, the error of the mean is a function of the mean
    with the period q. Its k-th harmonic is (q / pi k) exp(-2 (pi k s / q)^2).

    ratio: (...) variance of the actual noise over the electronics' variance.
    """
    exact = np.asarray(reading, dtype=float)
    if sensor.electronics is None:
        return np.zeros_like(exact)
    electronics, half, parts = sensor.electronics, half_sizes(sensor), split_detectors(exact)
    step = step_current(electronics)
    currents = electrode_currents(electronics, half, parts)
    noise = current_variances(electronics, currents)[..., :-1].sum(axis=-1)
    noise = noise * np.broadcast_to(ratio, exact.shape[:-1])[..., None, None] / step**2
    harmonics = np.zeros_like(noise)
    for k in range(1, HARMONICS + 1):
        harmonics += np.exp(-((2 * np.pi * k) ** 2) * noise) / k**2
    var = (step**2 / (2 * np.pi**2) * harmonics)[..., None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return reading_variances(electronics, half, parts, currents, var).reshape(exact.shape)


#: Number of harmonics of the steps' error; the others have a hundredth of its variance.
HARMONICS = 60


def two_layer_variances(electronics: Electronics, half: Floats, exact: Floats) -> Floats:
    """Sums over all sources (..., 3, 3) of `electric_variances` for duo-lateral detectors, in
    closed form, because a live loop computes them for each block.

    Let L be the current, p the position in half sizes h, and s |I| + e the variance of an
    electrode's current I. The variance of the position is
    h^2 (s (1 - p^2) / L + 2 e (1 + p^2) / L^2), and that of the power is (s L + 2 e) / 2 over the
    responsivity squared.
    """
    noise = two_layer_noise(electronics)
    light = noise.gain * exact[..., 2]
    out = np.empty(exact.shape)
    out[..., :2] = two_layer_place_variance(exact[..., :2] / half, half, light[..., None], noise)
    out[..., 2] = two_layer_power_variance(light, noise)
    return out


class TwoLayerNoise(NamedTuple):
    """Noise of a duo-lateral detector.  gain: responsivity, A/mW.  shot, even: A and A^2; an
    electrode with the current I has the variance shot |I| + even."""

    gain: float
    shot: float
    even: float


def two_layer_noise(electronics: Electronics) -> TwoLayerNoise:
    even = current_variances(electronics, np.zeros(1), together=True).item()
    return TwoLayerNoise(1e-3 * electronics.responsivity, 2 * CHARGE * electronics.bandwidth, even)


def two_layer_place_variance(place: Any, half: Any, light: Any, noise: TwoLayerNoise) -> Any:
    """Variance of a position on a duo-lateral detector, mm^2; floats, or arrays of one shape.

    place: the position, in half sizes `half`, which are in mm.  light: photocurrent, A.
    """
    inside = select(place > 1, 1.0, select(place < -1, -1.0, place))
    square = inside**2
    inverse = abs(light) / (light * light)  # NaN without light
    return half**2 * (
        (noise.shot * inverse) * (1 - square) + (2 * noise.even * inverse * inverse) * (1 + square)
    )


def two_layer_power_variance(light: Any, noise: TwoLayerNoise) -> Any:
    """Variance of the power on a duo-lateral detector, mW^2.  light: photocurrent, A."""
    return (noise.shot * abs(light) / 2 + noise.even) / noise.gain**2


@check_arguments
def add_noise(sensor: Sensor, reading: ArrayLike, rng: np.random.Generator) -> Floats:
    """Add noise to readings, as the sensor's detectors would.

    Parameters
    ----------
    sensor
        The noise follows `Sensor.electronics` where the sensor has them, and is then drawn in the
        electrodes' currents; else `Sensor.noise`.
    reading
        Readings without noise, (..., 9), in the order of Eq. (2); mm and mW.
    rng
        The generator of random numbers; the same seed gives the same noise.

    Returns
    -------
    ndarray
        Readings with noise, (..., 9). A detector reads NaN where its spot's centroid lies past its
        edge (see `reaches`), where its amplifiers saturate, and where its currents fit no position
        on it.

    Raises
    ------
    InputError
        If the last dimension of `reading` is not 9.

    Examples
    --------
    >>> import numpy as np, facets
    >>> sensor = facets.Sensor()
    >>> exact = facets.readings(sensor, np.zeros(8))
    >>> noisy = facets.add_noise(sensor, np.tile(exact, (10000, 1)), np.random.default_rng(1))
    >>> f"{1e3 * noisy[:, 0].std():.1f} um at {exact[2]:.1f} mW"
    '2.6 um at 0.1 mW'
    """
    return sample_readings(sensor, as_vectors(reading, 9, "reading"), rng)


def sample_readings(
    sensor: Sensor, exact: Floats, rng: np.random.Generator, rounded: bool = True
) -> Floats:
    """Draw readings with noise (..., 9) for readings without noise `exact` (..., 9).

    See `add_noise`.  rounded: whether the converter rounds to its steps. Otherwise the error of
    rounding is uniformly distributed over a step, which is the state of knowledge where the
    position between two steps is unknown (JCGM 101, 6.4.2).
    """
    if sensor.electronics is None:
        sigma = standard_deviations(sensor, exact)
        return mask_missed_spots(sensor, exact, exact + sigma * rng.standard_normal(sigma.shape))
    halves = half_sizes(sensor)
    currents = electrode_currents(sensor.electronics, halves, split_detectors(exact))
    parts = [
        sample_detector(sensor.electronics, half, currents[..., k, :], rng, rounded)
        for k, half in enumerate(halves)
    ]
    return mask_missed_spots(sensor, exact, np.concatenate(parts, axis=-1))


def largest_current(electronics: Electronics) -> float:
    """Electrode current, A, at the end of the converter's range."""
    return electronics.adc_range / electronics.transimpedance


def step_current(electronics: Electronics) -> float:
    """Electrode current, A, of one step of the converter."""
    return largest_current(electronics) / 2.0**electronics.adc_bits


def add_current_noise(
    electronics: Electronics, currents: Floats, rng: np.random.Generator
) -> Floats:
    """Add the noise of all sources except the converter to electrode currents (..., 4), A."""
    var = current_variances(electronics, currents)[..., :-1].sum(axis=-1)
    noisy: Floats = currents + np.sqrt(var) * rng.standard_normal(currents.shape)
    return noisy


def fullness(sensor: Sensor, exact: Floats) -> Floats:
    """Largest electrode current of each detector as a fraction of the converters' range (..., 3).

    exact: (..., 9) readings without noise. Above 1 the detector is saturated and has no reading.
    0 without electronics.
    """
    if sensor.electronics is None:
        return np.zeros((*exact.shape[:-1], 3))
    currents = electrode_currents(sensor.electronics, half_sizes(sensor), split_detectors(exact))
    ratio: Floats = currents.max(axis=-1) / largest_current(sensor.electronics)
    return ratio


def sample_detector(
    electronics: Electronics,
    half: Floats,
    currents: Floats,
    rng: np.random.Generator,
    rounded: bool = True,
) -> Floats:
    """Draw noise of a detector's currents (..., 4), A, and return its psi, zeta and power (..., 3),
    mm, mm and mW; NaN where it is saturated.  half: (2,) half sizes, mm."""
    kind = electronics.kind
    drawn = add_current_noise(electronics, currents, rng)
    step = step_current(electronics)
    if rounded:
        read = step * np.round(drawn / step)
    else:
        read = drawn + step * (rng.random(drawn.shape) - 0.5)
    out = np.empty((*currents.shape[:-1], 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        place = electrodes.places(kind, read, half[1] / half[0])
        out[..., :2] = half * place
    out[..., 2] = electrodes.total(kind, read) / (1e-3 * electronics.responsivity)
    out[(read > largest_current(electronics)).any(axis=-1) | ~np.isfinite(out).all(axis=-1)] = (
        np.nan
    )
    return out
