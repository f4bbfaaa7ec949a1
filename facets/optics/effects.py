"""Deviations of real light from the ideal: their numbers, and the vectors made from them.

`LightEffects` holds the numbers, `EFFECTS` their names and order. `Light` is the form that the
optics uses; `build_light` makes it once a sensor. Lengths in mm, powers in mW.
"""

from __future__ import annotations

from math import inf
from typing import Any, NamedTuple

from ..scalars.dispatch import Number, cos, pi, real, sin, sqrt
from .vectors import Vector, angle_between, combine, cross, dot

Three = tuple[Any, Any, Any]

#: The order of the numbers in `Effects.values`.
EFFECTS = (
    *(f"light.curvature_{axes}" for axes in ("xx", "xy", "yy")),
    "light.wavelength",
    *(f"edge_{edge}.rolloff" for edge in ("ca_a", "ab_a", "ab_b", "bc_b", "bc_c", "ca_c")),
    *(f"strip_{edge}.width" for edge in ("ca", "ab", "bc")),
    "tip.area",
    *(f"background_{letter}.{what}" for letter in "abc" for what in ("power", "y", "z")),
    "coating.n",
    "coating.k",
    "light.polarization",
    "rolloff.width",
)


class LightOptions(NamedTuple):
    """Constants: plain floats and truth values for all types of number.

    on: whether any effect is on; otherwise the formulas of ideal light apply.  coated: whether the
    facets reflect by incidence.  polarised: whether the light is polarised.  halves: of each
    detector's sensitive area along y and z, mm: the window in which light counts.  nearest: the
    least distance from a spot to the window's edge in the formula of diffraction, mm, which has a
    pole at the edge.
    """

    on: bool
    coated: bool
    polarised: bool
    halves: Three
    nearest: Any


class LightEffects(NamedTuple):
    """The numbers of the effects.

    values: in the order of `EFFECTS`.
    """

    values: tuple[Any, ...]
    options: LightOptions


class Light(NamedTuple):
    """The effects in the form that the optics takes.

    bend: the wavefront's curvature as it acts on vectors in sigmas: xx, xy, yx, yy; 1/mm.  fan:
    change of a ray's direction per sigma along the beam's two axes, in the world.  density: one
    over the area of a square of one sigma, 1/mm^2.  rolloff: of the first and the second edge of
    each facet.  tip_shares: shares of the facets in the loss at the tip.  tip_offsets: from the
    apex to the middle of each share, in the mirror's frame.  background: power and place on each
    detector.  coating: its refractive index, n and k.  plain: twice its reflectance of unpolarised
    light at 45 degrees.  field: direction of polarised light, in the world.
    """

    options: LightOptions
    bend: tuple[Any, Any, Any, Any]
    fan: tuple[Vector, Vector]
    density: Number
    wavelength: Number
    rolloff: Three
    rolloff_width: Number
    strips: Three
    tip: Number
    tip_shares: Three
    tip_offsets: Three
    background: Three
    coating: tuple[Any, Any]
    plain: Number
    field: Vector


UNBOUNDED = (inf, inf)
OFF = LightOptions(False, False, False, (UNBOUNDED, UNBOUNDED, UNBOUNDED), 0.0)
ZERO_VECTOR = (0.0, 0.0, 0.0)
IDEAL = Light(
    options=OFF,
    bend=(0.0, 0.0, 0.0, 0.0),
    fan=(ZERO_VECTOR, ZERO_VECTOR),
    density=0.0,
    wavelength=0.0,
    rolloff=((0.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
    rolloff_width=0.0,
    strips=ZERO_VECTOR,
    tip=0.0,
    tip_shares=ZERO_VECTOR,
    tip_offsets=(ZERO_VECTOR, ZERO_VECTOR, ZERO_VECTOR),
    background=(ZERO_VECTOR, ZERO_VECTOR, ZERO_VECTOR),
    coating=(1.0, 0.0),
    plain=1.0,
    field=ZERO_VECTOR,
)


def sector_centroid(first: Vector, second: Vector, opening: Number, radius: Number) -> Vector:
    """The vector from the middle of a disc to the centroid of its sector between two edges, seen
    along the mirror's axis, in the mirror's frame; mm."""
    one = sqrt(first[0] * first[0] + first[1] * first[1])
    other = sqrt(second[0] * second[0] + second[1] * second[1])
    far = 2 * radius / (3 * opening)
    return (
        far * (second[1] / other - first[1] / one),
        far * (first[0] / one - second[0] / other),
        radius * 0,
    )


def reflectances(index: tuple[Any, Any], cosine: Number) -> tuple[Number, Number]:
    """The reflectances across and along the plane of incidence (s, p) of a metal of index n + i
    k."""
    n, k = index
    square = 1 - cosine * cosine
    level = n * n - k * k - square
    whole = sqrt(level * level + 4 * n * n * k * k)
    a = sqrt((whole + level) / 2)
    b2 = (whole - level) / 2
    s = ((a - cosine) * (a - cosine) + b2) / ((a + cosine) * (a + cosine) + b2)
    tangent = square / cosine
    p = s * ((a - tangent) * (a - tangent) + b2) / ((a + tangent) * (a + tangent) + b2)
    return s, p


def ray_turn(effects: tuple[Any, ...], x: Vector, y: Vector, v: Vector) -> Vector:
    """The change of a ray's direction over a step v across the beam."""
    xx, xy, yy = effects[:3]
    right, up = dot(v, x), dot(v, y)
    return combine(xx * right + xy * up, x, xy * right + yy * up, y)


def build_light(
    effects: LightEffects,
    edges: Three,
    axes: tuple[Vector, Vector],
    spread: tuple[Vector, Vector],
    whitening: tuple[Vector, Vector],
) -> Light:
    """Convert `effects` to the form that the optics takes.

    edges: of the mirror, in its frame.  axes: the world's x and y as the beam's tilt carries them,
    in which curvature and polarisation are given.  spread, whitening: as in `Geometry`.
    """
    x, y = axes
    flat = [(x, y) for x, y, _ in edges]  # These are seen along the mirror's axis.
    shares = tuple(angle_between(flat[k], flat[(k + 1) % 3]) for k in range(3))
    whole = 2 * pi(shares[0])
    area = effects.values[13]
    radius = sqrt(area / pi(area)) if real(area) > 0 else area * 0
    v = effects.values
    first, second = ray_turn(v, x, y, spread[0]), ray_turn(v, x, y, spread[1])
    normal = cross(whitening[0], whitening[1])
    across, along = reflectances((v[23], v[24]), sqrt((v[23] * 0 + 1) / 2))
    return Light(
        options=effects.options,
        bend=(
            dot(whitening[0], first),
            dot(whitening[0], second),
            dot(whitening[1], first),
            dot(whitening[1], second),
        ),
        fan=(first, second),
        density=sqrt(dot(normal, normal)),
        wavelength=v[3],
        rolloff=((v[4], v[5]), (v[6], v[7]), (v[8], v[9])),
        rolloff_width=v[26],
        strips=(v[10], v[11], v[12]),
        tip=v[13],
        tip_shares=(shares[0] / whole, shares[1] / whole, shares[2] / whole),
        tip_offsets=(
            sector_centroid(edges[0], edges[1], shares[0], radius),
            sector_centroid(edges[1], edges[2], shares[1], radius),
            sector_centroid(edges[2], edges[0], shares[2], radius),
        ),
        background=((v[14], v[15], v[16]), (v[17], v[18], v[19]), (v[20], v[21], v[22])),
        coating=(v[23], v[24]),
        plain=across + along,
        field=combine(cos(v[25]), x, sin(v[25]), y),
    )
