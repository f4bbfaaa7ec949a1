"""A layout as symbols: what a sensor can do over a volume, as functions that casadi differentiates.

The text is that of `optics`, with its closed Jacobian; casadi only adds the derivatives by what is
varied.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .model import parameters
from .optics.forward import geometry, placed
from .optics.gradient import linearised
from .optics.rays import gradient_of_shift, reflect, slanted
from .optics.vectors import dot
from .sensor import Sensor

Floats = NDArray[np.float64]

#: What is measured in these, so that numbers are of order one: um and urad.
COLUMNS = (1e-3, 1e-3, 1e-3, 1e-6, 1e-6, 1e-6, 1e-3, 1e-3)
#: Half of the 1/e^2 diameter, in sigmas.
RIM = 2
#: Where the parts of a sensor's 30 parameters begin: the beam, the facets, the detectors.
FACETS, PSDS = (6, 8, 10), (12, 18, 24)


@dataclass(frozen=True)
class Outcome:
    """What one state of one layout gives, by its place in the function's only output.

    variances: 6, um^2 and urad^2.  powers: 3, mW.  room: 12, from the light inside the 1/e^2 circle
    to each detector's edges at -y, +y, -z, +z, mm, by the whole ellipse, which is no less.
    """

    VARIANCES = slice(0, 6)
    POWERS = slice(6, 9)
    ROOM = slice(9, 21)
    SIZE = 21


def outcome(sensor: Sensor) -> Any:
    """The casadi function (parameters (30), sizes (3), state (8), prior (1)) -> outcome (21).

    sizes: of the detectors, square, mm.  prior: 1 / um^2, what is known of bx and by; 0 nothing.
    """
    import casadi as ca

    p, sizes, s, prior = (ca.SX.sym(n, k) for n, k in (("p", 30), ("d", 3), ("s", 8), ("w", 1)))
    given, state = tuple(p[i] for i in range(30)), tuple(s[i] for i in range(8))
    fixed = geometry(given)
    detectors = linearised(fixed, state)
    rows = []
    for values, derivatives in detectors:
        place = sensor.noise.position * sensor.noise.at_power / values[2]
        for i, sigma in enumerate((place, place, sensor.noise.power)):
            scaled = [d * unit / sigma for d, unit in zip(derivatives[i], COLUMNS, strict=True)]
            rows.append(ca.horzcat(*scaled))
    matrix = ca.vertcat(*rows)
    information = ca.mtimes(matrix.T, matrix)
    for i in (6, 7):
        information[i, i] += prior
    inverse = ca.solve(information, ca.SX.eye(8)[:, :6])
    variances = [inverse[i, i] for i in range(6)]
    powers = [values[2] for values, _ in detectors]
    room = room_of(fixed, state, sizes)
    return ca.Function("outcome", [p, sizes, s, prior], [ca.vertcat(*variances, *powers, *room)])


def room_of(fixed: Any, state: Any, sizes: Any) -> list[Any]:
    """From the image of the beam's 1/e^2 ellipse to the detectors' edges; 12."""
    import casadi as ca

    at = placed(fixed, state)
    room = []
    for k in range(3):
        normal, (x, y, z) = at.normals[k], fixed.axes[k]
        leaving = reflect(fixed.direction, normal)
        centre = tuple(p - c for p, c in zip(at.apex, fixed.centres[k], strict=True))
        offset = tuple(b - t for b, t in zip(at.place, at.apex, strict=True))
        for axis in (y, z):
            along = slanted(axis, leaving, x)
            shift = gradient_of_shift(along, fixed.direction, normal)
            middle = dot(along, centre) + dot(shift, offset)
            reach = RIM * ca.sqrt(sum(dot(shift, spread) ** 2 for spread in fixed.spread))
            room += [sizes[k] / 2 + middle - reach, sizes[k] / 2 - middle - reach]
    return room


#: What may be varied, in the order of `config.layout_keys.Variables`, and its unit in the code.
VARIABLES = {
    "radius_mm": 1.0,
    "inclination_deg": np.pi / 180,
    "pitch_mrad": 1e-3,
    "azimuth_b_deg": np.pi / 180,
    "size_mm": 1.0,
    "diameter_mm": 1.0,
    "power_mw": 1.0,
}


def present(sensor: Sensor) -> dict[str, float]:
    """The variables' values as the sensor is, in the units of their names."""
    psd = sensor.psds[0]
    values = {
        "radius_mm": psd.radius,
        "inclination_deg": sensor.facets[0].inclination,
        "pitch_mrad": psd.pitch,
        "azimuth_b_deg": sensor.facets[1].azimuth,
        "size_mm": min(psd.size_y, psd.size_z),
        "diameter_mm": sensor.beam.diameter_x,
        "power_mw": sensor.beam.power,
    }
    return {name: values[name] / unit for name, unit in VARIABLES.items()}


def varied(sensor: Sensor, names: Sequence[str], x: Any) -> tuple[list[Any], list[Any]]:
    """The 30 parameters and the 3 sizes when the named variables take the values x.

    x: symbols or floats, in the units of the names. Detectors go up and down with the sub-beams.
    """
    p: list[Any] = list(parameters(sensor))
    sizes: list[Any] = [min(psd.size_y, psd.size_z) for psd in sensor.psds]
    value = {name: x[i] * VARIABLES[name] for i, name in enumerate(names)}
    for k, (facet, psd) in enumerate(zip(FACETS, PSDS, strict=True)):
        p[psd] = value.get("radius_mm", p[psd])
        p[psd + 4] = value.get("pitch_mrad", p[psd + 4])
        sizes[k] = value.get("size_mm", sizes[k])
        if "inclination_deg" in value:
            p[facet] = value["inclination_deg"]
            p[psd + 2] = p[psd] / tangent(2 * p[facet])
        if "azimuth_b_deg" in value and k > 0:
            turn = value["azimuth_b_deg"] if k == 1 else 2 * np.pi - value["azimuth_b_deg"]
            p[facet + 1] = p[psd + 1] = turn
    if "diameter_mm" in value:
        p[1] = p[2] = value["diameter_mm"]
    p[0] = value.get("power_mw", p[0])
    return p, sizes


def tangent(angle: Any) -> Any:
    from .numbers import cos, sin

    return sin(angle) / cos(angle)


def head_of(p: Sequence[Any]) -> Any:
    """The head's diameter, mm: twice the radius of detector A."""
    return 2 * p[PSDS[0]]
