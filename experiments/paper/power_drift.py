"""Not in the paper: pose errors after the laser's power has drifted."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

import facets
from facets.core.hues import chosen_hues
from facets.core.names import POSE
from facets.pictures import style
from facets.pictures.style import unit_of

from .experiment import NONE, PaperClaim, Table, columns_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Beyond the paper: drift of the laser's power"
CONFIG = "paper"
DRIFTS = (-5.0, -2.0, -1.0, -0.5, -0.1, 0.1, 0.5, 1.0, 2.0, 5.0)
AWAY = np.array([0.08, -0.05, 0.5, 3e-3, -2e-3, 5e-3, 0, 0])
WAYS = {
    "paper": {"method": "paper"},
    "nine readings": {},
    "nine readings; beam known": {"beam": "known"},
    "power solved for": {"power": "unknown", "accept_unchecked": True},
}


def compute(quick: bool) -> Table:
    """Error of each axis, um and urad, at a pose off the beam's centre, for each way of solving."""
    sensor = facets.load(CONFIG).sensor
    factors = np.array([unit_of(name)[3] for name in POSE])
    rows = []
    for drift in DRIFTS:
        power = (1 + drift / 100) * sensor.beam.power
        readings = facets.readings(replace(sensor, beam=replace(sensor.beam, power=power)), AWAY)
        for way, options in WAYS.items():
            poses = facets.solve(sensor, readings, start=AWAY, **options)  # type: ignore[arg-type]
            rows.append((drift, way, *((poses.state - AWAY)[:6] * factors)))
    return columns_of("drift_percent way tx_um ty_um tz_um roll_urad pitch_urad yaw_urad", rows)


def claims(table: Table) -> list[PaperClaim]:
    results = []
    for way in WAYS:
        row = np.flatnonzero((table["way"] == way) & (table["drift_percent"] == 1.0))[0]
        off = float(np.hypot(table["tx_um"][row], table["ty_um"][row]))
        why = "at 0.09 mm off the beam; a power that is wrong looks like light that has moved"
        if way == "power solved for":
            why = "a ninth unknown, which nine readings still give"
        results.append(
            PaperClaim(f"1 % more light: error of the place; {way}", "um", NONE, off, why)
        )
    return results


def picture(table: Table) -> Figure:
    hues = chosen_hues()
    with style.style_context():
        drawing = style.figure(style.SINGLE, 3.6)
        panel = drawing.subplots()
        for way, hue, mark in zip(WAYS, hues.series, "osD^", strict=False):
            rows = table["way"] == way
            off = np.hypot(table["tx_um"], table["ty_um"])[rows]
            panel.plot(table["drift_percent"][rows], off, marker=mark, ms=5, color=hue, label=way)
        panel.set(xlabel="drift of the laser's power, %", ylabel="error in x and y, µm")
        panel.set_yscale("symlog", linthresh=0.01)
        style.panels_legend(drawing, [panel], 2)
    return drawing
