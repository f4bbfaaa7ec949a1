"""Check that the box of a certificate holds every pose that keeps the rules of the range.

The check cuts the poses into parts. A part is done if it lies in the box, or if none of its poses
has all three spots on their detectors; any other part is contracted or halved. The rays come from
certificate_optics.py; docs/uniqueness.md, Eq. (6), explains why this is a proof.
"""

from __future__ import annotations

from decimal import ROUND_FLOOR, Context, Decimal
from fractions import Fraction
from typing import Any

import numpy as np
from flint import arb, arb_mat

from .certificate_optics import (
    IntervalSensor,
    edges_of,
    farthest_offset,
    inner_product,
    openings_between,
    rotation_by,
    span,
    spots,
)
from .certificate_schema import Refused, refuse_unless

#: Largest number of parts, and the share of its width above which a contracted part is cut.
MOST, KEPT = 60_000, 0.8
#: The check refuses an undecided part that is smaller than this share of the box in every axis.
SMALLEST = 0.2
#: Ratio of the distance to the farthest poses to the distance of a test pose, both from the box.
BESIDE = 1000
#: Number of parts of a facet's angle when the points on the facet are bounded.
PARTS = 6
#: Half the beam's 1/e^2 diameter, sigmas.
ELLIPSE = 2
#: Lever arms for comparing the axes' widths, mm/mm and mm/rad.
LEVERS_MM = (1, 1, 1, 250, 250, 250)

#: A side of a box of poses: two exact numbers.
Side = tuple[Any, Any]
#: A part of the poses: one side for each axis.
Sides = list[Side]


def check_range(rig: IntervalSensor, content: dict[str, Any]) -> tuple[list[str], list[str]]:
    """Return sentences about what was verified of the claimed range and what was not."""
    unverified = check_rules(content)
    claim = content["range"]
    box = [(arb(a), arb(b)) for a, b in zip(content["low"], content["high"], strict=True)]
    for part in poses_beyond(box, claim["farthest"]):
        smaller_parts(rig, content, part, box)  # refuses a pose that it cannot rule out
    parts = 0
    todo = [[(-arb(x), arb(x)) for x in claim["farthest"]]]
    while todo:
        part = todo.pop()
        if all(a >= low and b <= high for (a, b), (low, high) in zip(part, box, strict=True)):
            continue
        parts += 1
        refuse_unless(parts <= MOST, f"that the box holds the range takes more than {MOST} parts:"
                      f" not found near {[float(a.mid()) for a, _ in part]}")  # fmt: skip
        todo += smaller_parts(rig, content, part, box)
    x, y, z, *angles = map(Fraction, claim["farthest"])
    lengths = ", ".join(map(three_digits, (x, y, z)))
    far = f"{lengths} mm and {', '.join(three_digits(1000 * a) for a in angles)} mrad"
    return [f"the box holds every pose of the range, of those within {far}"], unverified


def three_digits(value: Fraction) -> str:
    """Format a length with three digits, rounded down."""
    context = Context(prec=3, rounding=ROUND_FLOOR)
    return f"{float(context.divide(Decimal(value.numerator), Decimal(value.denominator))):g}"


def poses_beyond(box: Sides, farthest: list[float]) -> list[Sides]:
    """Poses just beyond the middle of each face of the box, where most false claims show at once.

    Raises `Refused` if no poses beyond the box are examined, since any box would then pass.
    """
    middle = [((a + b) / 2).mid() for a, b in box]
    poses = []
    for axis, ((low, high), far) in enumerate(zip(box, map(arb, farthest), strict=True)):
        refuse_unless(-far < low and high < far, "range: farthest does not reach beyond the box on"
                      f" every side; axis {axis + 1} of tx, ty, tz, roll, pitch, yaw")  # fmt: skip
        for end, beyond in ((low, -far), (high, far)):
            place = (end + (beyond - end) / BESIDE).mid()
            poses.append([(x, x) for x in (*middle[:axis], place, *middle[axis + 1 :])])
    return poses


def smaller_parts(
    rig: IntervalSensor, content: dict[str, Any], part: Sides, box: Sides
) -> list[Sides]:
    """Return the parts of a part that remain to be examined."""
    claim = content["range"]
    try:
        points = points_of_spots(rig, part, content["least_share"], claim["whole_spot"])
        if cannot_land(rig, part, points, claim["halves_mm"]):
            return []
        kept = contract(rig, part, points, claim["halves_mm"])
    except Refused:  # the part is too wide for a decision
        return halve(part, (0, 0, 0, 1, 1, 1))
    if kept is None:
        return []
    sides = zip(part, kept, strict=True)
    if any(new[1] - new[0] < KEPT * (old[1] - old[0]) for old, new in sides):
        return [kept]
    refuse_unless_large(kept, box)
    return cut_sides(kept, box) or halve(kept, LEVERS_MM)


def refuse_unless_large(part: Sides, box: Sides) -> None:
    """Raise `Refused` if an undecided part is small beside the box, as more cuts would not help."""
    sides = zip(part, box, strict=True)
    large = any(b - a > SMALLEST * (high - low) for (a, b), (low, high) in sides)
    near = [float(f"{float(a.mid()):.4g}") for a, _ in part]
    refuse_unless(large, f"a pose near {near} may keep the rules of the range, outside of the box")


def cut_sides(part: Sides, box: Sides) -> list[Sides]:
    """Return what lies outside the box of a part that crosses the box on one axis only."""
    sides = zip(part, box, strict=True)
    out = [i for i, ((a, b), (low, high)) in enumerate(sides) if a < low or b > high]
    if len(out) != 1:
        return []
    axis = out[0]
    (a, b), (low, high) = part[axis], box[axis]
    if b <= low or a >= high:
        return []
    ends = [(a, low)] * (a < low) + [(high, b)] * (b > high)
    return [[*part[:axis], end, *part[axis + 1 :]] for end in ends]


def halve(part: Sides, levers: tuple[int, ...]) -> list[Sides]:
    widths = [(b - a) * lever for (a, b), lever in zip(part, levers, strict=True)]
    axis = max(range(6), key=lambda i: float(widths[i].mid()))
    a, b = part[axis]
    middle = ((a + b) / 2).mid()
    refuse_unless(a < middle < b, "a part of the range is too small to be cut")
    return [[*part[:axis], side, *part[axis + 1 :]] for side in ((a, middle), (middle, b))]


def points_of_spots(rig: IntervalSensor, part: Sides, least: float, whole: bool) -> list[list[Any]]:
    """Points (3, 2) of the facets, in sigmas from the apex seen along the beam, whose rays land
    on the detectors if the pose keeps the rules."""
    edges = edges_of(rig, [span(*side) for side in part[3:]])
    openings = openings_between(edges)
    offset = farthest_offset(openings, least)
    if whole and offset <= ELLIPSE:
        return [[arb(0), arb(0)]] * 3
    reach = arb(offset.numerator) / offset.denominator + (ELLIPSE if whole else 0)
    reach = (reach + farthest_centroid(least)).upper()
    points = []
    for k in range(3):
        turns = [edges[k][0] + openings[k] * (span(0, 1) + n) / PARTS for n in range(PARTS)]
        x, y = ([span(0, reach) * f(turn) for turn in turns] for f in (arb.cos, arb.sin))
        points.append([hull(x), hull(y)])
    return points


def hull(values: list[Any]) -> Any:
    whole = values[0]
    for value in values[1:]:
        whole = whole.union(value)
    return whole


def farthest_centroid(least: float) -> Any:
    """Largest distance, in sigmas, of the centroid of a share >= `least` from the beam's centre.

    |c| = E[x | part] along c <= z + E[(x - z)+] / least for every z, and E[(x - z)+] is at most the
    density of the normal distribution at z.
    """
    root = (2 * arb.pi()).sqrt()
    bounds = [z + (-(z * z) / 2).exp() / root / arb(least) for z in (arb(n) / 8 for n in range(49))]
    return min((bound.upper() for bound in bounds), key=float)


def cannot_land(
    rig: IntervalSensor, part: Sides, points: list[list[Any]], sizes: list[list[float]]
) -> bool:
    """Whether no pose of a part lets all three rays land on their detectors."""
    pose = [span(*side) for side in part]
    turn = rotation_by(*pose[3:])
    return any(misses_detector(rig, k, pose[:3], turn, points[k], sizes[k]) for k in range(3))


def misses_detector(
    rig: IntervalSensor, k: int, apex: list[Any], turn: Any, point: list[Any], size: list[float]
) -> bool:
    """Whether no pose of a part lets light from the facet's front land on the detector."""
    normal = [inner_product(row, rig.normals[k]) for row in turn]
    down = inner_product(normal, rig.down)
    if down >= 0:
        return True
    if not down < 0:
        return False
    beside = [sum(point[i] * rig.sigma[i] * rig.across[i][c] for i in range(2)) for c in range(3)]
    drop = -inner_product(normal, beside) / down
    away = [rig.down[c] - 2 * down * normal[c] for c in range(3)]
    start = [apex[c] + beside[c] + drop * rig.down[c] - rig.centres[k][c] for c in range(3)]
    return leads_beside(start, away, rig.axes[k], size)


def leads_beside(start: list[Any], away: list[Any], axes: list[Any], size: list[float]) -> bool:
    """Whether no ray of a bundle lands on an area of half sizes `size` across the first axis.

    The landing point is multiplied by the ray's component towards the area, which avoids a
    division by an interval that may contain zero.
    """
    x, *across = axes
    facing, gap = inner_product(away, x), -inner_product(start, x)
    if (facing > 0 and gap < 0) or (facing < 0 and gap > 0):
        return True
    for axis, half in zip(across, size, strict=True):
        landing = inner_product(start, axis) * facing + gap * inner_product(away, axis)
        if not (landing + span(-half, half) * facing).contains(arb(0)):
            return True
    return False


def spots_near(
    rig: IntervalSensor, middle: list[Any], pose: list[Any], points: list[list[Any]]
) -> tuple[Any, list[Any]]:
    """Slopes of G at the middle place over all angles of a part, and G at the part's middle."""
    light = {"from_point": [[(p.lower(), p.upper()) for p in row] for row in points],
             "turns": [[[(0, 0)] * 3] * 2] * 3}  # fmt: skip
    slopes = arb_mat([spot.slope for spot in spots(rig, [*middle[:3], *pose[3:]], light)])
    return slopes, [spot.value for spot in spots(rig, middle, light)]


def contract(
    rig: IntervalSensor, part: Sides, points: list[list[Any]], sizes: list[list[float]]
) -> Sides | None:
    """Contract a part to poses that can keep the rules, or None; raise `Refused` if it is too wide.

    G(p) - G(x) = slopes (p - x) with slopes at the middle place and all angles of the part, since G
    is linear in the apex; so p = x + C (G(p) - G(x)) + (1 - C slopes) (p - x).
    """
    middle = [((a + b) / 2).mid() for a, b in part]
    pose = [span(*side) for side in part]
    slopes, places = spots_near(rig, middle, pose, points)
    near = arb_mat(approximate_inverse(slopes))
    limits = [span(-half, half) for size in sizes for half in size]
    step = near * arb_mat([[a - b] for a, b in zip(limits, places, strict=True)])
    rest = near * slopes
    kept = []
    for i, (a, b) in enumerate(part):
        off = sum(((i == j) - rest[i, j]) * (pose[j] - middle[j]) for j in range(6))
        bounds = middle[i] + step[i, 0] + off
        low, high = max(a, bounds.lower()), min(b, bounds.upper())
        if not low <= high:
            refuse_unless(bool(low > high), "no bounds")
            return None
        kept.append((low, high))
    return kept


def approximate_inverse(slopes: Any) -> list[list[float]]:
    """Approximate inverse of the midpoints; any matrix is valid, a close one contracts best."""
    middles = np.array([[float(slopes[i, j].mid()) for j in range(6)] for i in range(6)])
    refuse_unless(bool(np.isfinite(middles).all()), "no bounds of the Jacobian")
    inverse: list[list[float]] = np.linalg.pinv(middles).tolist()
    return inverse


def check_rules(content: dict[str, Any]) -> list[str]:
    """Check that the claim has the configuration's rules; return those that are not verified."""
    resolved, claim = content["resolved"], content["range"]
    if resolved is None:
        return ["that the rules of the range are those of any configuration"]
    try:
        sensor, rules = resolved["sensor"], resolved["range"]
        sizes = [sensor["psd"][letter]["size_mm"] for letter in "abc"]
        enough = all(
            Fraction(half) * 2 >= Fraction(size)
            for mine, its in zip(claim["halves_mm"], sizes, strict=True)
            for half, size in zip(mine, its, strict=True)
        )
        refuse_unless(enough, "range: halves_mm are less than half the detectors' sizes")
        whole = claim["whole_spot"] == (rules["spot"] == "whole")
        refuse_unless(whole, "range: whole_spot is not as in the configuration's rules")
        if sensor["noise"]["model"] != "simple":
            return ["that the least share is that of the range's rules, which take the electronics"]
        least = Fraction(rules["snr"]) * Fraction(sensor["noise"]["power_uw"]) / 1000
        power = Fraction(content["parameters"][0]) + Fraction(content["tolerances"][0])
        low = Fraction(content["least_share"]) * power <= least
        refuse_unless(low, "least_share is more than the rules of the range ask for")
    except (KeyError, TypeError, ValueError) as error:
        raise Refused(f"the configuration has no rules of the range: {error!r}") from None
    return []
