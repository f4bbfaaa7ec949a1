"""The Pareto front of a design space, and what moves it."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def front_picture(
    table: dict[str, NDArray[Any]],
    best: NDArray[np.bool_],
    objectives: list[str],
    indices: dict[str, dict[str, float]],
) -> Figure:
    """Objectives against one another, the front marked; and first-order Sobol indices."""
    import matplotlib as mpl

    pairs = list(pairwise(objectives))
    with mpl.rc_context(style.STYLE):
        picture = style.figure(4.0 * (len(pairs) + 1), 3.6)
        panels = picture.subplots(1, len(pairs) + 1, squeeze=False)[0]
        for panel, (one, other) in zip(panels, pairs, strict=False):
            panel.plot(table[one], table[other], ".", ms=1.5, color=style.GREY, rasterized=True)
            panel.plot(table[one][best], table[other][best], "o", ms=3, color=style.BLUE)
            panel.set(xlabel=labelled(one), ylabel=labelled(other))
        panels[0].plot(
            [], [], "o", ms=3, color=style.BLUE, label="beaten by none in all objectives"
        )
        panels[0].legend(loc="best", fontsize=7)
        bars(panels[-1], indices)
    return picture


def labelled(name: str) -> str:
    words, _, unit = name.rpartition("_")
    return f"{words.replace('_', ' ')}, {unit.replace('u', 'µ', 1) if unit[0] == 'u' else unit}"


def bars(panel: Any, indices: dict[str, dict[str, float]]) -> None:
    variables = list(next(iter(indices.values()))) if indices else []
    width = 0.8 / max(len(indices), 1)
    for n, (objective, found) in enumerate(indices.items()):
        places = np.arange(len(variables)) + n * width
        values = [found[name] for name in variables]
        panel.barh(places, values, width, color=style.SERIES[n % len(style.SERIES)],
                   label=labelled(objective))  # fmt: skip
    panel.set(xlabel="first-order Sobol index")
    panel.set_yticks(np.arange(len(variables)) + 0.4 - width / 2, variables)
    if indices:
        panel.legend(fontsize=7)
