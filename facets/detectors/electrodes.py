"""A position-sensitive detector from its light to its electrodes' currents, and back.

Three kinds, with the formulas of Hamamatsu's handbook on PSDs (Opto-Semiconductor Handbook, chapter
PSD). Places are in half sizes of the sensitive area, -1 to 1, along y (psi) and z (zeta).

duo-lateral     a resistive layer on either face: two electrodes share the current along y, two
                along z. y = (I2 - I1) / (I1 + I2). Linear.
pincushion      four electrodes at the corners of one layer whose rim makes it linear (improved
                tetra-lateral): y = ((I2 + I4) - (I1 + I3)) / (I1 + I2 + I3 + I4).
tetra-lateral   four electrodes along the sides of one layer: y as duo-lateral, but bent. The sheet
                conducts evenly, so the current into a side is the potential at the light of a sheet
                with that side at 1 and the others at 0; readings are straightened by inverting it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

KINDS = ("duo-lateral", "pincushion", "tetra-lateral")
#: Where the potential's series ends: its terms have fallen to exp(-ENOUGH), or there are enough for
#: 1e-12 up to 0.97 of the half size.
ENOUGH, MOST_TERMS = 32.0, 700


def fractions(kind: str, y: Floats, z: Floats, aspect: float = 1.0) -> Floats:
    """Of the photocurrent, what flows into each electrode: (..., 4).

    y, z: (...). aspect: height over width of the area, for tetra-lateral. Duo-lateral and
    tetra-lateral: at -y, +y, -z, +z; pincushion: at (-,-), (+,-), (-,+), (+,+). They add up to 1;
    for duo-lateral, to 1 for each of its two layers.
    """
    if kind == "duo-lateral":
        return np.stack([1 - y, 1 + y, 1 - z, 1 + z], axis=-1) / 2
    if kind == "pincushion":
        corners = [(1 - y) * (1 - z), (1 + y) * (1 - z), (1 - y) * (1 + z), (1 + y) * (1 + z)]
        return np.stack(corners, axis=-1) / 4
    sides = [
        side(-y, z, aspect),
        side(y, z, aspect),
        side(-z, y, 1 / aspect),
        side(z, y, 1 / aspect),
    ]
    return np.stack(sides, axis=-1)


def side(towards: Floats, along: Floats, aspect: float) -> Floats:
    """The potential in a rectangle with the side at towards = 1 at 1 and the others at 0.

    along: the coordinate along that side; aspect: that side's length over the other's.
    """
    towards, along = np.asarray(towards), np.asarray(along)
    potential = np.zeros(np.broadcast(towards, along).shape)
    nearest = towards.max(initial=-1.0)
    for n in range(1, MOST_TERMS, 2):
        rate = n * np.pi / (2 * aspect)
        if rate * (1 - nearest) > ENOUGH:
            break
        # sinh(rate (1 + towards)) / sinh(2 rate), without overflow
        shape = np.exp(rate * (towards - 1)) * np.expm1(-2 * rate * (1 + towards))
        sign = 1 if n % 4 == 1 else -1
        factor = 4 * sign / (np.pi * n * np.expm1(-4 * rate))
        potential += factor * np.cos(n * np.pi / 2 * along) * shape
    return potential


def ratios(kind: str, currents: Floats) -> Floats:
    """The two coordinates that the electrodes' currents (..., 4) give by the kind's formula."""
    low_y, high_y, low_z, high_z = np.moveaxis(currents, -1, 0)
    if kind == "pincushion":
        a, b, c, d = low_y, high_y, low_z, high_z
        low_y, high_y, low_z, high_z = a + c, b + d, a + b, c + d
    pairs = [(high_y - low_y) / (high_y + low_y), (high_z - low_z) / (high_z + low_z)]
    return np.stack(pairs, axis=-1)


def total(kind: str, currents: Floats) -> Floats:
    """The photocurrent from the electrodes' currents (..., 4)."""
    whole: Floats = currents.sum(axis=-1) / (2 if kind == "duo-lateral" else 1)
    return whole


def places(kind: str, currents: Floats, aspect: float = 1.0) -> Floats:
    """Where the light's centroid is, from the electrodes' currents (..., 4): (..., 2).

    NaN where a tetra-lateral's currents fit no place on the area.
    """
    measured = ratios(kind, currents)
    if kind != "tetra-lateral":
        return measured
    found = measured.copy()
    for _ in range(30):
        rest = measured - bent(found, aspect)
        step = np.linalg.solve(slopes(found, aspect), rest[..., None])[..., 0]
        found = np.clip(found + np.clip(step, -0.3, 0.3), -0.97, 0.97)
        if np.abs(rest).max(initial=0) < 1e-12:
            break
    off = np.abs(measured - bent(found, aspect)).max(axis=-1) > 1e-9
    found[off] = np.nan
    return found


def bent(place: Floats, aspect: float) -> Floats:
    """The ratios (..., 2) that a tetra-lateral gives at places (..., 2)."""
    return ratios("tetra-lateral", fractions("tetra-lateral", place[..., 0], place[..., 1], aspect))


def slopes(place: Floats, aspect: float, step: float = 1e-6) -> Floats:
    """The derivatives (..., 2, 2) of `bent` by the place."""
    columns = []
    for axis in np.eye(2):
        ahead, behind = bent(place + step * axis, aspect), bent(place - step * axis, aspect)
        columns.append((ahead - behind) / (2 * step))
    return np.stack(columns, axis=-1)
