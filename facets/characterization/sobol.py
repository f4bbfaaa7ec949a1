"""Scrambled Sobol' sequences, without the second that importing SciPy's `stats` takes.

The points are those of `scipy.stats.qmc.Sobol`, bit for bit: the direction numbers of Joe and Kuo,
scrambled by random lower triangular matrices and a random shift (Matousek 1998).
"""

from __future__ import annotations

import numpy as np

from ..core.units import Floats, Integers

BITS = 30
#: Values of the bits, from the highest to the lowest.
PLACES = 2 ** np.arange(BITS)[::-1]
#: From the second dimension on: a primitive polynomial, whose coefficients are the bits of a
#: number, and the first direction numbers (Joe and Kuo, SIAM J. Sci. Comput. 30, 2635, 2008).
DIRECTIONS = """\
3 1
7 1 3
11 1 3 1
13 1 1 1
19 1 1 3 3
25 1 3 5 13
37 1 1 5 5 17
41 1 1 5 5 5
47 1 1 7 11 19
55 1 1 5 1 1
59 1 1 1 3 11
61 1 3 5 5 31
67 1 3 3 9 7 49
91 1 1 1 15 21 21
97 1 3 1 13 27 49
103 1 1 1 15 7 5
109 1 3 1 15 13 25
115 1 1 5 5 19 61
131 1 3 7 11 23 15 103
137 1 3 7 13 13 15 69
143 1 1 3 13 7 35 63
145 1 3 5 9 1 25 53
157 1 3 1 13 9 35 107
167 1 3 1 5 27 61 31
171 1 1 5 11 19 41 61
185 1 3 5 3 3 13 69
191 1 1 7 13 1 19 1
193 1 3 7 5 13 19 59
203 1 1 3 9 25 29 41
211 1 3 5 13 23 1 55
213 1 3 7 3 13 59 17
229 1 3 1 3 5 53 69
239 1 1 5 5 23 33 13
241 1 1 7 7 1 61 123
247 1 1 7 9 13 61 49
253 1 3 3 5 3 55 33
285 1 3 1 15 31 13 49 245
299 1 3 5 15 31 59 63 97
301 1 3 1 11 11 11 77 249
"""


class Sobol:
    """A Sobol' sequence of points between 0 and 1, scrambled by a random generator."""

    def __init__(self, dimension: int, rng: np.random.Generator) -> None:
        (child,) = rng.spawn(1)
        size = (dimension, BITS)
        self.point: Integers = child.integers(0, 2, size, np.uint32) @ PLACES[::-1]
        matrices = np.tril(child.integers(0, 2, (*size, BITS), np.uint32), -1) + np.eye(BITS)
        bits = directions(dimension)[:, None] // PLACES[:, None] % 2  # (dimension, bits, number)
        #: The direction numbers (BITS, dimension).
        self.numbers: Integers = (PLACES @ (matrices @ bits % 2).astype(int)).T
        self.count = 0

    def draw(self, count: int) -> Floats:
        """Return the next points (count, dimension), at most 2**BITS in all."""
        place = np.arange(self.count, self.count + count) + 1
        bit = np.bitwise_count((place & -place) - 1) % BITS  # of the Gray code
        points = np.bitwise_xor.accumulate(np.vstack([self.point, self.numbers[bit]]))
        self.count, self.point = self.count + count, points[-1]
        shares: Floats = points[:-1] / 2**BITS
        return shares


def directions(dimension: int) -> Integers:
    """The direction numbers (dimension, BITS) of a sequence that is not scrambled."""
    rows = [PLACES]
    for line in DIRECTIONS.splitlines()[: dimension - 1]:
        polynomial, *numbers = map(int, line.split())
        degree = len(numbers)
        while len(numbers) < BITS:
            number = numbers[-degree]
            for k in range(1, degree + 1):
                if polynomial >> (degree - k) & 1:
                    number ^= numbers[-k] << k
            numbers.append(number)
        rows.append(np.array(numbers) * PLACES)
    return np.array(rows)
