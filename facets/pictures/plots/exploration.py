"""Pictures of a design space's Pareto front, and of its sensitivity indices."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...characterization.sensitivity import Index
from ...core.hues import chosen_hues
from ...core.units import Booleans
from .. import style
from ..reports.wording import label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Table = dict[str, NDArray[Any]]
#: Marks of objectives, in their order, and inches of a lane of a variable.
MARKS, LANE = ("o", "D", "s", "^", "v"), 0.3
#: Number of designs above which each is drawn as a dot only.
MANY = 400


def front_picture(
    table: Table,
    best: Booleans,
    objectives: list[str],
    indices: dict[str, dict[str, Index]],
    present: dict[str, float] | None = None,
) -> Figure | None:
    """Draw objectives against one another with the front; below, first-order Sobol indices.

    A third objective is shown by colour. Designs that lack an objective are excluded. Returns None
    if there is nothing to draw: fewer than two complete designs, or one objective and no indices.

    present: measures of the present design, which is marked as well.
    """
    is_complete = np.all([np.isfinite(table[name]) for name in objectives], axis=0)
    views = [tuple(objectives)] if len(objectives) == 3 else list(pairwise(objectives))
    if is_complete.sum() < 2 or not (views or indices):
        return None
    others, front = (
        {name: table[name][rows] for name in objectives}
        for rows in (is_complete & ~best, is_complete & best)
    )
    variables = len(next(iter(indices.values()))) if indices else 0
    heights = [3.3 * -(-len(views) // 2)] * bool(views) + [LANE * variables + 1.0] * bool(indices)
    with style.style_context():
        picture = style.figure(style.FULL if len(views) != 1 or indices else 5.0, sum(heights))
        made: Any = picture.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)
        if views:
            draw_views(made[0, 0], views, others, front, present)
        if indices:
            draw_indices(made[-1, 0].subplots(), indices)
    return picture


def draw_views(
    part: Any, views: Sequence[tuple[str, ...]], others: Table, front: Table,
    present: dict[str, float] | None,
) -> None:  # fmt: skip
    """Draw a panel for each view, in two columns."""
    panels = part.subplots(-(-len(views) // 2), min(len(views), 2), squeeze=False).ravel()
    for panel, view in zip(panels, views, strict=False):
        draw_designs(part, panel, view, others, front, present)
    for panel in panels[len(views) :]:
        panel.set_axis_off()
    style.panels_legend(part, panels[:1], 3)


def draw_designs(
    part: Any, panel: Axes, view: tuple[str, ...], others: Table | None, front: Table,
    present: dict[str, float] | None, is_line: bool = False,
) -> None:  # fmt: skip
    """Draw the front large over other designs, and the present design as a star.

    view: the objectives along x and y and, if there are three, the one shown by colour.
    """
    hues, (x, y, *hue) = chosen_hues(), view
    options: dict[str, Any] = {"color": hues.grey}
    if hue:
        values = np.concatenate([table[hue[0]] for table in (others, front) if table is not None])
        options = {"cmap": style.ramp(), "vmin": np.nanmin(values), "vmax": np.nanmax(values)}
    if others is not None:
        size = 6 if len(others[x]) > MANY else 13
        colours: dict[str, Any] = {"c": others[hue[0]], "alpha": 0.75} if hue else {}
        panel.scatter(others[x], others[y], size, lw=0, rasterized=True, label="other designs",
                      **options, **colours)  # fmt: skip
    if hue:
        image = panel.scatter(front[x], front[y], 34, c=front[hue[0]], lw=1.1, ec=hues.ink,
                              label="beaten by none", **options)  # fmt: skip
        style.colour_bar(part, image, panel, label(hue[0]), aspect=28)
    else:
        panel.plot(front[x], front[y], "o-" if is_line else "o", ms=5, color=hues.accent,
                   label="beaten by none")  # fmt: skip
    if present is not None and np.isfinite([present[x], present[y]]).all():
        panel.plot(present[x], present[y], "*", ms=13, color=hues.series[1], mec=hues.ground,
                   mew=0.8, ls="", label="as it is")  # fmt: skip
    panel.set(xlabel=label(x), ylabel=label(y))


def draw_indices(panel: Axes, indices: dict[str, dict[str, Index]]) -> None:
    """Draw indices by variable with their intervals; each objective has a colour and a mark."""
    hues = chosen_hues()
    variables = list(next(iter(indices.values())))
    step = 0.7 / len(indices)
    for n, (objective, by_variable) in enumerate(indices.items()):
        places = np.arange(len(variables)) + (n - (len(indices) - 1) / 2) * step
        panel.errorbar(
            [by_variable[name].value for name in variables], places,
            xerr=[by_variable[name].half for name in variables], fmt=MARKS[n % len(MARKS)], ms=4.5,
            color=hues.series[n % len(hues.series)], elinewidth=1.2,
            label=label(objective).partition(", ")[0],
        )  # fmt: skip
    for n in range(1, len(variables)):
        panel.axhline(n - 0.5, color=hues.rule, lw=0.7)
    panel.axvline(0, color=hues.soft, lw=0.8)
    names = [label(name) for name in variables]
    style.name_lanes(panel, range(len(names)), names, len(names))
    panel.set_xlabel("first-order Sobol index, with its 95 % interval")
    style.panels_legend(panel.figure, [panel], min(len(indices), 3))


def pareto_picture(
    table: Table, objectives: list[str], cloud: Table | None, present: dict[str, float]
) -> Figure:
    """Draw the front's objectives against one another, and the prices in the first one below.

    cloud: other designs, if any.  present: the present design.
    """
    has_line = len(objectives) == 2
    with style.style_context():
        picture = style.figure(style.FULL, 5.9 + 0.4 * (not has_line))
        parts: Any = picture.subfigures(2, 1, height_ratios=(1.75, 1))
        upper, lower = parts
        panel = upper.subplots()
        draw_designs(upper, panel, tuple(objectives), cloud, table, present, has_line)
        style.panels_legend(upper, [panel], 3)
        panels = lower.subplots(1, len(objectives) - 1, squeeze=False)[0]
        for panel, other in zip(panels, objectives[1:], strict=True):
            draw_price(panel, table, objectives[0], other, has_line)
    return picture


def draw_price(panel: Axes, table: Table, first: str, other: str, is_line: bool) -> None:
    """Draw the price of another objective in the first one, except at the ends of the front."""
    prices = table[f"{first}_per_{other}"][1:-1]
    paid = np.where(prices > 1e-9, prices, np.nan)
    mark = "o-" if is_line else "o"
    panel.plot(table[other][1:-1], paid, mark, ms=4, color=chosen_hues().series[1])
    if np.isfinite(paid).any():
        panel.set_yscale("log")
        style.plain_log(panel.yaxis)
    else:
        style.say(panel, "no price is known between the ends of the front")
    units = [label(name).rpartition(", ")[2] for name in (first, other)]
    panel.set(xlabel=label(other), ylabel=f"price, {units[0]} for 1 {units[1]}")
    panel.set_title(f"{label(first).partition(', ')[0]}, its price")
