"""Values of a tape with their first and second derivatives, by truncated Taylor arithmetic.

A number carries its value, its gradient and the upper triangle of its Hessian through every
operation, so that one pass over the tape gives all of them exactly. Four states go side by side,
which a processor takes as one. Importing this imports Numba.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..core.units import Floats
from ..model.jit import compilable, compiler, doubles_at
from .tape import (
    ADD,
    AND,
    ATAN2,
    CONSTANT,
    COS,
    DIVIDE,
    ERF,
    EXP,
    GIVEN,
    LESS,
    LESS_OR_EQUAL,
    LOG,
    MULTIPLY,
    NEGATIVE,
    NOT,
    OR,
    OUTPUT,
    SIN,
    SQRT,
    SUBTRACT,
    VARIABLE,
    WHERE,
)

#: States side by side.
LANES = 4
kernel = compiler(__file__)


@compilable
def linear(w, o, a, b, p, q, count):  # type: ignore[no-untyped-def]
    """o = p a + q b, the first `count` coefficients."""
    for c in range(0, LANES * count, LANES):
        r0 = p * w[a + c] + q * w[b + c]
        r1 = p * w[a + c + 1] + q * w[b + c + 1]
        r2 = p * w[a + c + 2] + q * w[b + c + 2]
        r3 = p * w[a + c + 3] + q * w[b + c + 3]
        w[o + c], w[o + c + 1], w[o + c + 2], w[o + c + 3] = r0, r1, r2, r3


@compilable
def scaled(w, o, a, s, begin, count):  # type: ignore[no-untyped-def]
    """o = s a by lanes, where s is a value that does not vary; coefficients from `begin` on."""
    s0, s1, s2, s3 = w[s], w[s + 1], w[s + 2], w[s + 3]
    for c in range(LANES * begin, LANES * count, LANES):
        r0, r1, r2, r3 = s0 * w[a + c], s1 * w[a + c + 1], s2 * w[a + c + 2], s3 * w[a + c + 3]
        w[o + c], w[o + c + 1], w[o + c + 2], w[o + c + 3] = r0, r1, r2, r3


@compilable
def product(w, o, a, b, n, second):  # type: ignore[no-untyped-def]
    """o = a b, where both vary."""
    a0, a1, a2, a3 = w[a], w[a + 1], w[a + 2], w[a + 3]
    b0, b1, b2, b3 = w[b], w[b + 1], w[b + 2], w[b + 3]
    w[o], w[o + 1], w[o + 2], w[o + 3] = a0 * b0, a1 * b1, a2 * b2, a3 * b3
    for c in range(LANES, LANES * (n + 1), LANES):
        r0 = a0 * w[b + c] + b0 * w[a + c]
        r1 = a1 * w[b + c + 1] + b1 * w[a + c + 1]
        r2 = a2 * w[b + c + 2] + b2 * w[a + c + 2]
        r3 = a3 * w[b + c + 3] + b3 * w[a + c + 3]
        w[o + c], w[o + c + 1], w[o + c + 2], w[o + c + 3] = r0, r1, r2, r3
    if not second:
        return
    c = LANES * (n + 1)
    for i in range(LANES, LANES * (n + 1), LANES):
        ai0, ai1, ai2, ai3 = w[a + i], w[a + i + 1], w[a + i + 2], w[a + i + 3]
        bi0, bi1, bi2, bi3 = w[b + i], w[b + i + 1], w[b + i + 2], w[b + i + 3]
        for j in range(i, LANES * (n + 1), LANES):
            r0 = a0 * w[b + c] + b0 * w[a + c] + ai0 * w[b + j] + bi0 * w[a + j]
            r1 = a1 * w[b + c + 1] + b1 * w[a + c + 1] + ai1 * w[b + j + 1] + bi1 * w[a + j + 1]
            r2 = a2 * w[b + c + 2] + b2 * w[a + c + 2] + ai2 * w[b + j + 2] + bi2 * w[a + j + 2]
            r3 = a3 * w[b + c + 3] + b3 * w[a + c + 3] + ai3 * w[b + j + 3] + bi3 * w[a + j + 3]
            w[o + c], w[o + c + 1], w[o + c + 2], w[o + c + 3] = r0, r1, r2, r3
            c += LANES


@compilable
def chain(w, o, a, f, g, h, n, second):  # type: ignore[no-untyped-def]
    """o = f(a) from the places of f, f' and f'' by lanes."""
    f0, f1, f2, f3 = w[f], w[f + 1], w[f + 2], w[f + 3]
    g0, g1, g2, g3 = w[g], w[g + 1], w[g + 2], w[g + 3]
    h0, h1, h2, h3 = w[h], w[h + 1], w[h + 2], w[h + 3]
    w[o], w[o + 1], w[o + 2], w[o + 3] = f0, f1, f2, f3
    for c in range(LANES, LANES * (n + 1), LANES):
        r0, r1, r2, r3 = g0 * w[a + c], g1 * w[a + c + 1], g2 * w[a + c + 2], g3 * w[a + c + 3]
        w[o + c], w[o + c + 1], w[o + c + 2], w[o + c + 3] = r0, r1, r2, r3
    if not second:
        return
    c = LANES * (n + 1)
    for i in range(LANES, LANES * (n + 1), LANES):
        i0, i1, i2, i3 = h0 * w[a + i], h1 * w[a + i + 1], h2 * w[a + i + 2], h3 * w[a + i + 3]
        for j in range(i, LANES * (n + 1), LANES):
            r0 = g0 * w[a + c] + i0 * w[a + j]
            r1 = g1 * w[a + c + 1] + i1 * w[a + j + 1]
            r2 = g2 * w[a + c + 2] + i2 * w[a + j + 2]
            r3 = g3 * w[a + c + 3] + i3 * w[a + j + 3]
            w[o + c], w[o + c + 1], w[o + c + 2], w[o + c + 3] = r0, r1, r2, r3
            c += LANES


@compilable
def elementary(code, v):  # type: ignore[no-untyped-def]
    """(f, f', f'') of an elementary function of one number."""
    if code == EXP:
        f = math.exp(v)
        return f, f, f
    if code == SQRT:
        f = math.sqrt(v)
        g = 0.5 / f
        return f, g, -0.5 * g / v
    if code == ERF:
        g = 1.1283791670955126 * math.exp(-v * v)
        return math.erf(v), g, -2 * v * g
    if code == SIN:
        s, c = math.sin(v), math.cos(v)
        return s, c, -s
    if code == COS:
        s, c = math.sin(v), math.cos(v)
        return c, -s, -c
    if code == LOG:
        g = 1 / v
        return math.log(v), g, -g * g
    g = 1 / v
    return g, -g * g, 2 * g * g * g  # the inverse, of DIVIDE


@compilable
def functions(w, code, a, f, g, h):  # type: ignore[no-untyped-def]
    """`elementary` of four values, put at the places f, g and h."""
    for lane in range(LANES):
        w[f + lane], w[g + lane], w[h + lane] = elementary(code, w[a + lane])


@compilable
def arc_tangent(w, o, y, x, n, size, second):  # type: ignore[no-untyped-def]
    """o = atan2(y, x); its derivatives are those of the quotients that stay finite."""
    for lane in range(LANES):
        a, b = w[y + lane], w[x + lane]
        s = 1 / (a * a + b * b)
        ga, gb = b * s, -a * s
        haa, hab = 2 * ga * gb, gb * gb - ga * ga
        w[o + lane] = math.atan2(a, b)
        for c in range(LANES + lane, LANES * size, LANES):
            w[o + c] = ga * w[y + c] + gb * w[x + c]
        if second:
            c = LANES * (n + 1) + lane
            for i in range(LANES + lane, LANES * (n + 1), LANES):
                for j in range(i, LANES * (n + 1), LANES):
                    w[o + c] += haa * (w[y + i] * w[y + j] - w[x + i] * w[x + j])
                    w[o + c] += hab * (w[y + i] * w[x + j] + w[x + i] * w[y + j])
                    c += LANES


@compilable
def condition(w, code, o, a, b):  # type: ignore[no-untyped-def]
    for lane in range(LANES):
        one, other = w[a + lane], w[b + lane]
        if code == LESS:
            so = one < other
        elif code == LESS_OR_EQUAL:
            so = one <= other
        elif code == AND:
            so = one != 0 and other != 0
        elif code == OR:
            so = one != 0 or other != 0
        else:
            so = one == 0
        w[o + lane] = 1.0 if so else 0.0


@compilable
def chosen(w, o, a, b, size):  # type: ignore[no-untyped-def]
    """o = b where a holds, else 0."""
    for lane in range(LANES):
        so = w[a + lane] != 0
        for c in range(lane, LANES * size, LANES):
            w[o + c] = w[b + c] if so else 0.0


@kernel
def run(steps, constants, slots, x, second, states, found):  # type: ignore[no-untyped-def]
    """Fills found (states, outputs, coefficients) from a tape; see `Tape`.

    steps (n, 6): operation, place of its result, of its first and second operand, and whether each
    of these varies with x.  x: the variables; empty for values alone.
    """
    n = len(x)
    size = found.shape[2]
    most = LANES * size
    memory = np.zeros((slots + 4) * most)
    w = doubles_at(memory.ctypes.data)  # without the turns that an array takes for each index
    f, g, h, spare = (slots * most, (slots + 1) * most, (slots + 2) * most, (slots + 3) * most)
    for first in range(0, len(states), LANES):
        for k in range(len(steps)):
            code, o = steps[k, 0], steps[k, 1] * most
            a, b = steps[k, 2] * most, steps[k, 3] * most
            of_a, of_b = steps[k, 4] != 0 and size > 1, steps[k, 5] != 0 and size > 1
            count = size if of_a or of_b else 1
            if code == MULTIPLY:
                if of_a and of_b:
                    product(w, o, a, b, n, second)
                elif of_a:
                    scaled(w, o, a, b, 0, count)
                else:
                    scaled(w, o, b, a, 0, count)
            elif code in (ADD, SUBTRACT):
                sign = 1.0 if code == ADD else -1.0
                if of_a == of_b:
                    linear(w, o, a, b, 1.0, sign, count)
                else:
                    linear(w, o, a, b, 1.0, sign, 1)
                    some, its = (a, 1.0) if of_a else (b, sign)
                    for c in range(LANES, LANES * count):
                        w[o + c] = its * w[some + c]
            elif code == NEGATIVE:
                for c in range(LANES * count):
                    w[o + c] = -w[a + c]
            elif code == DIVIDE:
                functions(w, code, b, f, g, h)
                if not of_b:
                    scaled(w, o, a, f, 0, count)
                else:
                    chain(w, spare, b, f, g, h, n, second)
                    if of_a:
                        product(w, o, a, spare, n, second)
                    else:
                        scaled(w, o, spare, a, 0, count)
            elif code == CONSTANT:
                for lane in range(LANES):
                    w[o + lane] = constants[k]
            elif code == VARIABLE:
                for c in range(most):
                    w[o + c] = 0.0
                i = steps[k, 2]
                for lane in range(LANES):
                    w[o + lane] = constants[k] if n == 0 else x[i]
                    if size > 1:
                        w[o + LANES * (i + 1) + lane] = 1.0
            elif code == GIVEN:
                for lane in range(LANES):
                    w[o + lane] = states[min(first + lane, len(states) - 1), steps[k, 2]]
            elif code == OUTPUT:
                for lane in range(min(LANES, len(states) - first)):
                    for c in range(size):
                        place = a + c * LANES + lane
                        found[first + lane, steps[k, 1], c] = w[place] if c < count else 0.0
            elif code == ATAN2:
                for c in range(LANES, most):
                    w[a + c] = w[a + c] if of_a else 0.0
                    w[b + c] = w[b + c] if of_b else 0.0
                arc_tangent(w, o, a, b, n, size, second and count > 1)
            elif code == WHERE:
                chosen(w, o, a, b, count)
            elif code in (LESS, LESS_OR_EQUAL, AND, OR, NOT):
                condition(w, code, o, a, b)
            else:
                functions(w, code, a, f, g, h)
                if of_a:
                    chain(w, o, a, f, g, h, n, second)
                else:
                    for lane in range(LANES):
                        w[o + lane] = w[f + lane]
    return memory[0]  # which keeps it until here


def evaluate(
    steps: NDArray[np.int64],
    constants: Floats,
    slots: int,
    x: Floats,
    states: Floats,
    outputs: int,
    order: int,
) -> Floats:
    """(states, outputs, coefficients): values, then gradients, then the Hessians' upper triangles,
    row by row, as far as the order (0, 1 or 2) asks for."""
    n = len(x)
    size = (1, 1 + n, 1 + n + n * (n + 1) // 2)[order]
    found = np.empty((len(states), outputs, size))
    run(steps, constants, slots, x, order == 2, states, found)
    return found
