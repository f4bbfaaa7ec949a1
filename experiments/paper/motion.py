"""A simulated motion as a table, its errors, and drawn from it: Fig. 7, 8, 9 and 11."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

import facets
from facets.core.names import POSE, STATE_COLUMNS
from facets.pictures import style
from facets.pictures.style import unit_of
from facets.simulation.run import pose_table, simulate

from .experiment import Claim, Table
from .table2 import RESOLUTION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WHY = {
    "tx": "the paper's beam is better known than solved for: see known-beam",
    "ty": "as in x",
    "tz": "one noise of the centroids, fitted to Table 2; here an r.m.s., there the worst place",
    "roll": "the same", "pitch": "the same", "yaw": "the same",
}  # fmt: skip


def simulated(config_name: str, motion: str, track: bool = False) -> Table:
    """Truth, estimate and standard uncertainty of six axes; mm and mrad."""
    segments = simulate(facets.load(config_name), [motion], track=track)
    table = pose_table(segments)
    wanted = ["time_s", "status", *STATE_COLUMNS]
    wanted += [f"true_{name}" for name in STATE_COLUMNS]
    wanted += [name for name in table if name.startswith("u_")]
    return {name: table[name] for name in wanted}


def column(name: str) -> str:
    return next(key for key in STATE_COLUMNS if key.startswith(f"{name}_"))


def errors(table: Table, name: str) -> np.ndarray:
    """Estimate less truth, um or urad."""
    key = column(name)
    off: np.ndarray = 1e3 * (table[key] - table[f"true_{key}"])
    return off


def errors_in_six_axes(table: Table) -> list[Claim]:
    """Twice the root mean square error of each axis, beside the paper's resolution."""
    found = []
    for name, paper in zip(POSE, RESOLUTION, strict=True):
        off = 2 * float(np.sqrt(np.nanmean(errors(table, name) ** 2)))
        unit = unit_of(name)[2].replace("µ", "u")
        found.append(Claim(f"twice the r.m.s. error in {name}", unit, paper, off, WHY[name]))
    solved = float((table["status"] == "converged").mean())
    found.append(Claim("samples solved", "", 1, solved, ""))
    return found


def drawn(table: Table, axes: tuple[str, ...]) -> Figure:
    """The moved axes on the left, the errors of all six on the right."""
    with style.in_rules():
        drawing = style.figure(9, 4.6 if len(axes) == 1 else 7)
        halves: Any = drawing.subfigures(1, 2, width_ratios=(1, 1.35))
        left, right = halves
        moved = np.atleast_1d(left.subplots(len(axes), 1, sharex=True))
        for panel, name in zip(moved, axes, strict=True):
            key = column(name)
            panel.plot(table["time_s"], table[f"true_{key}"], color=style.INK, label="truth")
            panel.plot(table["time_s"], table[key], ".", ms=2, color=style.BLUE, label="estimate",
                       rasterized=True)  # fmt: skip
            panel.set_ylabel(f"{name}, {unit_of(name)[0]}")
        moved[0].legend(loc="best", fontsize=7)
        moved[-1].set_xlabel("time, s")
        panels = right.subplots(3, 2, sharex=True)
        for panel, name in zip(panels.T.ravel(), POSE, strict=True):
            panel.plot(
                table["time_s"], errors(table, name), ".", ms=1.5, color=style.BLUE, rasterized=True
            )
            panel.set_ylabel(f"error of {name}, {unit_of(name)[2]}", fontsize=7)
        for panel in panels[-1]:
            panel.set_xlabel("time, s")
    return drawing
