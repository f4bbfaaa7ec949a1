"""Many designs at once, compiled: what `exploration.looked_at` measures of each, for plain sensors.

A design is a row of its vectors' numbers. Its ranges are followed along each axis by regula falsi
on the least clearance of a spot, and shortened where too little light is left; the far end of a
range is looked for on one side, and on the other only where it is nearer there. What is not plain
(a facet without light, a way out that comes back, an ill-conditioned Jacobian) is left to the slow
way, and told so. Importing this imports Numba.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..characterization.ranges import FARTHEST
from ..core.rules import Rules
from ..core.sensor import Sensor
from ..core.units import Booleans, Floats
from ..model import blocks, evaluators, rare
from ..model.jit import call_address, compilable, compiler
from ..model.kinds import kind_of
from ..optics.forward import geometry
from ..scalars.nesting import leaves
from .variables import FACETS, PSDS, with_values

Array = Any
compiled = compiler(__file__)
#: Where the power is among the numbers of a sensor: behind the beam's direction.
POWER = 3
#: Past this condition number, squared, normal equations lose what the slow way keeps.
SQUARED = 1e9
#: The share of a range at which all that limits it must hold, as well as at its end.
SHARE = 0.5
#: What the compiled loop says of a design, beside the numbers of `exploration.SKIPPED`.
SLOW = -1
#: Steps of a search along an axis, at most.
STEPS = 60


@compilable
def least_spot(edges, packed, state, halves, found, memory):  # type: ignore[no-untyped-def]
    """The least clearance of a spot to an edge, over its detector's half size; NaN without one.

    edges: address of the model of how far the spots reach.  found: memory, (3, 5).
    """
    call_address(edges, packed, state, found, memory)
    least = np.inf
    for k in range(3):
        y, z = halves[k, 0], halves[k, 1]
        left, right, low, high = found[k, 0], found[k, 1], found[k, 2], found[k, 3]
        for value in ((y + left) / y, (y - right) / y, (z + low) / z, (z - high) / z):
            if value != value:
                return np.nan
            least = min(least, value)
    return least


@compilable
def place(state, axis, value, tracking):  # type: ignore[no-untyped-def]
    """Sets a state to rest but for one axis, which the beam follows in x and y if it is tracked."""
    for c in range(8):
        state[c] = 0.0
    if axis >= 0:
        state[axis] = value
        if tracking > 0 and axis < 2:
            state[6 + axis] = value


@compilable
def light(address, packed, state, found, memory):  # type: ignore[no-untyped-def]
    """The least power on a detector, mW; 0 where there is none."""
    call_address(address, packed, state, found, memory)
    least = np.inf
    for k in range(3):
        power = found[3 * k + 2]
        if power != power:
            return 0.0
        least = min(least, power)
    return least


@compilable
def sign_of_determinant(matrix):  # type: ignore[no-untyped-def]
    """Of (8, 8), which is spoilt: elimination with the largest pivot of a column."""
    sign = 1.0
    for c in range(8):
        best, row = abs(matrix[c, c]), c
        for r in range(c + 1, 8):
            if abs(matrix[r, c]) > best:
                best, row = abs(matrix[r, c]), r
        if not best > 0:
            return 0.0
        if row != c:
            sign = -sign
            for j in range(c, 8):
                matrix[c, j], matrix[row, j] = matrix[row, j], matrix[c, j]
        if matrix[c, c] < 0:
            sign = -sign
        for r in range(c + 1, 8):
            share = matrix[r, c] / matrix[c, c]
            for j in range(c + 1, 8):
                matrix[r, j] -= share * matrix[c, j]
    return sign


#: Past this condition number, squared, the eigenvalues of J'J have lost half their digits.
LOST = 1e8


@compilable
def condition_of(matrix, normal):  # type: ignore[no-untyped-def]
    """The condition number of (9, 8). normal: becomes the matrix's normal equations, (8, 8)."""
    for i in range(8):
        for j in range(i + 1):
            total = 0.0
            for row in range(9):
                total += matrix[row, i] * matrix[row, j]
            normal[i, j] = total
            normal[j, i] = total
    values = np.linalg.eigvalsh(normal)
    if values[0] * LOST > values[7]:
        return np.sqrt(values[7] / values[0])
    singular = np.linalg.svd(matrix)[1]
    return singular[0] / singular[7]


@compilable
def deviations(normal, factor, out, n):  # type: ignore[no-untyped-def]
    """Roots of the diagonal of the inverse of (8, 8) into out[n, 6:12]; whether it has one."""
    for i in range(8):
        for j in range(i + 1):
            total = normal[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i == j:
                if not total > 0:
                    return False
                factor[i, i] = np.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    for column in range(6):  # of the inverse of the factor, whose squares add up
        square = 0.0
        for i in range(column, 8):
            total = 1.0 if i == column else 0.0
            for k in range(column, i):
                total -= factor[i, k] * normal[0, k]
            normal[0, i] = total / factor[i, i]  # the normal matrix is no longer needed
            square += normal[0, i] ** 2
        out[n, 6 + column] = np.sqrt(square)
    return True


@compiled
def measure(
    read: int, linearise: int, edges: int, packed: Array, halves: Array, numbers: Array, out: Array,
    why: Array,
) -> None:  # fmt: skip
    """out (n, 14): ranges (6) in mm and rad, uncertainties (6) in um and urad, condition; the last
    is left as it is.

    read, linearise, edges: addresses of the models.  packed (n, m): `packing.pack` of each design.
    halves (n, 3, 2) mm.  numbers: a place's sigma times the power (mm mW), a power's (mW), the
    least power at rest and in a range (mW), whether the beam follows, the tolerance of a range over
    `FARTHEST`.  why (n,): 0, SLOW, or the reason in `SKIPPED`.
    """
    found, memory, state = np.empty(9), np.empty((3, 8, 11)), np.zeros((1, 8))
    ends_of_spots = np.empty((3, 5))
    whole, x = np.empty((10, 10)), np.zeros(9)
    scaled, normal, factor = np.empty((9, 8)), np.empty((8, 8)), np.zeros((8, 8))
    ends = np.zeros(2)
    for n in range(len(packed)):
        row = packed[n]
        place(state[0], -1, 0.0, 0.0)
        rest = least_spot(edges, row, state[0], halves[n], ends_of_spots, memory)
        if not rest > 0:
            why[n] = 1 if rest == rest else SLOW
            continue
        least = light(read, row, state[0], found, memory)
        if not least > numbers[2]:
            why[n] = 2
            continue
        # ---- at rest
        x[:] = 0.0
        x[8] = row[POWER]
        call_address(linearise, row, x, whole, memory)
        for r in range(9):
            sigma = numbers[1] if r % 3 == 2 else numbers[0] / whole[0, r - r % 3 + 2]
            for c in range(8):
                scaled[r, c] = whole[1 + r, c] * (1e-6 if 3 <= c < 6 else 1e-3) / sigma
        condition = condition_of(scaled, normal)
        out[n, 12] = condition
        if not condition * condition < SQUARED or not deviations(normal, factor, out, n):
            why[n] = SLOW
            continue
        if not least > numbers[3]:
            why[n] = 2
            continue
        # ---- ranges
        for axis in range(6):
            far = FARTHEST[axis]
            for side in range(2):
                sense = 1.0 - 2.0 * side
                if side == 1:  # is the range as long on this side?
                    inside = True
                    back = 0.0 if ends[0] >= far else numbers[5] * far
                    for value in (ends[0] - back, SHARE * ends[0]):
                        place(state[0], axis, -value, numbers[4])
                        spot = least_spot(edges, row, state[0], halves[n], ends_of_spots, memory)
                        if not spot > 0:
                            inside = False
                            break
                        if not light(read, row, state[0], found, memory) > numbers[3]:
                            inside = False
                            break
                    if inside:
                        ends[1] = ends[0]
                        continue
                # how far the spots stay on their detectors; along x and y the light ends first
                lit = axis < 2 and numbers[4] == 0
                low, at_low, high, at_high = 0.0, rest, 0.0, 1.0
                if lit:
                    at_low = min(rest, np.log(least / numbers[3]))
                step = 0.002 * far if lit else 0.01 * far
                for _ in range(STEPS):
                    place(state[0], axis, sense * step, numbers[4])
                    spot = least_spot(edges, row, state[0], halves[n], ends_of_spots, memory)
                    if lit:
                        power = light(read, row, state[0], found, memory)
                        bright = np.log(max(power, 1e-9 * numbers[3]) / numbers[3])
                        spot = bright if spot != spot and bright <= 0 else min(spot, bright)
                    if spot != spot:  # a facet is out of the circle, where the light ends it
                        low = step
                        if light(read, row, state[0], found, memory) > numbers[3]:
                            why[n] = SLOW
                        break
                    if spot <= 0:
                        high, at_high = step, spot
                        break
                    slope = (spot - at_low) / (step - low)
                    low, at_low = step, spot
                    if step >= far:
                        break
                    more = -1.02 * spot / slope if slope < 0 else 2.0 * step
                    step = min(step + min(max(more, 1e-3 * far), 3.0 * step), far)
                if why[n] == SLOW:
                    break
                end = low
                if at_high <= 0:
                    kept = 0
                    for _ in range(STEPS):  # regula falsi, the end that stays is halved (Illinois)
                        if high - low <= numbers[5] * far:
                            break
                        middle = (low * at_high - high * at_low) / (at_high - at_low)
                        gap = 0.3 * numbers[5] * far
                        middle = min(max(middle, low + gap), high - gap)
                        place(state[0], axis, sense * middle, numbers[4])
                        spot = least_spot(edges, row, state[0], halves[n], ends_of_spots, memory)
                        if lit:
                            power = light(read, row, state[0], found, memory)
                            bright = np.log(max(power, 1e-9 * numbers[3]) / numbers[3])
                            spot = bright if spot != spot and bright <= 0 else min(spot, bright)
                        if spot > 0:
                            low, at_low = middle, spot
                            if kept == 1:
                                at_high *= 0.5
                            kept = 1
                        elif spot <= 0:
                            high, at_high = middle, spot
                            if kept == -1:
                                at_low *= 0.5
                            kept = -1
                        else:
                            why[n] = SLOW
                            break
                    end = 0.5 * (low + high)
                # how far there is enough light
                place(state[0], axis, sense * low, numbers[4])
                if not light(read, row, state[0], found, memory) > numbers[3]:
                    low, high = 0.0, low
                    while high - low > numbers[5] * far:
                        end = 0.5 * (low + high)
                        place(state[0], axis, sense * end, numbers[4])
                        if light(read, row, state[0], found, memory) > numbers[3]:
                            low = end
                        else:
                            high = end
                    end = 0.5 * (low + high)
                # a way out that comes back is for the slow way
                back = 0.0 if end >= far else numbers[5] * far
                for value in (end - back, SHARE * end):
                    place(state[0], axis, sense * value, numbers[4])
                    spot = least_spot(edges, row, state[0], halves[n], ends_of_spots, memory)
                    if not spot > 0:
                        why[n] = SLOW
                place(state[0], axis, sense * SHARE * end, numbers[4])
                if not light(read, row, state[0], found, memory) > numbers[3]:
                    why[n] = SLOW
                ends[side] = end
            if why[n] == SLOW:
                break
            out[n, axis] = 2.0 * min(ends[0], ends[1])


@compiled
def signs(derivatives: Array, values: Array, out: Array) -> None:
    """out (n,): 1 where the determinants of rows (n, v, 72), the last power's left out, have one
    sign, else 0.  values: memory, (8, 8)."""
    for n in range(len(derivatives)):
        first, out[n] = 0.0, 1.0
        for v in range(derivatives.shape[1]):
            dark = False
            for r in range(9):
                dark |= derivatives[n, v, 8 * r] != derivatives[n, v, 8 * r]
            sign = 0.0
            if not dark:
                for r in range(8):
                    for c in range(8):
                        values[r, c] = derivatives[n, v, 8 * r + c]
                sign = sign_of_determinant(values)
            if v == 0:
                first = sign
            if sign == 0.0 or sign != first:
                out[n] = 0.0
                break


@compiled
def fill(linearise: int, packed: Array, volume: Array, left: Array, out: Array) -> None:
    """The derivatives (v, 72) of one design at those states of which `left` (v,) is not 0."""
    memory, whole, x = np.empty((3, 8, 11)), np.empty((10, 10)), np.zeros(9)
    for v in range(len(volume)):
        if left[v] > 0:
            for c in range(8):
                x[c] = volume[v, c]
            x[8] = 1.0
            call_address(linearise, packed, x, whole, memory)
            for r in range(9):
                lit = whole[0, r] == whole[0, r]
                for c in range(8):
                    out[v, 8 * r + c] = whole[1 + r, c] if lit else np.nan


#: Designs whose derivatives over the volume are kept at a time.
CHUNK = 32


def regular(linearise: int, rows: Floats, volume: Floats) -> Floats:
    """1 for each design whose determinant has one sign over the volume, else 0."""
    lanes = blocks.lanes()
    states = np.concatenate([volume, np.repeat(volume[-1:], -len(volume) % lanes, axis=0)])
    derive, count = blocks.kernel("derivatives"), len(states) // lanes
    found, left = np.empty((CHUNK, len(states), 72)), np.zeros(count, np.int64)
    out, memory = np.empty(len(rows)), np.empty((8, 8))
    where, to = blocks.address_of(states), blocks.address_of(left)
    for first in range(0, len(rows), CHUNK):
        some = rows[first : first + CHUNK]
        for n, row in enumerate(some):
            derive(blocks.address_of(row), where, blocks.address_of(found[n]), to, count)
            if left.any():
                bits = ((left[:, None] >> np.arange(lanes)) & 1).ravel()
                fill(linearise, row, states, bits, found[n])
        signs(found[: len(some)], memory, out[first : first + CHUNK])
    return out


class Columns(np.ndarray):
    """Numbers of many designs, for the text of the optics (`scalars.dispatch`)."""

    def sin(self) -> Any:
        return np.sin(self)

    def cos(self) -> Any:
        return np.cos(self)


def is_plain(sensor: Sensor, rules: Rules) -> bool:
    """Whether the compiled loop knows all that a sensor's ranges and resolution depend on."""
    return (
        kind_of(sensor) == "plain"
        and sensor.electronics is None
        and sensor.calibration is None
        and rules.whole_spot
        and not np.isfinite(rules.coarsest).any()
    )


def surveyed(
    sensor: Sensor, rules: Rules, names: Sequence[str], designs: Floats, volume: Floats,
    least_power: float, weakest: float, tolerance: float,
) -> tuple[Floats, NDArray[np.int64]]:  # fmt: skip
    """The head and what `measure` finds of designs (n, variables): (n, 15), NaN where it was not
    reached, and why (n,).

    weakest: the least power in a range, mW.  The rest as in `measure`.
    """
    count = len(designs)
    columns = [np.ascontiguousarray(column).view(Columns) for column in designs.T]
    p, sizes = with_values(sensor, names, columns)
    values = np.stack([np.broadcast_to(np.asarray(v, dtype=float), count) for v in p], axis=1)
    halves = halves_of(sensor, names, sizes, count)
    out = np.full((count, 15), np.nan)
    out[:, 0] = 2 * values[:, list(PSDS)].max(axis=1)
    why = np.full(count, SLOW)
    sound = possible(values) & (halves > 0).all(axis=(1, 2))
    if not sound.any():
        return out, why
    rows = packed(values[sound])
    numbers = np.array([
        sensor.noise.position * sensor.noise.at_power, sensor.noise.power, least_power, weakest,
        float(rules.tracking), tolerance,
    ])  # fmt: skip
    some, reasons = out[sound, 1:], np.zeros(len(rows), dtype=np.int64)
    measure(
        evaluators.address(evaluators.readings(sensor)),
        evaluators.address(evaluators.linearised(sensor)),
        evaluators.address(evaluators.footprints(sensor)),
        rows, halves[sound], numbers, some, reasons,
    )  # fmt: skip
    told = ~np.isnan(some[:, 12]) & (reasons >= 0)
    some[told, 13] = regular(evaluators.address(evaluators.linearised(sensor)), rows[told], volume)
    out[sound, 1:], why[sound] = some, reasons
    return out, why


def halves_of(sensor: Sensor, names: Sequence[str], sizes: list[Any], count: int) -> Floats:
    """(n, 3, 2) mm."""
    own = np.array([[psd.size_y, psd.size_z] for psd in sensor.psds]) / 2
    if "size_mm" not in names:
        return np.tile(own, (count, 1, 1))
    columns = [np.broadcast_to(np.asarray(size, dtype=float), count) / 2 for size in sizes]
    found: Floats = np.repeat(np.stack(columns, axis=1)[:, :, None], 2, axis=2)
    return found


def possible(p: Floats) -> Booleans:
    """Which rows of 30 parameters make a sensor (n,), as `core.sensor` checks them."""
    tilts = p[:, list(FACETS)]
    turns = p[:, [k + 1 for k in FACETS]]
    gaps = (np.roll(turns, -1, axis=1) - turns) % (2 * np.pi)
    fine = np.isfinite(p).all(axis=1) & (p[:, :3] > 0).all(axis=1)
    fine &= ((tilts > 0) & (tilts < np.pi / 2) & (gaps > 0) & (gaps < np.pi)).all(axis=1)
    found: Booleans = np.asarray(fine & (p[:, list(PSDS)] > 0).all(axis=1))
    return found


def packed(p: Floats) -> Floats:
    """`packing.pack` of each row of 30 parameters: (n, m)."""
    columns = tuple(np.ascontiguousarray(column).view(Columns) for column in p.T)
    parts = [np.broadcast_to(np.asarray(n + 0.0), len(p)) for n in leaves(geometry(columns))]
    address = np.broadcast_to(rare.ADDRESS, (len(p), len(rare.ADDRESS)))
    found: Floats = np.ascontiguousarray(np.column_stack([np.stack(parts, axis=1), address]))
    return found
