"""The poses that a calibration should visit, chosen by what their readings determine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..config import Config
from ..core.names import STATE_COLUMNS, STATE_UNITS
from ..core.units import Floats
from .identifiability import choose_poses, mean_reduction, pose_information
from .table import choice
from .tour import short_order, travel


@dataclass(frozen=True)
class Proposal:
    """Poses to calibrate with, in the order of a short path.

    columns: of a table: the poses (mm, mrad), their rank by information, and the uncertainty that
    is left after that many. reduction: standard uncertainties of the parameters after the
    calibration over those before, geometric mean; random_reduction: the same with as many random
    poses. saving: share of the path's length that the order saves. upward: (6,) the share of poses
    that each axis approaches from below: where both directions are frequent, a calibration finds
    the backlash of the reference.
    """

    columns: dict[str, Floats]
    reduction: float
    random_reduction: float
    saving: float
    upward: Floats


def propose_poses(settings: Config, poses: Floats, count: int) -> Proposal:
    """Choose those of poses (n, 6), mm and rad, whose readings together determine the parameters
    best."""
    sensor, calibrate = settings.sensor, settings.calibrate
    unknowns = choice(sensor, calibrate)
    sigma = np.array(calibrate.reference)
    chosen, remaining = choose_poses(sensor, unknowns, sigma, poses, count)
    rows = pose_information(sensor, unknowns, sigma, poses[:count]).reshape(-1, len(unknowns.names))
    shares = poses[chosen] / np.maximum(np.abs(poses).max(axis=0), 1e-12)
    rest = np.zeros((1, 6))
    order = short_order(shares, rest[0])
    columns = {
        name: poses[chosen[order], n] / STATE_UNITS[n] for n, name in enumerate(STATE_COLUMNS[:6])
    }
    columns["rank"], columns["mean_left"] = order + 1, remaining[order]
    long, short = (travel(np.vstack([rest, places])) for places in (shares, shares[order]))
    random_reduction = mean_reduction(np.eye(rows.shape[1]) + rows.T @ rows)
    steps = np.diff(np.vstack([rest, shares[order]]), axis=0)
    upward = (steps > 0).sum(axis=0) / np.maximum((steps != 0).sum(axis=0), 1)
    return Proposal(columns, remaining[-1], random_reduction, 1 - short / long, upward)
