"""How closely a beam follows the mirror with the solver on the board, beside a PC in the loop.

    python -m facets.experiments.studies.board_loop LIBRARY [--seconds 4]

LIBRARY is `libfacets.so`, or `libfacets-float.so`, of `facets export-c bench`. The stage of the
configuration `bench` without its limits of speed carries the beam after a mirror on a circle of
4 mm, by the law `feedforward` from poses that are solved from noisy readings: by the exported code
0.2 ms after the light, 5,000 times a second; and by facets 15 ms after it (a port's and a busy
loop's delay; see docs/accuracy.md), 200 times a second.

The law aims where the apex will be when the stage answers, by its speed over the last T = 20 ms. A
circle's acceleration a leaves a (h^2 / 2 + T h) over the horizon h from light to answer: this is
what is told; what is found is the largest distance of beam and apex after the first second.
"""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import facets
from facets.core.settings import Stage
from facets.core.units import Floats
from facets.detectors.noise import add_noise
from facets.firmware.library import FirmwareLibrary
from facets.tracking.control import SPEED_AVERAGING_S, ControlInput, Law
from facets.tracking.stage import StageModel

RADIUS = 4.0
SPEEDS = (6.28, 12.6, 25.0, 50.0)

#: Function of a reading (9,) and a start (8,), which holds the beam's position by the stage, that
#: returns a state (8,), or NaN if there is none.
Solver = Callable[[Floats, Floats], Floats]


@dataclass(frozen=True)
class Controller:
    """Where the loop is closed.  age: time from light to command, s.  rate: of commands, Hz."""

    name: str
    age: float
    rate: float
    solve: Solver


def circle(now: float, speed: float) -> Floats:
    """State of the mirror at a time, s; it reaches its speed smoothly within half a second."""
    passed = now - 0.25 if now > 0.5 else now**2
    angle = speed * passed / RADIUS
    state = np.zeros(8)
    state[:2] = RADIUS * np.sin(angle), RADIUS * (1 - np.cos(angle))
    return state


def follow(place: Controller, stage: Stage, speed: float, seconds: float) -> tuple[float, int]:
    """The largest distance of beam and apex after the first second, mm; and commands without pose.

    The run ends when the light is lost; the distance is then infinite.
    """
    sensor, rng = facets.load("bench").sensor, np.random.default_rng(1)
    settings = replace(stage, rate=place.rate)
    law, model = Law.from_sensor(sensor, settings), StageModel(settings)
    worst, blind, last = 0.0, 0, np.zeros(8)
    waiting: deque[ControlInput] = deque()
    for n in range(int(seconds * place.rate)):
        light = n / place.rate
        while waiting and waiting[0].now <= light:
            seen = waiting.popleft()
            model.advance(seen.now)
            model.command(law.command(seen))
        model.advance(light)
        state = circle(light, speed)
        state[6:] = last[6:] = model.place
        worst = max(worst, float(np.hypot(*(state[:2] - model.place))) if light > 1 else 0.0)
        reading = add_noise(sensor, facets.readings(sensor, state), rng)
        pose = place.solve(reading, last)
        if np.isfinite(pose[:2]).all():
            last = pose.copy()
            seen = ControlInput(
                light, light + place.age, reading[2::3], pose[:2], model.place.copy()
            )
            waiting.append(seen)
        else:
            blind += 1
            if blind > place.rate / 10:
                return float("inf"), blind
    return worst, blind


def predicted_distance(place: Controller, stage: Stage, speed: float) -> float:
    """The distance by which the circle's acceleration leads over the horizon, mm."""
    horizon = place.age + stage.latency + stage.lag + 0.5 / place.rate
    return speed**2 / RADIUS * (horizon**2 / 2 + SPEED_AVERAGING_S * horizon)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("library", type=Path)
    parser.add_argument("--seconds", type=float, default=4.0)
    options = parser.parse_args()
    library = FirmwareLibrary(options.library)
    config = facets.load("bench")
    wide = replace(
        config.stage, low=(-1e3,) * 2, high=(1e3,) * 2, max_speed=1e3, max_step=1e3,
        acceleration=1e5, law="feedforward", latency=2e-4, lag=1e-3,
    )  # fmt: skip

    def solve_like_board(reading: Floats, last: Floats) -> Floats:
        start = np.append(last, config.sensor.beam.power)
        state: Floats = library.solve(reading[None], "known", start).state[0]
        return state

    def solve_like_pc(reading: Floats, last: Floats) -> Floats:
        beam = facets.Prior(last[6:], 0.0)
        state: Floats = facets.solve(config.sensor, reading, beam=beam, start=last).state
        return state

    places = [
        Controller("board", 2e-4, 5000.0, solve_like_board),
        Controller("PC", 15e-3, 200.0, solve_like_pc),
    ]
    print(f"stage: latency {1e3 * wide.latency:g} ms, lag {1e3 * wide.lag:g} ms; circle of 4 mm")
    for speed in SPEEDS:
        for place in places:
            distance, blind = follow(place, wide, speed, options.seconds)
            predicted = predicted_distance(place, wide, speed)
            print(
                f"{place.name:6} {speed:5.1f} mm/s: predicted {1e3 * predicted:7.1f} um, "
                f"found {1e3 * distance:7.1f} um; {blind} commands without a pose"
            )


if __name__ == "__main__":
    main()
