"""The Pareto front of a design space, and what moves it."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..characterization.sensitivity import Index
from ..core.units import column_label
from . import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def front_picture(
    table: dict[str, NDArray[Any]],
    best: NDArray[np.bool_],
    objectives: list[str],
    indices: dict[str, dict[str, Index]],
    own: dict[str, float] | None = None,
) -> Figure | None:
    """Objectives against one another, the front marked; and first-order Sobol indices.

    own: the measures of the design as it is, which is marked as well.

    None where there is nothing to draw: fewer than two designs with all objectives, or one
    objective and no indices.
    """
    known = np.all([np.isfinite(table[name]) for name in objectives], axis=0)
    pairs = list(pairwise(objectives))
    count = len(pairs) + bool(indices)
    if known.sum() < 2 or count == 0:
        return None
    with style.in_rules():
        picture = style.figure(4.0 * count, 3.6)
        panels = picture.subplots(1, count, squeeze=False)[0]
        for panel, (one, other) in zip(panels, pairs, strict=False):
            panel.plot(table[one], table[other], ".", ms=1.5, color=style.GREY, rasterized=True)
            label = "beaten by none in all objectives"
            panel.plot(
                table[one][best], table[other][best], "o", ms=3, color=style.BLUE, label=label
            )
            if own is not None and np.isfinite([own[one], own[other]]).all():
                panel.plot(own[one], own[other], "*", ms=10, color=style.ORANGE, label="as it is")
            panel.set(xlabel=column_label(one), ylabel=column_label(other))
        if pairs:
            panels[0].legend(loc="best", fontsize=7)
        if indices:
            bars(panels[-1], indices)
    return picture


def pareto_picture(
    table: dict[str, NDArray[Any]],
    objectives: list[str],
    cloud: dict[str, NDArray[Any]] | None,
    own: dict[str, float],
) -> Figure:
    """The front's objectives against one another, with what the first costs below; a cloud of
    designs behind it, where there is one; and the design as it is."""
    pairs = list(pairwise(objectives))
    if len(objectives) > 2:
        pairs.append((objectives[0], objectives[-1]))
    with style.in_rules():
        picture = style.figure(4.2 * len(pairs), 5.4)
        above, below = picture.subplots(2, len(pairs), squeeze=False, height_ratios=(2, 1))
        mark = "o-" if len(objectives) == 2 else "o"
        for panel, (one, other) in zip(above, pairs, strict=True):
            if cloud is not None:
                panel.plot(cloud[one], cloud[other], ".", ms=1.5, color=style.GREY, rasterized=True,
                           label="designs drawn")  # fmt: skip
            panel.plot(table[one], table[other], mark, ms=3, color=style.BLUE, label="front")
            panel.plot(own[one], own[other], "*", ms=10, color=style.ORANGE, label="as it is")
            panel.set(xlabel=column_label(one), ylabel=column_label(other))
        above[0].legend(loc="best", fontsize=7)
        others = [name for name in objectives if name != objectives[0]]
        for panel, other in zip(below, [*others, *[""] * len(pairs)], strict=False):
            if not other:
                panel.set_axis_off()
                continue
            prices = table[f"{objectives[0]}_per_{other}"][
                1:-1
            ]  # at its ends the front is vertical
            panel.semilogy(table[other][1:-1], np.where(prices > 1e-9, prices, np.nan), mark, ms=3,
                           color=style.ORANGE)  # fmt: skip
            panel.set(xlabel=column_label(other), ylabel="its price")
            panel.set_title(f"{objectives[0]} for one unit of {other}", fontsize=7, loc="left")
    return picture


def bars(panel: Axes, indices: dict[str, dict[str, Index]]) -> None:
    """Indices by variable, a colour for each objective, with their intervals."""
    variables = list(next(iter(indices.values())))
    width = 0.8 / len(indices)
    for n, (objective, found) in enumerate(indices.items()):
        places = np.arange(len(variables)) + n * width
        values = [found[name].value for name in variables]
        panel.barh(
            places, values, width, xerr=[found[name].half for name in variables],
            color=style.SERIES[n % len(style.SERIES)], label=column_label(objective),
            error_kw={"lw": 0.8, "ecolor": style.INK},
        )  # fmt: skip
    panel.set(xlabel="first-order Sobol index, with its interval of 95 %")
    panel.set_yticks(np.arange(len(variables)) + 0.4 - width / 2, variables)
    panel.legend(fontsize=7)
