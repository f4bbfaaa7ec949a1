"""How steady the laser's power was: what a fit says of it, and the fit again with that known.

With a power for each sample the detectors' gains and the apex's place hardly part: three powers
then tell two shares. A laser drifts slowly and jitters little; how little is taken from the data,
by the likelihood of the readings once everything else is free (restricted maximum likelihood).
The scatter of the powers that a fit finds would be no measure: most of it is the fit's own noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.errors import InputError
from ..core.sensor import Sensor
from ..core.units import Floats
from .bundle_adjustment import OWN_UNITS, Data
from .fit import NORMAL_MEDIAN, Fit, Task, fit, huber_roots
from .scatter import NAMES, Likelihood, prior_variances
from .small_matrices import one_thread
from .unknowns import PLACE, POWER_DRIFT, block

#: Jitters that are tried, shares from sample to sample; one beyond the last stays free.
JITTERS = np.geomspace(5e-5, 0.02, 14)
#: How much less likely a jitter may be than the likeliest, in -2 log L: one standard deviation. The
#: largest such is taken, since a laser that is thought too steady makes poses look better known.
ONE_SIGMA_FALL = 1.0
#: A jitter that changes by less than this factor changes no fit.
SAME_JITTER_FACTOR = 1.25
#: What the slow drift may be, a share, 1 sigma.
DRIFT_SIGMA = 0.3


@one_thread
def fit_steady_laser(sensor: Sensor, data: Data, result: Fit, robust: float | None) -> Fit:
    """Fit again with a laser that drifts slowly and jitters as little as the data say.

    Returns the same fit if the jitter is as assumed, or if the laser jumps.
    """
    if data.slow is None or not result.choice.power:
        return result
    start = result if np.isfinite(result.choice.power) else add_slow_drift(data, result)
    jitter = estimate_jitter(sensor, data, start, robust)
    before = result.choice.power
    if jitter is None or max(jitter, before) < SAME_JITTER_FACTOR * min(jitter, before):
        return result
    again = fit(sensor, data, replace(start.choice, power=jitter), robust, start)
    return again if again.ended else result


def add_slow_drift(data: Data, result: Fit) -> Fit:
    """Convert a fit with one power for each sample to one with a slow drift, without fitting
    again."""
    assert data.slow is not None
    rows = np.column_stack([np.ones(len(data.slow)), data.slow])
    power, weight = result.own_values[:, 6], np.ones(len(rows))
    for _ in range(5):
        ways, *_ = np.linalg.lstsq(rows * weight[:, None], power * weight, rcond=None)
        residual = power - rows @ ways
        jitter = max(float(JITTERS[0]), NORMAL_MEDIAN * float(np.median(np.abs(residual))))
        weight = huber_roots(residual / jitter, 3.0)
    level = result.all_values[PLACE["beam.power"]]
    if level * (1 + ways[0]) <= 0:
        raise InputError(
            f"the fit puts the laser's mean power at {level * (1 + ways[0]):.4g} mW, so these "
            f"{len(rows)} samples do not determine it; take more samples, over a wider range of "
            "poses, and see what the motion does not determine"
        )
    known = {"beam.power": DRIFT_SIGMA * level} | dict.fromkeys(POWER_DRIFT, DRIFT_SIGMA)
    every, own_values = result.all_values.copy(), result.own_values.copy()
    every[PLACE["beam.power"]] *= 1 + ways[0]
    every[block(POWER_DRIFT)] = ways[1:] / (1 + ways[0])
    own_values[:, 6] = residual / (1 + ways[0])
    wide = replace(result.choice.add_unknowns(known), power=jitter)
    return replace(result, choice=wide, all_values=every, own_values=own_values)


def estimate_jitter(sensor: Sensor, data: Data, start: Fit, robust: float | None) -> float | None:
    """The largest jitter that is about as likely as the likeliest; None beyond all of `JITTERS`."""
    task = Task(sensor, data, start.choice, robust)
    unlikely = jitter_likelihoods(task, start)
    good = np.flatnonzero(unlikely < unlikely.min() + ONE_SIGMA_FALL)
    return None if good[-1] == len(JITTERS) - 1 else float(JITTERS[good[-1]])


def jitter_likelihoods(task: Task, start: Fit) -> Floats:
    """-2 log L of each of `JITTERS`, up to a constant, by the model linearised at a fit."""
    like, known = Likelihood(task, start), prior_variances(task.data, task.choice)
    known[7:] = (task.choice.beam / OWN_UNITS[7]) ** 2
    out = np.empty(len(JITTERS))
    for n, jitter in enumerate(JITTERS.tolist()):
        known[6] = (jitter / OWN_UNITS[6]) ** 2
        out[n] = like.restrict(known, np.zeros(len(NAMES))).unlikely
    return out
