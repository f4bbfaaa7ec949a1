"""A picture of standard uncertainties by axis and way of solving, and their main sources."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...characterization.resolution import Resolution
from ...core.hues import chosen_hues
from ...core.names import POSE
from ...core.units import unit_of
from .. import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Marks of sources, in their order; seven beside five hues, so that no two look alike.
MARKS = ("o", "D", "s", "^", "v", "P", "X")
#: The least share of the variance for which another source is named.
NAMED_SHARE = 0.01


def budget_picture(resolutions: Sequence[Resolution]) -> Figure:
    """Draw uncertainties at rest and at worst, on a logarithmic scale, shifts left, angles right.

    Each way of solving has a lane; the mark at rest denotes the source of most of the variance.
    """
    lanes = len(resolutions) + 1
    ways = [resolution.how.name for resolution in resolutions]
    with style.style_context():
        picture = style.figure(style.FULL, 0.19 * 3 * lanes + 1.15)
        panels = picture.subplots(1, 2)
        for panel, names in zip(panels, (POSE[:3], POSE[3:]), strict=True):
            for row, name in enumerate(names):
                heading(panel, row * lanes, style.component_label(name))
                for k, resolution in enumerate(resolutions):
                    draw_lane(panel, row * lanes + k + 1, resolution, name)
            places = [place for place in range(3 * lanes) if place % lanes]
            style.name_lanes(panel, places, 3 * ways, 3 * lanes)
            unit = unit_of(names[0]).fine_unit
            panel.set(xscale="log", xlabel=f"standard uncertainty, {unit}")
            low, high = panel.get_xlim()
            span = high / low
            panel.set_xlim(low / span**0.02, high * span**0.22)
            style.plain_log(panel.xaxis)
            panel.spines["left"].set_visible(False)
        panels[1].tick_params(labelleft=False)
        draw_legend(picture, panels[0], resolutions)
    return picture


def heading(panel: Axes, place: float, text: str) -> None:
    """Name the axis of the lanes below."""
    panel.annotate(text, (0, place), (3, 0), xycoords=("axes fraction", "data"), va="center",
                   textcoords="offset points", fontsize=style.LEAST, fontweight="bold")  # fmt: skip
    panel.axhspan(place - 0.5, place + 0.5, color=chosen_hues().rule, alpha=0.5, lw=0)


def draw_lane(panel: Axes, place: float, resolution: Resolution, name: str) -> None:
    """Draw a lane from the uncertainty at rest to the worst in the axis's range."""
    from matplotlib.transforms import ScaledTranslation

    hues, i = chosen_hues(), POSE.index(name)
    factor = unit_of(name).fine_factor
    rest, worst = factor * resolution.nominal[i], factor * resolution.worst[i]
    panel.plot([rest, worst], [place, place], color=hues.grey, lw=1.0, zorder=1)
    panel.plot(worst, place, "|", color=hues.ink, ms=8, mew=1.4)
    order = np.argsort(-resolution.shares[i])
    panel.plot(rest, place, ms=5.5, **look(int(order[0])))
    if len(order) > 1 and resolution.shares[i][order[1]] >= NAMED_SHARE:
        beside = panel.transData + ScaledTranslation(9 / 72, 0, panel.figure.dpi_scale_trans)
        panel.plot(worst, place, ms=4, transform=beside, **look(int(order[1])))
        text = f"{100 * resolution.shares[i][order[1]]:.0f} %"
        panel.annotate(text, (worst, place), (14, 0), textcoords="offset points", va="center",
                       fontsize=style.LEAST)  # fmt: skip


def look(source: int) -> dict[str, Any]:
    """The mark of a source."""
    series = chosen_hues().series
    return {"color": series[source % len(series)], "marker": MARKS[source % len(MARKS)], "ls": ""}


def draw_legend(picture: Figure, panel: Axes, resolutions: Sequence[Resolution]) -> None:
    sources = dict.fromkeys(source for each in resolutions for source in each.sources)
    for n, source in enumerate(sources):
        panel.plot([], [], label=source, **look(n))
    panel.plot([], [], "|", color=chosen_hues().ink, ms=8, mew=1.4,
               label="at worst in the axis's range")  # fmt: skip
    made = style.panels_legend(picture, [panel], 4)
    whose = "" if resolutions[0].object is None else "displacement of the object\n"
    made.set_title(f"{whose}at rest, marked by the source of most of the variance; "
                   "in %: the share of a second", {"size": style.LEAST})  # fmt: skip
