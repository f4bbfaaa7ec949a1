"""Check a certificate of uniqueness without any of the code that made it.

`python -m facets.experiments.check_certificate results/paper-jacobian/certificate.json`

It relies on the following, and on nothing else:

1. the theorem in docs/uniqueness.md, and S <= 1 for a normal distribution cut to a convex set;
2. that the sensor is as that page says: ideal light, flat facets, nothing else that cuts light;
3. the outward rounding of python-flint's intervals (Arb), and Python's comparison of floats;
4. JSON as Python reads it, after which the file has to fit the schema, every number finite;
5. this file with certificate_schema.py and .json, _optics.py and _pieces.py, some 1,000 lines;
   nothing else of the project;
6. that numpy's arrays of objects call the operators of their elements; its numbers are used only
   where they need not be right.

It trusts no number of the file. It traces rays itself, takes derivatives by dual numbers instead of
closed formulas, bounds the light on its own grid, and compares the pieces' edges exactly. It checks
that

- the configuration has this checksum and these parameters;
- the pieces fill the box;
- the bounds of the light are true;
- the hull of all Jacobians is regular with the file's inverse and weights, or about every middle.

It reports the claims that it could not verify. NaN fails every test; no test is an assert.

Functions named `check_...` raise `Refused` if they cannot verify something. Offsets q (2,) are in
sigmas of the beam, angles in rad; numbers are intervals, whose comparison holds only if it does for
all their values.
"""

from __future__ import annotations

import hashlib
import json
import sys
from fractions import Fraction
from itertools import pairwise, product
from math import floor, radians
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from flint import arb

from .certificate_optics import (
    Array,
    IntervalSensor,
    edges_of,
    farthest_offset,
    openings_between,
    span,
)
from .certificate_pieces import CheckResult, check_hull, check_middles, check_pieces
from .certificate_schema import SCHEMA, Refused, conform, refuse_unless

#: Number of cells on each side of the square of offsets, of rays across a facet (more in cells
#: that were cut), and of parts of the yaw range.
CELLS, RAYS, PARTS = 8, 24, 3
#: Largest number of times that a cell is quartered to verify the bounds of the light.
DEPTH = 8
#: Blocks that a sensor's configuration may have.
BLOCKS = ("beam", "mirror", "psd", "noise", "drift", "electronics", "apertures", "imperfections",
          "light", "temperature", "calibration")  # fmt: skip
#: Largest rounding difference between a parameter and its key, relative for magnitudes above 1.
ROUNDED = 1e-12


def nonnegative(x: Any) -> Any:
    """The lower end of an interval, but at least 0."""
    return max(x.lower(), arb(0))


class RayLight(NamedTuple):
    """Half-line over a cell of offsets: its light L, the means K / L and J / K along it, which all
    fall with q . u, and its direction u (2,)."""

    light: Any
    mean: Any
    reach: Any
    u: Array


def half_line(q: Array, angle: Any) -> RayLight:
    """The light along a half-line from q at an angle, enclosed for all q of a cell."""
    u = np.array([angle.cos(), angle.sin()])
    along = q @ u
    near, far = half_line_means(along.lower()), half_line_means(along.upper())
    aside = cross_product(q, u)
    nearest, farthest = (
        ((-(side**2)) / 2).exp() for side in (aside.abs_lower(), aside.abs_upper())
    )
    scale = (8 * arb.pi()).sqrt()
    light = (far[0] * farthest / scale).union(near[0] * nearest / scale)
    return RayLight(light, far[1].union(near[1]), far[2].union(near[2]), u)


def cross_product(u: Array, v: Array) -> Any:
    """The cross product of two vectors (2,)."""
    return u[0] * v[1] - u[1] * v[0]


def half_line_means(x: Any) -> tuple[Any, Any, Any]:
    """Return erfc and the means K / L and J / K of the light on a half-line that begins at x."""
    beyond = (x / arb(2).sqrt()).erfc()
    rho = (arb(2) / arb.pi()).sqrt() * (-x * x / 2).exp() / beyond - x
    return beyond, rho, 1 / rho - x


def holds(claim: list[float], value: Any) -> bool:
    """Whether a value lies within the two ends of a claim."""
    return bool(value >= arb(claim[0])) and bool(value <= arb(claim[1]))


Claims = list[tuple[list[float], Any]]


def light_on(edge: Any, opening: Any, q: Array, rays: int) -> tuple[Any, Array]:
    """Fraction of the light on a facet, and the light's centroid (2,) less the apex, over a
    cell."""
    mass, moment = arb(0), np.array([arb(0), arb(0)])
    for n in range(rays):
        ray = half_line(q, edge + opening * ((span(0, 1) + n) / rays))
        low = nonnegative(ray.light) * nonnegative(ray.mean)
        density = low.union(ray.light.upper() * ray.mean.upper())
        mass += density
        moment = moment + density * ray.reach * ray.u
    return mass * opening / rays, moment / mass


def claims_in_cell(edges: Any, q: Array, shares: Any, middles: Any, light: Any) -> Claims:
    """Pairs of a bound of the light in the file and its value computed in a cell of offsets."""
    rays = [half_line(q, edge[0]) for edge in edges]
    alpha = [cross_product(rays[e - 2].u, rays[e - 1].u) for e in range(3)]
    claims: Claims = [(light["slope"], slope_of_shares([ray.light for ray in rays], alpha))]
    for j in range(3):
        turns = [edge[1][j] for edge in edges]
        dq, half = offset_motion(rays, alpha, turns)
        for k in range(3):
            pushed = pushed_moment(rays, turns, k, middles[k])
            moved = pushed / shares[k] - dq / 2 + half * span(-1, 1)
            claims += [(light["turns"][k][i][j], moved[i]) for i in range(2)]
    return claims + [(light["from_point"][k][i], middles[k][i]) for k in range(3) for i in range(2)]


def offset_motion(rays: list[RayLight], alpha: list[Any], turns: list[Any]) -> tuple[Array, Any]:
    """Motion (2,) of the apex that keeps the shares while the edges turn, and half the bound of its
    length."""
    flow = sum(alpha[e] * rays[e].mean * turns[e] for e in range(3))
    flow = flow / sum(alpha[e] / rays[e].light for e in range(3))
    w = [flow / ray.light - ray.mean * turn for ray, turn in zip(rays, turns, strict=True)]
    dq = (w[0] * rays[1].u - w[1] * rays[0].u) / alpha[2]
    return dq, (dq[0].abs_upper() ** 2 + dq[1].abs_upper() ** 2).sqrt() / 2


def pushed_moment(rays: list[RayLight], turns: list[Any], k: int, middle: Array) -> Any:
    """First moment (2,) that facet k gains when its two edges turn."""
    first, second = (
        rays[e].light * rays[e].mean * turns[e] * (rays[e].reach * rays[e].u - middle)
        for e in (k, (k + 1) % 3)
    )
    return second - first


def slope_of_shares(lights: list[Any], alpha: list[Any]) -> Any:
    """The determinant of the derivatives of two shares by the apex's offset."""
    products = [(lights[e - 1], lights[e], alpha[e - 2]) for e in range(3)]
    low = sum(nonnegative(a) * nonnegative(b) * nonnegative(c) for a, b, c in products)
    return low.union(sum(a.upper() * b.upper() * c.upper() for a, b, c in products))


def check_cell(
    edges: Any, openings: list[Any], q: Array, least_share: float, light: Any, depth: int = 0
) -> None:
    """Check the file's bounds in a cell (2,) of offsets, unless a facet has less than the least
    share everywhere in it. Raises `Refused` if they fail even in quarters of `DEPTH` levels."""
    shares, middles = [], []
    for k in range(3):
        part, middle = light_on(edges[k][0], openings[k], q, RAYS * (1 + depth // 2))
        if part.upper() < least_share:
            return
        shares.append(max(part.lower(), arb(least_share)).union(part.upper()))
        middles.append(middle)
    if all(holds(*claim) for claim in claims_in_cell(edges, q, shares, middles, light)):
        return
    refuse_unless(
        depth < DEPTH, f"the bounds of the light do not hold with the apex near {q.tolist()}"
    )
    for quarter in product(*(halve_interval(side) for side in q)):
        check_cell(edges, openings, np.array(quarter), least_share, light, depth + 1)


def halve_interval(x: Any) -> list[Any]:
    """The halves of an interval, which share its midpoint."""
    low, middle, high = x.lower(), x.mid(), x.upper()
    return [low.union(middle), middle.union(high)]


def parts_of(low: float, high: float, count: int) -> list[float]:
    """Ends of equal parts; the last end is exactly `high`, without rounding."""
    return [low, *(low + (high - low) * part / count for part in range(1, count)), high]


def check_light(rig: IntervalSensor, content: dict[str, Any]) -> None:
    """Check the bounds of the light over a square of offsets, outside of which some facet has less
    than the least share."""
    low, high, least_share = content["low"], content["high"], content["least_share"]
    count = PARTS if high[5] > low[5] else 1
    for yaw in (span(*part) for part in pairwise(parts_of(low[5], high[5], count))):
        edges = edges_of(rig, [span(low[3], high[3]), span(low[4], high[4]), yaw])
        openings = openings_between(edges)
        far = farthest_offset(openings, least_share)
        sides = [arb(x.numerator) / x.denominator for x in
                 (far * (2 * n - CELLS) / CELLS for n in range(CELLS + 1))]  # fmt: skip
        strips = [a.union(b) for a, b in pairwise(sides)]
        for cell in product(strips, repeat=2):
            check_cell(edges, openings, np.array(cell), least_share, content["light"])


def check_cover(content: dict[str, Any]) -> None:
    """Check that the pieces fill the box, cut along their edges until a piece holds each part.

    Floats are only compared, so nothing is rounded.
    """
    low, high = content["low"], content["high"]
    ordered = all(a <= b for a, b in zip(low, high, strict=True))
    refuse_unless(ordered, "the box has an upper end below its lower one")
    for piece in content["pieces"]:
        ends = zip(low, piece["low"], piece["high"], high, strict=True)
        refuse_unless(all(a <= b <= c <= d for a, b, c, d in ends), f"a piece is not in the box:"
                      f" {piece['low']} to {piece['high']}")  # fmt: skip
    fill(tuple(low), tuple(high), [(p["low"], p["high"]) for p in content["pieces"]])


Ends = tuple[float, ...]


def fill(low: Ends, high: Ends, pieces: list[Any]) -> None:
    """Raise `Refused` if the pieces that meet a cell do not fill it."""
    refuse_unless(bool(pieces), f"the pieces leave a hole from {low} to {high}")
    if any(holds_cell(piece, low, high) for piece in pieces):
        return
    axis, place = best_cut(low, high, pieces)
    first, second = (*high[:axis], place, *high[axis + 1 :]), (*low[:axis], place, *low[axis + 1 :])
    fill(low, first, [piece for piece in pieces if piece[0][axis] < place])
    fill(second, high, [piece for piece in pieces if piece[1][axis] > place])


def holds_cell(piece: Any, low: Ends, high: Ends) -> bool:
    """Whether a piece contains a cell."""
    ends = zip(piece[0], low, high, piece[1], strict=True)
    return all(a <= b and c <= d for a, b, c, d in ends)


def best_cut(low: Ends, high: Ends, pieces: list[Any]) -> tuple[int, float]:
    """Choose the edge inside a cell that cuts the fewest pieces; of equals, the most central.
    Returns its axis and place. Raises `Refused` if no edge is inside."""
    edges = {
        (axis, end[axis])
        for piece in pieces
        for end in piece
        for axis in range(6)
        if low[axis] < end[axis] < high[axis]
    }

    refuse_unless(bool(edges), f"the pieces leave a hole from {low} to {high}")

    def cost(edge: tuple[int, float]) -> tuple[int, int]:
        """The number of pieces that the edge cuts, and the imbalance of the others."""
        axis, place = edge
        below = sum(piece[0][axis] < place for piece in pieces)
        above = sum(piece[1][axis] > place for piece in pieces)
        return below + above, abs(below - above)

    return min(sorted(edges), key=cost)


def check_configuration(content: dict[str, Any], result: CheckResult) -> None:
    """Check the resolved configuration's checksum and that the parameters are its sensor's."""
    resolved, checksum = content["resolved"], content.get("config_sha256")
    if resolved is None:
        refuse_unless(
            checksum is None, "config_sha256 is given without its configuration, resolved"
        )
        result.not_verified.append("that the parameters are those of any configuration")
        return
    text = json.dumps(resolved, separators=(",", ":"), allow_nan=False)
    refuse_unless(hashlib.sha256(text.encode()).hexdigest() == checksum,
                  "config_sha256 is not the checksum of the configuration, resolved")  # fmt: skip
    try:
        parameters = parameters_of(resolved["sensor"])
    except (KeyError, TypeError, ValueError) as error:
        raise Refused(f"the configuration's sensor is no sensor: {error!r}") from None
    unknown = sorted(set(resolved["sensor"]) - set(BLOCKS))
    refuse_unless(not unknown, f"the sensor has {', '.join(unknown)}, of which nothing is known")
    same = all(
        abs(a - b) <= ROUNDED * max(1.0, abs(b))
        for a, b in zip(content["parameters"], parameters, strict=True)
    )
    refuse_unless(same, "the parameters are not those of the configuration's sensor")
    for block in ("apertures", "light"):
        keys = resolved["sensor"].get(block) or {}
        plain = all(is_off(name, value) for name, value in keys.items() if name not in HARMLESS)
        refuse_unless(plain, f"sensor.{block} changes the light, which the theorem does not know")
    if not all(
        is_off(name, value) or name == "reference_c"
        for name, value in (resolved["sensor"].get("temperature") or {}).items()
    ):
        result.not_verified.append("anything at a temperature other than the sensor's reference_c")


#: Keys that are off only if null, because an aperture or a rim of zero size blocks all light.
OFF_IF_NULL = ("beam_ratio", "rim_mm", "wavelength_nm", "index")
#: Keys that change no reading: the time of sampling, and the polarization without an index.
HARMLESS = ("delays_us", "polarization_deg")


def is_off(name: str, value: Any) -> bool:
    """Whether the value of a key leaves the light unchanged."""
    if name in OFF_IF_NULL:
        return value is None
    if isinstance(value, list):
        return all(is_off(name, part) for part in value)
    return value is None or value is False or value == 0


def parameters_of(sensor: dict[str, Any]) -> list[float]:
    """Compute the 30 parameters from a configuration's keys; mm, rad, mW. Raises `KeyError`,
    `TypeError` or `ValueError` if a key is missing or no number."""
    beam, mirror, psd = sensor["beam"], sensor["mirror"], sensor["psd"]
    wide = beam["diameter_mm"]
    x, y = wide if isinstance(wide, list) else (wide, wide)
    tilts = [tilt / 1000 for tilt in beam["tilt_mrad"]]
    values = [beam["power_mw"], x, y, radians(beam["rotation_deg"]), *tilts]
    for letter in "abc":
        values += [radians(mirror[letter][f"{name}_deg"]) for name in ("inclination", "azimuth")]
    for letter in "abc":
        keys = psd[letter]
        values += [keys["radius_mm"], radians(keys["azimuth_deg"]), keys["height_mm"]]
        values += [keys[f"{name}_mrad"] / 1000 for name in ("roll", "pitch", "yaw")]
    if any(type(value) not in (int, float) for value in values):
        raise TypeError("a parameter is no number")
    return [float(value) for value in values]


def read(path: Path) -> dict[str, Any]:
    """Read a certificate; raise `Refused` if the file is not one."""
    try:
        content = json.loads(
            path.read_text("utf-8"),
            object_pairs_hook=refuse_repeated_names,
            parse_constant=refuse_number,
        )
    except (OSError, ValueError, RecursionError) as error:
        raise Refused(f"the file cannot be read as JSON: {error}") from None
    conform(content, SCHEMA)
    certificate: dict[str, Any] = content
    return certificate


def refuse_repeated_names(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make a record of names and values; raise `Refused` if a name occurs twice."""
    names = [name for name, _ in pairs]
    twice = sorted({name for name in names if names.count(name) > 1})
    refuse_unless(not twice, f"given twice: {', '.join(twice)}")
    return dict(pairs)


def refuse_number(text: str) -> float:
    """Raise `Refused` for a number that JSON does not have, such as NaN."""
    raise Refused(f"{text} is no number")


def check(path: Path) -> CheckResult:
    """Verify a certificate; raise `Refused` if it is not a proof."""
    content = read(path)
    try:
        return check_content(content)
    except Refused:
        raise
    except Exception as error:
        raise Refused(f"it cannot be checked: {error!r:.200}") from None


def check_content(content: dict[str, Any]) -> CheckResult:
    """Check the content of a certificate, and return what was verified."""
    result = CheckResult()
    check_configuration(content, result)
    check_cover(content)
    for claims in intervals_of(content["light"]):
        refuse_unless(
            claims[0] <= claims[1], f"a bound of the light has its ends crossed: {claims}"
        )
    refuse_unless(content["light"]["slope"][0] > 0, "the bound of the powers' slope is not above 0")
    rig = IntervalSensor(content["parameters"], content["tolerances"])
    refuse_unless(rig.power > 0 and all(s > 0 for s in rig.sigma), "the beam has no power or width")
    check_light(rig, content)
    jacobians = check_pieces(rig, content, result)
    if content.get("middles") is None:
        check_hull(jacobians, content, result)
    else:
        check_middles(rig, jacobians, content, result)
    if content.get("range") is not None:
        result.not_verified.append("that the box holds every pose of the range")
    names = ("object", "facets", "seed", "command", "made", "seconds", "work")
    result.not_verified.append(f"how it was made ({', '.join(n for n in names if n in content)})")
    return result


def intervals_of(light: dict[str, Any]) -> list[list[float]]:
    """All bounds of the light as pairs of ends."""
    rows = [interval for facet in light["from_point"] for interval in facet]
    turns = [interval for facet in light["turns"] for row in facet for interval in row]
    return [*rows, *turns, light["slope"]]


def describe(result: CheckResult) -> str:
    """Describe the verified bounds, rounded down."""
    margin, bound = floor(1000 * result.margin) / 1000, round_down(result.determinant)
    unverified = "; ".join(result.not_verified)
    return "\n".join(
        [
            f"holds, with a margin of at least {margin:.3f}; |Eq. (11)| is at least {bound}",
            f"  not verified: {unverified}",
        ]
    )


def round_down(value: Fraction) -> str:
    """Format a nonnegative number with three digits, rounded down, such as 4.57e6."""
    if value < Fraction(1, 10**30):
        return "0"
    power = 0
    while value >= 10:
        value, power = value / 10, power + 1
    while value < 1:
        value, power = value * 10, power - 1
    return f"{floor(100 * value) / 100:.2f}e{power}"


def main(arguments: list[str]) -> int:
    """Return 0 if every certificate holds, 1 if one is refused, 2 if none is given."""
    if arguments == ["--schema"]:
        print(json.dumps(SCHEMA, indent=1))
        return 0
    if not arguments:
        print("usage: python -m facets.experiments.check_certificate FILE... | --schema")
        return 2
    refused = 0
    for name in arguments:
        try:
            print(f"{name}: {describe(check(Path(name)))}")
        except Refused as reason:
            refused += 1
            print(f"{name}: refused: {reason}")
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
