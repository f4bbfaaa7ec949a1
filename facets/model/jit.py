"""Compiling the optics' text, and keeping the machine code. Importing this imports Numba.

The text of `facets.optics` is compiled as it stands; only what `scalars.dispatch` and the wedge
decide by number type gets a compiled twin here. Machine code is kept on disk in a folder named
after the text, because Numba notices when a compiled function's own file changes, but not when a
file that it calls into does.
"""

from __future__ import annotations

import ctypes
import math
import threading
from collections.abc import Callable
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numba  # noqa: TID253  this module is itself imported only where compiled code is needed
import numba.core.caching  # noqa: TID253
from llvmlite import ir
from numba import types  # noqa: TID253
from numba.extending import intrinsic, overload, register_jitable  # noqa: TID253

from ..optics import (
    bench_gradient,
    bench_light,
    compensated,
    cut,
    cut_light,
    cut_parameters,
    detected,
    effects,
    forward,
    gradient,
    half_normal,
    limits,
    rays,
    region,
    tail_quadrature,
    vectors,
    wedge,
)
from ..scalars import dispatch
from .code_folder import code_folder, tell
from .failures import raise_failure


def is_complex(kind: Any) -> bool:
    return isinstance(kind, numba.types.Complex)


TWINS: dict[Callable[..., Any], Callable[..., Any]] = {
    dispatch.exp: lambda x: lambda x: math.exp(x),
    # A number that carries a derivative in its imaginary part needs only the first order.
    dispatch.sqrt: lambda x: (
        (lambda x: complex(math.sqrt(x.real), x.imag / (2 * math.sqrt(x.real))))
        if is_complex(x)
        else lambda x: math.sqrt(x)
    ),
    dispatch.log: lambda x: lambda x: math.log(x),
    dispatch.sin: lambda x: lambda x: math.sin(x),
    dispatch.cos: lambda x: lambda x: math.cos(x),
    dispatch.erf: lambda x: lambda x: math.erf(x),
    dispatch.erfc: lambda x: lambda x: math.erfc(x),
    dispatch.atan2: lambda y, x: lambda y, x: math.atan2(y, x),
    dispatch.pi: lambda like: lambda like: math.pi,
    dispatch.nan_unless_positive: lambda value, a, b, c: (
        lambda value, a, b, c: (
            value if a.real > 0 and b.real > 0 and c.real > 0 else value * math.nan
        )
    ),
    wedge.side: lambda q, u: (
        lambda q, u: wedge.side_float(q, u, q[0] * u[0] + q[1] * u[1], q[0] * u[1] - q[1] * u[0])
    ),
    wedge.wedge: lambda q, u1, u2, side1, side2: (
        lambda q, u1, u2, side1, side2: wedge.wedge_float(q, u1, u2, side1, side2)
    ),
}
TEXT = (
    bench_light,
    bench_gradient,
    effects,
    vectors,
    rays,
    compensated,
    half_normal,
    tail_quadrature,
    wedge,
    forward,
    region,
    limits,
    gradient,
    cut,
    cut_parameters,
    detected,
    cut_light,
)
#: Compiled code alone calls this text, so the wrappers for Python and C, a quarter of the compile
#: time, are left out.
BARE: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
#: Functions that are called and not inlined, because they are long and called from many places, or
#: rarely.
LONG = (tail_quadrature,)


def twin(function: Callable[..., Any], make: Callable[..., Any]) -> None:
    """Let compiled code use the function that `make` gives for its argument types, in place of a
    function of text."""
    TWINS[function] = make
    overload(function, jit_options=BARE)(make)


def register(module: ModuleType, inline: bool = True) -> None:
    """Lets Numba compile the functions of a module of text where a compiled function calls them.

    inline: whether callers contain the functions, as formulas need; loops do not, and compile
    faster.
    """
    for function in vars(module).values():
        if not isinstance(function, FunctionType) or function.__module__ != module.__name__:
            continue
        if function not in TWINS and function not in _REGISTERED:
            _REGISTERED.add(function)
            register_jitable(forceinline=inline, **BARE)(function)


def compilable(function: Callable[..., Any]) -> Callable[..., Any]:
    """Mark a function as one that compiled functions may call."""
    return register_jitable(forceinline=True, **BARE)(function)


def cache_folder(*files: str | None) -> tuple[Path, object]:
    """The folder of the machine code that Numba makes from these files and the optics."""
    return code_folder(f"numba {numba.__version__}", __file__, *files)


_REGISTERED: set[Callable[..., Any]] = set()
for _function, _twin in TWINS.items():
    overload(_function, jit_options=BARE)(_twin)
for _module in TEXT:
    register(_module, inline=_module not in LONG)


def compiler(
    file: str, *modules: ModuleType, calls: tuple[ModuleType, ...] = ()
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """The decorator that compiles the functions of one file of kernels.

    file: the kernels' own.  modules: text that they call beside the optics.  calls: other files of
    kernels whose functions they call.  The machine code is made anew when any of these changes.
    """
    for module in modules:
        register(module, inline=False)
    folder, passing = cache_folder(file, *(module.__file__ for module in (*modules, *calls)))

    def compile_function(function: Callable[..., Any]) -> Callable[..., Any]:
        return _cached_function(function, folder, passing)

    return compile_function


class Locator(getattr(numba.core.caching, "UserProvidedCacheLocator", object)):  # type: ignore[misc]
    """Tells Numba the folder in which it stores the machine code of a file.

    The folder is named after the text, so that checkouts of one text share it. Numba's own locators
    also use the file's path; versions of Numba that accept no other locator use those.
    """

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        return Path(py_file).parent.name

    def get_source_stamp(self) -> str:
        return Path(self.get_cache_path()).parent.name


#: Numba's configuration is shared by all threads.
_CONFIGURING = threading.RLock()


def _compile_in_folder(folder: Path, make: Callable[[], Any]) -> Any:
    """Compile by `make`, and store the machine code in a folder."""
    with _CONFIGURING:
        return _call_with_cache(folder, make)


def _call_with_cache(folder: Path, make: Callable[[], Any]) -> Any:
    config: Any = numba.config
    asked = {"CACHE_DIR": str(folder), "CACHE_LOCATOR_CLASSES": f"{__name__}.{Locator.__name__}"}
    kept = {name: getattr(config, name) for name in asked if hasattr(config, name)}
    for name in kept:
        setattr(config, name, asked[name])
    try:
        return make()
    finally:
        for name, value in kept.items():
            setattr(config, name, value)


def _is_in(folder: Path, function: Callable[..., Any]) -> bool:
    return any(folder.rglob(f"*.{function.__name__}-*.nbi"))


def is_kept(file: str, function: Callable[..., Any], *modules: ModuleType) -> bool:
    """Whether the machine code of a function is stored."""
    return _is_in(cache_folder(file, *(module.__file__ for module in modules))[0], function)


def _tell(folder: Path, passing: object, function: Callable[..., Any]) -> None:
    """Print on the standard error that a function is compiled, if so."""
    if not _is_in(folder, function):
        tell(passing)


def _cached_function(
    function: Callable[..., Any], folder: Path, passing: object
) -> Callable[..., Any]:
    """Return the compiled `function`; print a message if it has to be compiled first."""
    make = numba.njit(cache=True, nogil=True, error_model="numpy")
    dispatcher = _compile_in_folder(folder, lambda: make(function))
    called = False

    def call(*arguments: Any) -> Any:
        nonlocal called
        if called:
            result = dispatcher(*arguments)
        else:
            _tell(folder, passing, function)
            result = dispatcher(*arguments)
            called = True
        raise_failure()
        return result

    call.keeps = passing  # type: ignore[attr-defined]  # a passing folder lives as long as this
    return call


_NUMBERS = types.CPointer(types.float64)  # type: ignore[no-untyped-call]
#: The arrays of input and output.
TWO_POINTERS = types.void(_NUMBERS, _NUMBERS)
#: The arrays of a sensor's vectors, of input rows, output rows and memory, and the number of rows.
MODEL = types.void(_NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS, types.int64)
_TASK = types.void(types.CPointer(types.int64))  # type: ignore[no-untyped-call]


def callback(file: str, function: Callable[..., Any], *modules: ModuleType, signature: Any) -> Any:
    """`function`, compiled now for a signature; `.address` is what kernels call.

    file: where it is written.  modules: other files that it is made of. Kernels call it by its
    address (`call_address`), so that it is compiled once for all of them.
    """
    folder, passing = cache_folder(file, *(module.__file__ for module in modules))
    _tell(folder, passing, function)
    make = numba.cfunc(signature, cache=True, error_model="numpy")
    compiled = _compile_in_folder(folder, lambda: make(function))
    compiled.keeps = passing
    return compiled


def task(file: str, function: Callable[..., Any], *modules: ModuleType) -> Callable[[int], None]:
    """`function` of a pointer to 64-bit integers, compiled now, to be called with their address.

    These integers are the addresses and lengths of its arrays. Passing one number is faster than
    passing arrays, each of which costs a fifth of a microsecond. The interpreter's lock is
    released.
    """
    for module in modules:
        register(module, inline=False)
    compiled = callback(file, function, *modules, signature=_TASK)
    start = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(compiled.address)

    def call(address: int) -> None:
        start(address)
        raise_failure()

    call.keeps = compiled  # type: ignore[attr-defined]
    return call


def _pointer_to(kind: Any) -> Any:
    """Compile a function that converts an address to a pointer to numbers of a kind."""

    def pointer_at(typing: Any, address: Any) -> tuple[Any, Any]:
        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.inttoptr(values[0], context.get_value_type(signature.return_type))

        return types.CPointer(kind)(types.int64), code  # type: ignore[no-untyped-call]

    return intrinsic(pointer_at)


doubles_at = _pointer_to(types.float64)
longs_at = _pointer_to(types.int64)
integers_at = _pointer_to(types.int32)
bytes_at = _pointer_to(types.int8)


def _call_address(
    typing: Any, address: Any, first: Any, second: Any, third: Any, fourth: Any
) -> tuple[Any, Any]:
    """Call a function of `MODEL` for one row, with the numbers of four contiguous arrays."""
    arrays = (first, second, third, fourth)

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        pointers = [
            context.make_array(kind)(context, builder, value).data
            for kind, value in zip(arrays, values[1:], strict=True)
        ]
        one = ir.Constant(ir.IntType(64), 1)
        given = [*pointers, one]
        kind = ir.FunctionType(ir.VoidType(), [each.type for each in given])
        builder.call(builder.inttoptr(values[0], kind.as_pointer()), given)
        return context.get_dummy_value()

    return types.void(types.intp, *arrays), code


call_address: Any = intrinsic(_call_address)
