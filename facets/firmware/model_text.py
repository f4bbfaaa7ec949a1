"""Write the C function of the readings and their derivatives, from the text of the optics."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..core.sensor import Sensor
from ..model.arrays import geometry_of
from ..optics.exact_text import BENCH, CUT, ExactText
from ..optics.footprint import footprints
from ..optics.forward import (
    Geometry,
    dark_scene,
    illuminate,
    mirror_facets,
    path,
    power_derivative,
    reading,
    replace_light,
    replace_power,
)
from ..optics.gradient import edge_turns, linearise_detector
from ..optics.vectors import rotation_axes
from ..scalars.dual import Dual
from ..scalars.nesting import leaves
from ..scalars.statements import CONSTANT
from .c_numbers import CWriter


class ModelText(NamedTuple):
    """The C code of a sensor's model.

    statements: body of `facets_linearise`.  ends: body of `spot_ends`, which fills ends[3][5] with
    the spots' `footprints`.  functions: text of the functions that both call.  operations: number
    of values that `facets_linearise` computes.
    """

    statements: str
    ends: str
    functions: str
    operations: int


def model_text(sensor: Sensor) -> ModelText:
    """Write the statements that compute found[10][10] from x[9], a state (mm, rad) and power (mW).

    The first row holds the nine readings, each further row the derivatives of one reading by x.
    """
    writer = CWriter()
    vectors = replace_power(geometry_of(sensor), writer.variable("(facets_real)x[8]"))
    if needs_double(sensor):
        detectors = linearise_exactly(writer, vectors, CUT if sensor.apertures.cut else BENCH)
    else:
        detectors = linearise_widely(writer, vectors)
    for k, (values, derivatives) in enumerate(detectors):
        for i, (value, slopes) in enumerate(zip(values, derivatives, strict=True)):
            row = 3 * k + i
            writer.put(f"found[0][{row}]", value)
            for c, slope in enumerate(slopes):
                writer.put(f"found[{1 + row}][{c}]", slope)
            writer.put(f"found[{1 + row}][8]", power_derivative(vectors, values, k, i))
    statements = writer.needed_statements()
    ends = CWriter(functions=writer.functions)
    if sensor.apertures.detectors:
        spots = footprints(geometry_of(sensor), ends.array("x", 8))
        for n, number in enumerate(leaves(spots)):
            ends.put(f"ends[{n // 5}][{n % 5}]", number)
    functions = "\n\n".join(writer.functions.values())
    operations = sum(map(bool, map(CONSTANT.match, statements)))
    ends_text = "\n".join(ends.needed_statements())
    return ModelText("\n".join(statements), ends_text, functions, operations)


def needs_double(sensor: Sensor) -> bool:
    """Whether the C code of a sensor requires double precision."""
    return sensor.apertures.cut or sensor.light.on


def linearise_widely(writer: CWriter, vectors: Geometry) -> list[Any]:
    """The readings of each detector in ideal light, and their derivatives by the state.

    Only the spots' positions are computed in wide numbers, because single precision would round
    them by some 50 nm at the detector's distance.
    """
    exact = writer.wide_array("x", 8)
    unlit = dark_scene(vectors, exact)
    at = illuminate(writer.narrow(unlit))
    lit = replace_light(unlit, at.integrals, at.moments)
    turns, axes = edge_turns(vectors, at), writer.narrow(rotation_axes(exact[4], exact[5]))
    detectors = []
    for narrow, wide in zip(mirror_facets(vectors, at), mirror_facets(vectors, lit), strict=True):
        values, derivatives = linearise_detector(narrow, turns, axes)
        psi, zeta, _ = writer.narrow(reading(wide, path(wide)))
        detectors.append(((psi, zeta, values[2]), derivatives))
    return detectors


def linearise_exactly(writer: CWriter, vectors: Geometry, text: ExactText) -> list[Any]:
    """The readings of each detector in real or cut light, with empty derivatives.

    A C loop over the components of the state computes and stores the derivatives.
    """
    state = writer.array("x", 8)
    at = text.scene(vectors, state)
    with writer.loop(8) as component:
        units = (writer.variable(f"(facets_real)({component} == {c})") for c in range(8))
        varied = tuple(Dual(number, unit) for number, unit in zip(state, units, strict=True))
        for row, slope in enumerate(leaves(text.slopes(vectors, varied, at))):
            writer.put(f"found[{1 + row}][{component}]", slope)
    return [(values, ((), (), ())) for values in text.readings(vectors, at)]
