"""Table of a simulated motion, its errors and its figure, for Fig. 7, 8, 9 and 11."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

import facets
from facets.core.hues import chosen_hues
from facets.core.names import POSE, STATE_COLUMNS
from facets.pictures import style
from facets.pictures.style import unit_of
from facets.simulation.run import pose_table, simulate

from .experiment import NONE, PaperClaim, Table
from .table2 import RESOLUTION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WHY = {
    "tx": "the paper's beam is better known than solved for: see known-beam",
    "ty": "as in x",
    "tz": "one noise of the centroids, fitted to Table 2; here an r.m.s., there the worst place",
    "roll": "the same", "pitch": "the same", "yaw": "the same",
}  # fmt: skip


def simulate_table(config_name: str, motion: str) -> Table:
    """Simulate truth, estimate and standard uncertainty of six axes; mm and mrad."""
    segments = simulate(facets.load(config_name), [motion])
    table = pose_table(segments)
    names = ["time_s", "status", *STATE_COLUMNS]
    names += [f"true_{name}" for name in STATE_COLUMNS]
    names += [name for name in table if name.startswith("u_")]
    return {name: table[name] for name in names}


def column(name: str) -> str:
    """The column of a pose's component, such as `tx_mm` of "tx"."""
    return next(key for key in STATE_COLUMNS if key.startswith(f"{name}_"))


def errors(table: Table, name: str) -> np.ndarray:
    """Estimate minus truth (n,), um or urad, of a component."""
    key = column(name)
    off: np.ndarray = 1e3 * (table[key] - table[f"true_{key}"])
    return off


def errors_in_six_axes(table: Table) -> list[PaperClaim]:
    """Compare twice the root mean square error of each axis with the paper's resolution."""
    results = []
    for name, paper in zip(POSE, RESOLUTION, strict=True):
        off = 2 * float(np.sqrt(np.nanmean(errors(table, name) ** 2)))
        unit = unit_of(name)[2].replace("µ", "u")
        results.append(PaperClaim(f"twice the r.m.s. error in {name}", unit, paper, off, WHY[name]))
    solved = float((table["status"] == "converged").mean())
    results.append(PaperClaim("samples solved", "", NONE, solved, ""))
    return results


def motion_figure(table: Table, axes: tuple[str, ...]) -> Figure:
    """Plot the moved axes, truth under estimate, above the errors of all six axes."""
    hues = chosen_hues()
    rows = -(-len(axes) // 2)
    with style.style_context():
        drawing = style.figure(style.FULL, 1.75 * rows + 4.1)
        parts: Any = drawing.subfigures(2, 1, height_ratios=(1.75 * rows + 0.3, 3.8))
        upper, lower = parts
        moved = upper.subplots(rows, min(len(axes), 2), squeeze=False).ravel()
        for panel, name in zip(moved, axes, strict=False):
            key = column(name)
            panel.plot(table["time_s"], table[f"true_{key}"], color=hues.grey, alpha=0.55, lw=4.2,
                       solid_capstyle="butt", label="truth")  # fmt: skip
            error_band(panel, table["time_s"], table[key], hues.axes[name], "estimate")
            panel.set(ylabel=style.place_label(name), xlabel="time, s")
        for panel in moved[len(axes) :]:
            panel.set_axis_off()
        moved[0].legend(loc="best")
        panels = lower.subplots(3, 2, sharex=True)
        for panel, name in zip(panels.T.ravel(), POSE, strict=True):
            error_band(panel, table["time_s"], errors(table, name), hues.axes[name])
            panel.set_ylabel(f"{style.component_label(name)}, {unit_of(name).fine_unit}")
        panels[0, 0].set_title("errors; bands from least to largest, lines at the median")
        for panel in panels[-1]:
            panel.set_xlabel("time, s")
    return drawing


def error_band(panel: Any, time: np.ndarray, error: np.ndarray, hue: str, label: str = "") -> None:
    """Plot many errors as a band from the minimum to the maximum of neighbours, with their
    median."""
    band = style.band(time, error)
    panel.fill_between(band.time, band.low, band.high, color=hue, alpha=0.4, lw=0, label=label)
    panel.plot(band.time, band.middle, color=hue, lw=1.0)
