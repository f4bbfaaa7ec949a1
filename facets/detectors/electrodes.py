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

from ..core.units import Floats

KINDS = ("duo-lateral", "pincushion", "tetra-lateral")
#: Images of the potential are added until they have fallen to exp(-ENOUGH); sinh(MOST) is finite.
ENOUGH, MOST = 40.0, 700.0


def fractions(kind: str, y: Floats, z: Floats, aspect: float = 1.0) -> Floats:
    """The fraction of the photocurrent that flows into each electrode: (..., 4).

    y, z: (...). aspect: height over width of the area, for tetra-lateral. Duo-lateral and
    tetra-lateral: at -y, +y, -z, +z; pincushion: at (-,-), (+,-), (-,+), (+,+). They add up to 1;
    for duo-lateral, to 1 for each of its two layers.
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
    """The potential in a rectangle with the side at towards = 1 at 1 and the others at 0.

    along: the coordinate along that side; aspect: that side's length over the other's. In a strip
    without an opposite side, with x = pi distance / (2 aspect), the potential is the sum of
    (4 / pi n) cos(n pi along / 2) exp(-n x) over odd n with alternating signs. The sum is
    (2 / pi) arctan(cos(pi along / 2) / sinh x). The opposite side at 0 adds mirror images, which
    fall off as exp(-2 pi / aspect).
    """
    distance, along = 1 - np.asarray(towards), np.asarray(along)
    height = np.cos(np.pi / 2 * along)
    rate = np.pi / (2 * aspect)
    potential = np.zeros(np.broadcast(distance, along).shape)
    for image in range(1 + int(np.ceil(ENOUGH / (4 * rate)))):
        # The sum of this image and of the image of opposite sign behind it.
        there = distance + 4 * image
        for sign, away in ((1, there), (-1, there + 2 * (1 - distance) + 2)):
            depth = np.sinh(np.minimum(rate * away, MOST))
            potential += sign * 2 / np.pi * np.arctan2(height, depth)
    return potential


def ratios(kind: str, currents: Floats) -> Floats:
    """The two coordinates that the kind's formula gives for the electrodes' currents (..., 4)."""
    ends = end_sums(kind, currents[..., None])[..., 0]
    low, high = ends[..., 0], ends[..., 1]
    quotients: Floats = (high - low) / (high + low)
    return quotients


def end_sums(kind: str, parts: Floats) -> Floats:
    """Sum the electrodes' parts (..., 4, m) over those that light moves away from, and those it
    moves towards, along y and along z: (..., 2, 2, m)."""
    shape = (*parts.shape[:-2], 2, 2, parts.shape[-1])
    if kind != "pincushion":
        return parts.reshape(shape)
    a, b, c, d = (parts[..., k, :] for k in range(4))
    return np.stack([a + c, b + d, a + b, c + d], axis=-2).reshape(shape)


def total(kind: str, currents: Floats) -> Floats:
    """The photocurrent from the electrodes' currents (..., 4)."""
    sums: Floats = currents.sum(axis=-1) / (2 if kind == "duo-lateral" else 1)
    return sums


def places(kind: str, currents: Floats, aspect: float = 1.0) -> Floats:
    """The light's centroid (..., 2) from the electrodes' currents (..., 4).

    NaN where a tetra-lateral's currents fit no place on the area.
    """
    measured = ratios(kind, currents)
    return measured if kind != "tetra-lateral" else tetra_lateral_places(measured, aspect)


def tetra_lateral_places(measured: Floats, aspect: float) -> Floats:
    """The places (..., 2) at which a tetra-lateral gives ratios (..., 2), by Newton's method.

    Each result is independent of the others; NaN where no place has the ratios.
    """
    target = measured.reshape(-1, 2)
    place, open_ = target.copy(), np.arange(len(target))
    for _ in range(30):
        current = place[open_]
        rest = target[open_] - tetra_lateral_ratios(current, aspect)
        step = np.linalg.solve(slopes(current, aspect), rest[..., None])[..., 0]
        place[open_] = np.clip(current + np.clip(step, -0.3, 0.3), -0.97, 0.97)
        open_ = open_[~(np.abs(rest).max(axis=-1) < 1e-12)]
        if len(open_) == 0:
            break
    off = np.abs(target - tetra_lateral_ratios(place, aspect)).max(axis=-1) > 1e-9
    place[off] = np.nan
    return place.reshape(measured.shape)


def tetra_lateral_ratios(place: Floats, aspect: float) -> Floats:
    """The ratios (..., 2) that a tetra-lateral gives at places (..., 2)."""
    return ratios("tetra-lateral", fractions("tetra-lateral", place[..., 0], place[..., 1], aspect))


def slopes(place: Floats, aspect: float, step: float = 1e-6) -> Floats:
    """The derivatives (..., 2, 2) of `tetra_lateral_ratios` by the place."""
    columns = []
    for axis in np.eye(2):
        ahead, behind = (
            tetra_lateral_ratios(place + step * axis, aspect),
            tetra_lateral_ratios(place - step * axis, aspect),
        )
        columns.append((ahead - behind) / (2 * step))
    return np.stack(columns, axis=-1)
