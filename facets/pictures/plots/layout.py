"""A picture of a layout's uncertainties and ranges, before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.hues import chosen_hues
from ...core.names import POSE
from ...core.units import write_micro
from .. import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def layout_picture(table: dict[str, NDArray[Any]]) -> Figure:
    """Draw the comparison of `verification.compare`: each axis after over before, and both numbers.

    A step to the left is finer, or a shorter range; the line at 1 is the value before.
    """
    with style.style_context():
        picture = style.figure(style.FULL, 4.9)
        fine, far = picture.subplots(2, 1)
        steps(fine, table, "u_", "worst standard uncertainty over the volume")
        steps(far, table, "range_", "symmetric range, twice its nearer end")
        far.set_xlabel("after over before")
        legend(picture, bool(np.isfinite(table["simulated"]).any()))
    return picture


def steps(panel: Axes, table: dict[str, NDArray[Any]], kind: str, title: str) -> None:
    """Draw the steps from before to after of six axes, relative to before, and their numbers."""
    hues = chosen_hues()
    rows = [n for n, name in enumerate(table["quantity"]) if str(name).startswith(kind)]
    names = [axis_of(str(table["quantity"][n])) for n in rows]
    panel.axvline(1, color=hues.soft, lw=1.0)
    for place, (n, name) in enumerate(zip(rows, names, strict=True)):
        before, after, drawn = (float(table[key][n]) for key in ("before", "after", "simulated"))
        unit = write_micro(str(table["quantity"][n]).rpartition("_")[2])
        step(panel, place, after / before if before else np.nan, hues.axes[name])
        if np.isfinite(drawn) and before:
            panel.plot(drawn / before, place, "|", color=hues.ink, ms=11, mew=1.4)
        panel.annotate(f"{number(before)} → {number(after)} {unit}", (1.0, place), (6, 0),
                       xycoords=("axes fraction", "data"), textcoords="offset points",
                       va="center", fontsize=style.LEAST)  # fmt: skip
    panel.set_yticks(range(len(rows)), [style.component_label(name) for name in names])
    panel.set(ylim=(len(rows) - 0.5, -0.5))
    panel.set_title(title)
    scale(panel)


def step(panel: Axes, place: int, share: float, hue: str) -> None:
    """Draw a step from 1 to the value after."""
    hues = chosen_hues()
    if not np.isfinite(share):
        panel.annotate("no number", (0.03, place), xycoords=("axes fraction", "data"),
                       va="center", color=hues.soft, fontsize=style.LEAST)  # fmt: skip
        return
    panel.plot([1, share], [place, place], color=hue, lw=2.4, solid_capstyle="butt", zorder=2)
    panel.plot(share, place, "o", color=hue, ms=6.5, zorder=3)


def legend(picture: Figure, simulated: bool) -> None:
    """Draw a legend whose marks have no axis's hue, since they apply to all axes."""
    from matplotlib.lines import Line2D

    ink = chosen_hues().ink
    handles = [Line2D([], [], color=ink, marker="|", ls="", ms=11, mew=1.0),
               Line2D([], [], color=ink, marker="o", ls="", ms=6.5)]  # fmt: skip
    texts = ["before", "after"]
    if simulated:
        handles.append(Line2D([], [], color=ink, marker="|", ls="", ms=11, mew=1.8))
        texts.append("after, spread of simulated solves")
    style.legend_below(picture, handles, texts, 3)


def scale(panel: Axes) -> None:
    """Set a logarithmic scale, on which half and twice are equally far."""
    panel.set_xscale("log")
    low, high = panel.get_xlim()
    panel.set_xlim(min(low, 0.8) / 1.06, max(high, 1.25) * 1.06)
    style.plain_log(panel.xaxis)
    panel.grid(visible=False, axis="y")
    panel.tick_params(axis="y", length=0)


def axis_of(quantity: str) -> str:
    """Return the axis of a quantity: "roll" for "u_roll_urad"."""
    return next(name for name in POSE if name in quantity.split("_"))


def number(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "none"
