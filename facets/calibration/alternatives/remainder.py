"""Residuals of a fit, and the score test of columns in addition to its unknowns.

An alternative is described by its effect on the readings: columns C in addition to the columns X of
the unknowns. With the readings' variance V and the residuals y, chi-square would fall by

    s' M^-1 s,    s = C' P y,    M = C' P C + prior,
    P = V^-1 - V^-1 X (X' V^-1 X + prior)^-1 X' V^-1

if the columns were unknowns, too (a score test). Where the alternative is absent, this fall has the
distribution of chi-square. Its probability, times the number of columns or of trials for the same
alternative, is the score. Two alternatives are compared sample by sample: the scatter of the
difference of their falls shows by how much it would change in another run (Vuong's test).
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
from .alternative import Trace
from .scatter import NAMES, NONE_TOGETHER, UNMEASURED_SIGMA, Likelihood, Together

#: Directions of columns of which the unknowns leave less than this fraction of the square are
#: excluded.
LEAST_FREE_FRACTION = 1e-6


class Residuals:
    """The residuals of a fit and their likelihood."""

    def __init__(
        self, sensor: Sensor, data: Data, result: Fit, robust: float | None,
        together: Together = NONE_TOGETHER,
    ) -> None:  # fmt: skip
        """together: the covariance of the readings of different places."""
        task = Task(sensor, data, result.choice, robust)
        assert task.data.noise is not None
        self.nominal = sensor
        self.data, self.fit, self.noise = task.data, result, task.data.noise
        self.likelihood = Likelihood(task, result)
        with np.errstate(over="ignore"):
            priors = np.minimum(
                (own_sigma(task.data, result.choice) / OWN_UNITS) ** 2, UNMEASURED_SIGMA**2
            )
        at = self.likelihood.restrict(priors, np.zeros(len(NAMES)), together)
        self.inverse, self.weighted, self.pulled = at.inverse, at.weighted, at.pulled
        self.matrix, self.covariance = at.matrix, np.linalg.inv(at.matrix)
        self.values, self.variance = result.values, np.linalg.inv(at.inverse)
        self.is_read: Booleans = (self.likelihood.own != 0).any(axis=2)
        self.sensor = assign_values(sensor, result.all_values)
        self.state = states_of(task.data, result.own_values, result.all_values)
        light = self.model_readings[:, 2::3] / self.noise[:, 2::3]
        self.light = np.nan_to_num(light)  # modelled: the noise of readings would look like a gain

    @property
    def row_numbers(self) -> Integers:
        """The numbers (n,) of the samples' rows in the table."""
        return row_numbers(self.data)

    @property
    def chi_square(self) -> float:
        """Chi-square of the residuals at the best common unknowns."""
        return float((self.pulled * self.residuals).sum())

    @property
    def residuals(self) -> Floats:
        """The residuals (n, 9) in standard deviations, at the best common unknowns."""
        residuals: Floats = (self.variance @ self.pulled[:, :, None])[:, :, 0]
        return residuals

    @property
    def raw(self) -> Floats:
        """The measured readings (n, 9); 1 for a missing one."""
        return np.nan_to_num(self.data.raw, nan=1.0)

    @property
    def model_readings(self) -> Floats:
        """The fitted readings (n, 9)."""
        return self.raw - self.residuals * self.noise

    @property
    def pose_columns(self) -> Floats:
        """The derivatives of the readings (n, 9, 6) by the mirror's pose on the reference, in
        standard deviations per mm and rad."""
        columns: Floats = self.likelihood.own[:, :, :6] / OWN_UNITS[:6]
        return columns

    @property
    def beam_columns(self) -> Floats:
        """The derivatives of the readings (n, 9, 2) by the beam's place, per mm."""
        columns: Floats = self.likelihood.own[:, :, 7:] / OWN_UNITS[7:]
        return columns


class Remainder(Residuals):
    """The residuals of a fit whose unknowns can be extended by further columns."""

    def extend_by(self, traces: list[Trace]) -> Remainder:
        """The remainder of a fit in which the columns of alternatives are unknowns, too."""
        rest = self
        for trace in traces:
            rest = rest.extend(self.readable(trace.columns), trace.prior)
        return rest

    def extend(self, columns: Floats, prior: Floats | float = 0.0) -> Remainder:
        """The remainder of a fit in which columns (n, 9, q) are unknowns, too.  prior: prior
        information on them."""
        squares, matrix, side = self.equations(columns)
        information = np.broadcast_to(np.asarray(prior, dtype=float), side.shape)
        scale = np.sqrt(np.maximum(np.diag(squares) + information, 1e-300))
        level, ways = np.linalg.eigh(matrix / scale[:, None] / scale)
        ways = ways[:, level > LEAST_FREE_FRACTION] / scale[:, None]
        if not ways.size:  # the unknowns explain all of it
            return self
        columns, side = columns @ ways, ways.T @ side
        weighted, flat = self.inverse @ columns, columns.reshape(-1, columns.shape[2])
        across = self.weighted.reshape(len(flat), -1).T @ flat
        square = flat.T @ weighted.reshape(flat.shape) + ways.T @ (information[:, None] * ways)
        rest, size = copy(self), len(self.matrix)
        rest.matrix = np.block([[self.matrix, across], [across.T, square]])
        rest.covariance = np.linalg.inv(rest.matrix)
        rest.weighted = np.concatenate([self.weighted, weighted], axis=2)
        step = rest.covariance[:, size:] @ side
        rest.values = self.values + step[: len(self.values)]
        rest.pulled = self.pulled - self.project(columns, step[size:])
        return rest

    def project(self, columns: Floats, amounts: Floats) -> Floats:
        """P C a (n, 9), for columns C (n, 9, q) and amounts a (q,)."""
        effect = (columns @ amounts)[:, :, None]
        across = self.weighted.reshape(-1, self.weighted.shape[2]).T @ effect.ravel()
        part: Floats = (self.inverse @ effect)[:, :, 0] - self.weighted @ (self.covariance @ across)
        return part

    def readable(self, columns: Floats) -> Floats:
        """Columns (n, 9, q) with zeros for missing readings."""
        readable: Floats = np.nan_to_num(columns) * self.is_read[:, :, None]
        return readable

    def equations(self, columns: Floats) -> tuple[Floats, Floats, Floats]:
        """The squares (q, q) of columns (n, 9, q), and the matrix M (q, q) and the vector s (q,) of
        the score test (see the beginning of this file)."""
        flat = columns.reshape(-1, columns.shape[2])
        across = self.weighted.reshape(len(flat), -1).T @ flat
        squares = flat.T @ (self.inverse @ columns).reshape(flat.shape)
        matrix = squares - across.T @ self.covariance @ across
        return squares, matrix, flat.T @ self.pulled.ravel()

    def visible_effect(self, trace: Trace) -> Floats:
        """The part of the effect on the readings (n, 9), mm and mW, that no unknown absorbs."""
        part = self.project(self.readable(trace.columns), trace.amounts)
        visible: Floats = (self.variance @ part[:, :, None])[:, :, 0] * self.noise
        return visible

    def shift_of_unknowns(self, trace: Trace) -> Floats:
        """The shift of the fit's common unknowns (p,) that the alternative would have caused."""
        effect = (self.readable(trace.columns) @ trace.amounts).ravel()
        size = len(self.fit.choice.names)
        moved: Floats = self.covariance @ (self.weighted.reshape(len(effect), -1).T @ effect)
        return moved[:size]


# ---- the fit's own unknowns


def rise_without(remainder: Remainder, names: Iterable[str]) -> float:
    """The rise of chi-square without some of the fit's unknowns."""
    _, off, step = offsets(remainder, names)
    return float(off @ step)


def offsets(remainder: Remainder, names: Iterable[str]) -> tuple[list[int], Floats, Floats]:
    """The indices of some of the fit's unknowns, their distances (names,) from their prior means,
    in their units, and these times their information."""
    at = [remainder.fit.choice.names.index(name) for name in names]
    off = (remainder.values - values_of(remainder.nominal)[remainder.fit.choice.places])[at]
    return at, off, np.linalg.solve(remainder.covariance[np.ix_(at, at)], off)


def drop_unknowns(remainder: Remainder, names: Iterable[str]) -> Remainder:
    """The remainder of a fit in which some of its unknowns have their prior means."""
    dropped, _, step = offsets(remainder, names)
    others = np.setdiff1d(np.arange(len(remainder.matrix)), dropped)
    rest = copy(remainder)
    rest.pulled = remainder.pulled + remainder.weighted @ (remainder.covariance[:, dropped] @ step)
    rest.matrix, rest.weighted = (
        remainder.matrix[np.ix_(others, others)],
        remainder.weighted[:, :, others],
    )
    rest.covariance, rest.values = np.linalg.inv(rest.matrix), np.delete(remainder.values, dropped)
    return rest


def second_moment(remainder: Remainder, columns: Floats, sigma: float) -> float:
    """The expected sum of squares of the amounts of columns (n, 9, q), whose prior is zero within
    `sigma`."""
    _, matrix, side = remainder.equations(remainder.readable(columns))
    covariance = np.linalg.inv(matrix + np.eye(len(matrix)) / sigma**2)
    amounts = covariance @ side
    return float(amounts @ amounts + np.trace(covariance))
