"""The two files of C that a sensor becomes: `facets.h` and `facets.c`."""

from __future__ import annotations

from importlib.resources import files
from typing import NamedTuple

from ..core.sensor import Sensor
from ..core.version import __version__
from .model_text import model_text
from .sensor_data import refuse_sensor, sensor_data


class Provenance(NamedTuple):
    """Where a sensor comes from.  name: of its configuration.  hash: of that."""

    name: str
    hash: str
    command: str


class CSource(NamedTuple):
    """header, code: the texts of the two files.  operations: of the model's readings and their
    derivatives, by count of the numbers that are computed."""

    header: str
    code: str
    operations: int


def template(name: str) -> str:
    return files(__package__).joinpath("c", name).read_text(encoding="utf-8")


def fill_template(text: str, about: Provenance) -> str:
    """A template with its marks replaced by what is known of the sensor."""
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
/* found: in the first row the readings at x, a state and the power; below, their derivatives by
 * each of these, a reading a row. Generated from the text of the optics. */
static void facets_linearise(const facets_wide x[9], facets_real found[10][10])
{{
{statements}
}}
"""


def write_source(sensor: Sensor, about: Provenance) -> CSource:
    """The C of a sensor. Raises `InputError` for one whose readings it would not give."""
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
        template("light.c"),
        MODEL.format(statements=model.statements),
        "static int finite_number(facets_real x) { return x - x == R(0.0); }\n",
        template("counts.c"),
        template("estimator.c"),
    ]
    return CSource(fill_template(template("facets.h.in"), about), "\n".join(code), model.operations)
