"""Random poses at which a sensor can be calibrated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..config import Config
from ..core.errors import InputError
from ..core.units import Floats
from .ranges import axis_ranges, clearances

#: Displacement in x and y, in diameters of the beam: large enough to separate gains, lost strips
#: and the beam's size from the apex's position.
REACH_DIAMETERS = 0.3
#: Least distance of a spot's centre from its detector's edge, mm.
EDGE_MM = 1.2
#: Least power on a detector, relative to the noise of the power.
LEAST_SNR = 100.0
#: Number of random poses from which the proposed ones are chosen.
CANDIDATES = 4000


def poses_to_calibrate_with(settings: Config) -> Floats:
    """Random poses (n, 6) within half the range of z and the angles, mm and rad. Raises
    `InputError` if none has light on all detectors."""
    sensor, beam = settings.sensor, settings.sensor.beam
    reach = np.array([a.symmetric / 2 for a in axis_ranges(sensor, settings.range, np.zeros(6))])
    reach[:2] = np.maximum(reach[:2], REACH_DIAMETERS * min(beam.diameter_x, beam.diameter_y))
    shares = np.random.default_rng(1).uniform(-1, 1, (CANDIDATES, 6))
    measured = np.isfinite(settings.calibrate.reference)
    poses = np.where(measured, shares, 0.0) * reach
    rules = replace(settings.range, whole_spot=False, snr=min(settings.range.snr, LEAST_SNR))
    margin = clearances(sensor, poses, rules)
    margin[:, 0] -= max(
        EDGE_MM / (size / 2) for psd in sensor.psds for size in (psd.size_y, psd.size_z)
    )
    possible: Floats = poses[margin.min(axis=1) > 0]
    if not len(possible):
        raise InputError(
            f"{settings.name}: no pose of a motion to calibrate with has light on all detectors "
            f"and its spots {EDGE_MM} mm from their edges"
        )
    return possible
