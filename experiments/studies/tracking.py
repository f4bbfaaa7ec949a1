"""How fast a mirror can move before the beam is lost, by law, against what is told beforehand.

`python -m facets.experiments.studies.tracking`
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import bisect

import facets
from facets.characterization.ranges import axis_ranges
from facets.core.settings import Stage
from facets.tracking.closed_loop import simulate_following
from facets.tracking.control import margin_of, pull_of

LAWS = ("proportional", "pi", "feedforward")


def offset(settings: Stage, speed: float, seconds: float = 3.0) -> float:
    """The largest distance of beam and mirror, mm, if the mirror comes to speed along x in 1 s."""
    time = np.arange(int(1000 * seconds)) / 1000
    truth = np.zeros((len(time), 8))
    truth[:, 0] = speed * np.where(time < 1, time**2 / 2, time - 0.5)
    states = simulate_following(facets.load("bench").sensor, settings, time, truth)
    return float(np.abs(states[:, 0] - states[:, 6]).max())


def loss_speed(settings: Stage, clearance: float) -> float:
    """The speed at which the mirror gets `clearance` mm ahead of the beam, mm/s."""
    return float(bisect(lambda speed: offset(settings, speed) - clearance, 0.1, 60.0, xtol=0.02))


if __name__ == "__main__":
    config = facets.load("bench")
    found = axis_ranges(config.sensor, config.range, np.zeros(6))[:2]
    clearance = min(axis.symmetric / 2 for axis in found)
    wide = replace(config.stage, low=(-1e3, -1e3), high=(1e3, 1e3))
    print(
        f"room {clearance:.4f} mm; {wide.rate:g} Hz, gain {wide.gain}, "
        f"{wide.max_speed:g} mm/s at most"
    )
    for law in LAWS:
        settings = replace(wide, law=law)  # type: ignore[arg-type]
        told = margin_of(settings, pull_of(config.sensor, clearance))
        seen = loss_speed(settings, clearance)
        print(f"{law:13} told {told.speed:6.2f} mm/s   found {seen:6.2f} mm/s   "
              f"{offset(settings, 6.28) * 1e3:6.1f} um off at 6.28 mm/s")  # fmt: skip
    time = np.arange(8000) / 1000
    for axis, reach in ((0, 6.0), (1, 5.0)):
        truth = np.zeros((len(time), 8))
        truth[:, axis] = reach * np.sin(2 * np.pi * time / 8)
        states = simulate_following(config.sensor, config.stage, time, truth)
        seen_ = facets.readings(config.sensor, states)
        solution = facets.solve(config.sensor, seen_, start=states)
        off = np.hypot(states[:, 0] - states[:, 6], states[:, 1] - states[:, 7]).max()
        print(
            f"Fig. 11, {'xy'[axis]}: +-{reach} mm, {int(solution.converged.sum())} of "
            f"{len(time)} solved, beam at most {1e3 * off:.1f} um off"
        )
