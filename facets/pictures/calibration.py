"""What a calibration leaves: residuals over each detector, and errors before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.names import DETECTORS, POSE
from . import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..calibration.bundle_adjustment import Data
    from ..calibration.fit import Fit

KINDS = (("psi", style.BLUE), ("zeta", style.ORANGE), ("power", style.GREEN))


def residual_picture(data: Data, found: Fit, table: dict[str, NDArray[Any]]) -> Figure:
    """Residuals in standard deviations over the spot's place, a column a detector; and the errors
    of poses held back, before and after."""
    with style.in_rules():
        picture = style.figure(10, 6.2)
        parts: Any = picture.subfigures(2, 1, height_ratios=(2, 1.1))
        upper, lower = parts
        panels = upper.subplots(2, 3, sharey=True)
        for k, letter in enumerate(DETECTORS):
            for row, place in enumerate(("psi", "zeta")):
                panel = panels[row, k]
                for i, (name, colour) in enumerate(KINDS):
                    panel.plot(data.raw[:, 3 * k + row], found.left[:, 3 * k + i], ".", ms=2,
                               color=colour, alpha=0.5, label=name, rasterized=True)  # fmt: skip
                panel.set_xlabel(f"{place} on PSD {letter.upper()}, mm")
        for panel in panels[:, 0]:
            panel.set_ylabel("residual, sigma")
        panels[0, 0].legend(loc="upper left", ncols=3, fontsize=7, markerscale=3)
        compared(lower, table)
    return picture


def compared(part: Any, table: dict[str, NDArray[Any]]) -> None:
    """Errors of each axis, on a logarithmic scale: they differ by hundreds."""
    panel = part.subplots()
    places = np.arange(len(POSE))
    for shift, name, colour in ((-0.2, "before", style.GREY), (0.2, "after", style.BLUE)):
        panel.bar(places + shift, table[name], 0.38, color=colour, label=name)
    panel.plot(places + 0.2, table["stated"], "_", ms=16, mew=2, color=style.ORANGE, label="stated")
    names = [f"{name}, {unit.replace('u', 'µ', 1)}"
             for name, unit in zip(POSE, table["unit"], strict=True)]  # fmt: skip
    panel.set_xticks(places, names)
    panel.set(yscale="log", ylabel="r.m.s. error, held back")
    panel.legend(ncols=3, fontsize=7)
