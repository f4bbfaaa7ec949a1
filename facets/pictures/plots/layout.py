"""The picture of a layout's uncertainties and ranges, before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.hues import chosen_hues
from ...core.units import write_micro
from .. import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def layout_picture(table: dict[str, NDArray[Any]]) -> Figure:
    """Draw the comparison of `verification.compare`: each axis after over before, and both values.

    The titles state which direction is better; the rings at 1 are the values before.
    """
    hues = chosen_hues()
    marks: dict[str, dict[str, Any]] = {
        "before": {"marker": "o", "ms": 6, "mfc": hues.ground},
        "after": {"marker": "o", "ms": 6.5},
    }
    if np.isfinite(table["simulated"]).any():
        marks["after, spread of simulated solves"] = {"marker": "|", "ms": 11, "mew": 1.8}
    with style.style_context():
        picture = style.figure(style.FULL, 4.9)
        fine, far = picture.subplots(2, 1)
        draw_steps(fine, table, "u_", "worst standard uncertainty over the volume (← better)")
        draw_steps(far, table, "range_", "symmetric range, twice its nearer end (better →)")
        far.set_xlabel("after over before, logarithmic scale")
        for text, mark in marks.items():  # in no axis's hue, since they apply to all axes
            far.plot([], [], ls="", color=hues.ink, label=text, **mark)
        style.panels_legend(picture, [far], 3)
    return picture


def draw_steps(panel: Axes, table: dict[str, NDArray[Any]], kind: str, title: str) -> None:
    """Draw the steps from before to after of six axes, relative to before, and their numbers.

    On the logarithmic scale half and twice are equally far.
    """
    hues = chosen_hues()
    rows = [n for n, name in enumerate(table["quantity"]) if str(name).startswith(kind)]
    names = []
    panel.axvline(1, color=hues.soft, lw=1.0)
    for place, n in enumerate(rows):
        _, name, unit = str(table["quantity"][n]).split("_")
        names.append(style.component_label(name))
        before, after, drawn = (float(table[key][n]) for key in ("before", "after", "simulated"))
        ratio = after / before if before else np.nan
        if np.isfinite(ratio):
            panel.plot([1, ratio], [place, place], color=hues.axes[name], lw=1.4,
                       solid_capstyle="butt", zorder=2)  # fmt: skip
            panel.plot(1, place, "o", color=hues.axes[name], ms=6, mfc=hues.ground, zorder=3)
            panel.plot(ratio, place, "o", color=hues.axes[name], ms=6.5, zorder=3)
        else:
            panel.annotate("no number", (0.03, place), xycoords=("axes fraction", "data"),
                           va="center", color=hues.soft, fontsize=style.LEAST)  # fmt: skip
        if np.isfinite(drawn) and before:
            panel.plot(drawn / before, place, "|", color=hues.ink, ms=11, mew=1.4)
        text = f"{write_number(before)} → {write_number(after)} {write_micro(unit)}"
        panel.annotate(text, (1.0, place), (6, 0), xycoords=("axes fraction", "data"),
                       textcoords="offset points", va="center", fontsize=style.LEAST)  # fmt: skip
    style.name_lanes(panel, range(len(rows)), names, len(rows))
    panel.set(title=title, xscale="log")
    low, high = panel.get_xlim()
    panel.set_xlim(min(low, 0.8) / 1.06, max(high, 1.25) * 1.06)
    style.plain_log(panel.xaxis)


def write_number(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "none"
