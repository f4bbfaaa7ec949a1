"""Table 1: the paper's rig, and the shipped configuration of it."""

from __future__ import annotations

from math import degrees

import numpy as np

import facets

from .experiment import PaperClaim, Table, columns_of, no_picture

TITLE = "Table 1: the experimental system"
CONFIG = "paper"


def compute(quick: bool) -> Table:
    sensor = facets.load(CONFIG).sensor
    turns = [
        (facet.azimuth, psd.azimuth) for facet, psd in zip(sensor.facets, sensor.psds, strict=True)
    ]
    between = np.degrees(np.diff(turns, axis=0))
    rows = [
        ("laser power", "mW", 0.3, sensor.beam.power),
        ("beam diameter 1/e^2", "mm", 0.85, sensor.beam.diameter_x),
        ("beam tilt", "mrad", 0.0, 1e3 * np.hypot(sensor.beam.tilt_x, sensor.beam.tilt_y)),
        ("facet inclination", "deg", 45.0, degrees(sensor.facets[0].inclination)),
        ("angle between facets", "deg", 120.0, between[:, 0].mean()),
        ("PSD width", "mm", 13.0, sensor.psds[0].size_y),
        ("PSD height", "mm", 13.0, sensor.psds[0].size_z),
        ("PSD distance", "mm", 250.0, sensor.psds[0].radius),
        ("angle between PSDs", "deg", 120.0, between[:, 1].mean()),
    ]
    return columns_of("what unit paper ours", rows)


def claims(table: Table) -> list[PaperClaim]:
    rows = zip(*(table[name].tolist() for name in ("what", "unit", "paper", "ours")), strict=True)
    return [PaperClaim(what, unit, paper, ours, "", is_input=True)
            for what, unit, paper, ours in rows]  # fmt: skip


picture = no_picture
