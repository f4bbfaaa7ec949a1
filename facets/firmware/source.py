"""Write the two C files of a sensor, `facets.h` and `facets.c`."""

from __future__ import annotations

from importlib.resources import files
from typing import NamedTuple

from ..core.sensor import Sensor
from ..core.version import __version__
from .model_text import model_text, needs_double
from .sensor_data import refuse_sensor, sensor_data


class Provenance(NamedTuple):
    """Origin of the C code: name and hash of the configuration, and the command that wrote it."""

    name: str
    hash: str
    command: str


class CSource(NamedTuple):
    """The C code of a sensor.

    header, code: the texts of the two files.  operations: number of values that the model computes
    for the readings and their derivatives.
    """

    header: str
    code: str
    operations: int


def template(name: str) -> str:
    return files(__package__).joinpath("c", name).read_text(encoding="utf-8")


def fill_template(text: str, about: Provenance) -> str:
    """Replace the marks of a template by the provenance, the version and the licence."""
    marks = {
        "@NAME@": about.name,
        "@HASH@": about.hash,
        "@COMMAND@": about.command,
        "@VERSION@": __version__,
        "@LICENCE@": LICENCE,
    }
    for mark, value in marks.items():
        text = text.replace(mark, value)
    return text


LICENCE = "MIT"

MODEL = """\
/* The light far off the beam's centre, and on a facet that holds little of it. Generated, as what
 * follows, from the text of the optics: `far_side`, `tail_wedge` and what these call. */
{functions}

/* found: in the first row the readings at x, a state and the power; below, their derivatives by
 * each of these, a reading a row. */
{guard}static void facets_linearise(const facets_wide x[9], facets_real found[10][10])
{{
{statements}
}}
"""

SPOT_ENDS = """\
/* The ends of each spot at a state: least and largest psi, then zeta, mm; and how far from its axis
 * the mirror is lit. */
static void spot_ends(const facets_wide x[9], facets_real ends[3][5])
{{
{statements}
}}
"""


ONLY_DOUBLE = """\
#ifdef FACETS_FLOAT
#error "the light of this sensor is computed in double precision only: compile without FACETS_FLOAT"
#endif
"""


def write_source(sensor: Sensor, about: Provenance) -> CSource:
    """Write the C code of a sensor; raises `InputError` if the code does not support it."""
    refuse_sensor(sensor)
    model = model_text(sensor)
    head = fill_template(
        '/* Written by facets @VERSION@ for "@NAME@", hash @HASH@; see facets.h. */', about
    )
    code = [
        head,
        '#include "facets.h"',
        template("numbers.h.in"),
        "/* The sensor. */\n" + sensor_data(sensor) + "\n",
        MODEL.format(
            functions=model.functions,
            statements=model.statements,
            guard=ONLY_DOUBLE if needs_double(sensor) else "",
        ),
        SPOT_ENDS.format(statements=model.ends) if model.ends else "",
        "static facets_real square(facets_real x) { return x * x; }\n"
        "static int finite_number(facets_real x) { return x - x == R(0.0); }\n",
        template("counts.c"),
        template("estimator.c"),
    ]
    return CSource(fill_template(template("facets.h.in"), about), "\n".join(code), model.operations)
