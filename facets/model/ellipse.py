"""The beam's ellipse as the covariance of its light.

It is smooth where diameters and an angle are not: near a round beam the angle has no direction.
"""

from __future__ import annotations

from dataclasses import replace
from math import atan2, cos, hypot, pi, sin, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.sensor import Beam, Sensor
from ..optics.forward import Geometry, geometry
from ..optics.vectors import Vector, add, combine, dot, scale
from .arrays import as_rows, of_light, openings, parameters

Floats = NDArray[np.float64]

#: The covariance of the light across the beam, along x_w and y_w as the beam's tilt carries them,
#: mm^2.
ELLIPSE = ("beam.sigma_xx", "beam.sigma_yy", "beam.sigma_xy")


def covariance_of(beam: Beam) -> Floats:
    """The beam's covariance (3,) in the order of `ELLIPSE`, mm^2."""
    x2, y2 = (beam.diameter_x / 4) ** 2, (beam.diameter_y / 4) ** 2
    c, s = cos(beam.rotation), sin(beam.rotation)
    return np.array([x2 * c * c + y2 * s * s, x2 * s * s + y2 * c * c, (x2 - y2) * s * c])


def covariance_jacobian(beam: Beam) -> Floats:
    """Derivatives of `covariance_of` by diameter_x, diameter_y and rotation: (3, 3)."""
    c, s = cos(beam.rotation), sin(beam.rotation)
    x, y = beam.diameter_x / 8, beam.diameter_y / 8
    apart = (beam.diameter_x / 4) ** 2 - (beam.diameter_y / 4) ** 2
    return np.array(
        [
            [x * c * c, y * s * s, -2 * s * c * apart],
            [x * s * s, y * c * c, 2 * s * c * apart],
            [x * s * c, -y * s * c, (c * c - s * s) * apart],
        ]
    )


def with_covariance(beam: Beam, covariance: ArrayLike) -> Beam:
    """The beam with another covariance (3,), its axes those nearest to the beam's own.

    Raises `InputError` where the covariance is none.
    """
    xx, yy, xy = (float(value) for value in np.asarray(covariance))
    middle, apart = (xx + yy) / 2, hypot((xx - yy) / 2, xy)
    if not middle > apart:
        raise InputError(
            f"sigma_xx, sigma_yy, sigma_xy are {xx}, {yy}, {xy} mm^2; needed: the first two above "
            "0, their product above the square of the third"
        )
    turn = atan2(xy, (xx - yy) / 2) / 2 if apart > 0 else beam.rotation
    quarters = round((beam.rotation - turn) / (pi / 2))
    sizes = [4 * sqrt(middle + apart), 4 * sqrt(middle - apart)]
    x, y = sizes if quarters % 2 == 0 else sizes[::-1]
    return replace(beam, diameter_x=x, diameter_y=y, rotation=turn + quarters * pi / 2)


def ellipse_jacobian(sensor: Sensor, state: ArrayLike) -> Floats:
    """The derivatives of the readings by the beam's covariance, closed; right for round beams too.

    state: (..., 8). Returns (..., 9, 3), columns in the order of `ELLIPSE`: mm and mW per mm^2.
    Raises `InputError` for a sensor with apertures.
    """
    from .kernels import differentiate_light, pack

    rows, shape = as_rows(state, 8, "state")
    if sensor.apertures.cut:
        raise InputError("sensor.apertures cut the light; its ellipse is not varied with them")
    copies = [pack(_widened(sensor, which)) for which in range(3)]
    out = np.empty((len(rows), 9, 3))
    plain = pack(geometry(parameters(sensor), openings(sensor), of_light(sensor)))
    differentiate_light(plain, np.array(copies, dtype=complex), rows, out)
    return out.reshape(*shape, 9, 3)


def _widened(sensor: Sensor, which: int) -> Geometry:
    """The sensor's vectors with one entry of the beam's covariance varied.

    A root of the covariance C is all that counts of the beam's two axes, so that they follow a
    change dC by half of dC / C, and their duals by the opposite.
    """
    from ..optics.bench_light import STEP
    from ..optics.effects import light
    from ..optics.forward import beam_axes, edges

    given = parameters(sensor)
    plain = geometry(given, openings(sensor))
    x, y, _ = beam_axes(0.0, sensor.beam.tilt_x, sensor.beam.tilt_y)
    change = np.array([[[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 1], [1, 0]]])[which] * STEP / 2
    xx, yy, xy = covariance_of(sensor.beam)
    onward = change @ np.linalg.inv([[xx, xy], [xy, yy]])

    def moved(v: Vector, by: Floats) -> Vector:
        right, up = by @ [dot(v, x), dot(v, y)]
        return add(v, scale(1j, combine(float(right), x, float(up), y)))

    spread = moved(plain.spread[0], onward), moved(plain.spread[1], onward)
    back = -onward.T
    whitening = moved(plain.whitening[0], back), moved(plain.whitening[1], back)
    own = light(of_light(sensor), edges(plain.normals), (x, y), spread, whitening)
    return plain._replace(spread=spread, whitening=whitening, light=own)
