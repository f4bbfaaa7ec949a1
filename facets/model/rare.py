"""Functions that the code for one pose rarely calls, compiled only after many calls.

The code calls them by addresses in a table. At first these lead to Python, which runs the text with
its floats. That gives the same bits, because all functions in it are those of the C library, and
takes some hundredths of a millisecond, whereas importing Numba and compiling take seconds. After a
second of that, Numba compiles the function or loads its stored code, and Python puts its address
into the table.
"""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np

from ..optics import wedge
from .failures import FAILURES

Pointer = Any
KIND = ctypes.CFUNCTYPE(None, *[ctypes.POINTER(ctypes.c_double)] * 2)


def put_side(found: Pointer, side: Any) -> None:
    found[0], found[1], found[2], found[3] = side


def put_moments(found: Pointer, moments: Any) -> None:
    found[0], (found[1], found[2]), (found[3], found[4], found[5]), (found[6], found[7]) = moments


def side_near(inputs: Pointer, found: Pointer) -> None:
    """`wedge.side_near` of q . u and q x u; four numbers."""
    put_side(found, wedge.side_near(inputs[0], inputs[1]))


def side_far(inputs: Pointer, found: Pointer) -> None:
    """`wedge.side_far` of q, u and q . u; four numbers."""
    put_side(found, wedge.side_far((inputs[0], inputs[1]), (inputs[2], inputs[3]), inputs[4]))


def quadrature_or_dark(inputs: Pointer, found: Pointer) -> None:
    """`wedge.quadrature_or_dark` of q, u1 and u2; eight numbers."""
    first, second = (inputs[2], inputs[3]), (inputs[4], inputs[5])
    put_moments(found, wedge.quadrature_or_dark((inputs[0], inputs[1]), first, second))


#: The functions, and how many numbers each gives.
FUNCTIONS: dict[str, tuple[Callable[..., None], int]] = {
    "side_near": (side_near, 4),
    "side_far": (side_far, 4),
    "quadrature_or_dark": (quadrature_or_dark, 8),
}
NAMES = list(FUNCTIONS)

_COMPILED: dict[str, Any] = {}
_COMPILING = threading.RLock()


#: Time, s, for which the functions run as text before their machine code is loaded if it is stored,
#: or else compiled, which takes several times as long.
LOAD_AFTER_S, MAX_TEXT_S = 0.2, 1.0
_spent = 0.0


@cache
def _is_kept(name: str) -> bool:
    from . import jit

    return jit.is_kept(__file__, FUNCTIONS[name][0])


def _runs_as_text(name: str) -> bool:
    """Whether a function has run too briefly for its machine code to pay."""
    if name in _COMPILED or _spent >= MAX_TEXT_S:
        return False
    return _spent < LOAD_AFTER_S or not _is_kept(name)


def _compiled_function(name: str) -> Any:
    """The compiled function, compiled or loaded if needed."""
    from . import jit

    with _COMPILING:  # Another thread's function would be lost, and its address with it.
        if name not in _COMPILED:
            for part in (put_side, put_moments):
                jit.compilable(part)
            function = FUNCTIONS[name][0]
            _COMPILED[name] = jit.callback(__file__, function, signature=jit.TWO_POINTERS)
            TABLE[NAMES.index(name)] = _COMPILED[name].address
    return KIND(_COMPILED[name].address)


def prepare() -> None:
    """Compile or load all of them now, for a loop that cannot wait when light is lost."""
    for name in NAMES:
        _compiled_function(name)


def _call(name: str, *pointers: Any) -> None:
    """The function to which the table first leads."""
    function, results = FUNCTIONS[name]
    try:
        if not (_runs_as_text(name) and _ran_as_text(function, pointers)):
            _compiled_function(name)(*pointers)
    # An example is Ctrl-C; until it is raised there are no results.
    except BaseException as failure:
        FAILURES.raised.append(failure)
        for n in range(results):
            pointers[1][n] = float("nan")


def _ran_as_text(function: Callable[..., None], pointers: Any) -> bool:
    """Run the text and return whether it succeeded: Python's floats raise for a division by zero
    and an overflow."""
    global _spent
    begin = time.thread_time()
    try:
        with np.errstate(all="raise", under="ignore"):
            function(*pointers)
    except (ArithmeticError, ValueError):
        return False
    finally:
        _spent += time.thread_time() - begin
    return True


#: The functions to which the table first leads, kept for as long as the process lives.
_FIRST = [KIND(partial(_call, name)) for name in NAMES]


def address_of_first(number: int) -> int:
    """The address of the Python callback of one function."""
    return ctypes.cast(_FIRST[number], ctypes.c_void_p).value or 0


TABLE = np.array([address_of_first(number) for number in range(len(NAMES))], dtype=np.intp)

#: The table's address as a float of the same bits, for storing behind a sensor's numbers.
ADDRESS = np.array([TABLE.ctypes.data], dtype=np.int64).view(np.float64)
