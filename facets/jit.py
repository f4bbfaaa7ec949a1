"""Compiling the optics' text, and keeping the machine code. Importing this imports Numba.

The text of `facets.optics` is compiled as it stands; only what `facets.numbers` and the wedge
decide by number type gets a compiled twin here. Machine code is kept on disk in a folder named
after the text, because Numba notices when a compiled function's own file changes, but not when a
file that it calls into does.
"""

from __future__ import annotations

import cmath
import hashlib
import math
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any

import numba  # noqa: TID253  this module is itself imported only where compiled code is needed
import platformdirs
from numba.extending import overload, register_jitable  # noqa: TID253

from . import estimate, least_squares, numbers
from .optics import (
    cut,
    cut_parameters,
    detected,
    exact,
    faint,
    footprint,
    forward,
    gradient,
    limits,
    parameters,
    rays,
    region,
    vectors,
    wedge,
)


def is_complex(kind: Any) -> bool:
    return isinstance(kind, numba.types.Complex)


TWINS: dict[Callable[..., Any], Callable[..., Any]] = {
    numbers.exp: lambda x: lambda x: math.exp(x),
    numbers.sqrt: lambda x: (lambda x: cmath.sqrt(x)) if is_complex(x) else lambda x: math.sqrt(x),
    numbers.sin: lambda x: (lambda x: cmath.sin(x)) if is_complex(x) else lambda x: math.sin(x),
    numbers.cos: lambda x: (lambda x: cmath.cos(x)) if is_complex(x) else lambda x: math.cos(x),
    numbers.erf: lambda x: lambda x: math.erf(x),
    numbers.erfc: lambda x: lambda x: math.erfc(x),
    numbers.atan2: lambda y, x: lambda y, x: math.atan2(y, x),
    numbers.pi: lambda like: lambda like: math.pi,
    numbers.defined: lambda value, a, b, c: (
        lambda value, a, b, c: value if a > 0 and b > 0 and c > 0 else math.nan
    ),
    wedge.side: lambda q, u: (
        lambda q, u: wedge.side_float(q, u, q[0] * u[0] + q[1] * u[1], q[0] * u[1] - q[1] * u[0])
    ),
    wedge.wedge: lambda q, u1, u2, side1, side2: (
        lambda q, u1, u2, side1, side2: wedge.wedge_float(q, u1, u2, side1, side2)
    ),
}
TEXT = (
    vectors,
    rays,
    exact,
    faint,
    wedge,
    forward,
    region,
    limits,
    footprint,
    gradient,
    cut,
    cut_parameters,
    detected,
    parameters,
    cut_parameters,
    least_squares,
    estimate,
)


def register_text() -> None:
    """Lets Numba compile the functions of the text where a compiled function calls them."""
    for function, twin in TWINS.items():
        overload(function)(twin)
    for module in TEXT:
        for function in vars(module).values():
            if not isinstance(function, FunctionType) or function.__module__ != module.__name__:
                continue
            if function not in TWINS:
                register_jitable(forceinline=module is not faint)(function)


def text(function: Callable[..., Any]) -> Callable[..., Any]:
    """Marks a function as text that compiled functions may call."""
    return register_jitable(forceinline=True)(function)


def cache_folder() -> tuple[Path, object]:
    """Where machine code is kept: the user's cache, else a folder that goes with this process.

    The second is what keeps that folder.
    """
    text = hashlib.sha256(numba.__version__.encode())
    files = [module.__file__ for module in (*TEXT, numbers) if module.__file__]
    for file in (*files, __file__, str(Path(__file__).with_name("kernels.py"))):
        text.update(Path(file).read_bytes())
    name = text.hexdigest()[:16]
    base = os.environ.get("NUMBA_CACHE_DIR") or platformdirs.user_cache_dir("facets-6dof")
    folder = Path(base) / name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder, None
    except OSError:
        passing = tempfile.TemporaryDirectory(prefix="facets-")
        return Path(passing.name), passing


register_text()
CACHE, _PASSING = cache_folder()


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """The compiled `function`; says so on the standard error when it has to be compiled first."""
    config: Any = numba.config
    kept, config.CACHE_DIR = config.CACHE_DIR, str(CACHE)
    try:
        dispatcher = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    finally:
        config.CACHE_DIR = kept
    seen = False

    def call(*arguments: Any) -> Any:
        nonlocal seen
        if not seen:
            seen = True
            if not any(CACHE.rglob(f"*.{function.__name__}-*.nbi")):
                print(f"facets: compiling {function.__name__}, once ...", file=sys.stderr)
        return dispatcher(*arguments)

    return call
