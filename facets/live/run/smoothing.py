"""Poses smoothed over a whole recording, by a model of how a mirror moves.

Each axis is the integral of white noise, once, twice or thrice: a mirror of nearly constant place,
speed or acceleration. The Kalman filter runs forward with the covariance of each sample's noise;
the recursion of Bryson and Frazier goes back and gives the estimate from all samples, before and
after. It is the fixed-interval smoother of Rauch, Tung and Striebel without the inverse of a
covariance, which is singular in double precision where a model is stiff. Time is counted in
samples, so that numbers stay near one.

How strongly the axes are shaken is what makes the innovations likeliest. Whether they are then what
the model expects is tested: their mean normalised square is one, and they are uncorrelated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import factorial, hypot
from typing import TYPE_CHECKING

import numpy as np

from ...core.errors import InputError
from ...core.knowledge import Prior
from ...core.names import ANGLES, POSE
from ...core.units import Booleans, Floats
from ...estimation.object_pose import ObjectPose, carry_pose
from ...estimation.plan import Plan, find_plan
from ...estimation.result import covariance_columns
from ...estimation.uncertainty import propagate, slices_of
from .pipeline import jitter_of

if TYPE_CHECKING:
    from ...core.settings import Config
    from ...estimation.solution import Solution

#: Order of the model: how often white noise is integrated.
MODELS = {"place": 1, "speed": 2, "acceleration": 3}
#: How strongly an axis may be shaken, in variances of its noise a sample; evenly in the logarithm.
STRENGTHS = np.logspace(-20, 2, 45)
#: Samples from which the strength is found.
LOOKED_AT = 4_000
#: A longer recording is smoothed in pieces of so many samples, each with so many more on both
#: sides, which is far more than an estimate reaches.
PIECE, MARGIN = 20_000, 2_000
#: Innovations whose mean normalised square is off by more are not those of the model.
DOUBT = 0.2


def require_model(model: str) -> None:
    """Raise `InputError` for a model of a motion that is none."""
    if model not in MODELS:
        raise InputError(f"--smooth {model}: unknown model; allowed: {', '.join(MODELS)}")


@dataclass(frozen=True)
class Smoothed:
    """states: (n, d), in the unit of what was given.  covariance: (n, d, d), by noise alone.

    squares: mean normalised square of the innovations, 1 where the model holds.  memory: their
    correlation from one sample to the next, 0 where it holds.  strength: (d,) of the white noise.
    """

    states: Floats
    covariance: Floats
    squares: float
    memory: float
    strength: Floats

    @property
    def sentence(self) -> str:
        """The sentence on whether the innovations agree with the model."""
        text = (
            f"innovations: mean normalised square {self.squares:.3g} (1 where the model holds), "
            f"correlation from sample to sample {self.memory:+.2g} (0)"
        )
        if abs(self.squares - 1) > DOUBT or abs(self.memory) > DOUBT:
            text += (
                "; the model of the motion or of the noise is wrong, and so are the smoothed "
                "uncertainties"
            )
        return text


def transition(order: int, steps: float) -> Floats:
    """Return the transition matrix (order, order) of one axis over a number of samples."""
    matrix = np.zeros((order, order))
    for i in range(order):
        for j in range(i, order):
            matrix[i, j] = steps ** (j - i) / factorial(j - i)
    return matrix


def process_noise(order: int, steps: float) -> Floats:
    """Covariance of one axis over a number of samples, for white noise of strength one."""
    last = order - 1
    return np.array([
        [
            steps ** (2 * last + 1 - i - j)
            / factorial(last - i) / factorial(last - j) / (2 * last + 1 - i - j)
            for j in range(order)
        ]
        for i in range(order)
    ])  # fmt: skip


def smooth(
    time: Floats,
    poses: Floats,
    covariance: Floats,
    model: str = "acceleration",
    strength: Floats | None = None,
) -> Smoothed:
    """The poses that all samples together make likeliest.

    time: (n,) s, growing.  poses: (n, d), NaN where there is none.  covariance: (n, d, d) of the
    noise of each.  model: of MODELS.  strength: (d,) of the white noise, per sample; found if it is
    not given. Raises `ValueError` where there are fewer than ten poses.
    """
    order = MODELS[model]
    there: Booleans = np.asarray(
        np.isfinite(poses).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    )
    if there.sum() < 10:
        raise ValueError(f"{int(there.sum())} poses are too few for smoothing")
    steps = np.diff(time, prepend=time[0]) / np.median(np.diff(time))
    if len(time) > PIECE + 2 * MARGIN:
        return smooth_pieces(time, poses, covariance, model, strength)
    units = np.sqrt(np.median(np.diagonal(covariance[there], axis1=1, axis2=2), axis=0))
    seen = np.where(there[:, None], poses / units, np.nan)
    noise = covariance / np.outer(units, units)
    if strength is None:
        strength = strengths(steps, seen, noise, there, order)
    states, spread, innovations = bryson_frazier(steps, seen, noise, there, order, strength)
    squares, memory = innovation_tests(innovations)
    return Smoothed(states * units, spread * np.outer(units, units), squares, memory, strength)


def smooth_pieces(
    time: Floats, poses: Floats, covariance: Floats, model: str, strength: Floats | None
) -> Smoothed:
    """Smooth a long recording piece by piece, to save memory, by the first piece's strength."""
    states, spreads = np.full(poses.shape, np.nan), np.full(covariance.shape, np.nan)
    tests = []
    for start in range(0, len(time), PIECE):
        part = slice(max(0, start - MARGIN), min(len(time), start + PIECE + MARGIN))
        inner = slice(start - part.start, start - part.start + PIECE)
        try:
            piece = smooth(time[part], poses[part], covariance[part], model, strength)
        except ValueError:  # a piece without poses stays without
            continue
        strength = piece.strength
        states[start : start + PIECE] = piece.states[inner]
        spreads[start : start + PIECE] = piece.covariance[inner]
        tests.append((piece.squares, piece.memory))
    if strength is None:
        raise ValueError("there are too few poses for smoothing")
    squares, memory = np.mean(tests, axis=0)
    return Smoothed(states, spreads, float(squares), float(memory), strength)


def first_spread(seen: Floats, there: Booleans) -> Floats:
    """How fast an axis may move at first: variance of a sample's step (d,), and of its change."""
    apart = np.abs(np.diff(seen[there], axis=0))
    variance: Floats = (3 * apart.max(axis=0) + 3) ** 2
    return variance


def strengths(steps: Floats, seen: Floats, noise: Floats, there: Booleans, order: int) -> Floats:
    """The likeliest strength of each axis (d,), each taken for itself, over the first samples."""
    count = min(len(seen), LOOKED_AT)
    width, tried = seen.shape[1], len(STRENGTHS)
    first = int(np.flatnonzero(there)[0])
    mean = np.zeros((width, tried, order))
    mean[..., 0] = seen[first][:, None]
    spread = np.zeros((width, tried, order, order))
    spread[..., 0, 0] = noise[first].diagonal()[:, None]
    wide = first_spread(seen, there)
    for n in range(1, order):
        spread[..., n, n] = wide[:, None]
    likelihood = np.zeros((width, tried))
    for n in range(first + 1, count):
        move = transition(order, steps[n])
        mean = mean @ move.T
        shaken = STRENGTHS[:, None, None] * process_noise(order, steps[n])
        spread = move @ spread @ move.T + shaken
        if not there[n]:
            continue
        total = spread[..., 0, 0] + noise[n].diagonal()[:, None]
        apart = seen[n][:, None] - mean[..., 0]
        likelihood -= np.log(total) + apart**2 / total
        gain = spread[..., 0] / total[..., None]
        mean = mean + gain * apart[..., None]
        spread = spread - gain[..., :, None] * spread[..., 0, :][..., None, :]
    return np.array([peak(row) for row in likelihood])


def peak(likelihood: Floats) -> float:
    """The strength of the largest value of a row, by a parabola through its neighbours."""
    n = int(np.argmax(likelihood))
    if not 0 < n < len(likelihood) - 1:
        return float(STRENGTHS[n])
    low, middle, high = likelihood[n - 1 : n + 2]
    off = 0.5 * (low - high) / (low - 2 * middle + high)
    return float(STRENGTHS[n] * (STRENGTHS[1] / STRENGTHS[0]) ** off)


def bryson_frazier(
    steps: Floats, seen: Floats, noise: Floats, there: Booleans, order: int, strength: Floats
) -> tuple[Floats, Floats, list[Floats]]:
    """Smoothed places (n, d), their covariances (n, d, d), and the whitened innovations."""
    count, width = seen.shape
    size, places = order * width, slice(0, None, order)
    shaken: Floats = np.kron(np.diag(strength), np.ones((order, order))).astype(np.float64)
    first = int(np.flatnonzero(there)[0])
    mean, spread = np.zeros(size), np.zeros((size, size))
    mean[places] = seen[first]
    wide = first_spread(seen, there)
    for n in range(order):
        spread[range(n, size, order), range(n, size, order)] = wide
    predicted, spreads = np.empty((count, size)), np.empty((count, size, size))
    updates: list[tuple[Floats, Floats, Floats] | None] = []
    whitened: list[Floats] = []
    moves: dict[float, tuple[Floats, Floats]] = {}
    for n in range(count):
        if n:
            move, shake = motion(moves, float(round(steps[n], 9)), order, width, shaken)
            mean = move @ mean
            spread = move @ spread @ move.T + shake
        predicted[n], spreads[n] = mean, spread
        if not there[n]:
            updates.append(None)
            continue
        total = spread[places, places] + noise[n]
        root = np.linalg.cholesky(total)
        apart = seen[n] - mean[places]
        inverse = np.linalg.inv(total)
        gain = spread[:, places] @ inverse
        updates.append((inverse, inverse @ apart, gain))
        if n > first:
            whitened.append(np.linalg.solve(root, apart))
        mean = mean + gain @ apart
        kept = np.eye(size)
        kept[:, places] -= gain
        spread = kept @ spread @ kept.T + gain @ noise[n] @ gain.T
    states, covariance = backward(steps, predicted, spreads, updates, places)
    return states, covariance, whitened


def motion(
    moves: dict[float, tuple[Floats, Floats]],
    step: float,
    order: int,
    width: int,
    shaken: Floats,
) -> tuple[Floats, Floats]:
    """Transition and process noise of all axes over a step, each made once."""
    if step not in moves:
        if len(moves) > 1000:
            moves.clear()
        shake: Floats = np.kron(np.eye(width), process_noise(order, step)) * shaken
        moves[step] = np.kron(np.eye(width), transition(order, step)).astype(np.float64), shake
    return moves[step]


def backward(
    steps: Floats,
    predicted: Floats,
    spreads: Floats,
    updates: list[tuple[Floats, Floats, Floats] | None],
    places: slice,
) -> tuple[Floats, Floats]:
    """Add the later samples to predictions, by the adjoint recursion of Bryson and Frazier."""
    count, size = predicted.shape
    width = len(range(size)[places])
    order = size // width
    adjoint, weight = np.zeros(size), np.zeros((size, size))
    states: Floats = np.empty((count, width))
    covariance: Floats = np.empty((count, width, width))
    for n in range(count - 1, -1, -1):
        update = updates[n]
        if update is not None:
            inverse, pull, gain = update
            kept = np.eye(size)
            kept[:, places] -= gain
            adjoint = kept.T @ adjoint
            adjoint[places] -= pull
            weight = kept.T @ weight @ kept
            weight[places, places] += inverse
        rows = spreads[n][places]
        states[n] = predicted[n][places] - rows @ adjoint
        covariance[n] = spreads[n][places, places] - rows @ weight @ rows.T
        if n:
            move = np.kron(np.eye(width), transition(order, float(round(steps[n], 9))))
            adjoint = move.T @ adjoint
            weight = move.T @ weight @ move
    return states, covariance


def innovation_tests(whitened: list[Floats]) -> tuple[float, float]:
    """Mean square and correlation from one to the next of whitened innovations."""
    rows = np.array(whitened)
    squares = float(np.mean(rows**2))
    memory = float(np.mean(rows[1:] * rows[:-1]) / squares) if squares > 0 else 0.0
    return squares, memory


def noise_covariance(config: Config, solution: Solution, carried: bool) -> Floats:
    """Return the part of the poses' covariance (n, 6, 6) that is noise of each sample; mm, rad.

    The beam's pointing jitter and the laser's power noise are part of it. The rest is what is not
    known of the beam, of the laser's power and of the calibration: it is the same in each sample,
    and no smoothing takes it away.  carried: whether a stage carried the
    beam, whose place is then known by its encoder.
    """
    if solution.noise_covariance is not None:
        return solution.noise_covariance[:, :6, :6]
    parts = [
        noise_of_part(config, solution.state[part], solution.used[part], carried)
        for part in slices_of(len(solution.state))
    ]
    return np.concatenate(parts)


def noise_of_part(config: Config, states: Floats, used: Booleans, carried: bool) -> Floats:
    """`noise_covariance` of states (n, 8) by the detectors used (n, 3)."""
    plan = plan_of(config, carried)
    return propagate(config.sensor, None, states, used, plan).noise[:, :6, :6]


def plan_of(config: Config, carried: bool) -> Plan:
    """The unknowns and priors with which samples are solved."""
    known = config.solve.knowledge(config.sensor)
    if carried and known.beam != "free":
        known = replace(
            known, beam=Prior((0.0, 0.0), hypot(config.stage.accuracy, jitter_of(config)))
        )
    return find_plan(config.sensor, known, config.solve.method, ())


def dynamic_error(config: Config, time: Floats, states: Floats) -> Floats:
    """Return how far the electronics' bandwidth holds back moving poses (n, d), in their unit.

    A low pass of the first order is late by 1 / (2 pi bandwidth). Zero where the configuration says
    nothing of the electronics. How late a given board is, is not known, so that this counts as an
    uncertainty, and the poses stay where they are.
    """
    electronics = config.sensor.electronics
    if electronics is None or len(time) < 2:
        return np.zeros_like(states)
    speed = np.abs(np.gradient(states, time, axis=0))
    late: Floats = np.nan_to_num(speed) / (2 * np.pi * electronics.bandwidth)
    return late


def smoothed_columns(
    config: Config,
    time: Floats,
    solution: Solution,
    carried: bool,
    model: str,
    covariance: bool = False,
) -> tuple[dict[str, Floats], Smoothed]:
    """Columns `smooth_tx_mm` ... and their standard uncertainties, beside the raw poses; and what
    `dynamic_error` says of both, where the electronics are known. With an object also
    `smooth_object_tx_mm` ..., and on request covariances.

    time: (n,) s. The uncertainties hold what smoothing takes no part of, too; see
    `noise_covariance`.
    """
    units = np.array([1e-3 if name in ANGLES else 1.0 for name in POSE])
    noise = noise_covariance(config, solution, carried)
    assert solution.covariance is not None
    state = np.where(solution.converged[:, None], solution.state[:, :6], np.nan)
    smoothed = smooth(time, state / units, noise / np.outer(units, units), model)
    apart = np.diagonal(solution.covariance[:, :6, :6] - noise, axis1=1, axis2=2) / units**2
    rest = np.maximum(apart, 0.0)
    typical = np.nanmedian(rest, axis=0)  # where there is no pose
    variance = np.diagonal(smoothed.covariance, axis1=1, axis2=2) + np.where(
        np.isfinite(rest), rest, typical
    )
    names = [f"{name}_{'mrad' if name in ANGLES else 'mm'}" for name in POSE]
    columns = {f"smooth_{name}": smoothed.states[:, n] for n, name in enumerate(names)}
    columns |= {f"u_smooth_{name}": np.sqrt(variance[:, n]) for n, name in enumerate(names)}
    if config.sensor.electronics is not None:
        late = dynamic_error(config, time, smoothed.states)
        columns |= {f"u_dynamic_{name}": late[:, n] for n, name in enumerate(names)}
    common = solution.covariance[:, :6, :6] - noise
    whole = smoothed.covariance * np.outer(units, units) + fill_unknown(common)
    columns |= smoothed_object_columns(config, smoothed.states * units, whole, covariance)
    return columns, smoothed


def fill_unknown(covariances: Floats) -> Floats:
    """Covariances (n, 6, 6) with that of the median total variance where there is none."""
    total = np.trace(covariances, axis1=1, axis2=2)
    known = np.flatnonzero(np.isfinite(total))
    if not len(known):
        return covariances
    typical = covariances[known[np.argsort(total[known])[len(known) // 2]]]
    return np.where(np.isfinite(total)[:, None, None], covariances, typical)


def smoothed_object_columns(
    config: Config, poses: Floats, covariances: Floats, with_covariance: bool
) -> dict[str, Floats]:
    """The object's columns of smoothed poses (n, 6) with covariances (n, 6, 6), mm and rad; on
    request the covariances of poses and object."""
    columns = {}
    if with_covariance:
        mirror = ObjectPose(poses, None, covariances, None, None, False)
        columns = covariance_columns(mirror, "smooth_")
    if config.object is not None:
        object_poses = carry_pose(poses, covariances, config.object)
        columns |= object_poses.columns("smooth_object_", with_covariance)
    return columns
