"""Cost of cut light: a pose with and without it, and the share of poses that need it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.sensor import Apertures, Sensor
from ..estimation.solver import solve
from ..model.arrays import jacobian, readings
from .clock import Contender, alternate
from .head import SENSOR, states_in_range

Row = dict[str, Any]
CUTS = {
    "nothing cut": Apertures(),
    "detectors": Apertures(detectors=True),
    "rim at 5 mm": Apertures(rim=5.0),
    "beam at 1/e^2": Apertures(beam=1.0),
    "gap of 10 um": Apertures(gap=0.01),
    "all of them": Apertures(beam=1.0, detectors=True, tip=0.02, rim=0.3, gap=0.01),
}


def apertures(quick: bool, seed: int) -> list[Row]:
    """Times of readings, Jacobians and warm solves for each cut, relative to uncut light.

    The states are those of the other studies: all centroids lie on their detectors, up to the edge.
    """
    poses = 500 if quick else 50_000
    states = states_in_range(poses, seed)
    sensors = {name: replace(SENSOR, apertures=cut) for name, cut in CUTS.items()}
    wide = replace(SENSOR, apertures=Apertures(rim=1e6))  # the same code, which cuts nothing
    plain = readings(wide, states)[:, 2::3]
    rows: list[Row] = []
    timings = [
        alternate([contender(kind, sensor, states) for sensor in sensors.values()], states, rounds)
        for kind, rounds in zip(KINDS, (3, 3, 3) if quick else (15, 15, 7), strict=True)
    ]
    for number, (name, sensor) in enumerate(sensors.items()):
        row: Row = {"cut": name, "poses_cut": share_cut(sensor, states, plain)}
        for kind, times in zip(KINDS, timings, strict=True):
            row[f"{kind}_us"] = 1e6 * times[number]
            row[f"{kind}_ratio"] = times[number] / times[0]
        rows.append(row)
    return rows


KINDS = ("readings", "jacobian", "solve")


def contender(kind: str, sensor: Sensor, states: NDArray[np.float64]) -> Contender:
    if kind == "readings":
        return Contender(kind, lambda s: readings(sensor, s), len(states))
    if kind == "jacobian":
        return Contender(kind, lambda s: jacobian(sensor, s), len(states))
    xi = readings(sensor, states)

    def warm(s: NDArray[np.float64]) -> None:
        solve(sensor, xi[: len(s)], start=s + 1e-6, covariance=False)

    return Contender(kind, warm, len(states))


#: Relative difference that rounding makes between powers computed singly and in blocks.
ROUNDING = 1e-13


def share_cut(sensor: Sensor, states: NDArray[np.float64], plain: NDArray[np.float64]) -> float:
    """Share of the poses in which a power differs from the uncut one by more than rounding."""
    power = readings(sensor, states)[:, 2::3]
    return float((np.abs(power - plain) > ROUNDING * plain).any(axis=1).mean())
