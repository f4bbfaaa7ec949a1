"""The model at one state after the other, as compiled functions with an address.

They compute the states that blocks leave over, and cut light. A model takes five integers: the
addresses of a sensor's vectors, of the input rows, of the output rows and of memory, and the number
of rows. llvmlite compiles the models of `row_code`; Numba compiles those of `cut_code`, whose text
has loops. Each is compiled at its first use.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from ..optics.limits import COLUMNS, MOST_SIDES
from .blocks import address_of
from .failures import raise_failure
from .kinds import LIT, kind_of
from .threads import once

#: The files from which these are made, beside the optics.
CODE = tuple(
    Path(__file__).parent / name
    for name in (
        "evaluators.py",
        "row_code.py",
        "block_code.py",
        "packing.py",
        "kinds.py",
        "rare.py",
    )
)


#: The models that this process has compiled or loaded.
_LOADED: set[str] = set()


def is_ready(name: str) -> bool:
    """Whether a model of `row_code` is loaded, or was stored when this was first asked."""
    return name in _LOADED or _was_kept(name)


@cache
def _was_kept(name: str) -> bool:
    from .object_code import is_kept

    return is_kept(f"each_{name}", *CODE)


def load_code(name: str, count: int) -> Callable[..., None]:
    """One of `row_code.LOOPS`, which takes `count` integers."""
    from .object_code import Write, function

    def make_writer() -> Write:
        from . import row_code

        return row_code.LOOPS[name]

    found = function(f"each_{name}", count, make_writer, *CODE)
    _LOADED.add(name)
    return found


@once
def model(name: str) -> Callable[..., None]:
    """Return one of `row_code.LOOPS` or `cut_code.MODELS`, compiled if needed."""
    if "_of_cut" in name:
        from . import cut_code

        return cut_code.model(name)
    return load_code(name, 5)


def address(name: str) -> int:
    """The address of the compiled function in this process."""
    code: Any = model(name)
    return ctypes.cast(code, ctypes.c_void_p).value or 0


def fill(name: str, vectors: Floats, inputs: Floats, found: Floats) -> None:
    """Fill rows of `found` for rows of `inputs` by one of the models."""
    memory = np.empty((3, MOST_SIDES, COLUMNS))
    model(name)(*map(address_of, (vectors, inputs, found, memory)), len(inputs))
    raise_failure()


@once
def slopes_model(name: str) -> Callable[..., None]:
    """Return a model of derivatives, see `row_code.each_row_of_slopes`."""
    return load_code(name, 6)


def slopes(name: str, vectors: Floats, varied: Floats, states: Floats, found: Floats) -> None:
    """Fill found (n, 9, m) with the derivatives that `blocks.slopes` gives."""
    where = map(address_of, (vectors, states, found, varied))
    slopes_model(name)(*where, len(states), found.shape[2])
    raise_failure()


def readings(sensor: Sensor) -> str:
    """The model of a sensor's readings."""
    return f"readings_of_{kind_of(sensor)}"


def footprints(sensor: Sensor) -> str:
    """The model of how far the spots reach."""
    return "footprints_of_light" if sensor.light.on else "footprints_of_plain"


def linearisation(sensor: Sensor) -> str:
    """The model of the readings and of their derivatives by a state and the beam's power."""
    kind = kind_of(sensor)
    return f"linearisation_of_{kind}" if kind in LIT else approximate_linearisation(sensor)


def approximate_linearisation(sensor: Sensor) -> str:
    """The approximate model for steps of an iteration and for uncertainties: under real light its
    derivatives leave out terms that are slow to compute and small."""
    return f"approximate_linearisation_of_{kind_of(sensor)}"
