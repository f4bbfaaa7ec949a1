"""Convert the position of light on a position-sensitive detector to electrode currents, and back.

Three kinds, with the formulas of Hamamatsu's handbook on PSDs (Opto-Semiconductor Handbook, chapter
PSD). Positions are in half sizes of the sensitive area, -1 to 1, along y (psi) and z (zeta).

duo-lateral     a resistive layer on either face: two electrodes share the current along y, two
                along z. y = (I2 - I1) / (I1 + I2), which is linear.
pincushion      four electrodes at the corners of one layer whose rim makes it linear (improved
                tetra-lateral): y = ((I2 + I4) - (I1 + I3)) / (I1 + I2 + I3 + I4).
tetra-lateral   four electrodes along the sides of one layer, with the formula of duo-lateral, which
                is not linear here. The fraction of the current into a side equals the potential at
                the light's position if that side is at 1 and the others at 0; inverting this
                function gives the position.
"""

from __future__ import annotations

import numpy as np

from ..core.units import Floats

KINDS = ("duo-lateral", "pincushion", "tetra-lateral")
#: Mirror images of the potential are summed until they have fallen to exp(-IMAGE_DECAY).
IMAGE_DECAY = 40.0
#: Largest argument of sinh, whose result is then still finite.
MAX_SINH = 700.0


def fractions(kind: str, y: Floats, z: Floats, aspect: float = 1.0) -> Floats:
    """Fractions (..., 4) of the photocurrent that flow into the electrodes.

    y, z: (...) position of the light, in half sizes.  aspect: height over width of the area, for
    tetra-lateral. The electrodes lie at -y, +y, -z, +z; those of pincushion at the corners (-,-),
    (+,-), (-,+), (+,+). The fractions add up to 1; for duo-lateral, to 1 in each of its two layers.
    """
    if kind == "duo-lateral":
        half_y, half_z = y / 2, z / 2
        return np.stack([0.5 - half_y, 0.5 + half_y, 0.5 - half_z, 0.5 + half_z], axis=-1)
    if kind == "pincushion":
        corners = [(1 - y) * (1 - z), (1 + y) * (1 - z), (1 - y) * (1 + z), (1 + y) * (1 + z)]
        return np.stack(corners, axis=-1) / 4
    sides = [
        side_potential(-y, z, aspect),
        side_potential(y, z, aspect),
        side_potential(-z, y, 1 / aspect),
        side_potential(z, y, 1 / aspect),
    ]
    return np.stack(sides, axis=-1)


def side_potential(towards: Floats, along: Floats, aspect: float) -> Floats:
    """Potential (...) in a rectangle whose one side is at potential 1 and the others at 0.

    towards: (...) coordinate towards that side, which is at 1.  along: (...) coordinate along it.
    aspect: length of that side over the other's. In a strip
    without an opposite side, with x = pi distance / (2 aspect), the potential is the sum of
    (4 / pi n) cos(n pi along / 2) exp(-n x) over odd n with alternating signs. The sum is
    (2 / pi) arctan(cos(pi along / 2) / sinh x). The opposite side at 0 adds mirror images, which
    fall off as exp(-2 pi / aspect).
    """
    distance, along = 1 - np.asarray(towards), np.asarray(along)
    height = np.cos(np.pi / 2 * along)
    rate = np.pi / (2 * aspect)
    potential = np.zeros(np.broadcast(distance, along).shape)
    for image in range(1 + int(np.ceil(IMAGE_DECAY / (4 * rate)))):
        # Each image has one of opposite sign behind it.
        near = distance + 4 * image
        for sign, image_distance in ((1, near), (-1, near + 2 * (1 - distance) + 2)):
            depth = np.sinh(np.minimum(rate * image_distance, MAX_SINH))
            potential += sign * 2 / np.pi * np.arctan2(height, depth)
    return potential


def ratios(kind: str, currents: Floats) -> Floats:
    """Coordinates (..., 2), in half sizes, by the kind's formula from electrode currents (..., 4);
    for tetra-lateral not yet linear."""
    ends = end_sums(kind, currents[..., None])[..., 0]
    low, high = ends[..., 0], ends[..., 1]
    quotients: Floats = (high - low) / (high + low)
    return quotients


def end_sums(kind: str, parts: Floats) -> Floats:
    """Sum quantities of the electrodes (..., 4, m) over the negative and the positive end of y and
    of z: (..., 2, 2, m), by axis and end."""
    shape = (*parts.shape[:-2], 2, 2, parts.shape[-1])
    if kind != "pincushion":
        return parts.reshape(shape)
    a, b, c, d = (parts[..., k, :] for k in range(4))
    return np.stack([a + c, b + d, a + b, c + d], axis=-2).reshape(shape)


def total(kind: str, currents: Floats) -> Floats:
    """The photocurrent (...) from the electrodes' currents (..., 4), in the same unit."""
    sums: Floats = currents.sum(axis=-1) / (2 if kind == "duo-lateral" else 1)
    return sums


def places(kind: str, currents: Floats, aspect: float = 1.0) -> Floats:
    """Centroid of the light (..., 2), in half sizes, from the electrodes' currents (..., 4).

    NaN where a tetra-lateral's currents fit no position on the area.
    """
    measured = ratios(kind, currents)
    return measured if kind != "tetra-lateral" else tetra_lateral_places(measured, aspect)


def tetra_lateral_places(measured: Floats, aspect: float) -> Floats:
    """Positions (..., 2), in half sizes, at which a tetra-lateral measures ratios (..., 2).

    Newton's method, for each position on its own; NaN where no position has the ratios.
    """
    target = measured.reshape(-1, 2)
    place, remaining = target.copy(), np.arange(len(target))
    for _ in range(30):
        current = place[remaining]
        residual = target[remaining] - tetra_lateral_ratios(current, aspect)
        step = np.linalg.solve(slopes(current, aspect), residual[..., None])[..., 0]
        place[remaining] = np.clip(current + np.clip(step, -0.3, 0.3), -0.97, 0.97)
        remaining = remaining[~(np.abs(residual).max(axis=-1) < 1e-12)]
        if len(remaining) == 0:
            break
    has_failed = np.abs(target - tetra_lateral_ratios(place, aspect)).max(axis=-1) > 1e-9
    place[has_failed] = np.nan
    return place.reshape(measured.shape)


def tetra_lateral_ratios(place: Floats, aspect: float) -> Floats:
    """Ratios (..., 2) that a tetra-lateral measures for light at positions (..., 2)."""
    return ratios("tetra-lateral", fractions("tetra-lateral", place[..., 0], place[..., 1], aspect))


def slopes(place: Floats, aspect: float, step: float = 1e-6) -> Floats:
    """Derivatives (..., 2, 2) of `tetra_lateral_ratios` by the position, as central differences."""
    columns = []
    for axis in np.eye(2):
        ahead, behind = (
            tetra_lateral_ratios(place + step * axis, aspect),
            tetra_lateral_ratios(place - step * axis, aspect),
        )
        columns.append((ahead - behind) / (2 * step))
    return np.stack(columns, axis=-1)
