"""Rigs with hidden errors, under ideal light and under the light of a real bench.

The errors of a rig are up to 0.3 mm and 5 mrad for detectors, 2 mrad for facets and the beam's
tilt, and 3 % for powers and scales. The mirror is away from the reference's pivot and from the
beam. The reference's standard uncertainties are 0.1 um and 0.5 urad. `simulated_bench` measures
rigs on a bench, and `calibrations` calibrates them as `facets calibrate` does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from facets.calibration.fitting.unknowns import (
    ALL,
    MOUNT,
    MOUNTING,
    PLACE,
    Choice,
    assign_values,
    block,
    values_of,
)
from facets.core.sensor import Sensor
from facets.core.units import Floats

from .bench_rays import RayBench

Rng = np.random.Generator
#: Standard uncertainty of the reference, mm and rad.
REFERENCE = np.array([1e-4] * 3 + [5e-7] * 3)
#: Half widths of the motion, mm and rad.
BOX = np.array([0.12, 0.12, 2.0, 6e-3, 6e-3, 8e-3])
#: Reach of a calibration's motion in x and y, mm. It exceeds the beam's sigma of 0.21 mm, because
#: only the curvature of the powers distinguishes gains, strips and the beam's size from the apex's
#: place.
REACH_MM = 0.25


def hidden() -> dict[str, float]:
    """Half the range of each hidden error of a parameter; mm, rad, and relative ones."""
    sigmas = {"beam.tilt_x": 2e-3, "beam.tilt_y": 2e-3}
    for letter in "abc":
        sigmas |= {f"facet_{letter}.{name}": 2e-3 for name in ("inclination", "azimuth")}
        sigmas |= {f"psd_{letter}.{name}": 0.3 for name in ("radius", "height")}
        sigmas[f"psd_{letter}.azimuth"] = 0.3 / 250
        sigmas |= {f"psd_{letter}.{name}": 5e-3 for name in ("roll", "pitch", "yaw")}
        sigmas[f"correction_{letter}.power"] = 0.03
        sigmas |= {f"correction_{letter}.{name}": 0.03 * 6.5 for name in ("y10", "z01")}
    return sigmas | dict(zip(MOUNTING, (20.0, 20.0, 40.0, 0.05, 0.05), strict=False))


def choice() -> Choice:
    """Unknowns of the calibration, with these half ranges as priors."""
    spread = hidden()
    return Choice(tuple(spread), np.array(list(spread.values())))


class Rig(NamedTuple):
    """A rig.  sensor: the true one.  values: its parameters, and the mirror's place on the
    reference."""

    sensor: Sensor
    values: Floats


def draw_rig(nominal: Sensor, rng: Rng) -> Rig:
    """A rig whose parameters differ from the nominal ones by random hidden errors."""
    values = values_of(nominal)
    for name, half in hidden().items():
        values[ALL.index(name)] += rng.uniform(-half, half)
    return Rig(assign_values(nominal, values), values)


def rms(error: Floats) -> Floats:
    """The root of the mean square of each column; NaN values are ignored."""
    root: Floats = np.sqrt(np.nanmean(error**2, axis=0))
    return root


class BenchRig(NamedTuple):
    """A rig on a bench.  rig: the rig under ideal light.  bench: the light of the bench."""

    rig: Rig
    bench: RayBench


def draw_bench_rig(nominal: Sensor, rng: Rng) -> BenchRig:
    """Sample a rig with all effects at once, each as large as on a good bench."""
    rig = draw_rig(nominal, rng)
    values = rig.values.copy()
    values[block(MOUNT)] = rng.uniform(-1, 1, 3) * [1e-3, 1e-3, 8e-3]
    for letter in "abc":
        for name in ("y20", "y11", "y02", "z20", "z11", "z02", "y30", "z03"):
            values[PLACE[f"correction_{letter}.{name}"]] = rng.uniform(-0.02, 0.02)
    sigma = nominal.beam.diameter_x / 4
    long, short, turn = sigma * (1 + 0.0125), sigma * (1 - 0.0125), rng.uniform(0, np.pi)
    axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    round_ = rng.uniform(2000, 6000) * rng.choice([-1, 1])
    bench = RayBench(
        covariance=axes @ np.diag([long**2, short**2]) @ axes.T,
        curvature=np.diag(1 / (round_ * rng.uniform(0.8, 1.25, 2))),
        wavelength=633e-6,
        metal=1.37 + 7.62j,
        polarisation=float(rng.uniform(0, np.pi)),
        strips=rng.uniform(0.004, 0.012, 3),
        depth=rng.uniform(5e-6, 3e-5, (3, 2)),
        width=0.03,
        background=np.column_stack([rng.uniform(1e-4, 5e-4, 3), rng.uniform(-3, 3, (3, 2))]),
    )
    return BenchRig(Rig(assign_values(nominal, values), values), bench)
