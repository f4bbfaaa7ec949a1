"""A detector's non-linearity as a smooth surface beyond third order, for a calibration to find.

A bicubic spline on a few knots over the sensitive area, less what polynomials up to third order
can do, which are unknowns of their own. Its coefficients are orthonormal at the knots: each is in
mm there, and what the samples do not reach stays small by what is known before. What is found goes
into a sensor as the fine grid of `Correction.grid`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np

from ..core.names import DETECTORS
from ..core.sensor import Grid, Sensor
from ..core.units import Floats
from ..model.arrays import half_sizes

#: Knots along each side; polynomials up to third order in two variables; what is left beside them.
KNOTS, POLYNOMIALS = 5, 10
LEFT = KNOTS**2 - POLYNOMIALS
#: Of each detector: what is added to psi, then to zeta.
SPLINE = tuple(
    f"spline_{letter}.{axis}{n}" for letter in DETECTORS for axis in "yz" for n in range(LEFT)
)
#: Places of the fine grid along each side; linear interpolation is wrong by 7 thousandths at most.
FINE_PLACES = 53


@cache
def directions() -> Floats:
    """Values (KNOTS^2, LEFT) at the knots in which no polynomial up to third order has a part."""
    at = np.linspace(-1, 1, KNOTS)
    y, z = (part.ravel() for part in np.meshgrid(at, at, indexing="ij"))
    powers = [y**a * z**b for a, b in product(range(4), repeat=2) if a + b <= 3]
    whole, _ = np.linalg.qr(np.column_stack(powers), mode="complete")
    rest: Floats = whole[:, POLYNOMIALS:]
    return rest


def bases(places: Floats) -> Floats:
    """The values (n, LEFT) of the base functions at places (n, 2), in half sizes; beyond the edge,
    the values at the edge.

    Scaled so that a coefficient is about the r.m.s. of what it adds at the knots.
    """
    from scipy.interpolate import CubicSpline

    along = CubicSpline(np.linspace(-1, 1, KNOTS), np.eye(KNOTS), bc_type="natural")
    with np.errstate(invalid="ignore"):
        y, z = (along(np.clip(np.nan_to_num(places[:, n]), -1, 1)) for n in range(2))
    tensor = (y[:, :, None] * z[:, None, :]).reshape(len(places), KNOTS**2)
    added: Floats = KNOTS * tensor @ directions()
    return added


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
    at = np.linspace(-1, 1, FINE_PLACES)
    y, z = np.meshgrid(at, at, indexing="ij")
    return bases(np.column_stack([y.ravel(), z.ravel()]))


def replace_spline(sensor: Sensor, coefficients: Floats) -> Sensor:
    """The sensor whose detectors are corrected by splines (6 LEFT), mm, instead of other grids."""
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
    """The standard uncertainty (9,), r.m.s. over the samples, of what the splines add to readings,
    mm.

    covariance: (p, p) of the names. What the splines share with other unknowns is in the
    uncertainty of those; here it is theirs with the others where they are.
    """
    kept = [n for n, name in enumerate(names) if name in SPLINE]
    if not kept:
        return np.zeros(9)
    columns = [SPLINE.index(names[n]) for n in kept]
    slopes = spline_slopes(sensor, raw)[:, :, columns]
    alone = np.linalg.inv(np.linalg.inv(covariance)[np.ix_(kept, kept)])
    variance = np.einsum("nip,nip->ni", slopes @ alone, slopes)
    size: Floats = np.sqrt(variance.mean(axis=0))
    return size
