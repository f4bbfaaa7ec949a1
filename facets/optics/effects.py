"""Deviations of real light from ideal light: their numbers, and the vectors made from them.

`LightEffects` holds the numbers that `facets.core.sensor.BenchLight` declares. `Light` is the form
that the optics uses; `build_light` makes it once for a sensor. Lengths are in mm, powers in mW.
"""

from __future__ import annotations

from math import inf
from typing import Any, NamedTuple

from ..scalars.dispatch import Number, cos, holds_anywhere, pi, real, sin, sqrt
from .vectors import Plane, Vector, angle_between, combine, cross, dot, unit_vector

Three = tuple[Any, Any, Any]
#: Components xxx, xxy, xyy, yyy of a symmetric tensor, in the beam's own or in other axes.
Four = tuple[Any, Any, Any, Any]
#: Components xxxx, xxxy, xxyy, xyyy, yyyy of a symmetric tensor, in the beam's own or other axes.
Five = tuple[Any, Any, Any, Any, Any]


class LightOptions(NamedTuple):
    """The constants of the light: floats and truth values in runs with any type of number.

    on: whether any effect is on; otherwise the formulas of ideal light apply.  coated: whether the
    facets' reflectance depends on the angle of incidence.  polarised: whether the light is
    polarised.  profiled: whether the beam's profile is not Gaussian, or stains take light.  halves:
    of each detector's sensitive area along y and z, mm: the window in which light is detected.
    nearest: lower bound of the distance from a spot to the window's edge in the formula of
    diffraction, mm, which has a pole at the edge.
    """

    on: bool
    coated: bool
    polarised: bool
    profiled: bool
    halves: Three
    nearest: Any


class LightEffects(NamedTuple):
    """The numbers and the options of the effects.

    numbers: of each field of `facets.core.sensor.BenchLight` that has numbers, by its name.
    """

    numbers: dict[str, Any]
    options: LightOptions


class Light(NamedTuple):
    """The effects in the form that the optics takes.

    bend: the wavefront's curvature as a matrix for vectors in sigmas: xx, xy, yx, yy; 1/mm.  fan:
    change of a ray's direction per sigma along the beam's two axes, in the world.  density: one
    over the area of a square of one sigma, 1/mm^2.  wavelength: mm.  rolloff: depth at the first
    and the second edge of each facet.  rolloff_width: mm.  strips: width lost along each edge, mm.
    tip: area lost at the tip, mm^2.  tip_fractions: of the facets in this area.  tip_offsets: from
    the apex to the middle of each facet's part, in the mirror's frame, mm.  background: power and
    place on each detector.  coating: its refractive index, n and k.  plain: twice its reflectance
    of unpolarised light at 45 degrees.  field: direction of polarised light, in the world.
    profile, asymmetry: symmetric tensors of fourth and third Hermite order, along the beam's own
    axes.  stains: coefficients of the light that each facet lacks.  own_axis: the first of the
    beam's own axes, in the axes of the stains.
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
    tip_fractions: Three
    tip_offsets: Three
    background: Three
    coating: tuple[Any, Any]
    plain: Number
    field: Vector
    profile: Five
    asymmetry: Four
    stains: Three
    own_axis: Plane


UNBOUNDED = (inf, inf)
OFF = LightOptions(False, False, False, False, (UNBOUNDED, UNBOUNDED, UNBOUNDED), 0.0)
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
    tip_fractions=ZERO_VECTOR,
    tip_offsets=(ZERO_VECTOR, ZERO_VECTOR, ZERO_VECTOR),
    background=(ZERO_VECTOR, ZERO_VECTOR, ZERO_VECTOR),
    coating=(1.0, 0.0),
    plain=1.0,
    field=ZERO_VECTOR,
    profile=(0.0, 0.0, 0.0, 0.0, 0.0),
    asymmetry=(0.0, 0.0, 0.0, 0.0),
    stains=((0.0,) * 15, (0.0,) * 15, (0.0,) * 15),
    own_axis=(1.0, 0.0),
)


def sector_centroid(first: Vector, second: Vector, opening: Number, radius: Number) -> Vector:
    """The vector from the middle of a disc to the centroid of its sector between two edges, seen
    along the mirror's axis, in the mirror's frame; mm."""
    size1 = sqrt(first[0] * first[0] + first[1] * first[1])
    size2 = sqrt(second[0] * second[0] + second[1] * second[1])
    far = 2 * radius / (3 * opening)
    return (
        far * (second[1] / size2 - first[1] / size1),
        far * (first[0] / size1 - second[0] / size2),
        radius * 0,
    )


def reflectances(index: tuple[Any, Any], cosine: Number) -> tuple[Number, Number]:
    """The reflectances (s, p) of a metal for light polarised across and along the plane of
    incidence.

    index: n and k of the refractive index n + i k.
    """
    n, k = index
    square = 1 - cosine * cosine
    level = n * n - k * k - square
    size = sqrt(level * level + 4 * n * n * k * k)
    a = sqrt((size + level) / 2)
    b2 = (size - level) / 2
    s = ((a - cosine) * (a - cosine) + b2) / ((a + cosine) * (a + cosine) + b2)
    tangent = square / cosine
    p = s * ((a - tangent) * (a - tangent) + b2) / ((a + tangent) * (a + tangent) + b2)
    return s, p


def ray_turn(curvature: Three, x: Vector, y: Vector, v: Vector) -> Vector:
    """The change of a ray's direction over a step v across the beam.

    curvature: of the wavefront, xx, xy, yy.
    """
    xx, xy, yy = curvature
    right, up = dot(v, x), dot(v, y)
    return combine(xx * right + xy * up, x, xy * right + yy * up, y)


def tensor_of(coefficients: Five) -> Five:
    """The symmetric tensor T for which T : dddd = sum c_n d^n."""
    a, b, c, d, e = coefficients
    return a, b / 4, c / 6, d / 4, e


def turn_tensor(t: Five, u: Plane, w: Plane) -> Five:
    """Components uuuu, uuuw, uuww, uwww, wwww of a symmetric tensor given as xxxx, ... yyyy."""
    u0, u1, u2, u3 = contract_fourth(t, u)
    w0, w1, w2, w3 = contract_fourth(t, w)
    uu = u0 * u[0] + u1 * u[1], u1 * u[0] + u2 * u[1], u2 * u[0] + u3 * u[1]
    uw = u0 * w[0] + u1 * w[1], u1 * w[0] + u2 * w[1], u2 * w[0] + u3 * w[1]
    ww = w0 * w[0] + w1 * w[1], w1 * w[0] + w2 * w[1], w2 * w[0] + w3 * w[1]
    return (
        contract_twice(uu, u, u),
        contract_twice(uu, u, w),
        contract_twice(uu, w, w),
        contract_twice(uw, w, w),
        contract_twice(ww, w, w),
    )


def turn_cubic(t: Four, u: Plane, w: Plane) -> Four:
    """Components uuu, uuw, uww, www of a symmetric tensor given as xxx, xxy, xyy, yyy."""
    along = t[0] * u[0] + t[1] * u[1], t[1] * u[0] + t[2] * u[1], t[2] * u[0] + t[3] * u[1]
    across = t[0] * w[0] + t[1] * w[1], t[1] * w[0] + t[2] * w[1], t[2] * w[0] + t[3] * w[1]
    return (
        contract_twice(along, u, u),
        contract_twice(along, u, w),
        contract_twice(along, w, w),
        contract_twice(across, w, w),
    )


def contract_fourth(t: Five, v: Plane) -> tuple[Any, Any, Any, Any]:
    """The contraction (xxx, xxy, xyy, yyy) of a symmetric tensor of fourth order, (xxxx, ...,
    yyyy), with a vector."""
    return (
        t[0] * v[0] + t[1] * v[1],
        t[1] * v[0] + t[2] * v[1],
        t[2] * v[0] + t[3] * v[1],
        t[3] * v[0] + t[4] * v[1],
    )


def contract_twice(t: Three, v: Plane, w: Plane) -> Number:
    """The number v t w.  t: a symmetric matrix, as xx, xy, yy."""
    return (t[0] * v[0] + t[1] * v[1]) * w[0] + (t[1] * v[0] + t[2] * v[1]) * w[1]


def split_in_three(numbers: tuple[Any, ...], count: int) -> Three:
    """Three tuples of `count` numbers, for the three facets or detectors."""
    return numbers[:count], numbers[count : 2 * count], numbers[2 * count :]


def build_light(
    effects: LightEffects,
    edges: Three,
    axes: tuple[Vector, Vector],
    spread: tuple[Vector, Vector],
    whitening: tuple[Vector, Vector],
) -> Light:
    """Convert `effects` to the form that the optics takes.

    edges: of the mirror, in its frame.  axes: the world's x and y, rotated with the beam's tilt, in
    which curvature and polarisation are given.  spread, whitening: as in `Geometry`.
    """
    x, y = axes
    flat = [(x, y) for x, y, _ in edges]  # as seen along the mirror's axis
    angles = tuple(angle_between(flat[k], flat[(k + 1) % 3]) for k in range(3))
    full_turn = 2 * pi(angles[0])
    numbers = effects.numbers
    (area,) = numbers["tip"]
    radius = sqrt(area / pi(area)) if holds_anywhere(real(area) > 0) else area * 0
    curvature = (*numbers["curvature_xx"], *numbers["curvature_xy"], *numbers["curvature_yy"])
    first, second = ray_turn(curvature, x, y, spread[0]), ray_turn(curvature, x, y, spread[1])
    normal = cross(whitening[0], whitening[1])
    u = unit_vector((dot(spread[0], x), dot(spread[0], y)))  # the first of the beam's own axes
    across_u, odd = (-u[1], u[0]), numbers["asymmetry"]
    (n, k), (polarization,) = numbers["index"], numbers["polarization"]
    across, along = reflectances((n, k), sqrt((n * 0 + 1) / 2))
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
        wavelength=numbers["wavelength"][0],
        rolloff=split_in_three(numbers["rolloff"], 2),
        rolloff_width=numbers["rolloff_width"][0],
        strips=numbers["strips"],
        tip=area,
        tip_fractions=(angles[0] / full_turn, angles[1] / full_turn, angles[2] / full_turn),
        tip_offsets=(
            sector_centroid(edges[0], edges[1], angles[0], radius),
            sector_centroid(edges[1], edges[2], angles[1], radius),
            sector_centroid(edges[2], edges[0], angles[2], radius),
        ),
        background=split_in_three(numbers["background"], 3),
        coating=(n, k),
        plain=across + along,
        field=combine(cos(polarization), x, sin(polarization), y),
        profile=turn_tensor(tensor_of(numbers["profile"]), u, across_u),
        asymmetry=turn_cubic((odd[0], odd[1] / 3, odd[2] / 3, odd[3]), u, across_u),
        stains=split_in_three(numbers["stains"], 15),
        own_axis=u,
    )
