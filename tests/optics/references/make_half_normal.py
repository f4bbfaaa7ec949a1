"""Makes the polynomial of `facets.optics.half_normal`: python make_half_normal.py > half_normal.txt

I2(a) = int s^2 exp(-s^2/2 - a s) ds from 0 up, over z^3 with z = 4 / (4 + a), as a polynomial in
2 z - 1 for 0 < z < 1, lowest power first. Chebyshev interpolation in 60 digits; what it leaves out
is below 1e-17.
"""

import mpmath as mp

mp.mp.dps = 60
TERMS = 28


def second(a: mp.mpf) -> mp.mpf:
    """I2 from the complementary error function, or its continued fraction where that cancels."""
    if a < 40:
        with mp.workdps(120):
            zeroth = mp.exp(a * a / 2) * mp.sqrt(mp.pi / 2) * mp.erfc(a / mp.sqrt(2))
            return (1 + a * a) * zeroth - a
    ratio = (mp.sqrt(a * a + 480) - a) / 2
    for n in range(120, 2, -1):
        ratio = n / (a + ratio)
    second_ratio = 2 / (a + ratio)
    first_ratio = 1 / (a + second_ratio)
    return second_ratio * first_ratio / (a + first_ratio)


def coefficients() -> list[mp.mpf]:
    nodes = [mp.cos(mp.pi * (2 * k + 1) / (2 * TERMS)) for k in range(TERMS)]
    matrix, values = mp.matrix(TERMS, TERMS), mp.matrix(TERMS, 1)
    for k, node in enumerate(nodes):
        z = (node + 1) / 2
        values[k] = second(4 / z - 4) / z**3
        for power in range(TERMS):
            matrix[k, power] = node**power
    return list(mp.lu_solve(matrix, values))


if __name__ == "__main__":
    for coefficient in coefficients():
        print(f"    {float(coefficient)!r},")
