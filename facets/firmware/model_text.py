"""The C function of the readings and their derivatives, from the text of the optics."""

from __future__ import annotations

from typing import NamedTuple

from ..core.sensor import Sensor
from ..model.arrays import geometry_of
from ..optics.forward import by_power, with_power
from ..optics.gradient import linearised
from .c_numbers import CONSTANT, Writer, needed


class ModelText(NamedTuple):
    """statements: of `facets_linearise`.  operations: how many numbers they compute."""

    statements: str
    operations: int


def model_text(sensor: Sensor) -> ModelText:
    """The statements that fill found[10][10] from x[9]: a state (mm, rad) and the power (mW).

    The first row holds the nine readings, each further row one reading's derivatives.
    """
    writer = Writer()
    x = [writer.value(f"x[{c}]") for c in range(9)]
    vectors = with_power(geometry_of(sensor), x[8])
    for k, (values, derivatives) in enumerate(linearised(vectors, tuple(x[:8]))):
        for i in range(3):
            row = 3 * k + i
            writer.put(f"found[0][{row}]", values[i])
            for c in range(8):
                writer.put(f"found[{1 + row}][{c}]", derivatives[i][c])
            writer.put(f"found[{1 + row}][8]", by_power(vectors, values, k, i))
    statements = needed(writer.statements)
    return ModelText("\n".join(statements), sum(map(bool, map(CONSTANT.match, statements))))
