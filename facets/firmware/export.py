"""Write a sensor's solver as a folder of C code."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..core.sensor import Sensor
from .model_text import needs_double
from .source import CSource, Provenance, fill_template, template, write_source
from .vectors import TestVectors, make_vectors

#: Sizes and speeds, measured with GCC 12.2 at -O2 and QEMU 7.2, which counts instructions.
COSTS = """\
For the shipped configuration `bench` (GCC 12.2, `-O2`; instructions as QEMU counts; a Cortex-M7 at
600 MHz with one instruction a cycle would need 17 us for a step):

| core | precision | code | stack | instructions of a step | from the last pose | from zero |
| --- | --- | --- | --- | --- | --- | --- |
| Cortex-M7 | double | 29 kB | 5.8 kB | 10,100 | 10,300 | 60,000 in 6 steps |
| Cortex-M7 | single | 29 kB | 3.0 kB | 10,500 | 10,700 | 53,000 in 5 steps |
| Cortex-M4F | single | 31 kB | 3.0 kB | 31,700 | 31,800 | 153,000 in 5 steps |
| Cortex-M7 | double, spots cut by edges | 74 kB | | 44,300 | 44,500 | 238,000 in 6 steps |
| Cortex-M7 | double, all effects of a bench | 117 kB | | 152,000 | 152,000 | 913,000 in 6 steps |

Without the C library's `exp`, `atan2` and their like; the light far off the beam's centre takes
10 kB. The Cortex-M4F has no double precision, in which the last part of each reading is computed in
either build."""

#: The further files, by their paths in the package; without `.in`, also in the written folder. They
#: are listed because an installed package's folders contain other files too, such as bytecode.
FILES = (
    "CMakeLists.txt.in",
    "Makefile.in",
    "README.md.in",
    "facets_frame.c",
    "facets_frame.h",
    "facets_test.c",
    "callers/facets_ctypes.py",
    "callers/facets_matlab.m",
    "callers/labview.md",
    "teensy41/teensy41.ino",
)


def export(sensor: Sensor, about: Provenance) -> dict[Path, str]:
    """Texts of the folder's files, by path.

    Raises `InputError` for a sensor that the C code does not support.
    """
    code = write_source(sensor, about)
    paths = {
        Path("facets.h"): code.header,
        Path("facets.c"): code.code,
        Path("vectors.h"): vectors_header(make_vectors(sensor), about, sensor.light.on),
    }
    for name in FILES:
        paths[Path(name.removesuffix(".in"))] = fill_folder_template(
            template(name), code, about, not needs_double(sensor)
        )
    return paths


def fill_folder_template(text: str, code: CSource, about: Provenance, single: bool) -> str:
    return (
        fill_template(text, about)
        .replace("@SINGLE@", "yes" if single else "")
        .replace("@OPERATIONS@", f"{code.operations:,}")
        .replace("@COSTS@", COSTS)
    )


def vectors_header(vectors: TestVectors, about: Provenance, real_light: bool) -> str:
    """Write the test vectors as C constants in double precision."""
    count = len(vectors.status)
    lines = [
        fill_template('/* Test vectors of "@NAME@", hash @HASH@, by facets @VERSION@. */', about),
        "#ifndef FACETS_VECTORS_H",
        "#define FACETS_VECTORS_H",
        "#include <math.h>",
        f"#define VECTORS {count}",
        f"#define VECTORS_OF_REAL_LIGHT {int(real_light)}",
        table("double VECTOR_READING", vectors.reading),
        table("int VECTOR_BEAM_KNOWN", vectors.beam_known.astype(int)),
        table("int VECTOR_STATUS", vectors.status),
        table("double VECTOR_STATE", vectors.state),
        table("double VECTOR_UNCERTAINTY", vectors.uncertainty),
        "#endif",
        "",
    ]
    return "\n".join(lines)


def table(name: str, values: np.ndarray) -> str:
    """Write a constant C array of one or two dimensions.  name: its type and name."""
    size = "".join(f"[{n}]" for n in values.shape)
    rows = [", ".join(map(constant, np.atleast_1d(row).tolist())) for row in values]
    if values.ndim > 1:
        rows = [f"{{{row}}}" for row in rows]
    inside = ",\n".join(f"    {row}" for row in rows)
    return f"static const {name}{size} = {{\n{inside}}};"


def constant(value: float) -> str:
    if value != value:
        return "NAN"
    if abs(value) == np.inf:
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(value)
