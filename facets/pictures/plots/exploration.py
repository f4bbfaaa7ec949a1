"""Pictures of a design space's Pareto front, and of its sensitivity indices."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...characterization.sensitivity import Index
from ...core.hues import chosen_hues
from ...core.units import Booleans, column_label
from .. import style

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
    """Draw objectives against one another with the front marked; below, first-order Sobol indices.

    A third objective is the hue. Designs without all objectives are left out.  present: measures of
    the present design, which is marked as well. Returns None if there is nothing to draw: fewer
    than two designs with all objectives, or one objective and no indices.
    """
    known = np.all([np.isfinite(table[name]) for name in objectives], axis=0)
    views = views_of(objectives)
    if known.sum() < 2 or not (views or indices):
        return None
    variables = len(next(iter(indices.values()))) if indices else 0
    heights = [3.3 * -(-len(views) // 2)] * bool(views) + [LANE * variables + 1.0] * bool(indices)
    with style.style_context():
        picture = style.figure(style.FULL if len(views) != 1 or indices else 5.0, sum(heights))
        made: Any = picture.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)
        parts = made.ravel()
        if views:
            designs(parts[0], table, views, known, best, present)
        if indices:
            effects(parts[-1].subplots(), indices)
    return picture


def views_of(objectives: list[str]) -> list[tuple[str, str, str]]:
    """List the panels as (x, y, hue), with hue "" for none."""
    if len(objectives) == 3:
        return [(objectives[0], objectives[1], objectives[2])]
    return [(first, second, "") for first, second in pairwise(objectives)]


def designs(
    part: Any, table: Table, views: list[tuple[str, str, str]], known: Booleans, best: Booleans,
    present: dict[str, float] | None,
) -> None:  # fmt: skip
    """Draw the designs of each panel, the front and the present design."""
    panels = part.subplots(-(-len(views) // 2), min(len(views), 2), squeeze=False).ravel()
    for panel, (x, y, hue) in zip(panels, views, strict=False):
        cloud(part, panel, table, (x, y, hue), known, best)
        if present is not None and np.isfinite([present[x], present[y]]).all():
            star(panel, present[x], present[y])
        panel.set(xlabel=style.measure_label(x), ylabel=style.measure_label(y))
    for panel in panels[len(views) :]:
        panel.set_axis_off()
    handles, texts = panels[0].get_legend_handles_labels()
    style.legend_below(part, handles, texts, 3)


def cloud(
    part: Any, panel: Axes, table: Table, view: tuple[str, str, str], known: Booleans,
    best: Booleans,
) -> None:  # fmt: skip
    """Draw all designs small, those on the front large and rimmed; hue is a third objective."""
    from matplotlib.colors import Normalize

    hues, (x, y, hue) = chosen_hues(), view
    beaten, first = known & ~best, known & best
    size = 6 if known.sum() > MANY else 13
    if not hue:
        panel.scatter(table[x][beaten], table[y][beaten], size, color=hues.grey, lw=0,
                      rasterized=True, label="other designs")  # fmt: skip
        panel.scatter(table[x][first], table[y][first], 26, color=hues.accent, lw=0,
                      label="beaten by none")  # fmt: skip
        return
    values = table[hue][known]
    options: dict[str, Any] = {"cmap": style.ramp(), "norm": Normalize(values.min(), values.max())}
    panel.scatter(table[x][beaten], table[y][beaten], size, c=table[hue][beaten], lw=0,
                  alpha=0.75, rasterized=True, label="other designs", **options)  # fmt: skip
    image = panel.scatter(table[x][first], table[y][first], 34, c=table[hue][first], lw=1.1,
                          ec=hues.ink, label="beaten by none", **options)  # fmt: skip
    bar = part.colorbar(image, ax=panel, label=style.measure_label(hue), pad=0.02, aspect=28)
    bar.outline.set_visible(False)


def star(panel: Axes, x: float, y: float) -> None:
    """Mark the present design."""
    hues = chosen_hues()
    panel.plot(x, y, "*", ms=13, color=hues.series[1], mec=hues.ground, mew=0.8, ls="",
               label="as it is")  # fmt: skip


def effects(panel: Axes, indices: dict[str, dict[str, Index]]) -> None:
    """Draw indices by variable, a hue and a mark for each objective, with their intervals."""
    hues = chosen_hues()
    variables = list(next(iter(indices.values())))
    step = 0.7 / len(indices)
    for n, (objective, by_variable) in enumerate(indices.items()):
        places = np.arange(len(variables)) + (n - (len(indices) - 1) / 2) * step
        panel.errorbar(
            [by_variable[name].value for name in variables], places,
            xerr=[by_variable[name].half for name in variables], fmt=MARKS[n % len(MARKS)], ms=4.5,
            color=hues.series[n % len(hues.series)], elinewidth=1.2,
            label=objective_words(objective),
        )  # fmt: skip
    for n in range(1, len(variables)):
        panel.axhline(n - 0.5, color=hues.rule, lw=0.7)
    panel.axvline(0, color=hues.soft, lw=0.8)
    panel.grid(visible=False, axis="y")
    panel.set(xlabel="first-order Sobol index, with its 95 % interval",
              ylim=(len(variables) - 0.5, -0.5))  # fmt: skip
    panel.set_yticks(np.arange(len(variables)), [column_label(name) for name in variables])
    panel.tick_params(axis="y", length=0)
    handles, texts = panel.get_legend_handles_labels()
    style.legend_below(panel.figure, handles, texts, min(len(texts), 3))


def objective_words(objective: str) -> str:
    return style.measure_label(objective).rpartition(", ")[0] or objective


def pareto_picture(
    table: Table, objectives: list[str], cloud: Table | None, present: dict[str, float]
) -> Figure:
    """Draw the front's objectives against one another and the first one's prices below, with a
    cloud of designs if there is one, and the present design."""
    others = [name for name in objectives if name != objectives[0]]
    with style.style_context():
        picture = style.figure(style.FULL, 5.9 + 0.4 * (len(objectives) > 2))
        parts: Any = picture.subfigures(2, 1, height_ratios=(1.75, 1))
        upper, lower = parts
        draw_front(upper, upper.subplots(), table, objectives, cloud, present)
        panels = lower.subplots(1, len(others), squeeze=False)[0]
        for panel, other in zip(panels, others, strict=True):
            price(panel, table, objectives[0], other, len(objectives) == 2)
    return picture


def draw_front(
    part: Any, panel: Axes, table: Table, objectives: list[str], cloud: Table | None,
    present: dict[str, float],
) -> None:  # fmt: skip
    hues = chosen_hues()
    x, y = objectives[:2]
    if cloud is not None:
        known = np.isfinite(cloud[x]) & np.isfinite(cloud[y])
        panel.scatter(cloud[x][known], cloud[y][known], 6, color=hues.grey, lw=0, rasterized=True,
                      label="designs drawn")  # fmt: skip
    if len(objectives) == 2:
        panel.plot(table[x], table[y], "o-", ms=5, color=hues.accent, label="front")
    else:
        image = panel.scatter(table[x], table[y], 34, c=table[objectives[2]], cmap=style.ramp(),
                              ec=hues.ink, lw=0.8, label="front")  # fmt: skip
        bar = part.colorbar(image, ax=panel, label=style.measure_label(objectives[2]), pad=0.02)
        bar.outline.set_visible(False)
    if np.isfinite([present[x], present[y]]).all():
        star(panel, present[x], present[y])
    panel.set(xlabel=style.measure_label(x), ylabel=style.measure_label(y))
    handles, texts = panel.get_legend_handles_labels()
    style.legend_below(part, handles, texts, 3)


def price(panel: Axes, table: Table, first: str, other: str, line: bool) -> None:
    """Draw the price of another objective in the first one; at its ends the front is upright."""
    hues = chosen_hues()
    prices = table[f"{first}_per_{other}"][1:-1]
    paid = np.where(prices > 1e-9, prices, np.nan)
    panel.plot(table[other][1:-1], paid, "o-" if line else "o", ms=4, color=hues.series[1])
    if np.isfinite(paid).any():
        panel.set_yscale("log")
        style.plain_log(panel.yaxis)
    else:
        style.say(panel, "no price is known between the ends of the front")
    units = [style.measure_label(name).rpartition(", ")[2] for name in (first, other)]
    panel.set(xlabel=style.measure_label(other), ylabel=f"price, {units[0]} for 1 {units[1]}")
    panel.set_title(f"{objective_words(first)}, its price")
