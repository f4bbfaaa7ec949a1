"""Eq. 7 to 9: the error of the paper's irradiance on a PSD.

Eq. (8) lacks a cross term, which is zero if the sub-beam is level.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

import facets
from facets.core.hues import DASHES, MARKS, chosen_hues
from facets.pictures import style

from .experiment import PaperClaim, Table, columns_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Eq. 8: what the paper's irradiance leaves out"
CONFIG = "paper"
AXES = {"roll": (1, 0, 0), "pitch": (0, 1, 0), "yaw": (0, 0, 1), "all three": (1, 1, 1)}
TILTS = (1, 2, 5, 10, 15, 20)
OFFSETS = (0.0, 0.1)


def errors(sensor: facets.Sensor, state: Any) -> tuple[float, float]:
    """Largest errors over the detectors: of position, nm, and of power, ppm of the beam's."""
    printed = facets.readings(sensor, state, irradiance="paper")
    difference = np.abs(printed - facets.readings(sensor, state)).reshape(3, 3)
    return 1e6 * difference[:, :2].max(), 1e6 * difference[:, 2].max() / sensor.beam.power


def compute(quick: bool) -> Table:
    sensor = facets.load(CONFIG).sensor
    rows = []
    for offset in OFFSETS:
        for name, turn in AXES.items():
            for tilt in TILTS:
                state = np.array([offset, 0, 0, *(1e-3 * tilt * np.array(turn)), 0, 0])
                rows.append((offset, name, tilt, *errors(sensor, state)))
    return columns_of("offset_mm axis tilt_mrad place_nm power_ppm", rows)


def claims(table: Table) -> list[PaperClaim]:
    results = []
    for axis, tilt in (("roll", 10), ("yaw", 20), ("all three", 20)):
        rows = (table["axis"] == axis) & (table["tilt_mrad"] == tilt)
        rows &= table["offset_mm"] == 0
        results.append(
            PaperClaim(f"error of a place; {axis} {tilt} mrad", "nm", 0.0,
                  float(table["place_nm"][rows].max()),
                  "the paper calls its formula the irradiance; grows as the tilt squared")
        )  # fmt: skip
    return results


def picture(table: Table) -> Figure:
    hues = chosen_hues()
    with style.style_context():
        drawing = style.figure(style.SINGLE, 3.1)
        panel = drawing.subplots()
        for name, size in zip(AXES, (10, 5, 5, 5), strict=True):  # two of them coincide
            rows = (table["axis"] == name) & (table["offset_mm"] == 0)
            if table["place_nm"][rows].max() > 1e-3:
                panel.loglog(table["tilt_mrad"][rows], table["place_nm"][rows], ms=size, label=name,
                             color=hues.axes.get(name, hues.ink), ls=DASHES.get(name, "-"),
                             marker=MARKS.get(name, "*"))  # fmt: skip
        panel.set(xlabel="tilt, mrad", ylabel="largest error of a place, nm")
        for axis in (panel.xaxis, panel.yaxis):
            style.plain_log(axis)
        panel.legend()
    return drawing
