"""Residuals of a calibration over each detector, and errors before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.hues import chosen_hues
from ...core.names import ANGLES, DETECTORS, KINDS, POSE
from ...core.units import Floats, write_micro
from .. import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...calibration.fitting.bundle_adjustment import Data
    from ...calibration.fitting.fit import Fit

#: Ends of the scale of residuals, standard deviations.
ENDS = 3.0
#: Rows of `compared`: column, mark, and whether it is filled.
ROWS = (("before", "o", False), ("after", "o", True), ("stated", "|", True))


def residual_picture(data: Data, result: Fit, table: dict[str, NDArray[Any]]) -> Figure:
    """Draw residuals over each detector's face, a row for each reading, and errors of held-back
    poses.

    A cell's hue is the mean residual of the samples whose spots fell there: an unmodelled effect
    shows as patches, noise does not.
    """
    with style.style_context(axes__grid=False):
        picture = style.figure(style.FULL, 8.0)
        parts: Any = picture.subfigures(2, 1, height_ratios=(2.45, 1))
        upper, lower = parts
        panels = upper.subplots(3, 3, sharex="col", sharey="col")
        for k, letter in enumerate(DETECTORS):
            for row, kind in enumerate(KINDS):
                image = face(panels[row, k], data.raw[:, 3 * k : 3 * k + 2],
                             result.residuals[:, 3 * k + row], letter, kind)  # fmt: skip
            panels[2, k].set_xlabel("psi, mm")
        for panel in panels[:, 0]:
            panel.set_ylabel("zeta, mm")
        bar = upper.colorbar(image, ax=panels, shrink=0.6, pad=0.02, extend="both")
        bar.set_label("mean residual in a cell, standard deviations (above: r.m.s.)")
        bar.outline.set_visible(False)
        draw_comparison(lower, table)
    return picture


def face(panel: Axes, spots: Floats, left: Floats, letter: str, kind: str) -> Any:
    """Draw the mean residuals (n,) at spots (n, 2), in cells; cells without light stay empty."""
    from matplotlib.colors import TwoSlopeNorm

    there = np.isfinite(spots).all(axis=1) & np.isfinite(left)
    psi, zeta = spots[there].T
    image = panel.hexbin(
        psi, zeta, C=left[there], gridsize=14, cmap=diverging(), lw=0.1, mincnt=1,
        norm=TwoSlopeNorm(0, -ENDS, ENDS), rasterized=True,
    )  # fmt: skip
    rms = np.sqrt(np.mean(left[there] ** 2)) if there.any() else np.nan
    panel.set_title(f"{letter.upper()} {kind}, {rms:.2f}", color=chosen_hues().detectors[letter])
    panel.locator_params(nbins=4)
    panel.margins(0.06)
    if not there.any():
        style.say(panel, "no light")
    return image


def diverging() -> Any:
    """A colour map from blue over the ground's colour to red."""
    from matplotlib.colors import LinearSegmentedColormap

    middle = chosen_hues().rule
    return LinearSegmentedColormap.from_list("residual", ["#0B5FA5", middle, "#B3341C"])


def draw_comparison(part: Any, table: dict[str, NDArray[Any]]) -> None:
    """Errors of each axis before and after, on a logarithmic scale: they differ by hundreds."""
    panels = part.subplots(1, 2)
    for panel, angles in zip(panels, (False, True), strict=True):
        names = [name for name in POSE if (name in ANGLES) == angles]
        for row, name in enumerate(names):
            errors(panel, row, table, list(POSE).index(name))
        unit = write_micro(str(table["unit"][list(POSE).index(names[0])]))
        panel.set_yticks(range(3), [style.component_label(name) for name in names])
        panel.set(xscale="log", ylim=(2.6, -0.6), xlabel=f"r.m.s. error, held back, {unit}")
        panel.tick_params(axis="y", length=0)
        panel.grid(visible=True, axis="x")
        style.plain_log(panel.xaxis)
    handles, texts = panels[0].get_legend_handles_labels()
    by_text = dict(zip(texts, handles, strict=True))
    style.legend_below(part, list(by_text.values()), list(by_text), 3)


def errors(panel: Axes, row: int, table: dict[str, NDArray[Any]], i: int) -> None:
    hues = chosen_hues()
    low, high = table["before"][i], table["after"][i]
    panel.plot([low, high], [row, row], color=hues.grey, lw=1.0, zorder=1)
    for column, mark, filled in ROWS:
        colour = hues.ink if column == "stated" else hues.axes[POSE[i]]
        panel.plot(table[column][i], row, mark, color=colour, ms=11 if mark == "|" else 6,
                   mfc=colour if filled else hues.ground, mew=1.4, ls="",
                   label=column if column != "stated" else "after, as stated")  # fmt: skip
