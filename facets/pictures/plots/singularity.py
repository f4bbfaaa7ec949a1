"""Pictures of the Jacobian's regularity: Fig. 4, and singular states."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...characterization.ambiguity import AmbiguousPair
from ...characterization.singularity import Survey
from ...core.hues import chosen_hues
from ...core.units import Floats
from .. import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DISTANCE = "apex from the beam's centre, mm"
DETERMINANT = "determinant, units of mm, mW, rad"


def survey_picture(survey: Survey, pair: AmbiguousPair | None = None) -> Figure:
    """Draw the determinant (as Fig. 4) and the smallest singular value against the apex's offset.

    pair: two states with the same readings, if any were found.
    """
    rows = 1 if pair is None else 2
    with style.style_context(axes__grid=False):
        picture = style.figure(style.FULL, 2.9 * rows + 0.2)
        panels = picture.subplots(rows, 2, squeeze=False)
        first = density(picture, panels[0, 0], survey.edges[0], survey.edges[1], survey.counts)
        second = density(picture, panels[0, 1], survey.edges[0], survey.edges[2], survey.second)
        panels[0, 0].set(xlabel=DISTANCE, ylabel=DETERMINANT, title="Eq. (11) without power_c")
        panels[0, 1].set(
            xlabel=DISTANCE, ylabel="standard deviations per µm or µrad",
            title="smallest singular value",
        )  # fmt: skip
        for image, panel in zip((first, second), panels[0], strict=True):
            bar = style.colour_bar(picture, image, panel, "states in a cell", aspect=30)
            style.plain_log(bar.ax.yaxis)
        if pair is not None:
            draw_path_between_pair(panels[1], pair)
    return picture


def density(picture: Figure, panel: Axes, x: Floats, y: Floats, counts: Floats) -> Any:
    """Draw the number of states in each cell, empty cells transparent, and a line at zero."""
    from matplotlib.colors import LogNorm

    shown = np.ma.masked_equal(counts.T, 0)
    most = max(float(counts.max(initial=0)), 2.0)
    image = panel.pcolormesh(x, y, shown, norm=LogNorm(vmin=1, vmax=most), cmap=style.ramp(),
                             rasterized=True)  # fmt: skip
    zero(panel, "singular")
    panel.ticklabel_format(axis="y", style="sci", scilimits=(-2, 3), useMathText=False)
    panel.locator_params(nbins=5)
    return image


def zero(panel: Axes, text: str) -> None:
    hues = chosen_hues()
    panel.axhline(0, color=hues.alarm, lw=1.2)
    box = {"fc": hues.ground, "ec": "none", "alpha": 0.85, "pad": 1}
    panel.annotate(text, (0.99, 0), (0, 3), xycoords=("axes fraction", "data"), ha="right",
                   textcoords="offset points", va="bottom", color=hues.alarm,
                   fontsize=style.LEAST, bbox=box)  # fmt: skip


def draw_path_between_pair(panels: NDArray[np.object_], pair: AmbiguousPair) -> None:
    """Draw the difference of readings and the determinant along the line between two states."""
    hues = chosen_hues()
    first, second = panels
    first.plot(pair.position, pair.difference, color=hues.accent)
    first.plot([0, 1], [0, 0], "o", color=hues.alarm, clip_on=False)
    first.set(
        xlabel="from one state (0) to its twin (1)",
        ylabel="readings apart, std. deviations",
        title="two states, the same readings",
    )
    second.plot(pair.position, pair.determinant, color=hues.accent)
    zero(second, "singular")
    second.set(
        xlabel="from one state (0) to its twin (1)", ylabel=DETERMINANT,
        title="its sign changes between",
    )  # fmt: skip
    for panel in panels:
        panel.grid(visible=True)
        panel.ticklabel_format(axis="y", style="sci", scilimits=(-2, 4))
