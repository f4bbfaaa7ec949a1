"""Test vectors of the C code: readings and the poses that `facets.solve` finds for them."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..core.errors import InputError
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.noise import add_noise
from ..estimation.solver import solve
from ..model.arrays import half_sizes, reaches, readings

#: Numbers of poses with the beam free and known; each has a reading without and one with noise.
FREE, KNOWN = 16, 8
SEED = 1


class TestVectors(NamedTuple):
    """Readings with the poses that `facets.solve` finds for them.

    reading: (n, 9), mm and mW.  beam_known: (n,) whether the beam's position is known.  status:
    (n,) codes.  state, uncertainty: (n, 8) mm and rad.
    """

    reading: Floats
    beam_known: np.ndarray
    status: np.ndarray
    state: Floats
    uncertainty: Floats


def sample_states(sensor: Sensor, count: int, rng: np.random.Generator) -> Floats:
    """Sample states (count, 8) around zero at which every spot reaches its detector.

    Raises `InputError` if a spot misses its detector even at zero.
    """
    if not reaches(sensor, np.zeros((1, 8))).all():
        raise InputError(
            "at the mirror's zero pose a spot misses its detector, so that there is nothing to "
            "test the C code with; see `facets render`"
        )
    half, distance = half_sizes(sensor), max(psd.radius for psd in sensor.psds)
    across = 0.15 * min(sensor.beam.diameter_x, sensor.beam.diameter_y)
    along, turn = half.min() / 2, half.min() / (4 * distance)
    sizes = np.array([across, across, along, turn, turn, turn, across, across])
    states = np.zeros((0, 8))
    while len(states) < count:
        drawn = sizes * rng.uniform(-1, 1, (4 * count, 8))
        states = np.concatenate([states, drawn[reaches(sensor, drawn).all(axis=1)]])
        sizes *= 0.9
    return states[:count]


def unsolvable_readings(reading: Floats, half: Floats) -> Floats:
    """Readings (6, 9) that cannot be solved, or only from two detectors.

    reading: (9,) a solvable reading, mm and mW.  half: (3, 2) half sizes of the detectors, mm.
    """
    rows = np.tile(reading, (6, 1))
    rows[0] = 0.0
    rows[1, 2::3] *= 1e-9
    rows[2, 4] = np.nan
    rows[3, 0] = 3 * half[0, 0]
    rows[4, 6:9] = np.inf
    rows[5] = -rows[5]
    return rows


def make_vectors(sensor: Sensor) -> TestVectors:
    """Make the test vectors of a sensor, which are the same in every run."""
    rng = np.random.default_rng(SEED)
    parts = []
    for count, beam in ((FREE, "free"), (KNOWN, "known")):
        states = sample_states(sensor, count, rng)
        if beam == "known":
            states[:, 6:] = 0
        exact = readings(sensor, states)
        bad = unsolvable_readings(exact[0], half_sizes(sensor))
        parts.append(
            solve_readings(
                sensor, np.concatenate([exact, add_noise(sensor, exact, rng), bad]), beam
            )
        )
    return TestVectors(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def solve_readings(sensor: Sensor, rows: Floats, beam: str) -> TestVectors:
    plain = replace(sensor, calibration=None)  # the C code has no uncertainty of the parameters
    poses = solve(plain, rows, beam=beam)  # type: ignore[arg-type]
    is_known = np.full(len(rows), beam == "known")
    return TestVectors(rows, is_known, poses.status, poses.state, poses.uncertainty)
