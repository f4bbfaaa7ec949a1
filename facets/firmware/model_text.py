"""The C function of the readings and their derivatives, from the text of the optics."""

from __future__ import annotations

from typing import NamedTuple

from ..core.sensor import Sensor
from ..model.arrays import geometry_of
from ..optics.forward import (
    dark_scene,
    illuminate,
    path,
    power_derivative,
    reading,
    replace_light,
    replace_power,
)
from ..optics.gradient import edge_turns, linearise_detector
from ..optics.vectors import rotation_axes
from .c_numbers import CONSTANT, CWriter, prune_statements


class ModelText(NamedTuple):
    """statements: body of `facets_linearise`.  functions: that it calls.  operations: count of its
    computed numbers."""

    statements: str
    functions: str
    operations: int


def model_text(sensor: Sensor) -> ModelText:
    """The statements that fill found[10][10] from x[9]: a state (mm, rad) and the power (mW).

    The first row holds the nine readings, each further row one reading's derivatives. The spots'
    positions are computed in wide numbers: over the detector's distance, single precision would
    round them by some 50 nm. The light and the derivatives do not need this.
    """
    writer = CWriter()
    exact = tuple(writer.variable(f"x[{c}]", wide=True) for c in range(8))
    vectors = replace_power(geometry_of(sensor), writer.variable("(facets_real)x[8]"))
    standing = dark_scene(vectors, exact)
    at = illuminate(writer.narrow(standing))
    lit = replace_light(standing, at.integrals, at.moments)
    turns, axes = edge_turns(vectors, at), writer.narrow(rotation_axes(exact[4], exact[5]))
    for k in range(3):
        values, derivatives = linearise_detector(vectors, at, k, turns, axes)
        psi, zeta, _ = writer.narrow(reading(vectors, lit, k, path(vectors, lit, k)))
        for i, value in enumerate((psi, zeta, values[2])):
            row = 3 * k + i
            writer.put(f"found[0][{row}]", value)
            for c in range(8):
                writer.put(f"found[{1 + row}][{c}]", derivatives[i][c])
            writer.put(f"found[{1 + row}][8]", power_derivative(vectors, values, k, i))
    statements = prune_statements(writer.statements)
    functions = "\n\n".join(text for text, _ in writer.functions.values())
    operations = sum(map(bool, map(CONSTANT.match, statements)))
    return ModelText("\n".join(statements), functions, operations)
