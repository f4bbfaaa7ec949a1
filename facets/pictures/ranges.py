"""Pictures of measurement ranges and of what is inside them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..characterization.ranges import CAUSES, Boundary
from ..characterization.resolution import Resolution
from ..core.names import POSE
from ..core.units import Floats
from . import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#: By cause, in the order of `ranges.CAUSES`.
COLOURS = (style.BLUE, style.ORANGE, style.INK, style.GREEN)


def ranges_picture(boundaries: Sequence[Boundary], inside: Sequence[Any] = ()) -> Figure:
    """Outlines coloured by cause, a panel each.

    inside: for each, (x, y, values, label) of what is drawn within, mm or rad; or nothing at all.
    """
    from matplotlib.lines import Line2D

    columns = min(len(boundaries), 3 if len(boundaries) < 10 else 5)
    rows = -(-len(boundaries) // columns)
    with style.in_rules():
        picture = style.figure(3.4 * columns, 3.1 * rows + 0.3)
        panels = picture.subplots(rows, columns, squeeze=False)
        for panel in panels.ravel()[len(boundaries) :]:
            panel.set_visible(False)
        for number, boundary in enumerate(boundaries):
            panel = panels.ravel()[number]
            if inside:
                values(picture, panel, boundary, *inside[number])
            outline(panel, boundary, filled=not inside)
        seen = sorted({int(cause) for b in boundaries for cause in b.causes if cause >= 0})
        lines = [Line2D([], [], color=COLOURS[cause], lw=2) for cause in seen]
        picture.legend(
            lines, [CAUSES[cause] for cause in seen], loc="outside lower center", ncols=len(seen)
        )
    return picture


def outline(panel: Axes, boundary: Boundary, filled: bool) -> None:
    """The range: filled, its rim coloured by what ends it there."""
    from matplotlib.collections import LineCollection

    factors = np.array([style.unit_of(name)[1] for name in boundary.axes])
    points = boundary.points * factors
    closed = np.concatenate([points, points[:1]])
    segments = np.stack([closed[:-1], closed[1:]], axis=1)
    colours = [COLOURS[cause] if cause >= 0 else style.GREY for cause in boundary.causes]
    if filled:
        panel.fill(*points.T, color=style.GREY, alpha=0.18, lw=0)
    panel.add_collection(LineCollection(list(segments), colors=colours, linewidths=1.8))
    panel.plot(0, 0, "+", color=style.INK, ms=6)
    panel.autoscale_view()
    labels = [f"{name}, {style.unit_of(name)[0]}" for name in boundary.axes]
    panel.set(xlabel=labels[0], ylabel=labels[1])
    if set(boundary.axes) == {"tx", "ty"}:
        panel.set_aspect("equal", adjustable="box")


def values(
    picture: Figure, panel: Axes, boundary: Boundary, x: Floats, y: Floats, z: Floats, label: str
) -> None:
    """A map of values inside the range; NaN outside."""
    factors = [style.unit_of(name)[1] for name in boundary.axes]
    image = panel.pcolormesh(factors[0] * x, factors[1] * y, z, cmap="viridis", rasterized=True)
    picture.colorbar(image, ax=panel, label=label)


def budget_picture(found: Sequence[Resolution]) -> Figure:
    """For each estimator, what part of each axis's variance at rest comes from which source."""
    with style.in_rules(axes__grid=False):
        picture = style.figure(3.1 * len(found), 3.2)
        panels = picture.subplots(1, len(found), sharey=True, squeeze=False)[0]
        for panel, row in zip(panels, found, strict=True):
            bottom = np.zeros(len(POSE))
            for number, source in enumerate(row.sources):
                share = 100 * row.shares[:, number]
                panel.bar(
                    POSE, share, bottom=bottom, color=style.SERIES[number], width=0.7, label=source
                )
                bottom += share
            for place, (name, value) in enumerate(zip(POSE, row.nominal, strict=True)):
                _, _, unit, factor = style.unit_of(name)
                text = f"{factor * value:.3g}\n{unit}"
                panel.annotate(text, (place, 101), ha="center", va="bottom", fontsize=7)
            panel.set(title=row.how.name, ylim=(0, 118), yticks=(0, 25, 50, 75, 100))
            panel.title.set_fontsize(9)
        panels[0].set_ylabel("share of the variance at rest, %")
        handles, names = panels[0].get_legend_handles_labels()
        picture.legend(handles, names, loc="outside lower center", ncols=len(names))
    return picture
