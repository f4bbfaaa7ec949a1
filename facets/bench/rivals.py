"""Other methods that compute readings and poses of the paper's head.

Readings are computed by double integrals, as in the paper, and by a quadrature in NumPy. Poses are
computed from these models by SciPy's solvers. The exported C computes both.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from ..firmware.export import export
from ..firmware.source import Provenance
from ..model.arrays import parameters, reaches
from .ray_model import DoubleIntegrals, RayModel

#: Compiler of the exported C, and its options.
COMPILER, OPTIONS = "gcc", ("-O3", "-march=native", "-std=c99")
#: Number of floats in a solution of the exported C, of which the state is the first.
SOLUTION_NUMBERS = 77
#: Loops over many readings or states, so that the call from Python takes no time per pose.
LOOPS = f"""\
#include "facets.c"
void all_readings(const double *states, double *found, long count)
{{
    for (long n = 0; n < count; n++) facets_readings(states + 8 * n, found + 9 * n);
}}
void all_poses(const double *readings, double *found, long count)
{{
    for (long n = 0; n < count; n++)
        facets_solve_plain(readings + 9 * n, 0, 0, found + {SOLUTION_NUMBERS} * n);
}}
"""

SENSOR = Sensor()
#: Nine readings (n, 9) for states (n, 8).
readings_by_dblquad = DoubleIntegrals(parameters(SENSOR))
readings_by_legendre = RayModel(parameters(SENSOR))
#: Scales of the unknowns, mm and rad, and the step of differences: the root of a float's last bit.
SCALE, STEP = np.array([1, 1, 1, 1e-2, 1e-2, 1e-2, 1, 1]), 1.5e-8
Function = Callable[[Floats], Floats]


def states_in_range(count: int, seed: int) -> Floats:
    """Random states (count, 8), mm and rad, whose three spots lie on their detectors."""
    half = np.array([0.1, 0.1, 6.0, 12e-3, 12e-3, 24e-3, 0.05, 0.05])
    rng = np.random.default_rng(seed)
    states: list[Floats] = []
    while sum(map(len, states)) < count:
        drawn = rng.uniform(-half, half, (2 * count + 1000, 8))
        states.append(drawn[reaches(SENSOR, drawn).all(axis=1)])
    return np.concatenate(states)[:count]


def solve_by_scipy(model: Function, readings: Floats) -> Floats:
    """States (n, 8) of readings (n, 9), by `fsolve` from zero. Eight readings, without the third
    power, determine eight unknowns of order one.

    model: function that computes the readings (n, 9) of states (n, 8).
    """
    from scipy.optimize import fsolve

    def first_eight(unknowns: Floats) -> Floats:
        """The first eight readings (n, 8) at scaled unknowns (n, 8)."""
        return model(unknowns * SCALE)[:, :8]

    def slopes(x: Floats, _: Floats) -> Floats:
        """The derivatives (8, 8), from nine states in one call, which takes a vectorised model
        little time."""
        values = first_eight(np.vstack([x, x + STEP * np.eye(8)]))
        differences: Floats = (values[1:] - values[0]).T / STEP
        return differences

    def residual(x: Floats, reading: Floats) -> Floats:
        """The differences (8,) of the first eight readings."""
        differences: Floats = first_eight(x[None])[0] - reading[:8]
        return differences

    unknowns = [fsolve(residual, np.zeros(8), (reading,), slopes) for reading in readings]
    states: Floats = np.array(unknowns) * SCALE
    return states


def has_compiler() -> bool:
    """Whether a compiler of C is installed."""
    return shutil.which(COMPILER) is not None


@cache
def exported_c() -> ctypes.CDLL:
    """The C that `facets export-c` writes for the head, compiled for this machine's processor."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path, text in export(SENSOR, Provenance("paper", "", "facets bench")).items():
            if path.parent == Path() and path.suffix in (".c", ".h"):
                (folder / path).write_text(text)
        (folder / "loops.c").write_text(LOOPS)
        subprocess.run(
            [COMPILER, *OPTIONS, "-shared", "-fPIC", "loops.c", "-o", "loops.so", "-lm"],
            cwd=folder, check=True,
        )  # fmt: skip
        return ctypes.CDLL(str(folder / "loops.so"))


def readings_by_c(states: Floats) -> Floats:
    """Readings (n, 9) of states (n, 8)."""
    return call_c("all_readings", states, 9)


def poses_by_c(readings: Floats) -> Floats:
    """States (n, 8) of readings (n, 9), from zero, computed with their covariances."""
    return call_c("all_poses", readings, SOLUTION_NUMBERS)[:, :8]


def call_c(loop: str, rows: Floats, width: int) -> Floats:
    """Results (n, width) of a loop of the exported C code for rows (n, ...)."""
    rows, results = np.ascontiguousarray(rows), np.empty((len(rows), width))
    pointers = (ctypes.c_void_p(array.ctypes.data) for array in (rows, results))
    getattr(exported_c(), loop)(*pointers, ctypes.c_long(len(rows)))
    return results
