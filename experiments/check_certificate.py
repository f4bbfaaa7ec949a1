"""Checks a certificate of uniqueness again, with none of the code that made it.

`python -m facets.experiments.check_certificate results/paper-jacobian/certificate.json`

What it shares with `facets jacobian --certify` is the theorem (docs/uniqueness.md), the interval
arithmetic of python-flint, and the file. It traces rays itself, takes derivatives by dual numbers
instead of closed formulas, bounds the light on its own grid, and then asks three things: do the
pieces fill the box, do the file's bounds of the light hold, and is the hull of all the pieces'
Jacobians regular with the file's inverse and weights?
"""

from __future__ import annotations

import json
import sys
from itertools import combinations, product
from math import prod
from pathlib import Path
from typing import Any

from flint import arb

FORMAT = "facets uniqueness certificate 1"
#: Cells on each side of the square of offsets, rays across a facet, and parts of the yaw range.
CELLS, RAYS, PARTS = 16, 48, 3


def span(low: float, high: float) -> Any:
    return arb(low).union(arb(high))


class Dual:
    """A value and its derivatives by tx, ty, tz, roll, pitch, yaw; intervals."""

    def __init__(self, value: Any, slope: list[Any] | None = None) -> None:
        self.value, self.slope = value, slope or [arb(0)] * 6

    def __add__(self, other: Any) -> Dual:
        b = other if isinstance(other, Dual) else Dual(other)
        return Dual(self.value + b.value, [x + y for x, y in zip(self.slope, b.slope, strict=True)])

    def __mul__(self, other: Any) -> Dual:
        b = other if isinstance(other, Dual) else Dual(other)
        both = zip(self.slope, b.slope, strict=True)
        return Dual(self.value * b.value, [x * b.value + self.value * y for x, y in both])

    def __truediv__(self, other: Dual) -> Dual:
        ratio = self.value / other.value
        both = zip(self.slope, other.slope, strict=True)
        return Dual(ratio, [(x - ratio * y) / other.value for x, y in both])

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Dual:
        return self * arb(-1)

    def __sub__(self, other: Any) -> Dual:
        difference: Dual = self + other * arb(-1)
        return difference


def sine(x: Dual) -> Dual:
    return Dual(x.value.sin(), [x.value.cos() * d for d in x.slope])


def cosine(x: Dual) -> Dual:
    return Dual(x.value.cos(), [-x.value.sin() * d for d in x.slope])


def inner(a: Any, b: Any) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def product_of(a: Any, b: Any) -> Any:
    return [[inner(row, [b[0][j], b[1][j], b[2][j]]) for j in range(3)] for row in a]


def turned(angles: Any, sin: Any, cos: Any, one: Any) -> Any:
    """Rz(yaw) Ry(pitch) Rx(roll), as three rows."""
    roll, pitch, yaw = angles
    none = one * arb(0)
    x = [[one, none, none], [none, cos(roll), -sin(roll)], [none, sin(roll), cos(roll)]]
    y = [[cos(pitch), none, sin(pitch)], [none, one, none], [-sin(pitch), none, cos(pitch)]]
    z = [[cos(yaw), -sin(yaw), none], [sin(yaw), cos(yaw), none], [none, none, one]]
    return product_of(z, product_of(y, x))


def turned_by(roll: Any, pitch: Any, yaw: Any) -> Any:
    return turned((roll, pitch, yaw), lambda a: a.sin(), lambda a: a.cos(), arb(1))


class Rig:
    """The sensor from its 30 parameters, in the order of `facets.PARAMETERS`."""

    def __init__(self, parameters: list[float]) -> None:
        p = [arb(value) for value in parameters]
        tilt = turned_by(p[4], p[5], arb(0))
        x, y, back = ([row[i] for row in tilt] for i in range(3))
        c, s = p[3].cos(), p[3].sin()
        self.down = [-value for value in back]
        self.across = [[c * a + s * b for a, b in zip(x, y, strict=True)],
                       [c * b - s * a for a, b in zip(x, y, strict=True)]]  # fmt: skip
        self.sigma = [p[1] / 4, p[2] / 4]
        self.normals = [
            [p[i].sin() * p[i + 1].cos(), p[i].sin() * p[i + 1].sin(), p[i].cos()]
            for i in (6, 8, 10)
        ]
        self.centres, self.axes = [], []
        for i in (12, 18, 24):
            self.centres.append([p[i] * p[i + 1].cos(), p[i] * p[i + 1].sin(), p[i + 2]])
            rows = turned_by(p[i + 3], p[i + 4], p[i + 1] + p[i + 5])
            self.axes.append([[row[j] for row in rows] for j in range(3)])

    def flat(self, v: Any) -> Any:
        """A vector seen along the beam, sigmas."""
        return [inner(v, a) * (1 / s) for a, s in zip(self.across, self.sigma, strict=True)]


def spots(rig: Rig, box: list[Any], light: Any) -> list[Dual]:
    """psi and zeta of the three detectors, with their derivatives at fixed shares of the light."""
    unknown = [Dual(x, [arb(i == j) for j in range(6)]) for i, x in enumerate(box)]
    turn = turned((unknown[3], unknown[4], unknown[5]), sine, cosine, Dual(arb(1)))
    apex, out = unknown[:3], []
    for k in range(3):
        normal = [inner(row, rig.normals[k]) for row in turn]
        middle = [
            Dual(span(*light["from_point"][k][i]),
                 [arb(0)] * 3 + [span(*d) for d in light["turns"][k][i]])
            for i in range(2)
        ]  # fmt: skip
        beside = [
            sum((middle[i] * (rig.sigma[i] * rig.across[i][c]) for i in range(2)), Dual(arb(0)))
            for c in range(3)
        ]
        down = inner(normal, rig.down)
        drop = -inner(normal, beside) / down
        start = [apex[c] + beside[c] + drop * rig.down[c] for c in range(3)]
        away = [normal[c] * (down * arb(-2)) + rig.down[c] for c in range(3)]
        x, y, z = rig.axes[k]
        reach = inner([Dual(m) - s for m, s in zip(rig.centres[k], start, strict=True)], x)
        facing = inner(away, x)
        assert down.value < 0 < facing.value, "a facet or a detector may be turned away"
        assert reach.value > 0, "a detector may stand behind the mirror"
        place = [start[c] + away[c] * (reach / facing) - rig.centres[k][c] for c in range(3)]
        out += [inner(place, y), inner(place, z)]
    return out


def edges_of(rig: Rig, angles: list[Any]) -> list[tuple[Any, list[Any]]]:
    """Of each edge, its angle seen along the beam and how that changes with roll, pitch and yaw."""
    own = [Dual(x, [arb(0)] * 3 + [arb(i == j) for j in range(3)]) for i, x in enumerate(angles)]
    turn = turned((own[0], own[1], own[2]), sine, cosine, Dual(arb(1)))
    found = []
    for k in range(3):
        a, b = rig.normals[k], rig.normals[k - 1]
        edge = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        x, y = rig.flat([inner(row, edge) for row in turn])
        c, s = x.value.mid(), y.value.mid()
        angle = arb.atan2(s, c) + arb.atan2(c * y.value - s * x.value, c * x.value + s * y.value)
        slopes = [
            (x.value * y.slope[j] - y.value * x.slope[j]) / (x.value**2 + y.value**2)
            for j in (3, 4, 5)
        ]
        found.append((angle, slopes))
    return found


def along(q: list[Any], angle: Any) -> tuple[Any, Any, Any, list[Any]]:
    """Light L on a half-line from q, K / L, J / K, and its direction; all fall as q . u grows."""
    u = [angle.cos(), angle.sin()]
    a, h = q[0] * u[0] + q[1] * u[1], q[0] * u[1] - q[1] * u[0]
    low, high = float(h.abs_lower()), float(h.abs_upper())

    def rho(x: Any) -> Any:
        return (arb(2) / arb.pi()).sqrt() * (-x * x / 2).exp() / (x / arb(2).sqrt()).erfc() - x

    def light(x: Any, far: float) -> Any:
        g = (x / arb(2).sqrt()).erfc() / (8 * arb.pi()).sqrt()
        return g * (-(arb(far) ** 2) / 2).exp()

    ends = a.lower(), a.upper()
    whole = light(ends[1], high).union(light(ends[0], low))
    mean = rho(ends[1]).union(rho(ends[0]))
    reach = (1 / rho(ends[1]) - ends[1]).union(1 / rho(ends[0]) - ends[0])
    return whole, mean, reach, u


def holds(claim: list[float], value: Any) -> bool:
    return bool(value >= arb(claim[0])) and bool(value <= arb(claim[1]))


def wanted(claims: list[tuple[list[float], Any]]) -> bool:
    return all(holds(claim, value) for claim, value in claims)


def check_cell(
    edges: Any, openings: list[Any], q: list[Any], least: float, light: Any, depth: int
) -> None:
    """Whether the file's bounds hold in a cell of offsets, where its shares can be enough."""
    shares, middles = [], []
    for k in range(3):
        mass, moment = arb(0), [arb(0), arb(0)]
        for n in range(RAYS):
            part = span(0, 1) / RAYS + arb(n) / RAYS
            whole, mean, reach, u = along(q, edges[k][0] + openings[k] * part)
            density = (whole.lower() * mean.lower()).union(whole.upper() * mean.upper())
            mass += density
            moment = [moment[i] + density * reach * u[i] for i in range(2)]
        shares.append(mass * openings[k] / RAYS)
        middles.append([m / mass for m in moment])
    if any(share.upper() < least for share in shares):
        return
    rays = [along(q, edge[0]) for edge in edges]
    u = [ray[3] for ray in rays]
    alpha = [u[e - 2][0] * u[e - 1][1] - u[e - 2][1] * u[e - 1][0] for e in range(3)]
    claims: list[tuple[list[float], Any]] = []
    for j in range(3):
        flow = sum(alpha[e] * rays[e][1] * edges[e][1][j] for e in range(3))
        flow = flow / sum(alpha[e] / rays[e][0] for e in range(3))
        w = [flow / rays[e][0] - rays[e][1] * edges[e][1][j] for e in range(2)]
        dq = [(w[0] * u[1][i] - w[1] * u[0][i]) / alpha[2] for i in range(2)]
        half = (arb(dq[0].abs_upper()) ** 2 + arb(dq[1].abs_upper()) ** 2).sqrt() / 2
        for k, i in product(range(3), range(2)):
            share = arb(max(float(shares[k].lower()), least)).union(shares[k].upper())
            pushed = arb(0)
            for e, sign in ((k, -1), ((k + 1) % 3, 1)):
                whole, mean, reach, side = rays[e]
                pushed += sign * whole * mean * (reach * side[i] - middles[k][i]) * edges[e][1][j]
            moved = pushed / share - dq[i] / 2 + half * span(-1, 1)
            claims.append((light["turns"][k][i][j], moved))
    claims += [(light["from_point"][k][i], middles[k][i]) for k in range(3) for i in range(2)]
    if wanted(claims):
        return
    assert depth < 7, f"the bounds of the light do not hold near {q}"
    for x, y in product(*(quarter(side) for side in q)):
        check_cell(edges, openings, [x, y], least, light, depth + 1)


def quarter(x: Any) -> list[Any]:
    low, middle, high = x.lower(), x.mid(), x.upper()
    return [low.union(middle), middle.union(high)]


def check_light(rig: Rig, content: dict[str, Any]) -> None:
    """The bounds of the light, over the square beyond which a facet lacks its least share."""
    low, high = content["low"], content["high"]
    far = 8.0
    for part in range(PARTS):
        ends = [low[5] + (high[5] - low[5]) * (part + n) / PARTS for n in range(2)]
        angles = [span(low[3], high[3]), span(low[4], high[4]), span(*ends)]
        edges = edges_of(rig, angles)
        turn = 2 * arb.pi()
        gaps = [edges[(k + 1) % 3][0] - edges[k][0] for k in range(3)]
        openings = [gap - turn * (gap / turn).mid().floor() for gap in gaps]
        for gap in openings:
            assert 0 < gap < arb.pi(), "the edges are no fan"
            sharp = gap.sin() if gap > arb.pi() / 2 else arb(1)
            beyond = (far * sharp / arb(2).sqrt()).erfc() / 2
            assert beyond < content["least_share"], "light may be further off"
        places = [-far + 2 * far * n / CELLS for n in range(CELLS + 1)]
        for i, j in product(range(CELLS), repeat=2):
            q = [span(places[i], places[i + 1]), span(places[j], places[j + 1])]
            check_cell(edges, openings, q, content["least_share"], content["light"], 0)


def check_cover(content: dict[str, Any]) -> None:
    """The pieces lie in the box, do not overlap, and are together as large."""
    low, high, pieces = content["low"], content["high"], content["pieces"]
    wide = [i for i in range(6) if high[i] > low[i]]
    for piece in pieces:
        assert all(a <= b <= c <= d for a, b, c, d in
                   zip(low, piece["low"], piece["high"], high, strict=True))  # fmt: skip
    for a, b in combinations(pieces, 2):
        over = (min(a["high"][i], b["high"][i]) > max(a["low"][i], b["low"][i]) for i in wide)
        assert not all(over), "two pieces overlap"
    whole = prod(high[i] - low[i] for i in wide)
    parts = sum(prod(p["high"][i] - p["low"][i] for i in wide) for p in pieces)
    assert abs(parts / whole - 1) < 1e-9, "the pieces do not fill the box"


def check_hull(rig: Rig, content: dict[str, Any]) -> float:
    """By how much |1 - C M| shrinks the weights, for every M in the hull of the pieces."""
    hull: list[list[Any]] = []
    for piece in content["pieces"]:
        box = [span(a, b) for a, b in zip(piece["low"], piece["high"], strict=True)]
        rows = [spot.slope for spot in spots(rig, box, content["light"])]
        hull = rows if not hull else [
            [x.union(y) for x, y in zip(a, b, strict=True)] for a, b in zip(hull, rows, strict=True)
        ]  # fmt: skip
    inverse, weights = content["inverse"], content["weights"]
    assert all(weight > 0 for weight in weights)
    worst = 0.0
    for i in range(6):
        row = arb(0)
        for j in range(6):
            entry = sum(arb(inverse[i][k]) * hull[k][j] for k in range(6)) - (i == j)
            row += arb(entry.abs_upper()) * weights[j]
        worst = max(worst, float((row / weights[i]).upper()))
    return 1 - worst


def check(path: Path) -> float:
    """The margin that is found again; raises AssertionError where the certificate does not hold."""
    content = json.loads(path.read_text("utf-8"))
    assert content["format"] == FORMAT, "another kind of file"
    assert content["unique"], "the file claims no uniqueness"
    rig = Rig(content["parameters"])
    check_cover(content)
    check_light(rig, content)
    margin = check_hull(rig, content)
    assert margin > 0, f"the hull is not regular: {margin}"
    return margin


if __name__ == "__main__":
    for name in sys.argv[1:]:
        print(f"{name}: holds, with a margin of {check(Path(name)):.3f}")
