"""What a layout has become: uncertainties and ranges, before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.names import POSE
from . import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def layout_picture(table: dict[str, NDArray[Any]]) -> Figure:
    """The comparison of `recheck.compare`: bars of what was over what is."""
    with style.in_rules():
        picture = style.figure(9, 3.4)
        fine, far = picture.subplots(1, 2)
        pairs(fine, table, "u_")
        fine.set_title("worst standard uncertainty over the volume", loc="left")
        pairs(far, table, "range_")
        far.set_title("symmetric range: twice the nearer end", loc="left")
        handles, texts = fine.get_legend_handles_labels()
        picture.legend(handles, texts, loc="outside lower center", ncols=3)
    return picture


def pairs(panel: Axes, table: dict[str, NDArray[Any]], kind: str) -> None:
    """Before and after of six axes, side by side, each over the larger of the two."""
    rows = [n for n, name in enumerate(table["quantity"]) if str(name).startswith(kind)]
    before, after, drawn = (table[key][rows] for key in ("before", "after", "simulated"))
    top = np.fmax(before, after)
    places = np.arange(len(rows))
    panel.bar(places - 0.2, before / top, 0.38, color=style.GREY, label="before")
    panel.bar(places + 0.2, after / top, 0.38, color=style.BLUE, label="after")
    if np.isfinite(drawn).any():
        label = "after, spread of simulated solves"
        panel.plot(places + 0.2, drawn / top, "_", ms=14, mew=2, color=style.ORANGE, label=label)
    for x, values in ((-0.2, before), (0.2, after)):
        for place, value, share in zip(places + x, values, values / top, strict=True):
            if np.isfinite(value):
                panel.annotate(f"{value:.3g}", (place, share), (0, 4), ha="center", fontsize=7,
                               textcoords="offset points")  # fmt: skip
    units = [str(table["quantity"][n]).rpartition("_")[2] for n in rows]
    names = [f"{name}\n{u.replace('u', 'µ', 1) if u[0] == 'u' else u}"
             for name, u in zip(POSE, units, strict=True)]  # fmt: skip
    panel.set_xticks(places, names)
    panel.set(ylim=(0, 1.15), yticks=[])
    panel.grid(visible=False)
    panel.spines["left"].set_visible(False)
