"""The unknowns of a calibration by name, and the sensor with given values of them.

`ALL` has their order: the sensor's parameters, with the beam's shape as a covariance; corrections
of the detectors; effects of real light; the mirror's position on its reference; changes over the
run. Units are mm, rad, mW, s and fractions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ...core.names import DETECTORS, POSE
from ...core.rigid_body import rotation_matrix
from ...core.sensor import MONOMIALS, Calibration, Grid, Sensor
from ...core.units import Floats
from ...detectors.correction import NAMES, NAMES_OF_ONE, coefficients
from ...model import arrays
from ...model.arrays import EFFECTS, effects, half_sizes, parameters, replace_effects, sensor_with
from ...model.beam_shape import (
    OF_SHAPE,
    SHAPE,
    axes_of,
    shape_derivatives,
    shape_of,
)
from ...optics.forward import PARAMETERS

#: Number of knots along each side of a detector's spline, of polynomials up to third order in two
#: variables, and of the basis functions that are orthogonal to these polynomials at the knots.
KNOTS, POLYNOMIALS = 5, 10
LEFT = KNOTS**2 - POLYNOMIALS
#: Coefficients of the splines that are added to psi and to zeta of each detector.
SPLINE = tuple(
    f"spline_{letter}.{axis}{n}" for letter in DETECTORS for axis in "yz" for n in range(LEFT)
)
#: Number of places of the fine grid along each side; the error of linear interpolation between them
#: is 7 thousandths of a coefficient at most.
FINE_PLACES = 53


@cache
def directions() -> Floats:
    """Orthonormal values (KNOTS^2, LEFT) at the knots, orthogonal to all polynomials up to third
    order."""
    at = np.linspace(-1, 1, KNOTS)
    y, z = (part.ravel() for part in np.meshgrid(at, at, indexing="ij"))
    powers = [y**a * z**b for a, b in product(range(4), repeat=2) if a + b <= 3]
    basis, _ = np.linalg.qr(np.column_stack(powers), mode="complete")
    rest: Floats = basis[:, POLYNOMIALS:]
    return rest


def natural_powers(x: Floats) -> Floats:
    """Values (n, KNOTS) of a basis of natural cubic splines at positions (n,) from -1 to 1: 1, x,
    and pieces of third order that are straight lines beyond the knots."""
    knots = np.linspace(-1, 1, KNOTS)[:-1]
    pieces = np.maximum(x[:, None] - knots, 0) ** 3 / (1 - knots)
    return np.column_stack([np.ones(len(x)), x, pieces[:, :-1] - pieces[:, -1:]])


def bases(places: Floats) -> Floats:
    """Values (n, LEFT) of a detector's basis functions at positions (n, 2), in half sizes; beyond
    the edge, the values at the edge.

    They are scaled so that a coefficient is about the r.m.s. correction at the knots.
    """
    at_knots = np.linalg.inv(natural_powers(np.linspace(-1, 1, KNOTS)))
    y, z = (natural_powers(x) @ at_knots for x in np.clip(np.nan_to_num(places), -1, 1).T)
    tensor = (y[:, :, None] * z[:, None, :]).reshape(len(places), KNOTS**2)
    scaled: Floats = KNOTS * tensor @ directions()
    return scaled


def spline_slopes(sensor: Sensor, raw: Floats) -> Floats:
    """The derivatives (n, 9, 6 LEFT) of corrected readings by the coefficients, at raw readings (n,
    9)."""
    out = np.zeros((len(raw), 9, len(SPLINE)))
    for k, half in enumerate(half_sizes(sensor)):
        part, first = bases(raw[:, 3 * k : 3 * k + 2] / half), 2 * LEFT * k
        out[:, 3 * k, first : first + LEFT] = part
        out[:, 3 * k + 1, first + LEFT : first + 2 * LEFT] = part
    return out


@cache
def fine_bases() -> Floats:
    """The splines' basis functions (places, functions) on a fine grid over the detector."""
    at = np.linspace(-1, 1, FINE_PLACES)
    y, z = np.meshgrid(at, at, indexing="ij")
    return bases(np.column_stack([y.ravel(), z.ravel()]))


def replace_spline(sensor: Sensor, coefficients: Floats) -> Sensor:
    """Replace the grids of a sensor's corrections by splines with coefficients (6 LEFT,), mm; the
    sensor is unchanged if all are zero."""
    if not coefficients.any():
        return sensor
    psds, at = [], np.linspace(-1, 1, FINE_PLACES)
    for psd, part, half in zip(
        sensor.psds, coefficients.reshape(3, 2, LEFT), half_sizes(sensor), strict=True
    ):
        add = [(fine_bases() @ row).reshape(FINE_PLACES, FINE_PLACES) for row in part]
        tuples = [tuple(map(tuple, values.tolist())) for values in add]
        grid = Grid(tuple((at * half[0]).tolist()), tuple((at * half[1]).tolist()), *tuples)
        psds.append(replace(psd, correction=replace(psd.correction, grid=grid)))
    return replace(sensor, psds=(psds[0], psds[1], psds[2]))


def spline_error(sensor: Sensor, raw: Floats, names: tuple[str, ...], covariance: Floats) -> Floats:
    """The standard uncertainty (9,) of the splines' corrections of the readings, r.m.s. over the
    samples, mm.

    covariance: (p, p) of the named unknowns. All other unknowns are held, because their uncertainty
    already contains the part that they have in common with the splines.
    """
    places = [n for n, name in enumerate(names) if name in SPLINE]
    if not places:
        return np.zeros(9)
    columns = [SPLINE.index(names[n]) for n in places]
    slopes = spline_slopes(sensor, raw)[:, :, columns]
    alone = np.linalg.inv(np.linalg.inv(covariance)[np.ix_(places, places)])
    variance = np.einsum("nip,nip->ni", slopes @ alone, slopes)
    size: Floats = np.sqrt(variance.mean(axis=0))
    return size


#: Place of the mirror on its reference: the apex from the reference's pivot; the apex from the beam
#: while the reference is at zero; the mirror's rotation on the reference.
MOUNTING = (
    *(f"lever.{axis}" for axis in "xyz"),
    *(f"apex.{axis}" for axis in "xyz"),
    *(f"mount.{axis}" for axis in ("roll", "pitch", "yaw")),
)
APEX, MOUNT = MOUNTING[3:6], MOUNTING[6:]
DELAY = "reference.delay"
#: Delay of each detector's reading after the stated time, s.
SKEW = tuple(f"skew_{letter}.delay" for letter in DETECTORS)
#: Lag of the mirror behind the reference, against the direction of each axis's last step: half the
#: play, mm and rad.
BACKLASH = tuple(f"backlash.{name}" for name in POSE)
#: Lag of the mirror behind the reference, as a fraction of each axis's last step.
LAG = tuple(f"lag.{name}" for name in POSE)
#: The quantities that may drift: the beam's position, and each detector's reading of a place.
OF_DRIFT = ("bx", "by", *(f"{kind}_{k}" for k in DETECTORS for kind in ("psi", "zeta")))
#: The regressors of drifts, in the order of `Data.clock`; the last is the temperature's past: a
#: temperature that follows the measured one late, or its rate of change for a late thermometer.
CLOCKS = ("time", "temperature", "past")
DRIFTS = tuple(f"{cause}.{what}" for cause in CLOCKS for what in OF_DRIFT)
TIME_DRIFT = DRIFTS[: len(OF_DRIFT)]
PAST = DRIFTS[-len(OF_DRIFT) :]

#: The laser's slow drift, relative power: coefficients of polynomials over the run.
POWER_DRIFT = tuple(f"time.power_{n}" for n in range(1, 6))

GEOMETRY = tuple(name for name in PARAMETERS if name not in OF_SHAPE)
OF_SENSOR = (*GEOMETRY, *SHAPE, *NAMES, *EFFECTS)
#: All unknowns. The splines are last, because their columns are computed only if one is chosen.
ALL = (*OF_SENSOR, *MOUNTING, DELAY, *SKEW, *BACKLASH, *LAG, *DRIFTS, *POWER_DRIFT, *SPLINE)
PLACE = {name: n for n, name in enumerate(ALL)}


def block(names: tuple[str, ...]) -> slice:
    """The slice of `ALL` that holds consecutive names; empty for no names."""
    return slice(PLACE[names[0]], PLACE[names[-1]] + 1) if names else slice(0, 0)


@dataclass(frozen=True)
class Choice:
    """The unknowns of a fit: names out of `ALL`, and their prior standard uncertainties.

    sigma: (p,) these uncertainties.  power: relative standard deviation of the laser's power
    between samples; 0 if it is constant, infinite if each sample has its own.  beam: standard
    deviation of the beam's position between samples, mm.  joint: joint prior covariance of some of
    the unknowns; None for independent priors.
    """

    names: tuple[str, ...]
    sigma: Floats
    power: float = 0.0
    beam: float = 0.0
    joint: Calibration | None = None

    @property
    def places(self) -> NDArray[np.int64]:
        """The indices (p,) in `ALL` of the choice's names."""
        return np.array([PLACE[name] for name in self.names], dtype=np.int64)

    def add_unknowns(self, sigma: dict[str, float]) -> Choice:
        """Add further unknowns; one that is already present keeps the larger uncertainty."""
        sigmas = dict(zip(self.names, self.sigma.tolist(), strict=True))
        for name, value in sigma.items():
            sigmas[name] = max(value, sigmas.get(name, 0.0))
        return replace(self, names=tuple(sigmas), sigma=np.array(list(sigmas.values())))


# ---- a sensor and its values


def values_of(sensor: Sensor) -> Floats:
    """Values (ALL,) of all unknowns for a sensor, with the apex on the pivot and on the beam and
    without changes over the run."""
    nominal = dict(zip(PARAMETERS, parameters(sensor), strict=True))
    values = np.zeros(len(ALL))
    for name in GEOMETRY:
        values[PLACE[name]] = nominal[name]
    values[block(SHAPE)] = shape_of(*(nominal[name] for name in OF_SHAPE))
    values[block(NAMES)] = coefficients(sensor)
    values[block(EFFECTS)] = effects(sensor)
    values[block(SKEW)] = sensor.light.delays
    return values


def assign_values(sensor: Sensor, values: Floats) -> Sensor:
    """Return the sensor with values (ALL,) of the unknowns; raise `InputError` for impossible
    ones."""
    geometry = dict(zip(GEOMETRY, values[block(GEOMETRY)].tolist(), strict=True))
    axes = axes_of(values[block(SHAPE)], sensor.beam.rotation)
    geometry |= dict(zip(OF_SHAPE, axes, strict=True))
    assigned = sensor_with(sensor, [geometry[name] for name in PARAMETERS])
    assigned = replace_corrections(assigned, values[block(NAMES)])
    assigned = replace_effects(assigned, values[block(EFFECTS)])
    assigned = replace_spline(assigned, values[block(SPLINE)])
    a, b, c = values[block(SKEW)].tolist()
    return replace(assigned, light=replace(assigned.light, delays=(a, b, c)), calibration=None)


def replace_corrections(sensor: Sensor, coefficient: Floats) -> Sensor:
    """Replace the sensor's corrections by coefficients, mm, mW and fractions, in the order of
    `correction.NAMES`."""
    parts = coefficient.reshape(3, len(NAMES_OF_ONE)).tolist()
    count = len(MONOMIALS)
    psds = [
        replace(psd, correction=replace(
            psd.correction, power=gain, dark=offset, y=tuple(rest[:count]), z=tuple(rest[count:])
        ))
        for psd, (gain, offset, *rest) in zip(sensor.psds, parts, strict=True)
    ]  # fmt: skip
    return replace(sensor, psds=(psds[0], psds[1], psds[2]))


# ---- derivatives by the sensor's own parameters


def sensor_derivatives(sensor: Sensor, states: Floats) -> Floats:
    """The model's derivatives by `GEOMETRY` and `SHAPE`: (n, 9, 30)."""
    slopes = arrays.parameter_jacobian(sensor, states)
    out = np.empty((len(states), 9, len(GEOMETRY) + len(SHAPE)))
    out[:, :, : len(GEOMETRY)] = slopes[:, :, [PARAMETERS.index(name) for name in GEOMETRY]]
    out[:, :, len(GEOMETRY) :] = shape_derivatives(sensor, states, slopes)
    return out


# ---- the mirror's rotation on its reference becomes part of its facets


def normals(values: Floats) -> Floats:
    """The facets' normals (3, 3) in the mirror's frame, from values of `ALL`."""
    rows = []
    for letter in DETECTORS:
        tilt, turn = (values[PLACE[f"facet_{letter}.{n}"]] for n in ("inclination", "azimuth"))
        rows.append([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    return np.array(rows)


def fold_mount(values: Floats) -> Floats:
    """Merge the mount's rotation into the facets: values (ALL,) with a mount at zero.

    The mirror's frame is then the reference's: with the reference at zero, solved angles are zero.
    """
    folded = values.copy()
    turn = rotation_matrix(values[block(MOUNT)])
    for letter, normal in zip(DETECTORS, normals(values) @ turn.T, strict=True):
        place = PLACE[f"facet_{letter}.azimuth"]
        azimuth = np.arctan2(normal[1], normal[0])
        folded[place] = azimuth + 2 * np.pi * round((values[place] - azimuth) / (2 * np.pi))
        folded[PLACE[f"facet_{letter}.inclination"]] = np.arccos(np.clip(normal[2], -1, 1))
    folded[block(MOUNT)] = 0.0
    return folded


def fold_derivatives(values: Floats) -> tuple[list[int], list[int], Floats]:
    """Indices in `ALL` that `fold_mount` changes, indices on which it depends, and its derivatives
    (6, 9)."""
    facets = [PLACE[f"facet_{k}.{n}"] for k in DETECTORS for n in ("inclination", "azimuth")]
    sources = facets + [PLACE[name] for name in MOUNT]
    slope = np.empty((6, 9))
    for n, place in enumerate(sources):
        step = np.zeros(len(ALL))
        step[place] = 1e-6
        slope[:, n] = (fold_mount(values + step) - fold_mount(values - step))[facets] / 2e-6
    return facets, sources, slope
