"""Shifts of poses by changes of a bench after a perfect calibration, over the noise of one reading.

    python -m facets.experiments.studies.drifts

Readings of the changed sensor, without noise, are solved by the sensor as it was calibrated, over
poses within 0.12 mm, 2 mm and 6 mrad of rest. The study prints the largest shift of x and y, and of
the other axes, over their standard uncertainty from one reading, with the beam's place known and
free. It takes half a minute, most of it for compiling.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import facets
from facets.core.sensor import Sensor
from facets.core.units import Floats

SENSOR = facets.Sensor()
HALF = np.array([0.12, 0.12, 2, 6e-3, 6e-3, 6e-3])


def change_beam(**changes: float) -> Sensor:
    """The sensor with other properties of its beam."""
    return replace(SENSOR, beam=replace(SENSOR.beam, **changes))


def change_psds(**changes: float) -> Sensor:
    """The sensor with detectors whose properties differ by these amounts."""
    psds = tuple(
        replace(psd, **{name: getattr(psd, name) + more for name, more in changes.items()})
        for psd in SENSOR.psds
    )
    return replace(SENSOR, psds=psds)  # type: ignore[arg-type]


def poses(count: int = 300, seed: int = 1) -> Floats:
    """Random states (count, 8) in the box, with the beam at rest."""
    states = np.zeros((count, 8))
    states[:, :6] = np.random.default_rng(seed).uniform(-1, 1, (count, 6)) * HALF
    return states


def cases() -> dict[str, tuple[Floats, str]]:
    """Readings (n, 9) after each change, and the knowledge of the laser's power in the solution."""
    some, beam = poses(), SENSOR.beam
    plain = facets.readings(SENSOR, some)
    moved, turned = some.copy(), some.copy()
    moved[:, 6] += 1e-3
    turned[:, 6] += 500 * 10e-6
    gain = plain.copy()
    gain[:, 2] *= 1.001
    brighter = facets.readings(change_beam(power=1.01 * beam.power), some)
    speed = np.array([10, 10, 10, 0.1, 0.1, 0.1, 0, 0])  # mm/s and rad/s
    late = plain.copy()
    for k in (1, 2):
        far = facets.readings(SENSOR, some + speed * 10e-6 * k)
        late[:, 3 * k : 3 * k + 3] = far[:, 3 * k : 3 * k + 3]
    return {
        "beam 1 µm aside": (facets.readings(SENSOR, moved), "known"),
        "laser half a metre away turned 10 µrad": (
            facets.readings(change_beam(tilt_y=10e-6), turned), "known"),
        "laser 1 % brighter, its power taken as known": (brighter, "known"),
        "laser 1 % brighter, its power taken as unknown": (brighter, "unknown"),
        "one detector's gain 0.1 % up": (gain, "known"),
        "beam 0.2 % wider": (
            facets.readings(change_beam(diameter_x=1.002 * beam.diameter_x,
                                      diameter_y=1.002 * beam.diameter_y), some), "known"),
        "detectors' posts 1 K warmer, 2.3 µm higher": (
            facets.readings(change_psds(height=2.3e-3), some), "known"),
        "channels 10 µs apart, 10 mm/s and 0.1 rad/s": (late, "known"),
    }  # fmt: skip


def shift_to_noise_ratio(readings: Floats, beam: str, power: str) -> Floats:
    """Largest shift of each pose component over its standard uncertainty: (6,)."""
    some = poses()
    knowledge: Any = {"beam": beam, "power": power}
    result = facets.solve(SENSOR, readings, **knowledge, accept_unchecked=True)
    shift = np.abs(result.state - some)[:, :6] / result.uncertainty[:, :6]
    largest: Floats = shift.max(axis=0)
    return largest


def main() -> None:
    print("| change | known: x, y | others | free, worst |\n| --- | --- | --- | --- |")
    for name, (readings, power) in cases().items():
        still = shift_to_noise_ratio(readings, "known", power)
        free = shift_to_noise_ratio(readings, "free", power)
        print(f"| {name} | {still[:2].max():.2g} | {still[2:].max():.2g} | {free.max():.2g} |")


if __name__ == "__main__":
    main()
