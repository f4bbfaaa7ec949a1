"""The beam's cross-section as a covariance, and the readings' derivatives by it.

Diameters and rotation have no derivative where the beam is round, because the rotation has no
effect there; the three elements of a symmetric matrix always have one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.errors import InputError
from ..core.sensor import Sensor
from ..core.units import Floats
from ..optics.forward import PARAMETERS
from .arrays import parameter_slopes

#: The irradiance's covariance in the beam's cross-section, mm^2, which is fitted instead of two
#: diameters and a rotation, because a round beam has no rotation.
SHAPE = ("beam.sigma_xx", "beam.sigma_yy", "beam.sigma_xy")
OF_SHAPE = ("beam.diameter_x", "beam.diameter_y", "beam.rotation")


def shape_of(diameter_x: float, diameter_y: float, rotation: float) -> tuple[float, float, float]:
    """The covariance (sigma_xx, sigma_yy, sigma_xy) of a beam, whose 1/e^2 diameters are four
    sigmas each."""
    u, v, c, s = (diameter_x / 4) ** 2, (diameter_y / 4) ** 2, np.cos(rotation), np.sin(rotation)
    return (
        float(u * c * c + v * s * s),
        float(u * s * s + v * c * c),
        float((u - v) * c * s),
    )


def axes_of(shape: Floats, near: float = 0.0) -> tuple[float, float, float]:
    """The (diameter_x, diameter_y, rotation) of a shape, with the rotation nearest to `near`.

    Raises `InputError` where no beam has that shape.
    """
    xx, yy, xy = shape
    middle, half = (xx + yy) / 2, float(np.hypot((xx - yy) / 2, xy))
    if not middle - half > 0:
        raise InputError(f"no beam has a cross-section of covariance {xx:g}, {yy:g}, {xy:g} mm^2")
    if half < 1e-12 * middle:
        return 4 * float(np.sqrt(middle)), 4 * float(np.sqrt(middle)), near
    turn = float(np.arctan2(xy, (xx - yy) / 2)) / 2
    quarters = round((near - turn) / (np.pi / 2))
    long, short = 4 * float(np.sqrt(middle + half)), 4 * float(np.sqrt(middle - half))
    turn += quarters * np.pi / 2
    return (long, short, turn) if quarters % 2 == 0 else (short, long, turn)


def axes_of_shapes(shapes: Floats, near: float) -> Floats:
    """The results (n, 3) of `axes_of` for shapes (n, 3); NaN where no beam has that shape."""
    xx, yy, xy = shapes.T
    middle, half = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    is_round = half < 1e-12 * middle
    turn = np.where(is_round, near, np.arctan2(xy, (xx - yy) / 2) / 2)
    half = np.where(is_round, 0.0, half)
    quarters = np.round((near - turn) / (np.pi / 2))
    with np.errstate(invalid="ignore"):
        long, short = 4 * np.sqrt(middle + half), 4 * np.sqrt(middle - half)
    is_even = quarters % 2 == 0
    along, across = np.where(is_even, long, short), np.where(is_even, short, long)
    return np.stack([along, across, turn + quarters * np.pi / 2], axis=1)


def shape_derivatives(sensor: Sensor, states: Floats, slopes: Floats) -> Floats:
    """The derivatives by `SHAPE` (n, 9, 3).

    slopes: (n, 9, 30) derivatives by the parameters.

    In the axes of the ellipse a change of the covariance is a change of two variances and a
    rotation. For a round beam the off-diagonal element is a change of two variances along axes at
    45 degrees.
    """
    x, y, turn = (PARAMETERS.index(name) for name in OF_SHAPE)
    beam = sensor.beam
    u, v = (beam.diameter_x / 4) ** 2, (beam.diameter_y / 4) ** 2
    of_u = slopes[:, :, x] * beam.diameter_x / (2 * u)
    of_v = slopes[:, :, y] * beam.diameter_y / (2 * v)
    if abs(u - v) > 1e-6 * (u + v):
        across = slopes[:, :, turn] / (u - v)
    else:
        slanted = replace(sensor, beam=replace(beam, rotation=beam.rotation + np.pi / 4))
        other = parameter_slopes(slanted, states, (x, y))
        across = other[:, :, 0] * beam.diameter_x / (2 * u)
        across -= other[:, :, 1] * beam.diameter_y / (2 * v)
    c, s = np.cos(beam.rotation), np.sin(beam.rotation)
    return np.stack(
        [
            of_u * c * c + of_v * s * s - across * c * s,
            of_u * s * s + of_v * c * c + across * c * s,
            2 * c * s * (of_u - of_v) + across * (c * c - s * s),
        ],
        axis=-1,
    )
