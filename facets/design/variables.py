"""A layout: what may be varied of it, and what a state of it gives, in symbols for casadi.

The text is that of `optics`, with its closed Jacobian; casadi only adds the derivatives by what is
varied.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..core.names import DETECTORS, FINE_UNITS
from ..core.sensor import Electronics, Sensor
from ..core.units import Floats
from ..model.arrays import parameters, sensor_with
from ..optics.forward import build_geometry, dark_scene
from ..optics.gradient import linearise
from ..optics.limits import gradient_per_sigma, outward_direction
from ..optics.rays import gradient_of_shift, reflect, slant
from ..optics.vectors import dot, subtract
from .electronics import deviations

#: Half of the 1/e^2 diameter, in sigmas.
RIM = 2
#: Where the parts of a sensor's 30 parameters begin: the beam, the facets, the detectors.
FACETS, PSDS = (6, 8, 10), (12, 18, 24)


@dataclass(frozen=True)
class Outcome:
    """What one state of one layout gives, by its place in the function's only output.

    variances: 6, um^2 and urad^2.  powers: 3, mW.  clearances: 12, from the light inside the 1/e^2
    circle to each detector's edges at -y, +y, -z, +z, mm, by the whole ellipse, which is no less.
    condition: square of the weighted Jacobian's condition number in the Frobenius norm, which is at
    least that of the spectral norm and at most 8 times it.  After these, where the noise follows
    from electronics, `HEADROOM`: what is left of the amplifiers' full scale.
    """

    VARIANCES = slice(0, 6)
    POWERS = slice(6, 9)
    CLEARANCES = slice(9, 21)
    CONDITION = slice(21, 22)
    SIZE = 22
    HEADROOM = slice(22, 34)


def outcome(sensor: Sensor) -> Any:
    """The casadi function (parameters (30), sizes (3), state (8), prior (1)) -> outcome (22).

    sizes: of the detectors, square, mm.  prior: 1 / um^2, what is known of bx and by; 0 nothing.
    """
    import casadi as ca

    p, sizes, s, prior = (ca.SX.sym(n, k) for n, k in (("p", 30), ("d", 3), ("s", 8), ("w", 1)))
    given, state = tuple(p[i] for i in range(30)), tuple(s[i] for i in range(8))
    found = ca.vertcat(*outcome_of(sensor, given, sizes, state, prior))
    return ca.Function("outcome", [p, sizes, s, prior], [found])


def outcome_of(
    sensor: Sensor, given: Any, sizes: Any, state: Any, prior: Any, gain: Any = None
) -> list[Any]:
    """The numbers of `Outcome` in casadi's symbols, for 30 parameters `given`.

    gain: of the amplifiers, ohm, where it is not the sensor's.
    """
    import casadi as ca

    fixed = build_geometry(given)
    detectors = linearise(fixed, state)
    rows = []
    headroom: list[Any] = []
    for k, (values, derivatives) in enumerate(detectors):
        place = sensor.noise.position * sensor.noise.at_power / values[2]
        sigmas = [place, place, sensor.noise.power]
        if sensor.electronics is not None:
            own = sensor.electronics.transimpedance if gain is None else gain
            halves = halves_of(sensor, k, sizes[k])
            sigmas, spare = deviations(sensor.electronics, values, halves, own)
            headroom += spare
        for i, sigma in enumerate(sigmas):
            scaled = [d * unit / sigma for d, unit in zip(derivatives[i], FINE_UNITS, strict=True)]
            rows.append(ca.horzcat(*scaled))
    matrix = ca.vertcat(*rows)
    information = ca.mtimes(matrix.T, matrix)
    for i in (6, 7):
        information[i, i] += prior
    inverse = ca.solve(information, ca.SX.eye(8))
    condition = ca.trace(information) * ca.trace(inverse)
    variances = [inverse[i, i] for i in range(6)]
    powers = [values[2] for values, _ in detectors]
    return [*variances, *powers, *clearances_of(fixed, state, sizes), condition, *headroom]


def halves_of(sensor: Sensor, k: int, size: Any) -> tuple[Any, Any]:
    """Half of detector k, mm: as it is, or of a square of a size that varies."""
    psd = sensor.psds[k]
    if isinstance(size, float) and size == min(psd.size_y, psd.size_z):
        return psd.size_y / 2, psd.size_z / 2
    return size / 2, size / 2


def rim_clearances(fixed: Any, state: Any, rim: float) -> list[Any]:
    """From the light inside the 1/e^2 ellipse to the mirror's rim on each facet, over the rim."""
    import casadi as ca

    at = dark_scene(fixed, state)
    found = []
    for k in range(3):
        along = slant(outward_direction(fixed, at, k), fixed.direction, at.normals[k])
        slope = gradient_per_sigma(fixed, along)
        out = dot(subtract(at.place, at.apex), along)
        reach = RIM * ca.sqrt(slope[0] ** 2 + slope[1] ** 2)
        found.append(1 - (out + reach) / rim)
    return found


def clearances_of(fixed: Any, state: Any, sizes: Any) -> list[Any]:
    """From the image of the beam's 1/e^2 ellipse to the detectors' edges; 12."""
    import casadi as ca

    at = dark_scene(fixed, state)
    clearances = []
    for k in range(3):
        normal, (x, y, z) = at.normals[k], fixed.axes[k]
        leaving = reflect(fixed.direction, normal)
        centre = tuple(p - c for p, c in zip(at.apex, fixed.centres[k], strict=True))
        offset = tuple(b - t for b, t in zip(at.place, at.apex, strict=True))
        for axis in (y, z):
            along = slant(axis, leaving, x)
            shift = gradient_of_shift(along, fixed.direction, normal)
            middle = dot(along, centre) + dot(shift, offset)
            reach = RIM * ca.sqrt(sum(dot(shift, spread) ** 2 for spread in fixed.spread))
            clearances += [sizes[k] / 2 + middle - reach, sizes[k] / 2 - middle - reach]
    return clearances


UNITS = {"mm": 1.0, "mw": 1.0, "mrad": 1e-3, "deg": np.pi / 180, "kohm": 1e3}
#: The amplifiers' gain, which is no parameter of the optics.
GAIN = "transimpedance_kohm"
#: What may be varied for all facets or detectors alike; see `config.layout_keys`.
COMMON = (
    "radius_mm", "inclination_deg", "roll_mrad", "pitch_mrad", "yaw_mrad", "azimuth_b_deg",
    "size_mm", "diameter_mm", "power_mw", GAIN,
)  # fmt: skip
#: Of one facet or detector: the place among its own parameters.
OF_A_FACET = {"inclination_deg": 0, "azimuth_deg": 1}
OF_A_PSD = {"radius_mm": 0, "azimuth_deg": 1, "height_mm": 2,
            "roll_mrad": 3, "pitch_mrad": 4, "yaw_mrad": 5}  # fmt: skip


def unit_of(name: str) -> float:
    """Of a variable, in mm, mW or rad: its name ends in it."""
    return UNITS[name.rpartition("_")[2]]


#: What may be varied of one facet or detector alone, by its place in the 30 parameters.
SINGLES = {
    f"{kind}_{letter}_{key}": first[k] + i
    for kind, first, keys in (("facet", FACETS, OF_A_FACET), ("psd", PSDS, OF_A_PSD))
    for k, letter in enumerate(DETECTORS)
    for key, i in keys.items()
}


def present_values(sensor: Sensor) -> dict[str, float]:
    """The variables' values as the sensor is, in the units of their names."""
    psd, p = sensor.psds[0], parameters(sensor)
    values = {
        "radius_mm": psd.radius,
        "inclination_deg": sensor.facets[0].inclination,
        "roll_mrad": psd.roll,
        "pitch_mrad": psd.pitch,
        "yaw_mrad": psd.yaw,
        "azimuth_b_deg": sensor.facets[1].azimuth,
        "size_mm": min(psd.size_y, psd.size_z),
        "diameter_mm": sensor.beam.diameter_x,
        "power_mw": sensor.beam.power,
        GAIN: (sensor.electronics or Electronics()).transimpedance,
    } | {name: float(p[i]) for name, i in SINGLES.items()}
    return {name: value / unit_of(name) for name, value in values.items()}


def with_values(sensor: Sensor, names: Sequence[str], x: Any) -> tuple[list[Any], list[Any]]:
    """The 30 parameters and the 3 sizes when the named variables take the values x.

    x: symbols or floats, in the units of the names. Detectors go up and down with the sub-beams
    where an inclination varies.
    """
    p: list[Any] = list(parameters(sensor))
    sizes: list[Any] = [min(psd.size_y, psd.size_z) for psd in sensor.psds]
    value = {name: x[i] * unit_of(name) for i, name in enumerate(names)}
    alone = {i: value[name] for name, i in SINGLES.items() if name in value}
    for k, (facet, psd) in enumerate(zip(FACETS, PSDS, strict=True)):
        for name in ("radius_mm", "roll_mrad", "pitch_mrad", "yaw_mrad"):
            i = psd + OF_A_PSD[name]
            p[i] = value.get(name, p[i])
        sizes[k] = value.get("size_mm", sizes[k])
        p[facet] = value.get("inclination_deg", p[facet])
        if "azimuth_b_deg" in value and k > 0:
            turn = value["azimuth_b_deg"] if k == 1 else 2 * np.pi - value["azimuth_b_deg"]
            p[facet + 1] = p[psd + 1] = turn
        for i in (facet, facet + 1, *range(psd, psd + 6)):
            p[i] = alone.get(i, p[i])
        if ("inclination_deg" in value or facet in alone) and psd + 2 not in alone:
            p[psd + 2] = p[psd] / tangent(2 * p[facet])
    if "diameter_mm" in value:
        p[1] = p[2] = value["diameter_mm"]
    p[0] = value.get("power_mw", p[0])
    return p, sizes


def sensor_of(sensor: Sensor, names: Sequence[str], x: Floats) -> Sensor:
    """The sensor with the named variables at x. Raises `InputError` where that is none."""
    p, sizes = with_values(sensor, names, x.tolist())
    made = sensor_with(sensor, p)
    if GAIN in names and made.electronics is not None:
        own = gain_of(sensor, names, x.tolist())
        made = replace(made, electronics=replace(made.electronics, transimpedance=own))
    if "size_mm" not in names:
        return made
    a, b, c = (replace(psd, size_y=d, size_z=d) for psd, d in zip(made.psds, sizes, strict=True))
    return replace(made, psds=(a, b, c))


def gain_of(sensor: Sensor, names: Sequence[str], x: Any) -> Any:
    """The amplifiers' gain, ohm, when the named variables take the values x; None where the noise
    does not follow from electronics."""
    if sensor.electronics is None:
        return None
    if GAIN not in names:
        return sensor.electronics.transimpedance
    return x[list(names).index(GAIN)] * unit_of(GAIN)


def tangent(angle: Any) -> Any:
    from ..scalars.dispatch import cos, sin

    return sin(angle) / cos(angle)


def heads_of(p: Sequence[Any]) -> list[Any]:
    """Twice the radius of each detector, mm; the largest is the head's diameter."""
    return [2 * p[psd] for psd in PSDS]
