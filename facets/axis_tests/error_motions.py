"""Error motions of a linear or rotary axis from the poses of its dwells.

The names are those of ISO 230-1:2012, 3.4 and 3.5: E, the direction of the error (X, Y, Z: shifts;
A, B, C: rotations about these), and the axis that moves. EXX is the positioning error of the axis
X, EYX and EZX are its straightness errors, EAX, EBX and ECX its angular errors. Of a rotary axis C,
ECC is the angular positioning error, EXC and EYC are radial, EZC is axial, EAC and EBC are tilts.

The parts of the motion that depend on the set-up of the test are no errors of the axis and are
removed. They are a constant of each component, the direction of the axis relative to the object's
axes (unless the reference line is the nominal one), and the position of a rotary axis. They are
linear in the poses' errors, which are therefore propagated to the error motions by draws from the
joint distribution of all poses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from ..core import (
    MIRROR,
    Booleans,
    Calibration,
    Floats,
    Integers,
    Knowledge,
    MeasuredObject,
    Sensor,
    object_displacements,
    rotation_matrix,
)
from ..detectors import MISFIT, step_variances
from ..estimation import (
    Plan,
    Propagation,
    carry,
    common_detectors,
    lasting_covariance,
    make_plan,
    propagate,
    propagate_in_light,
    root_of_covariance,
)

#: Directions of errors and names of axes: shifts along X, Y, Z, and rotations about these.
LETTERS = "XYZABC"
ReferenceLine = Literal["least-squares", "end-points", "nominal"]
#: Largest number of draws of the poses' errors, and of the numbers in all draws together.
MOST_DRAWS, MOST_NUMBERS = 2000, 8_000_000
SEED = 1


@dataclass(frozen=True)
class Commands:
    """Commanded positions in their order.

    positions: (k,) mm or rad.  direction: (k,) 0 for an approach in the positive direction, 1 in
    the negative.
    """

    positions: Floats
    direction: Integers


@dataclass(frozen=True)
class AxisTest:
    """The setting of a test of an axis.

    Attributes
    ----------
    axis
        X, Y or Z: linear along, A, B or C: rotary about this axis of the object.
    commands
        The commanded positions in their order; None for unknown, equally spaced positions.
    body
        The point of interest and the object's axes; by default the mirror's apex and axes.
    line
        Reference of straightness, and of the tilt of a rotary axis: the line by least squares, the
        line through the means at the first and the last target, or the object's axis.
    shortest_s
        Duration of the shortest dwell, s.
    """

    axis: str
    commands: Commands | None = None
    body: MeasuredObject = MIRROR
    line: ReferenceLine = "least-squares"
    shortest_s: float = 0.2

    @property
    def main(self) -> int:
        """The number of the component along or about which the axis moves."""
        return LETTERS.index(self.axis)


@dataclass(frozen=True)
class Visits:
    """Dwells of an axis at its target positions.

    Attributes
    ----------
    targets
        (m,) the commanded positions, ascending; mm or rad.
    target, direction, run
        (k,) number of each dwell's target; 0 for an approach in the positive direction, 1 in the
        negative; number of the run.
    time
        (k,) s.
    states
        (k, 8) means over the samples of each dwell; mm and rad.
    samples
        (k,) number of samples in each mean.
    excess
        (6,) standard deviation of the means over that due to the sensor's noise, 1 or more.
    trend
        (k, 6) drift of the errors, which is removed; mm and rad.
    used
        (k, 3) whether each detector took part in each dwell; None for all.
    """

    targets: Floats
    target: Integers
    direction: Integers
    run: Integers
    time: Floats
    states: Floats
    samples: Floats
    excess: Floats
    trend: Floats | float = 0.0
    used: Booleans | None = None

    def select(self, chosen: Booleans, trend: Floats) -> Visits:
        """The chosen dwells (k,), with a drift (k, 6) that is to be removed."""
        names = ("target", "direction", "run", "time", "states", "samples")
        some = {name: getattr(self, name)[chosen] for name in names}
        used = None if self.used is None else self.used[chosen]
        return replace(self, **some, trend=trend[chosen], used=used)

    def grid(self, values: Floats) -> Floats:
        """Arrange values (..., k) of the dwells by target, direction and run: (..., m, 2, n)."""
        shape = (len(self.targets), 2, int(self.run.max()) + 1)
        grid: Floats = np.full((*values.shape[:-1], *shape), np.nan)
        grid[..., self.target, self.direction, self.run] = values
        return grid


@dataclass(frozen=True)
class ErrorMotions:
    """The six error motions of an axis at its targets, with draws of their errors.

    Attributes
    ----------
    axis
        X, Y, Z, A, B or C.
    targets
        (m,) mm or rad.
    values
        (6, m, 2, n) by component, target, direction and run; mm and rad, NaN without a run.
    draws
        (6, draws, m, 2, n) errors of the values, from their joint distribution.
    frame
        (3, 3) the axes of the errors, as rows in the object's axes; the main one is the direction
        of the axis under test.
    offset
        (3,) from the point of interest to a rotary axis, mm; 0 along the axis and for a linear
        axis.
    """

    axis: str
    targets: Floats
    values: Floats
    draws: Floats
    frame: Floats
    offset: Floats

    @property
    def names(self) -> list[str]:
        """The names EXX, EYX, ... in the order of the components."""
        return [f"E{letter}{self.axis}" for letter in LETTERS]

    @property
    def main(self) -> int:
        """The number of the component along or about which the axis moves."""
        return LETTERS.index(self.axis)

    @property
    def is_rotary(self) -> bool:
        """Whether the axis turns, instead of moving along a line."""
        return self.main >= 3


def measure_error_motions(
    sensor: Sensor,
    knowledge: Knowledge,
    visits: Visits,
    test: AxisTest,
    is_tracked: bool = False,
) -> ErrorMotions:
    """Compute the error motions of an axis and draws of their errors.

    Parameters
    ----------
    sensor, knowledge
        The sensor, and the knowledge of its beam with which the poses were solved.
    visits
        The dwells of the axis.
    test
        The axis, the point of interest and the object's axes, and the reference of straightness.
    is_tracked
        Whether the beam followed the mirror, so that the error of its position differs from dwell
        to dwell.

    Returns
    -------
    ErrorMotions
        In mm and rad.
    """
    fitted = fit_errors(visits, test)
    drawn = draw_pose_errors(sensor, knowledge, visits, is_tracked)
    off = np.einsum("kij,dkj->dki", fitted.slopes, drawn).reshape(len(drawn), -1)
    off -= (off @ fitted.solver.T) @ fitted.design.T
    return ErrorMotions(
        test.axis,
        visits.targets,
        visits.grid(fitted.values.T),
        visits.grid(np.moveaxis(off.reshape(drawn.shape), -1, 0)),
        fitted.frame,
        fitted.offset,
    )


class FittedErrors(NamedTuple):
    """Errors of dwells without the set-up, and the matrices that remove it.

    values: (k, 6).  frame, offset: as in `ErrorMotions`.  slopes: (k, 6, 6) derivatives of the
    deviations by the mirror's pose, before the removal.  design, solver: (6 k, q) and (q, 6 k), of
    the least-squares fit of the set-up.
    """

    values: Floats
    frame: Floats
    offset: Floats
    slopes: Floats
    design: Floats
    solver: Floats


def fit_errors(visits: Visits, test: AxisTest) -> FittedErrors:
    """Fit the set-up of a test, and remove it from the deviations of the dwells."""
    main, line = test.main, test.line
    moved, slopes, _ = object_displacements(visits.states[:, :6], np.zeros(6), test.body)
    commanded = visits.targets[visits.target]
    frame, offset = np.eye(3), np.zeros(3)
    first: ReferenceLine = "least-squares" if line == "nominal" else line
    for step in (first, first, line):  # the direction; corrections of second order
        raw = deviations_of(moved, commanded, main, frame) - visits.trend
        design, weights = set_up_design(visits, moved, main, frame, step)
        if step == "nominal":  # the axis leans from the object's, and moves as far as it does
            for n in crosswise(main):
                raw[:, n] += commanded * frame[main % 3, n % 3] / frame[main % 3, main % 3]
        solver = np.linalg.pinv(design * weights[:, None]) * weights
        sizes = solver @ raw.ravel()
        if step != "nominal":
            frame = turn_frame(frame, main, sizes[6:8])
    errors = (raw.ravel() - design @ sizes).reshape(raw.shape)
    if main >= 3:
        offset[[n for n in range(3) if n != main - 3]] = -sizes[-2:]
    by_state = slopes_of_deviations(moved, commanded, main, frame) @ slopes
    return FittedErrors(errors, frame, offset, by_state, design, solver)


def deviations_of(moved: Floats, commanded: Floats, main: int, frame: Floats) -> Floats:
    """Displacements (k, 6) less the commanded motion: shifts, and rotation vectors, along the axes
    `frame` (3, 3)."""
    from scipy.spatial.transform import Rotation

    shifts = moved[:, :3] @ frame.T
    turns = frame @ rotation_matrix(moved[:, 3:]) @ frame.T
    if main < 3:
        shifts[:, main] -= commanded
    else:
        vectors = np.zeros((len(commanded), 3))
        vectors[:, main - 3] = -commanded
        turns = turns @ Rotation.from_rotvec(vectors).as_matrix()
    return np.hstack([shifts, Rotation.from_matrix(turns).as_rotvec()])


def slopes_of_deviations(moved: Floats, commanded: Floats, main: int, frame: Floats) -> Floats:
    """Derivatives (k, 6, 6) of `deviations_of` by the displacements."""
    step, columns = 1e-5, []
    for n in range(6):
        ends = [
            deviations_of(moved + sign * step * np.eye(6)[n], commanded, main, frame)
            for sign in (1, -1)
        ]
        columns.append((ends[0] - ends[1]) / (2 * step))
    return np.stack(columns, axis=-1)


def crosswise(main: int) -> tuple[int, int]:
    """The two components across the axis that depend on its direction: the straightness errors of a
    linear axis, the tilts of a rotary one."""
    start = main // 3 * 3
    first, second = (n for n in range(start, start + 3) if n != main)
    return first, second


def set_up_design(
    visits: Visits, moved: Floats, main: int, frame: Floats, line: ReferenceLine
) -> tuple[Floats, Floats]:
    """The design matrix (6 k, q) of the set-up, and the weights (6 k,) of its rows.

    Its columns are a constant of each component, two slopes of the axis's direction, and two
    distances of a rotary axis.
    """
    count, commanded = len(moved), visits.targets[visits.target]
    columns = [np.tile(unit, count) for unit in np.eye(6)]
    weights = np.ones((count, 6))
    if line != "nominal":
        for n in crosswise(main):
            columns.append(np.kron(commanded, np.eye(6)[n]))
            if line == "end-points":
                ends = (visits.target == 0) | (visits.target == len(visits.targets) - 1)
                weights[~ends, n] = 0.0
    if main >= 3:
        turns = frame @ rotation_matrix(moved[:, 3:]) @ frame.T - np.eye(3)
        for n in range(3):
            if n != main - 3:
                columns.append(np.hstack([turns[:, :, n], np.zeros((count, 3))]).ravel())
    return np.stack(columns, axis=1), weights.ravel()


def turn_frame(frame: Floats, main: int, slopes: Floats) -> Floats:
    """Axes `frame` turned so that the main one has the direction with these slopes (2,)."""
    from scipy.spatial.transform import Rotation

    direction = np.zeros(3)
    direction[main % 3] = 1.0
    first, second = crosswise(main)
    direction[[first % 3, second % 3]] = slopes
    across = np.cross(np.eye(3)[main % 3], direction)
    size = float(np.linalg.norm(across))
    turn = Rotation.from_rotvec(across / size * np.arctan(size) if size else across)
    turned: Floats = turn.as_matrix().T @ frame
    return turned


def draw_pose_errors(
    sensor: Sensor, knowledge: Knowledge, visits: Visits, is_tracked: bool = False
) -> Floats:
    """Draw errors (draws, k, 6) of the dwells' poses from their joint distribution.

    Noise is independent from dwell to dwell; the errors of the calibration and of the prior of a
    beam at rest follow `lasting_covariance`. Errors that may or may not be equal in two visits of a
    target from the same side are counted twice: as common to both visits, and as independent.
    """
    plan = make_plan(sensor, knowledge)
    sides, side = np.unique(2 * visits.target + visits.direction, return_inverse=True)
    count, kinds = len(visits.states), len(sides)
    draws = min(MOST_DRAWS, max(400, MOST_NUMBERS // (6 * count)))
    rng = np.random.default_rng(SEED)
    used = np.ones((count, 3), dtype=bool) if visits.used is None else visits.used
    by_dwell = propagate_in_light(sensor, visits.states, plan, used)
    noise = by_dwell.noise / visits.samples[:, None, None]
    noise[:, :6, :6] *= np.outer(visits.excess, visits.excess)
    noise += doubtful_covariance(sensor, by_dwell, (visits.states, used), plan, is_tracked)
    states = np.stack([visits.states[side == n].mean(axis=0) for n in range(kinds)])
    in_all = np.stack([common_detectors(used[side == n]) for n in range(kinds)])
    by_side = propagate_in_light(sensor, states, plan, in_all)
    doubtful = doubtful_covariance(
        sensor, by_side, (states, in_all), plan, is_tracked, misfit=False
    )
    if is_tracked:
        by_side.priors[:, :, :2] = 0.0
    lasting = lasting_covariance(sensor, by_side, states)[:, :6, :, :6]
    lasting[np.arange(kinds), :, np.arange(kinds)] += doubtful[:, :6, :6]
    common = (
        rng.standard_normal((draws, 6 * kinds))
        @ root_of_covariance(lasting.reshape(6 * kinds, -1)).T
    )
    drawn = rng.standard_normal((draws, count, 6))
    out: Floats = np.einsum("kij,dkj->dki", root_of_covariance(noise[:, :6, :6]), drawn)
    return out + common.reshape(draws, kinds, 6)[:, side]


def doubtful_covariance(
    sensor: Sensor,
    propagation: Propagation,
    dwells: tuple[Floats, Booleans],
    plan: Plan,
    is_tracked: bool,
    misfit: bool = True,
) -> Floats:
    """The covariance (k, 8, 8) of errors that may or may not be equal in two visits of a target.

    They are those of the converters' steps, of the position of a beam that follows the mirror, and,
    with `misfit`, the unexplained residuals of a calibration.

    dwells: their states (k, 8), and whether each detector was used (k, 3).
    """
    unit = Calibration(MISFIT, tuple(map(tuple, np.eye(9).tolist())))
    gain = propagate(sensor, unit, *dwells, plan).slopes
    assert gain is not None
    variances = np.zeros((len(gain), 9))
    if sensor.electronics is not None:
        variances += np.nan_to_num(step_variances(sensor, propagation.readings))
    if sensor.calibration is not None and misfit:
        sizes = np.diag(sensor.calibration.covariance)
        for name, size in zip(sensor.calibration.names, sizes, strict=True):
            if name in MISFIT:
                variances[:, MISFIT.index(name)] += size
    covariance = carry(gain, variances[:, None, :] * np.eye(9))
    if is_tracked:
        covariance += carry(propagation.priors[:, :, :2], np.eye(2))
    return covariance
