"""The sensors and states that the tests run on."""

import numpy as np
from facets.experiments.sensors import SENSORS as SENSORS


def states(count: int, seed: int, offset: float = 0.2, angle: float = 0.02) -> np.ndarray:
    """Random states: apex off the beam's centre by up to `offset` mm, tilts up to `angle` rad."""
    rng = np.random.default_rng(seed)
    radius, turn = offset * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    state = np.zeros((count, 8))
    state[:, :3] = rng.uniform(-6, 6, (count, 3))
    state[:, 3:6] = rng.uniform(-angle, angle, (count, 3))
    state[:, 6] = state[:, 0] - radius * np.cos(turn)
    state[:, 7] = state[:, 1] - radius * np.sin(turn)
    return state
