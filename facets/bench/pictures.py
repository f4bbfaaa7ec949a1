"""The pictures of `facets bench`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..pictures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Row = dict[str, Any]


def work_precision(forward: Sequence[Row], inverse: Sequence[Row]) -> Figure:
    """Time a pose against error, readings left and poses right; nearer the corner is better."""
    with style.in_rules():
        picture = style.figure(11, 5)
        left, right = picture.subplots(1, 2)
        diagram(left, forward, "place_error_mm")
        diagram(right, inverse, "length_error_mm")
        left.set(title="readings", ylabel="largest error of a spot's place, mm")
        right.set(title="poses from readings", ylabel="largest error of a length, mm")
    return picture


def diagram(axes: Axes, rows: Sequence[Row], error: str) -> None:
    shown = [row for row in rows if np.isfinite(row[error])]
    shown.sort(key=lambda row: row["us_per_pose"])
    for number, row in enumerate(shown, start=1):
        ours = row["way"].startswith("facets")
        colour = style.BLUE if ours else style.ORANGE
        time, value = row["us_per_pose"], row[error]
        spread = [[time - row["low_us"]], [row["high_us"] - time]]
        label = f"{number}  {row['way']}"
        axes.errorbar(time, value, xerr=spread, fmt="o" if ours else "s", color=colour, label=label)
        side = (6, 4 if number % 2 else -11)
        axes.annotate(str(number), (time, value), side, textcoords="offset points", fontsize=8)
    axes.set(xscale="log", yscale="log", xlabel="time a pose, µs")
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(0, -0.14), ncols=2)


def heat_map(rows: Sequence[Row]) -> Figure:
    """Digits of power and place over apex offset and tilt."""
    offsets = sorted({row["offset_sigma"] for row in rows})
    tilts = sorted({row["tilt_mrad"] for row in rows})
    with style.in_rules(axes__grid=False):
        picture = style.figure(10, 3.2)
        left, right = picture.subplots(1, 2)
        for axes, key, title in (
            (left, "power_error", "relative error of a power"),
            (right, "place_error_mm", "error of a spot's place, mm"),
        ):
            values = {(r["tilt_mrad"], r["offset_sigma"]): r[key] for r in rows}
            grid = np.array([[values[tilt, offset] for offset in offsets] for tilt in tilts])
            image = axes.imshow(
                np.log10(np.maximum(grid, 1e-17)),
                origin="lower", aspect="auto", cmap="viridis", vmin=-17, vmax=-11,
            )  # fmt: skip
            axes.set_xticks(range(len(offsets)), [f"{offset:g}" for offset in offsets], fontsize=7)
            axes.set_yticks(range(len(tilts)), [f"{tilt:g}" for tilt in tilts])
            axes.set(xlabel="apex offset, sigmas of the beam", ylabel="tilt, mrad", title=title)
            picture.colorbar(image, ax=axes, label="log10")
    return picture


def histograms(digits: Sequence[Row], steps: Sequence[Row]) -> Figure:
    """Digits lost by powers and places, and steps from zero to a pose."""
    with style.in_rules():
        picture = style.figure(10, 3.4)
        left, right = picture.subplots(1, 2)
        bars(left, digits, "digits_lost", ("powers", "places"), 0.25)
        left.set(xlabel="digits lost (0: the last bit)", ylabel="numbers", title="readings")
        bars(right, steps, "steps", ("exact", "noisy"), 1.0)
        right.set(xlabel="steps from zero", ylabel="poses", title="poses from readings")
    return picture


def bars(axes: Axes, rows: Sequence[Row], key: str, series: Sequence[str], width: float) -> None:
    places = np.array([row[key] for row in rows])
    for name, side, colour in zip(series, (0.25, 0.75), (style.BLUE, style.ORANGE), strict=True):
        heights = [row[name] for row in rows]
        axes.bar(places + side * width, heights, 0.45 * width, color=colour, label=name)
    axes.legend()
