"""What an estimate is asked, what it is screened by, and how it can end."""

from __future__ import annotations

from typing import Any, NamedTuple

Array = Any

CONVERGED, MAX_STEPS, SINGULAR, OUT_OF_RANGE, NO_LIGHT, NON_FINITE, STALLED = range(7)

#: Converged when the next step would move the fit by less than this, in sigmas, squared.
SMALL = 1e-12
#: A detector with less light than this, in standard deviations of its power, is left out: the noise
#: of its spot's place, which goes as 1 / power, is then no Gaussian that a weight could stand for.
FAINTEST = 10.0
#: A step to where a detector that reads light would have less than this, in standard deviations of
#: its power, is a step into the dark: there the readings do not tell the way back.
DARK = 1.0
#: An estimate that starts in the dark has so many steps to find the light.
STEPS_IN_THE_DARK = 8
#: After each so many steps the sum of squares must have fallen below this share of what it was
#: before them; else the estimate goes round in circles and is stalled.
PATIENCE, SLOWEST = 10, 0.9
#: A step that the damping has shortened by this much, and that still does not help: stalled.
HEAVIEST = 1e12
#: Rounding of a computed reading, relative to the detector's distance or to the power.
ROUNDING = 4e-15
UNKNOWNS = 9
ROWS = 9 + 3 + UNKNOWNS


class Problem(NamedTuple):
    """What is known beside the readings, and how to go on.

    means: (n or 1, 3) of bx, by (mm) and power (mW).  weight: (3,) 1/sigma of these, 0 where they
    are unknown.  free: (m,) numbers of the unknowns that are asked for, ascending.
    starts: (n or 1, 9), with the values of what is known.
    previous: whether to start where the last converged sample ended.
    damped: whether a step that does not help is shortened (Levenberg-Marquardt), or accepted.
    """

    means: Array
    weight: Array
    free: Array
    starts: Array
    previous: bool
    max_steps: int
    damped: bool


class Limits(NamedTuple):
    """What a reading is screened by.

    noise: (3,) a centroid's sigma (mm) at a power (mW), and a power's sigma (mW).
    half_sizes: (3, 2) of the detectors' sensitive areas, mm.  eight: leave out the last power.
    rounding: (2,) of a computed place, mm, and of a power, mW.
    """

    noise: Array
    half_sizes: Array
    eight: bool
    rounding: Array


#: The layers of a workspace: what the model gives, the weighted Jacobian's columns and residuals,
#: the normal equations here and at the step that is tried, and what is made of them.
FOUND, COLUMNS, HERE, THERE, FACTOR, INVERSE, COVARIANCE, VECTORS, LAYERS = range(9)
#: The rows of the layer VECTORS.
WEIGHTS, TRIAL = range(2)


class Workspace(NamedTuple):
    """Memory that every estimate of a batch uses again.

    layers: (LAYERS, 10, 10).  rows: (ROWS, 10) for the reflections.  outlines: see `model.kernels`.
    """

    layers: Array
    rows: Array
    outlines: Array


class Model(NamedTuple):
    """address: of `model.evaluators.linearised`.  packed: the sensor's vectors."""

    address: int
    packed: Array


class Readings(NamedTuple):
    """values: (n, 9) mm, mW.  sigmas: (n, 9) their standard deviations; empty where those of
    `Limits` hold."""

    values: Array
    sigmas: Array


class Results(NamedTuple):
    """states: (n, 9), with the power.  used: (n, 3) the detectors that took part.
    status, steps: (n,).  residuals: (n,) root of the sum of squares left.
    covariances: (n, 8, 8), zeroed, or empty.  Where status is not CONVERGED, states, residuals and
    covariances become NaN."""

    states: Array
    used: Array
    status: Array
    steps: Array
    residuals: Array
    covariances: Array
