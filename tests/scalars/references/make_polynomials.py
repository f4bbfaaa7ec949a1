"""Makes the tables of `facets.scalars.polynomials`: python make_polynomials.py > polynomials.txt

Polynomials through the zeros of Chebyshev's, in 60 digits, lowest power first; beside each what it
leaves out at most.
"""

from collections.abc import Callable

import mpmath as mp

mp.mp.dps = 60


def over_root(function: Callable[[mp.mpf], mp.mpf]) -> Callable[[mp.mpf], mp.mpf]:
    """f(sqrt z) / sqrt z of an odd function whose slope at zero is one."""
    return lambda z: function(mp.sqrt(z)) / mp.sqrt(z) if z > mp.mpf(10) ** -50 else mp.mpf(1)


def error_function(z: mp.mpf) -> mp.mpf:
    """erf(sqrt(z / 2)) / sqrt z."""
    half = mp.sqrt(mp.mpf(1) / 2)
    return half * (2 / mp.sqrt(mp.pi)) * over_root(lambda x: mp.erf(x) * mp.sqrt(mp.pi) / 2)(z / 2)


def decay(z: mp.mpf) -> mp.mpf:
    """(1 - exp(-z)) / z."""
    return -mp.expm1(-z) / z if z > mp.mpf(10) ** -50 else mp.mpf(1)


#: The function, the end of its interval from zero, and how many coefficients.
WANTED = {
    "EXPONENTIAL": (lambda z: mp.exp(-z), mp.mpf(1), 13),
    "ERROR_FUNCTION": (error_function, mp.mpf(4), 14),
    "DECAY": (decay, mp.mpf(2), 14),
    "SINE": (over_root(mp.sin), mp.mpf(1), 8),
    "COSINE": (lambda z: mp.cos(mp.sqrt(z)), mp.mpf(1), 8),
    "ARC_TANGENT": (over_root(mp.atan), (mp.sqrt(2) - 1) ** 2, 12),
}

if __name__ == "__main__":
    for name, (function, end, count) in WANTED.items():
        coefficients, error = mp.chebyfit(function, [0, end], count, error=True)
        print(f"# leaves out {mp.nstr(error, 2)}\n{name} = (")
        for coefficient in reversed(coefficients):
            print(f"    {float(coefficient)!r},")
        print(")")
