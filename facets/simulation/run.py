"""Move a configured sensor: true states, readings, poses and their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arguments import check_arguments
from ..core.errors import InputError
from ..core.names import POSE, READING_COLUMNS, STATE_COLUMNS, state_columns
from ..core.notebook import show_shortly
from ..core.rigid_body import MIRROR, MeasuredObject
from ..core.sensor import Drift, Sensor
from ..core.settings import Config, Solve
from ..core.units import Floats
from ..detectors.correction import invert_correction
from ..detectors.drift import draw_beam_and_temperature, draw_readings
from ..detectors.noise import add_noise, fullness
from ..detectors.skew import align, delayed_readings
from ..estimation.measurement import Measurement
from ..estimation.object_pose import transform
from ..estimation.solution import LABELS, Poses, Samples, Solution, worded_columns
from ..estimation.tally import Tally
from ..estimation.zero import PoseColumns
from ..files.columns import join_columns
from ..model.arrays import is_on_detector, mask_missed_spots
from ..tracking.closed_loop import simulate_following
from .motion import find_motion, shaker_force, states
from .reference import reference_columns, reference_poses


@show_shortly
@dataclass(frozen=True)
class Segment:
    """One simulated motion.

    time: (n,) s.  truth: (n, 8) mm, rad.  readings: (n, 9) as solved, NaN for a detector that its
    spot misses.  place: (n, 2) the reported place of the beam, mm.  reached: (n, 3) whether the
    spots lie on their detectors.  saturated: (n, 3) whether a detector has too much light to be
    read.  poses: solved by the measurement.  force: (n,) of a vibration's shaker, N.
    """

    name: str
    time: Floats
    truth: Floats
    readings: Floats
    place: Floats
    reached: NDArray[np.bool_]
    saturated: NDArray[np.bool_]
    poses: Poses
    measurement: Measurement
    force: Floats | None = None

    @property
    def solution(self) -> Solution:
        """The solution of each sample."""
        return self.poses.solution

    @property
    def error(self) -> Floats:
        """Estimate minus truth, (n, 8), NaN if not solved."""
        error: Floats = self.solution.state - self.truth
        return error


@dataclass(frozen=True)
class AxisErrors:
    """The errors of one axis of the pose in a segment; mm or rad.

    low, high: of the true motion.  largest: error.  rms: error.  uncertainty: root mean square of
    the solver's standard uncertainty.
    """

    name: str
    low: float
    high: float
    largest: float
    rms: float
    uncertainty: float

    @property
    def is_varied(self) -> bool:
        """Whether the error differs over the range."""
        return self.high > self.low


def read_detectors(
    sensor: Sensor, time: Floats, truth: Floats, noise: bool, rng: np.random.Generator
) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
    """Readings (n, 9) of a simulated bench, whether spots reach their detectors (n, 3), and whether
    these are saturated (n, 3)."""
    if not noise:
        exact = delayed_readings(sensor, time, truth, truth)
        measured = mask_missed_spots(sensor, exact, exact)
    else:
        exact = light_of_bench(sensor, time, truth, rng)
        measured = add_noise(sensor, exact, rng)
    reached = is_on_detector(sensor, exact)
    # a detector without light has no reading either
    saturated = reached & np.isnan(measured[:, 2::3]) & (fullness(sensor, exact) > 0.5)
    return invert_correction(sensor, measured), reached, saturated


def light_of_bench(sensor: Sensor, time: Floats, truth: Floats, rng: np.random.Generator) -> Floats:
    """Places and powers (n, 9) of the spots on the detectors, with the laser's jitter and slow
    noise, and without the detectors' noise."""
    electronics, count, state = sensor.electronics, len(time), truth.copy()
    if electronics is not None and electronics.pointing > 0:
        state[:, 6:] += electronics.pointing * rng.standard_normal((count, 2))
    if sensor.drift == Drift() or count == 1:
        exact = delayed_readings(sensor, time, truth, state)
    else:
        step = (time[-1] - time[0]) / (count - 1)
        shift, warmer = draw_beam_and_temperature(sensor, count, step, rng)
        state[:, 6:] += shift
        exact = delayed_readings(sensor, time, truth, state)
        exact = exact + draw_readings(sensor, exact, warmer, step, rng)
    if electronics is not None and electronics.power_noise > 0:
        exact[:, 2::3] *= 1 + electronics.power_noise * rng.standard_normal((count, 1))
    return exact


def reported_beam_place(
    options: Solve, truth: Floats, noise: bool, rng: np.random.Generator
) -> Floats:
    """The reported place of the beam (n, 2), mm, with the prior's uncertainty and without the
    beam's offset."""
    place: Floats = truth[:, 6:] - np.array(options.beam_offset)
    if noise and options.beam == "prior":
        place += options.beam_sigma * rng.standard_normal(place.shape)
    return place


def simulate_motion(
    measurement: Measurement, name: str, noise: bool, rng: np.random.Generator, track: bool = False
) -> Segment:
    """Simulate and solve one motion."""
    config = measurement.config
    force = shaker_force(config.motions[name], rng)
    time, truth = states(config.motions[name], rng)
    if track:
        truth = simulate_following(config.sensor, config.stage, time, truth)
    measured, reached, saturated = read_detectors(config.sensor, time, truth, noise, rng)
    place = reported_beam_place(config.solve, truth, noise, rng)
    aligned = align(config.sensor, time, measured)
    samples = Samples(aligned, time=time, place=place)
    (poses,) = measurement.poses_of_all([samples], f"motion {name}")
    return Segment(
        name, time, truth, measured, place, reached, saturated, poses, measurement, force
    )


@check_arguments
def simulate(
    config: Config,
    motions: Sequence[str] = (),
    noise: bool | None = None,
    seed: int | None = None,
    track: bool = False,
    columns: PoseColumns | None = None,
) -> list[Segment]:
    """Simulate a configuration's motions of the mirror, their readings and the solutions.

    Parameters
    ----------
    config
        A configuration, from `facets.load`.
    motions
        Names of the motions to simulate, one after the other; all by default.
    noise
        Whether the readings are noisy; the configuration's setting by default.
    seed
        Seed of the noise; the configuration's by default. Each motion draws from a stream of its
        own, so that omitting a motion changes no other.
    track
        Whether the beam follows the mirror, carried by the configuration's stage.
    columns
        Further columns of the poses, such as displacements from a zero of each motion.

    Returns
    -------
    list of Segment
        One for each motion: times, true states, readings and the solution. A sample that cannot be
        solved has a status, and NaN in its pose.

    Raises
    ------
    InputError
        If the configuration has no motion of that name, or a motion has no samples for its zero.

    Examples
    --------
    >>> import facets
    >>> (segment,) = facets.simulate(facets.load("paper"), ["yaw-sweep"], seed=1)
    >>> segment.truth.shape, bool(segment.solution.ok.all())
    ((401, 8), True)
    """
    names = list(motions) or list(config.motions)
    if not names:
        raise InputError(f"{config.path}: has no motions; describe one in the block motions")
    for name in names:
        find_motion(config, name)
    entropy = config.seed if seed is None else seed
    if entropy < 0:
        raise InputError(f"seed is {seed}; allowed: 0 or more")
    noisy, tally = config.noise if noise is None else noise, Tally()
    return [
        simulate_motion(
            Measurement(config, columns, tally=tally),
            name, noisy, generator_of(entropy, list(config.motions).index(name)), track,
        )
        for name in names
    ]  # fmt: skip


def generator_of(entropy: int, number: int) -> np.random.Generator:
    """The random generator of the motion with this number."""
    return np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=(number,)))


def axes(segment: Segment, body: MeasuredObject = MIRROR) -> list[AxisErrors]:
    """Compute the six axes' errors over the solved samples; NaN if there are none.

    body: the object whose pose has these axes.
    """
    ok = segment.solution.converged
    errors, uncertainty, truth = segment.error, segment.solution.uncertainty, segment.truth
    if body != MIRROR:
        poses, truth = transform(segment.solution, body), transform(truth, body).pose
        errors, uncertainty = poses.pose - truth, poses.uncertainty
    rows = []
    for i, name in enumerate(POSE):
        error, sigma = errors[ok, i], uncertainty[ok, i]
        true = truth[:, i]
        is_solved = len(error) > 0
        rows.append(
            AxisErrors(
                name=name,
                low=float(true.min()),
                high=float(true.max()),
                largest=float(np.abs(error).max()) if is_solved else np.nan,
                rms=float(np.sqrt(np.mean(error**2))) if is_solved else np.nan,
                uncertainty=float(np.sqrt(np.mean(sigma**2))) if is_solved else np.nan,
            )
        )
    return rows


def statuses(segment: Segment) -> dict[str, int]:
    """Count the samples of each status that occurs."""
    numbers, counts = np.unique(segment.solution.status, return_counts=True)
    return {LABELS[n]: count for n, count in zip(numbers.tolist(), counts.tolist(), strict=True)}


def reading_table(segments: Sequence[Segment]) -> dict[str, Any]:
    """The readings of all segments as columns, for `facets solve`."""
    columns: dict[str, Any] = time_columns(segments)
    rows = np.concatenate([segment.readings for segment in segments])
    place = np.concatenate([segment.place for segment in segments])
    columns |= {name: rows[:, i] for i, name in enumerate(READING_COLUMNS)}
    return columns | {name: place[:, i] for i, name in enumerate(STATE_COLUMNS[6:])}


def reference_table(
    segments: Sequence[Segment], sigma: Sequence[float], seed: int
) -> dict[str, Any]:
    """The poses measured by a reference as columns, for `facets calibrate`.  sigma: (6,)."""
    truth = np.concatenate([segment.truth[:, :6] for segment in segments])
    rng = np.random.default_rng([seed, 6])
    return reference_columns(reference_poses(truth, sigma, rng))


def pose_table(segments: Sequence[Segment]) -> dict[str, Any]:
    """True states, estimates and their uncertainties of all segments as columns."""
    parts = [true_columns(part) | worded_columns(part.poses.columns()) for part in segments]
    return time_columns(segments) | join_columns(parts)


def true_columns(segment: Segment) -> dict[str, Any]:
    """True states, and true poses and displacements of the object, as columns.

    A displacement is relative to the true mean pose of the zero's samples, or to the zero itself if
    it comes from a file.
    """
    measurement = segment.measurement
    poses, body, zero = {"": segment.truth}, measurement.config.object, measurement.zero
    if body is not None:
        poses["object_"] = transform(segment.truth, body).pose
    if zero is not None:
        members = segment.poses.members
        start = segment.truth[members].mean(axis=0) if members.any() else zero.state
        poses["displacement_"] = transform(segment.truth, body, start).pose
    columns: dict[str, Any] = {}
    for prefix, pose in poses.items():
        columns |= state_columns(pose, f"true_{prefix}")
    return columns


def time_columns(segments: Sequence[Segment]) -> dict[str, Any]:
    """The motion's name and time of each row, and the force where there is a shaker."""
    columns: dict[str, Any] = {
        "motion": np.concatenate([np.repeat(s.name, len(s.time)) for s in segments]),
        "time_s": np.concatenate([segment.time for segment in segments]),
    }
    if any(segment.force is not None for segment in segments):
        parts = [np.full(len(s.time), np.nan) if s.force is None else s.force for s in segments]
        columns["force_n"] = np.concatenate(parts)
    return columns
