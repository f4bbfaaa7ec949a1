"""Residuals of a calibration over each detector, and errors before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...calibration.fitting.samples import row_numbers
from ...core.hues import chosen_hues
from ...core.names import DETECTORS, FINE_UNITS, KINDS, POSE
from ...core.units import Floats, write_micro
from .. import style
from ..reports.report_page import inline

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...calibration.fitting.bundle_adjustment import Data
    from ...calibration.fitting.fit import Fit

#: Ends of the scale of mean residuals, standard errors.
ENDS = 3.0
#: Number of parts of an axis whose mean residuals a line joins.
LINE_PARTS = 12


def residual_picture(data: Data, result: Fit, table: dict[str, NDArray[Any]]) -> Figure:
    """Draw residuals over the detectors' faces, and the errors of poses that were held back.

    The colour of a cell is the mean residual of the samples whose spots were there, over the
    standard error of this mean. Noise seldom exceeds 2; an unmodelled effect shows as patches.
    """
    with style.style_context(axes__grid=False):
        picture = style.figure(style.FULL, 8.0)
        parts: Any = picture.subfigures(2, 1, height_ratios=(2.45, 1))
        upper, lower = parts
        panels = upper.subplots(3, 3, sharex=True, sharey=True)
        for k, letter in enumerate(DETECTORS):
            for row, kind in enumerate(KINDS):
                image = face(panels[row, k], data.raw[:, 3 * k : 3 * k + 2],
                             result.residuals[:, 3 * k + row], letter, kind)  # fmt: skip
            panels[2, k].set_xlabel("psi, mm")
        for panel in panels[:, 0]:
            panel.set_ylabel("zeta, mm")
        words = "mean residual in a cell, its standard errors (above: r.m.s. in noise)"
        style.colour_bar(upper, image, panels, words, shrink=0.6, extend="both")
        draw_comparison(lower, table)
    return picture


def residual_lines(data: Data, result: Fit) -> Figure:
    """Draw mean residuals over their standard errors along the reference's axes and the rows.

    There is a row of panels for each reading, and a line for each detector.

    The residuals of an unmodelled effect follow the pose or the time; noise scatters about zero.
    """
    hues = chosen_hues()
    abscissas = [*(data.pose / FINE_UNITS[:6] / 1e3).T, row_numbers(data)]
    names = [*(f"{name}, {'mm' if n < 3 else 'mrad'}" for n, name in enumerate(POSE)), "row"]
    with style.style_context():
        picture = style.figure(style.FULL, 4.6)
        panels: Any = picture.subplots(3, len(names), sharex="col", sharey=True)
        residuals = np.where(np.isfinite(data.raw), result.residuals, 0).T
        for column, (abscissa, name) in enumerate(zip(abscissas, names, strict=True)):
            parts = np.array_split(np.argsort(abscissa), LINE_PARTS)
            places = [abscissa[part].mean() for part in parts]
            for reading, values in enumerate(residuals):
                panels[reading % 3, column].plot(
                    places, [values[part].mean() * np.sqrt(len(part)) for part in parts], lw=0.9,
                    color=hues.detectors[DETECTORS[reading // 3]],
                    label=DETECTORS[reading // 3].upper(),
                )  # fmt: skip
            panels[2, column].set_xlabel(name)
            panels[2, column].locator_params(nbins=3)
        for panel, kind in zip(panels[:, 0], KINDS, strict=True):
            panel.set_ylabel(f"{kind}, std. errors")
        style.panels_legend(picture, panels[0], 3)
    return picture


def residual_drawing(data: Data, result: Fit, table: dict[str, NDArray[Any]]) -> str:
    """Draw the residuals by place on the detectors, by pose and by row, as SVG of a page."""
    faces, lines = residual_picture(data, result, table), residual_lines(data, result)
    return inline(faces, "Residuals by place") + inline(lines, "Residuals by pose and row")


def face(panel: Axes, spots: Floats, residuals: Floats, letter: str, kind: str) -> Any:
    """Draw mean residuals (n,) at spots (n, 2) over their standard errors, by cells."""
    from matplotlib.colors import TwoSlopeNorm

    has_light = np.isfinite(spots).all(axis=1) & np.isfinite(residuals)
    residuals, (psi, zeta) = residuals[has_light], spots[has_light].T
    image = panel.hexbin(
        psi, zeta, C=residuals, gridsize=14, cmap=diverging(), lw=0.1, mincnt=1,
        reduce_C_function=lambda values: np.sum(values) / np.sqrt(len(values)),
        norm=TwoSlopeNorm(0, -ENDS, ENDS), rasterized=True,
    )  # fmt: skip
    rms = np.sqrt(np.mean(residuals**2)) if has_light.any() else np.nan
    panel.set_title(f"{letter.upper()} {kind}, {rms:.2f}", color=chosen_hues().detectors[letter])
    panel.locator_params(nbins=4)
    panel.margins(0.06)
    if not has_light.any():
        style.say(panel, "no light")
    return image


def diverging() -> Any:
    """Return a colour map from blue over grey to red."""
    from matplotlib.colors import LinearSegmentedColormap

    middle = chosen_hues().rule
    return LinearSegmentedColormap.from_list("residual", ["#0B5FA5", middle, "#B3341C"])


def draw_comparison(part: Any, table: dict[str, NDArray[Any]]) -> None:
    """Draw each axis's errors before and after, on a logarithmic scale: ratios reach hundreds."""
    hues = chosen_hues()
    panels = part.subplots(1, 2)
    for panel, rows in zip(panels, (range(3), range(3, 6)), strict=True):
        for lane, n in enumerate(rows):
            hue = hues.axes[POSE[n]]
            before, after, stated = (table[key][n] for key in ("before", "after", "stated"))
            panel.plot([before, after], [lane, lane], color=hues.grey, lw=1.0, zorder=1)
            mark: dict[str, Any] = {"ls": "", "mew": 1.4}
            panel.plot(before, lane, "o", color=hue, ms=6, mfc=hues.ground, label="before", **mark)
            panel.plot(after, lane, "o", color=hue, ms=6, label="after", **mark)
            panel.plot(stated, lane, "|", color=hues.ink, ms=11, label="after, as stated", **mark)
        names = [style.component_label(POSE[n]) for n in rows]
        style.name_lanes(panel, range(3), names, 3)
        unit = write_micro(str(table["unit"][rows[0]]))
        panel.set(xscale="log", ylim=(2.6, -0.6), xlabel=f"r.m.s. error, held back, {unit}")
        style.plain_log(panel.xaxis)
    style.panels_legend(part, panels, 3)
