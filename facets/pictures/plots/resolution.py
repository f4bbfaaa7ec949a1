"""A picture of standard uncertainties by axis and way of solving, and their main sources."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ...characterization.resolution import Resolution
from ...core.hues import chosen_hues
from ...core.names import POSE
from ...core.units import unit_of
from .. import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def budget_picture(resolutions: Sequence[Resolution]) -> Figure:
    """Draw uncertainties at rest and at worst, and the fractions of the variance at rest.

    Shifts are on the left, angles on the right; each way of solving has a lane.
    """
    lanes = len(resolutions) + 1
    ways = [resolution.how.name for resolution in resolutions]
    with style.style_context():
        picture = style.figure(style.FULL, 0.19 * 3 * lanes + 1.15)
        panels = picture.subplots(1, 4, width_ratios=(4, 1, 4, 1), sharey=True)
        for values, shares, names in zip(
            panels[::2], panels[1::2], (POSE[:3], POSE[3:]), strict=True
        ):
            for row, name in enumerate(names):
                heading(values, row * lanes, style.component_label(name))
                heading(shares, row * lanes, "")
                for k, resolution in enumerate(resolutions):
                    draw_range(values, row * lanes + k + 1, resolution, name)
                    draw_shares(shares, row * lanes + k + 1, resolution, name)
            places = [place for place in range(3 * lanes) if place % lanes]
            style.name_lanes(values, places, 3 * ways, 3 * lanes)
            unit = unit_of(names[0]).fine_unit
            values.set(xscale="log", xlabel=f"uncertainty, {unit}")
            style.plain_log(values.xaxis)
            shares.set(xlim=(0, 100), xticks=(0, 100), xlabel="part, %")
        for panel in panels:
            panel.spines["left"].set_visible(False)
            panel.tick_params(left=False, labelleft=panel is panels[0])
        legend = style.panels_legend(picture, panels, 4)
        whose = "" if resolutions[0].object is None else "displacement of the object: "
        legend.set_title(f"{whose}standard uncertainties, and fractions of the variance at rest",
                         {"size": style.LEAST})  # fmt: skip
    return picture


def heading(panel: Axes, place: float, text: str) -> None:
    """Draw the heading of the lanes below."""
    panel.annotate(text, (0, place), (3, 0), xycoords=("axes fraction", "data"), va="center",
                   textcoords="offset points", fontsize=style.LEAST, fontweight="bold")  # fmt: skip
    panel.axhspan(place - 0.5, place + 0.5, color=chosen_hues().rule, alpha=0.5, lw=0)


def draw_range(panel: Axes, place: float, resolution: Resolution, name: str) -> None:
    """Draw a line from the uncertainty at rest to the largest in the axis's range."""
    hues, i = chosen_hues(), POSE.index(name)
    factor = unit_of(name).fine_factor
    rest, worst = factor * resolution.nominal[i], factor * resolution.worst[i]
    panel.plot([rest, worst], [place, place], color=hues.grey, lw=1.0, zorder=1)
    panel.plot(rest, place, "o", color=hues.ink, ms=5, label="at rest")
    panel.plot(worst, place, "|", color=hues.ink, ms=8, mew=1.4,
               label="at worst in the axis's range")  # fmt: skip


def draw_shares(panel: Axes, place: float, resolution: Resolution, name: str) -> None:
    """Stack the fractions of the variance at rest, with one colour for each source."""
    start = 0.0
    for n, percent in enumerate(100 * resolution.shares[POSE.index(name)]):
        panel.barh(place, percent, 0.6, start, label=resolution.sources[n], **bar_style(n))
        start += percent


def bar_style(source: int) -> dict[str, Any]:
    """Return the style of a source's bar, which is hatched once the colours are used up."""
    hues = chosen_hues()
    cycle, n = divmod(source, len(hues.series))
    return {"color": hues.series[n], "hatch": cycle * "////", "edgecolor": hues.ground, "lw": 0}
