"""Pictures of measurement ranges and of values inside them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ...characterization.outlines import Boundary
from ...characterization.ranges import CAUSES
from ...core.hues import chosen_hues
from ...core.units import Floats, Integers
from .. import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Dashes by cause, in the order of `ranges.CAUSES`.
DASHES = (
    "-", (0, (5, 1.5)), (0, (3, 1, 1, 1, 1, 1)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)),
)  # fmt: skip
#: Relative difference up to which the values inside a range are written as one number.
SAME_RATIO = 5e-3
#: Height of a panel in its widths, by the number of panels in a row.
PANEL_HEIGHTS = {1: 0.8, 2: 0.85, 3: 0.92}


def ranges_picture(
    boundaries: Sequence[Boundary],
    inside: Sequence[tuple[Floats, Floats, Floats]] = (),
    what: str = "",
) -> Figure:
    """Draw outlines coloured by cause, one in each panel.

    inside: for each outline, the map (x, y, values) within, see `map_inside`; or none.  what:
    quantity of the maps.
    """
    columns = min(len(boundaries), 3)
    rows = -(-len(boundaries) // columns)
    width = style.SINGLE if columns == 1 else style.FULL
    with style.style_context():
        picture = style.figure(width, width / columns * PANEL_HEIGHTS[columns] * rows + 0.5)
        panels = picture.subplots(rows, columns, squeeze=False).ravel()
        for panel in panels[len(boundaries) :]:
            panel.set_visible(False)
        for panel, boundary in zip(panels, boundaries, strict=False):
            outline(panel, boundary)
        if inside:
            map_values(picture, panels[: len(boundaries)], boundaries, inside, what)
        for cause in sorted({int(cause) for b in boundaries for cause in b.causes}):
            words = CAUSES[cause] if cause >= 0 else "end of the box"
            panels[0].plot([], [], label=words, **line_of(cause))
        style.panels_legend(picture, panels[:1], 3 if columns > 1 else 2)
    return picture


def line_of(cause: int) -> dict[str, Any]:
    """Return the colour and dashes of a range's end by its cause, -1 for no limit."""
    hues = chosen_hues()
    if cause < 0:
        return {"color": hues.grey, "ls": "-", "lw": 1.8}
    series = (hues.ink, *hues.series)
    return {"color": series[cause % len(series)], "ls": DASHES[cause % len(DASHES)], "lw": 1.8}


def outline(panel: Axes, boundary: Boundary) -> None:
    """Draw a range, filled, with its rim by cause and a cross at rest."""
    factors = np.array([style.unit_of(name).factor for name in boundary.axes])
    points = boundary.points * factors
    hues = chosen_hues()
    if len(points):
        panel.fill(*points.T, color=hues.rule, alpha=0.6, lw=0)
    for cause, line in runs(points, boundary.causes):
        panel.plot(*line.T, **line_of(cause), solid_capstyle="butt", dash_capstyle="butt")
    for colour, size, width in ((hues.ground, 8, 3.0), (hues.ink, 6, 1.0)):
        panel.plot(0, 0, "+", color=colour, ms=size, mew=width)
    if not len(points):
        style.say(panel, "no range")
    panel.autoscale_view()
    whose = "" if boundary.object is None else "object: "
    labels = [whose + style.place_label(name) for name in boundary.axes]
    panel.set(xlabel=labels[0], ylabel=labels[1])
    panel.locator_params(axis="y", nbins=5)
    panel.locator_params(axis="x", nbins=4)
    if set(boundary.axes) == {"tx", "ty"}:
        panel.set_aspect("equal", adjustable="datalim")


def runs(points: Floats, causes: Integers) -> Iterator[tuple[int, Floats]]:
    """Yield pieces of the closed rim with one cause each: (cause, points)."""
    if not len(points):
        return
    closed = np.concatenate([points, points[:1]])
    breaks = [0, *(np.flatnonzero(np.diff(causes)) + 1).tolist(), len(points)]
    for start, end in pairwise(breaks):
        yield int(causes[start]), closed[start : end + 1]


def map_values(
    picture: Figure,
    panels: Any,
    boundaries: Sequence[Boundary],
    inside: Sequence[tuple[Floats, Floats, Floats]],
    what: str,
) -> None:
    """Draw maps of a quantity inside the ranges on one scale of colours.

    Where the quantity is the same everywhere, its value is written instead.
    """
    label, words = "log10 of the condition", "condition\nis $10^{{{:.3g}}}$\n\neverywhere\n"
    if what != "condition":
        unit = style.unit_of(what).fine_unit
        label, words = f"u({what}), {unit}", f"u({what})\nis {{:.3g}} {unit}\n\neverywhere\n"
    low, high = (
        np.array([end.reduce(values, axis=None) for *_, values in inside])
        for end in (np.fmin, np.fmax)
    )
    differs = high > (1 + SAME_RATIO) * low
    image = None
    for n, (panel, boundary, (x, y, values)) in enumerate(
        zip(panels, boundaries, inside, strict=True)
    ):
        if differs[n]:
            factors = [style.unit_of(axis).factor for axis in boundary.axes]
            image = panel.pcolormesh(
                factors[0] * x, factors[1] * y, values, cmap=style.ramp(), rasterized=True,
                vmin=low[differs].min(), vmax=high[differs].max(),
            )  # fmt: skip
            panel.grid(visible=False)
        else:
            panel.text(0, 0, words.format(low[n]), ha="center", va="center", fontsize=style.LEAST)
    if image is not None:
        rows = panels[0].get_gridspec().nrows
        style.colour_bar(picture, image, panels, label, aspect=25 * rows)
