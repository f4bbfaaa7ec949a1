"""How much an alternative would explain of a fit's residuals: one score for all of them.

An alternative is known by what it does to the readings: columns C beside the columns X of the
unknowns. With the readings' variance V and the residuals y, chi-square would fall by

    s' M^-1 s,    s = C' P y,    M = C' P C + prior,
    P = V^-1 - V^-1 X (X' V^-1 X + prior)^-1 X' V^-1

if the columns were unknowns, too (a score test). Where the alternative is absent, this fall has the
distribution of chi-square; its chance, times the number of columns or times that were tried for the
same alternative, is the score. Two alternatives are compared sample by sample: the scatter of the
difference of their falls says by how much it would change in another run (Vuong's test).
"""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy

import numpy as np

from ...core.sensor import Sensor
from ...core.units import Booleans, Floats, Integers
from ..fitting.bundle_adjustment import OWN_UNITS, Data, own_sigma, states_of
from ..fitting.fit import Fit, Task
from ..fitting.samples import row_numbers
from ..fitting.unknowns import assign_values, values_of
from .alternative import LAST_TRIALS, WORTH_MORE, Trace
from .scatter import NAMES, NONE_TOGETHER, UNMEASURED_SIGMA, Likelihood, Together

#: A direction of columns that the unknowns explain but for this share of its square is left out.
LEAST_OWN_SHARE = 1e-6
#: A step has at least this number of samples on both sides.
STEP_MARGIN = 8
#: How often sizes and states of something that switches are found in turn.
SWITCH_ROUNDS = 6
#: Of what switches more often than in this share of the samples nobody would say so.
MOST_SWITCHES = 0.08


class Remainder:
    """The residuals of a fit and their likelihood, in which further columns are tested."""

    def __init__(
        self, sensor: Sensor, data: Data, result: Fit, robust: float | None,
        together: Together = NONE_TOGETHER,
    ) -> None:  # fmt: skip
        """together: the covariance of different places."""
        task = Task(sensor, data, result.choice, robust)
        assert task.data.noise is not None
        self.nominal = sensor
        self.data, self.fit, self.noise = task.data, result, task.data.noise
        self.likelihood = Likelihood(task, result)
        with np.errstate(over="ignore"):
            known = np.minimum(
                (own_sigma(task.data, result.choice) / OWN_UNITS) ** 2, UNMEASURED_SIGMA**2
            )
        at = self.likelihood.restrict(known, np.zeros(len(NAMES)), together)
        self.inverse, self.weighted, self.pulled = at.inverse, at.weighted, at.pulled
        self.matrix, self.covariance = at.matrix, np.linalg.inv(at.matrix)
        self.values, self.variance = result.values, np.linalg.inv(at.inverse)
        self.is_read: Booleans = (self.likelihood.own != 0).any(axis=2)
        self.sensor = assign_values(sensor, result.all_values)
        self.state = states_of(task.data, result.own_values, result.all_values)
        light = self.model_readings[:, 2::3] / self.noise[:, 2::3]
        self.light = np.nan_to_num(light)  # by the model: their own noise would look like a gain

    @property
    def row_numbers(self) -> Integers:
        """The numbers (n,) of the samples' rows in the table."""
        return row_numbers(self.data)

    @property
    def chi_square(self) -> float:
        return float((self.pulled * self.residuals).sum())

    @property
    def residuals(self) -> Floats:
        """The residuals (n, 9) in standard deviations, the common unknowns at their best."""
        whole: Floats = (self.variance @ self.pulled[:, :, None])[:, :, 0]
        return whole

    @property
    def raw(self) -> Floats:
        """The readings (n, 9) as the detectors gave them; 1 where there is none."""
        return np.nan_to_num(self.data.raw, nan=1.0)

    @property
    def model_readings(self) -> Floats:
        """The readings (n, 9) as the fit has them."""
        return self.raw - self.residuals * self.noise

    @property
    def pose_columns(self) -> Floats:
        """The derivatives of the readings (n, 9, 6) by the mirror's pose on the reference, in
        standard deviations per mm and rad."""
        whole: Floats = self.likelihood.own[:, :, :6] / OWN_UNITS[:6]
        return whole

    @property
    def beam_columns(self) -> Floats:
        """The derivatives of the readings (n, 9, 2) by the beam's place, per mm."""
        whole: Floats = self.likelihood.own[:, :, 7:] / OWN_UNITS[7:]
        return whole

    def extend_by(self, traces: list[Trace]) -> Remainder:
        """The remainder in which the columns of some alternatives are unknowns, too."""
        rest = self
        for trace in traces:
            rest = rest.extend(self.readable(trace.columns), trace.prior)
        return rest

    def extend(self, columns: Floats, prior: Floats | float = 0.0) -> Remainder:
        """The remainder in which columns (n, 9, q) are unknowns, too.  prior: information on them
        before."""
        whole, matrix, side = self.equations(columns)
        known = np.broadcast_to(np.asarray(prior, dtype=float), side.shape)
        scale = np.sqrt(np.maximum(np.diag(whole) + known, 1e-300))
        level, ways = np.linalg.eigh(matrix / scale[:, None] / scale)
        ways = ways[:, level > LEAST_OWN_SHARE] / scale[:, None]
        if not ways.size:  # the unknowns explain all of it
            return self
        columns, side = columns @ ways, ways.T @ side
        weighted, flat = self.inverse @ columns, columns.reshape(-1, columns.shape[2])
        across = self.weighted.reshape(len(flat), -1).T @ flat
        square = flat.T @ weighted.reshape(flat.shape) + ways.T @ (known[:, None] * ways)
        rest, size = copy(self), len(self.matrix)
        rest.matrix = np.block([[self.matrix, across], [across.T, square]])
        rest.covariance = np.linalg.inv(rest.matrix)
        rest.weighted = np.concatenate([self.weighted, weighted], axis=2)
        step = rest.covariance[:, size:] @ side
        rest.values = self.values + step[: len(self.values)]
        rest.pulled = self.pulled - self.project(columns, step[size:])
        return rest

    def rise_without(self, names: Iterable[str]) -> float:
        """By how much chi-square would rise without some of the fit's unknowns."""
        _, off, step = self.offsets(names)
        return float(off @ step)

    def offsets(self, names: Iterable[str]) -> tuple[list[int], Floats, Floats]:
        """The places of some of the fit's unknowns, how far they are from what they were before,
        and that times their information."""
        at = [self.fit.choice.names.index(name) for name in names]
        off = (self.values - values_of(self.nominal)[self.fit.choice.places])[at]
        return at, off, np.linalg.solve(self.covariance[np.ix_(at, at)], off)

    def drop_unknowns(self, names: Iterable[str]) -> Remainder:
        """The remainder in which some of the fit's unknowns are what they were before."""
        gone, _, step = self.offsets(names)
        kept = np.setdiff1d(np.arange(len(self.matrix)), gone)
        rest = copy(self)
        rest.pulled = self.pulled + self.weighted @ (self.covariance[:, gone] @ step)
        rest.matrix, rest.weighted = self.matrix[np.ix_(kept, kept)], self.weighted[:, :, kept]
        rest.covariance, rest.values = np.linalg.inv(rest.matrix), np.delete(self.values, gone)
        return rest

    def project(self, columns: Floats, amounts: Floats) -> Floats:
        """P C a: (n, 9)."""
        effect = (columns @ amounts)[:, :, None]
        across = self.weighted.reshape(-1, self.weighted.shape[2]).T @ effect.ravel()
        part: Floats = (self.inverse @ effect)[:, :, 0] - self.weighted @ (self.covariance @ across)
        return part

    def readable(self, columns: Floats) -> Floats:
        """Columns (n, 9, q) without what they say of readings that are not there."""
        kept: Floats = np.nan_to_num(columns) * self.is_read[:, :, None]
        return kept

    def equations(self, columns: Floats) -> tuple[Floats, Floats, Floats]:
        """The squares of columns (n, 9, q), the matrix M and the vector s of the score test (see
        the beginning of this file): (q, q), (q, q), (q,)."""
        flat = columns.reshape(-1, columns.shape[2])
        across = self.weighted.reshape(len(flat), -1).T @ flat
        whole = flat.T @ (self.inverse @ columns).reshape(flat.shape)
        matrix = whole - across.T @ self.covariance @ across
        return whole, matrix, flat.T @ self.pulled.ravel()

    # ---- what the residuals follow

    def test(
        self,
        key: str,
        columns: Floats,
        sigma: Floats | float = np.inf,
        least: float = LEAST_OWN_SHARE,
    ) -> Trace:
        """The fall that columns (n, 9, q) bring.  sigma: prior standard uncertainty of their
        amounts.  least: share of the square of a direction that is left beside the unknowns."""
        columns = self.readable(columns)
        whole, matrix, side = self.equations(columns)
        prior = np.broadcast_to(np.asarray(sigma, dtype=float) ** -2.0, side.shape)
        fall, amounts, count = falls_of(whole[None], matrix[None], side[None], prior, least)
        is_partial = least > LEAST_OWN_SHARE
        return Trace(key, float(fall[0]), float(count[0]), columns, amounts[0], 0.0, (), prior,
                     is_partial)  # fmt: skip

    def complete(self, trace: Trace) -> Trace:
        """A trace whose score left directions out that the unknowns nearly explain, with the
        amounts of the fewest columns that explain as much: these move the unknowns, too."""
        if not trace.is_partial:
            return trace
        _, matrix, side = self.equations(trace.columns)
        matrix = matrix + np.diag(np.broadcast_to(trace.prior, side.shape))
        chosen, amounts, fall = list[int](), np.zeros(len(side)), 0.0
        while len(chosen) < len(side):
            falls = np.zeros(len(side))
            for n in set(range(len(side))) - set(chosen):
                at = [*chosen, n]
                falls[n] = side[at] @ np.linalg.solve(matrix[np.ix_(at, at)], side[at])
            if falls.max() < fall + WORTH_MORE:
                break
            chosen.append(int(np.argmax(falls)))
            fall = falls[chosen[-1]]
        amounts[chosen] = np.linalg.solve(matrix[np.ix_(chosen, chosen)], side[chosen])
        return trace._replace(amounts=amounts)

    def test_courses(
        self, key: str, columns: Floats, courses: Floats, sigma: Floats | float = np.inf
    ) -> Trace:
        """The best of several courses (m, n, w): the columns (n, 9, q) times the w functions of the
        rows, or of the mirror's place, of one of them.  sigma: prior standard uncertainty of the
        amounts (q,)."""
        columns, trials = self.readable(columns), len(courses)
        prior = np.broadcast_to(np.asarray(sigma, dtype=float) ** -2.0, columns.shape[2:])
        if not courses.any() or not columns.any():
            return Trace(key, 0.0, 0.0, columns, np.zeros(columns.shape[2]), 0.0, (0.0,))
        if courses.shape[2] > 1 and trials > LAST_TRIALS:
            kept = self.screen_courses(columns, courses)
            trace = self.compare_courses(key, columns, courses[kept], prior)
            return trace._replace(
                log_trials=float(np.log(trials)), at=(float(kept[int(trace.at[0])]),)
            )
        return self.compare_courses(key, columns, courses, prior)

    def screen_courses(self, columns: Floats, courses: Floats) -> Integers:
        """The numbers of the best courses, by what they would explain if no unknown took up any of
        it."""
        turned = np.swapaxes(columns, 1, 2)
        pulled = (turned @ self.pulled[:, :, None])[:, :, 0]
        squares = np.einsum("nqi,nij,njq->nq", turned, self.inverse, columns)
        sides = np.einsum("mnw,nq->mwq", courses, pulled, optimize=True)
        whole = np.einsum("mnw,nq->mwq", courses**2, squares, optimize=True)
        falls = (sides**2 / np.maximum(whole, 1e-300)).sum(axis=(1, 2))
        return np.argsort(-falls)[:LAST_TRIALS]

    def compare_courses(self, key: str, columns: Floats, courses: Floats, prior: Floats) -> Trace:
        """The best of a few courses; see `test_courses`."""
        trials, rows, ways = courses.shape
        size, unknowns = columns.shape[2] * ways, self.matrix.shape[0]
        turned = np.swapaxes(columns, 1, 2)
        pulled = (turned @ self.pulled[:, :, None])[:, :, 0]
        weighted = (turned @ self.weighted).reshape(rows, -1)
        squares = (turned @ self.inverse @ columns).reshape(rows, -1)
        count = columns.shape[2]
        flat = np.swapaxes(courses, 1, 2).reshape(-1, rows)
        sides = np.swapaxes((flat @ pulled).reshape(trials, ways, count), 1, 2).reshape(-1, size)
        each = (flat @ weighted).reshape(trials, ways, count, unknowns)
        across = np.swapaxes(each, 1, 2).reshape(trials, size, unknowns)
        pairs = (courses[:, :, :, None] * courses[:, :, None, :]).reshape(trials, rows, -1)
        whole = np.swapaxes(pairs, 1, 2).reshape(-1, rows) @ squares
        whole = whole.reshape(trials, ways, ways, count, count)
        whole = whole.transpose(0, 3, 1, 4, 2).reshape(trials, size, size)
        matrix = whole - across @ self.covariance @ np.swapaxes(across, 1, 2)
        fall, amounts, free = falls_of(whole, matrix, sides, np.repeat(prior, ways))
        best = int(np.argmax(fall))
        chosen = columns[:, :, :, None] * courses[best][:, None, None, :]
        return Trace(key, float(fall[best]), float(free[best]), chosen.reshape(rows, 9, size),
                     amounts[best], float(np.log(trials)), (float(best),),
                     np.repeat(prior, ways))  # fmt: skip

    def test_switching(
        self, columns: Floats, step: Trace, sigma: Floats | float = np.inf
    ) -> tuple[Trace, Booleans]:
        """The best of two states between which columns (n, 9, q) switch at any rows.

        step: the best of one step, which is one of the two courses from which the search begins.
        Sizes and states are found in turn; each switch costs the choice of its row. Returns
        the states (n,), too.
        """
        columns, count = self.readable(columns), len(columns)
        turned = np.swapaxes(columns, 1, 2)
        squares = turned @ self.inverse @ columns
        sides = (turned @ self.pulled[:, :, None])[:, :, 0]
        first: Booleans = np.arange(count) >= step.at[0]
        best, best_state = step, first
        for state in (first, leading_state(squares, sides)):
            for _ in range(SWITCH_ROUNDS):
                if not STEP_MARGIN <= state.sum() <= count - STEP_MARGIN:
                    break
                switches = np.flatnonzero(np.diff(state.astype(int))) + 1
                if len(switches) > MOST_SWITCHES * count:  # that is noise
                    break
                trace = self.test(step.key, columns * state[:, None, None], sigma)
                cost = len(switches) * float(np.log(count))
                trace = trace._replace(log_trials=cost, at=tuple(switches.astype(float)))
                if trace.score > best.score:
                    best, best_state = trace, state
                own = np.einsum("nij,i,j->n", squares, trace.amounts, trace.amounts)
                gain = 2 * sides @ trace.amounts + (2 * state.mean() - 1) * own
                following = likeliest_states(gain, 2 * np.log(count))
                if (following == state).all():
                    break
                state = following
        return best, best_state

    def sample_falls(self, trace: Trace) -> Floats:
        """By how much chi-square of each sample (n,) falls."""
        part = self.project(self.readable(trace.columns), trace.amounts)
        moved = (self.variance @ part[:, :, None])[:, :, 0]
        falls: Floats = (2 * self.residuals * part - moved * part).sum(axis=1)
        return falls

    def visible_effect(self, trace: Trace) -> Floats:
        """What of the effect on the readings (n, 9) no unknown takes up, mm and mW."""
        part = self.project(self.readable(trace.columns), trace.amounts)
        moved = self.variance @ part[:, :, None]
        whole: Floats = moved[:, :, 0] * self.noise
        return whole

    def shift_of_unknowns(self, trace: Trace) -> Floats:
        """By how much the alternative would have moved the common unknowns of the fit (p,)."""
        effect = (self.readable(trace.columns) @ trace.amounts).ravel()
        size = len(self.fit.choice.names)
        moved: Floats = self.covariance @ (self.weighted.reshape(len(effect), -1).T @ effect)
        return moved[:size]

    def second_moment(self, columns: Floats, sigma: float) -> float:
        """The expectation of the sum of squares of columns' amounts, of which each was known to be
        zero within `sigma` before the samples."""
        _, matrix, side = self.equations(self.readable(columns))
        covariance = np.linalg.inv(matrix + np.eye(len(matrix)) / sigma**2)
        amounts = covariance @ side
        return float(amounts @ amounts + np.trace(covariance))


def falls_of(
    whole: Floats,
    matrix: Floats,
    side: Floats,
    prior: Floats | None = None,
    least: float = LEAST_OWN_SHARE,
) -> tuple[Floats, Floats, Floats]:
    """Falls (m,), amounts (m, q) and numbers of columns (m,) that the unknowns do not explain.

    whole: (m, q, q) the columns' squares; matrix: the same beside the unknowns; side: (m, q);
    prior: (q,) what is known before of the amounts, which counts as part of a column that the
    unknowns explain.
    """
    size = np.diagonal(whole, axis1=1, axis2=2) + (0.0 if prior is None else prior)
    scale = np.sqrt(np.maximum(size, 1e-300))
    known = np.zeros_like(matrix) if prior is None else np.diag(prior)
    alone = matrix / scale[:, :, None] / scale[:, None, :]
    level, ways = np.linalg.eigh(alone + known / scale[:, :, None] / scale[:, None, :])
    aim = (np.swapaxes(ways, 1, 2) @ (side / scale)[:, :, None])[:, :, 0]
    share = np.einsum("mij,mik,mkj->mj", ways, alone, ways)
    free = share / np.maximum(level, 1e-300)
    is_free = share > least
    level = np.where(is_free, level, 1.0)
    step = np.where(is_free, aim / level, 0.0)
    amounts = (ways @ step[:, :, None])[:, :, 0] / scale
    return (step * aim).sum(axis=1), amounts, (free * is_free).sum(axis=1)


def leading_state(squares: Floats, sides: Floats) -> Booleans:
    """On which side of zero each sample (n,) lies along the direction in which the amounts of some
    columns scatter most.

    squares: (n, q, q) of the columns in a sample; sides: (n, q).
    """
    mean = squares.mean(axis=0)
    level, ways = np.linalg.eigh(sides.T @ sides / len(sides))
    aim = np.linalg.lstsq(mean, ways[:, -1] * np.sqrt(max(level[-1], 0.0)), rcond=None)[0]
    return np.asarray(sides @ aim > 0)


def likeliest_states(gain: Floats, cost: float) -> Booleans:
    """The states (n,) of largest sum of gains where a state is on, less a cost for each switch."""
    off, on, came = 0.0, 0.0, np.zeros((len(gain), 2), bool)
    for n, value in enumerate(gain.tolist()):
        came[n] = on - cost > off, on > off - cost
        off, on = max(off, on - cost), max(on, off - cost) + value
    states, is_on = np.zeros(len(gain), bool), on > off
    for n in range(len(gain) - 1, -1, -1):
        states[n] = is_on
        is_on = bool(came[n, int(is_on)])
    return states
