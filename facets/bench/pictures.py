"""The pictures of `facets bench`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.hues import chosen_hues
from ..pictures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Row = dict[str, Any]
#: Size of a panel, points; and least distances of two numbers, across and up.
SIZE, NEAR = np.array([205.0, 165.0]), (13.0, 11.0)


def work_precision(forward: Sequence[Row], inverse: Sequence[Row]) -> Figure:
    """Draw time per pose against error, readings above and poses below."""
    with style.style_context():
        picture = style.figure(style.FULL, 6.6)
        upper, lower = picture.subplots(2, 1)
        diagram(upper, forward, "place_error_mm")
        diagram(lower, inverse, "length_error_mm")
        upper.set(title="readings", ylabel="error of a place, mm")
        lower.set(title="poses from readings", ylabel="error of a length, mm")
    return picture


def diagram(axes: Axes, rows: Sequence[Row], error: str) -> None:
    """Draw a number beside each mark, and its meaning to the right."""
    hues = chosen_hues()
    shown = [row for row in rows if np.isfinite(row[error])]
    shown.sort(key=lambda row: row["us_per_pose"])
    if not shown:
        style.say(axes, "no contender gave a number")
    for number, row in enumerate(shown, start=1):
        ours = row["way"].startswith("facets")
        colour, mark = (hues.accent, "o") if ours else (hues.series[1], "s")
        time, value = row["us_per_pose"], row[error]
        spread = [[time - row["low_us"]], [row["high_us"] - time]]
        axes.errorbar(time, value, xerr=spread, fmt=mark, ms=6, color=colour, elinewidth=1.0,
                      label=f"{number}  {row['way']}")  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="time a pose, µs")
    axes.margins(0.08, 0.25)
    if shown:
        numbers(axes, [(row["us_per_pose"], row[error]) for row in shown])
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.03), handlelength=0.9,
                    borderaxespad=0.3)  # fmt: skip


def numbers(axes: Axes, places: Sequence[tuple[float, float]]) -> None:
    """Write a number above each mark; one that would overlap goes higher, on a thin line."""
    hues = chosen_hues()
    axes.autoscale_view()
    ends = np.log10([axes.get_xlim(), axes.get_ylim()])
    share = (np.log10(places) - ends[:, 0]) / (ends[:, 1] - ends[:, 0])
    taken: list[tuple[float, float]] = []
    for number, ((x, y), place) in enumerate(zip(share * SIZE, places, strict=True), start=1):
        up = 8.0
        while any(abs(x - a) < NEAR[0] and abs(y + up - b) < NEAR[1] for a, b in taken):
            up += 2.0
        taken.append((x, y + up))
        line = {"arrowstyle": "-", "lw": 0.6, "color": hues.grey, "shrinkA": 0, "shrinkB": 0}
        ground = {"boxstyle": "round,pad=0.05", "fc": axes.get_facecolor(), "ec": "none"}
        # the higher ones first, so that a lower number hides the line that passes under it
        axes.annotate(str(number), place, (0, up), textcoords="offset points", ha="center",
                      va="center", fontsize=style.LEAST, fontweight="bold", bbox=ground,
                      zorder=4 - 0.01 * number, arrowprops=line if up > 8 else None)  # fmt: skip


def heat_map(rows: Sequence[Row]) -> Figure:
    """Draw the digits of power and position over apex offset and tilt."""
    offsets = sorted({row["offset_sigma"] for row in rows})
    tilts = sorted({row["tilt_mrad"] for row in rows})
    with style.style_context(axes__grid=False):
        picture = style.figure(style.FULL, 3.2)
        panels = picture.subplots(1, 2, sharey=True)
        for axes, key, title in zip(
            panels, ("power_error", "place_error_mm"),
            ("relative error of a power", "error of a place, mm"), strict=True,
        ):  # fmt: skip
            values = {(r["tilt_mrad"], r["offset_sigma"]): r[key] for r in rows}
            grid = np.array([[values[tilt, offset] for offset in offsets] for tilt in tilts])
            image = axes.imshow(
                np.log10(np.maximum(grid, 1e-17)),
                origin="lower", aspect="auto", cmap="viridis", vmin=-17, vmax=-11,
            )  # fmt: skip
            some = slice(None, None, max(1, -(-len(offsets) // 6)))
            axes.set_xticks(range(len(offsets))[some], [f"{x:g}" for x in offsets[some]])
            axes.set_yticks(range(len(tilts)), [f"{tilt:g}" for tilt in tilts])
            axes.set(xlabel="apex offset, sigmas of the beam", title=title)
        panels[0].set_ylabel("tilt, mrad")
        bar = picture.colorbar(image, ax=panels, pad=0.02, aspect=28, extend="both")
        bar.set_label("error, power of ten")
        bar.outline.set_visible(False)
    return picture
