"""The sensors and states that the tests run on."""

import numpy as np
from facets.experiments.studies import sensors as experiments_sensors

from facets import BenchLight, Calibration, Sensor, readings

SENSORS = experiments_sensors.SENSORS

#: How far the mirror's edges roll off, mm.
DEPTHS = (6e-5, 3e-5, 5e-5, 7e-5, 2e-5, 4e-5)
#: All effects of the light of a bench.
ALL = BenchLight(
    curvature_xx=1 / 2100,
    curvature_xy=2e-5,
    curvature_yy=1 / 3000,
    wavelength=632.8e-6,
    rolloff=DEPTHS,
    rolloff_width=0.1,
    strips=(0.01, 0.014, 0.008),
    tip=0.002,
    background=((5e-4, 1, 2), (4e-4, -1, 0.5), (6e-4, 0, -2)),
    index=(1.37, 7.62),
    polarization=0.3,
)
#: A beam's profile without any symmetry.
PROFILE = (0.012, -0.006, 0.02, 0.004, -0.008)
ASYMMETRY = (0.01, -0.02, 0.015, 0.008)
STAINS = tuple(map(tuple, np.random.default_rng(3).uniform(-5e-3, 5e-3, (3, 15)).tolist()))


def states(count: int, seed: int, offset: float = 0.2, angle: float = 0.02) -> np.ndarray:
    """Sample states with the apex up to `offset` mm off the beam and tilts up to `angle` rad."""
    rng = np.random.default_rng(seed)
    radius, turn = offset * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    state = np.zeros((count, 8))
    state[:, :3] = rng.uniform(-6, 6, (count, 3))
    state[:, 3:6] = rng.uniform(-angle, angle, (count, 3))
    state[:, 6] = state[:, 0] - radius * np.cos(turn)
    state[:, 7] = state[:, 1] - radius * np.sin(turn)
    return state


def box(count: int, seed: int, reach: float = 0.12) -> np.ndarray:
    """Sample states of the mirror in the paper's box, up to `reach` mm off a beam at rest."""
    some = np.zeros((count, 8))
    ends = [reach, reach, 2, 6e-3, 6e-3, 6e-3]
    some[:, :6] = np.random.default_rng(seed).uniform(-1, 1, (count, 6)) * ends
    return some


def lit_states(sensor, low, high, share, count, rng) -> np.ndarray:
    """Sample states in a box of poses (6,), of which each facet has this fraction of the light."""
    pose = rng.uniform(low, high, (count, 6))
    some = np.concatenate([pose, pose[:, :2] - rng.uniform(-0.3, 0.3, (count, 2))], axis=1)
    return some[readings(sensor, some)[:, 2::3].min(axis=1) >= share * sensor.beam.power]


#: A calibration that knows less than a good one, so that its part counts beside the noise.
SIGMAS = {"psd_a.radius": 2e-3, "psd_b.height": 1e-3, "psd_c.azimuth": 1e-5, "psd_a.roll": 2e-4,
          "facet_b.inclination": 4e-6, "facet_c.azimuth": 6e-6, "beam.tilt_x": 5e-6}  # fmt: skip


def calibrated() -> Sensor:
    """The paper's sensor with a calibration of these uncertainties, whose errors are correlated."""
    mixing = np.random.default_rng(1).standard_normal((len(SIGMAS), 2 * len(SIGMAS)))
    sizes = np.array(list(SIGMAS.values()))
    covariance = np.corrcoef(mixing) * np.outer(sizes, sizes)
    known = Calibration(tuple(SIGMAS), tuple(map(tuple, covariance.tolist())))
    return Sensor(calibration=known)
