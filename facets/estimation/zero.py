"""The zero: the samples whose mean pose is the reference for displacements."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core.arguments import check_arguments, require_plausible
from ..core.errors import InputError
from ..core.knowledge import BeamKnowledge, Knowledge, PowerKnowledge
from ..core.names import POSE, STATE_COLUMNS, STATE_UNITS, TEMPERATURE_COLUMN
from ..core.notebook import show_shortly
from ..core.plain_numbers import count_text, short_number
from ..core.sensor import Sensor
from ..core.units import Booleans, Floats, Integers
from ..files import tables
from ..model.arrays import as_rows
from .plan import Plan, make_plan
from .solution import Solution, detectors_of, root_of_diagonal
from .uncertainty import Propagation, propagate

if TYPE_CHECKING:
    from ..core.settings import Config
    from .solution import Samples

#: The mirror was not at rest if the scatter of a zero's samples over their noise exceeds this, and
#: exceeds chance: n samples exceed 1 + CHANCE_TERM / sqrt(n - 1) once in 10,000 zeros.
MOVED, CHANCE_TERM = 1.5, 3.0


@show_shortly
@dataclass(frozen=True)
class ZeroPose:
    """A measured reference pose of the mirror; from `facets.zero_pose`.

    Attributes
    ----------
    state
        (8,) mm, rad: the mean of the samples.
    samples
        Number of samples in the mean.
    sensor
        The sensor that measured it.
    plan
        The unknowns and priors of the estimates.
    propagation
        Propagation of the errors of noise, priors and parameters to the state.
    scatter
        (6,) standard deviation of the samples over that of their noise; NaN for a single sample.
        Above about 1.5, and 1 + 3 / sqrt(samples - 1), the mirror was not at rest.
    same_calibration
        Whether the zero and the poses that are compared with it have the same calibration errors.
    """

    state: Floats
    samples: int
    sensor: Sensor
    plan: Plan
    propagation: Propagation
    scatter: Floats
    same_calibration: bool = True


@check_arguments
def zero_pose(
    sensor: Sensor,
    states: Solution | ArrayLike,
    samples: int | None = None,
    *,
    beam: BeamKnowledge = "free",
    power: PowerKnowledge = "known",
    temperature: float | None = None,
) -> ZeroPose:
    """Compute a reference pose of the mirror, from which `facets.transform` gives displacements.

    Parameters
    ----------
    sensor
        The sensor; the errors of `Sensor.calibration` are common to this pose and the others.
    states
        A solution of samples at the reference, or states (..., 8) measured with all detectors; mm
        and rad, world frame. Rows with NaN are ignored.
    samples
        Number of samples whose mean `states` already is; by default the number of rows.
    beam, power
        Knowledge of them, as for `facets.solve`; the mean of a `Prior` is ignored.
    temperature
        Mean temperature of the samples, degrees Celsius, for a sensor with `Sensor.thermal`.

    Returns
    -------
    ZeroPose
        The mean of the states, with the propagation of noise, priors and calibration to it.

    Raises
    ------
    InputError
        If no row has a finite state, if no two detectors took part in all samples, or if an
        argument has a wrong shape or value.

    Examples
    --------
    >>> import numpy as np, facets
    >>> sensor, head = facets.Sensor(), facets.MeasuredObject((0, 0, 50))
    >>> zero = facets.zero_pose(sensor, np.zeros((100, 8)))
    >>> state = np.array([0, 0, 0, 0, 0.001, 0, 0, 0])
    >>> f"{1e3 * facets.transform(state, head, zero).pose[0]:.1f} um along x"
    '50.0 um along x'
    """
    if samples is not None and samples < 1:
        raise InputError(f"samples is {samples}; allowed: 1 or more")
    knowledge, used = Knowledge(beam=beam, power=power), None
    if isinstance(states, Solution):
        used, states = states.used.reshape(-1, 3), states.state
    rows, _ = as_rows(states, 8, "states")
    warmer = 0.0
    if temperature is not None:
        require_plausible(temperature, TEMPERATURE_COLUMN, "temperature")
        warmer = temperature - sensor.thermal.reference
    plan = make_plan(sensor, knowledge, shape=(len(rows),))
    return make_zero(sensor, rows, plan, used, samples, warmer)


def make_zero(
    sensor: Sensor,
    states: Floats,
    plan: Plan,
    used: Booleans | None = None,
    samples: int | None = None,
    warmer: float = 0.0,
) -> ZeroPose:
    """Make a zero from states (n, 8) that were solved by a plan.

    used: (n, 3) whether each detector took part; None for all. A detector that took part in only
    some of the samples counts as unused, so that the stated noise is too large rather than too
    small.  samples: number of samples in the mean; None: n.  warmer: temperature above the
    calibration's reference, K. Raises `InputError` as `zero_pose` does.
    """
    finite = np.isfinite(states).all(axis=1)
    rows = states[finite]
    common: Booleans = np.ones((1, 3), bool)
    if used is not None:
        common = used[finite].all(axis=0).reshape(1, 3)
    if not len(rows):
        raise InputError(
            "the zero has no solved pose that fits its readings; choose samples with light on all "
            "detectors"
        )
    if common.sum() < 2:
        raise InputError(
            "the samples of the zero were measured with different detectors; choose samples with "
            "light on the same two, or on all"
        )
    mean = rows.mean(axis=0, keepdims=True)
    propagation = propagate(sensor, sensor.calibration, mean, common, plan, np.array([warmer]))
    if np.isnan(propagation.readings[np.repeat(common, 3, axis=1)]).any():
        raise InputError(
            "at the mean pose of the zero a detector has no light, so that it cannot have been "
            "measured with this sensor; choose another zero"
        )
    scatter = np.full(6, np.nan)
    if len(rows) > 1:
        scatter = rows[:, :6].std(axis=0, ddof=1) / root_of_diagonal(propagation.noise)[0, :6]
    return ZeroPose(mean[0], samples or len(rows), sensor, plan, propagation, scatter)


@check_arguments
@dataclass(frozen=True)
class ZeroRequest:
    """The definition of a zero: the samples of the first `seconds`, the sample `row` (from 1), or
    the poses in a file."""

    seconds: float = 0.0
    row: int = 0
    file: Path | None = None

    def members(self, rows: Integers, time: Floats | None, start: float) -> Booleans:
        """Whether each sample belongs to the zero: (n,).

        rows: (n,) numbers of the samples, from 1.  time: (n,) s.  start: time of the first sample.
        No sample after the first one that is later than `seconds` belongs to the zero.
        """
        if self.row:
            return np.equal(rows, self.row)
        if self.file is not None:
            return np.zeros(len(rows), dtype=bool)
        if time is None:
            raise InputError("--zero has seconds, but there is no column time_s; use --zero row:N")
        after = time - start
        rounding = 4 * np.spacing(abs(start) + self.seconds)
        is_outside = (after < 0) | (after >= self.seconds - rounding)
        members: Booleans = (np.cumsum(is_outside) == 0) & np.isfinite(after)
        return members

    def require_length(self, lasts: float, samples: int, what: str) -> None:
        """Raise `InputError` if a table is shorter than the zero, by more than one sample's step.

        lasts: time from the first to the last sample, s.  what: the table's name in messages.
        """
        if lasts + 2 * lasts / max(samples - 1, 1) < self.seconds:
            raise InputError(
                f"--zero is {self.text}, but {what} lasts {lasts:.4g} s; give a shorter time, or "
                "row:N"
            )

    @property
    def text(self) -> str:
        """The request as a phrase."""
        if self.file is not None:
            return f"the poses of {self.file}"
        return f"row {self.row}" if self.row else f"the first {self.seconds:g} s"


@check_arguments
@dataclass(frozen=True)
class PoseColumns:
    """The columns of poses in addition to the mirror's pose and the object's.

    zero: the zero of displacements, or None for no displacements.  covariance: whether complete
    covariances are included.  coverage: probability of expanded uncertainties, or None for none.
    """

    zero: ZeroRequest | None = None
    covariance: bool = False
    coverage: float | None = None


class ZeroSearch:
    """Collection of a zero's samples from pieces of a table or a run, until the zero is known.

    zero: the reference pose; None until it is known.  is_begun: whether the zero's first sample was
    received.  first: its number and time, s.  is_over: whether a sample after the zero was
    received.  count: number of samples in the zero, with or without a pose.  last: the newest
    time, s.
    """

    def __init__(self, request: ZeroRequest, config: Config, waits: bool) -> None:
        """Begin without samples.

        waits: whether the zero begins with the first pose that fits its readings, as in a run,
        which may begin without light; else with the first sample.

        Raises `InputError` if the requested table is unusable.
        """
        self.request, self.config, self.waits = request, config, waits
        self.zero: ZeroPose | None = None
        if request.file is not None:
            self.zero = zero_of_table(request.file, config)
        self.forget()

    def forget(self) -> None:
        """Discard the samples so far."""
        self.is_begun = self.is_over = False
        self.first = 0, np.nan
        self.count, self.last = 0, np.nan
        #: States, temperatures and detectors of the zero's samples so far.
        self.members: list[tuple[Floats, Floats, Booleans]] = []

    def add(self, samples: Samples, solution: Solution) -> Booleans:
        """Add solved samples, and compute the zero at the first sample after it.

        Returns whether each sample (n,) belongs to the zero and has a pose that fits its readings.
        If the samples of the zero are unusable, discards them and raises `InputError`.
        """
        no_members = np.zeros(len(samples.readings), dtype=bool)
        if self.zero is not None or not (self.is_begun or self.begin(samples, solution)):
            return no_members
        number, start = self.first
        inside = self.request.members(samples.numbers - number + 1, samples.time, start)
        inside &= not self.is_over
        members: Booleans = inside & solution.ok
        self.count += int(inside.sum())
        if members.any():
            warm = np.empty(0) if samples.temperature is None else samples.temperature[members]
            self.members.append((solution.state[members], warm, solution.used[members]))
        ahead = inside[samples.numbers >= number]
        if samples.time is not None and np.isfinite(samples.time).any():
            self.last = float(np.nanmax(samples.time))
        self.is_over |= bool(self.request.seconds) and len(ahead) > 0 and not ahead[-1]
        if self.count and (self.is_over or self.request.row):
            self.measure()
        return members

    def begin(self, samples: Samples, solution: Solution) -> bool:
        """Search these samples for the first sample of the zero; return whether it was found."""
        starts = solution.ok if self.waits else np.ones(len(samples.readings), dtype=bool)
        time = samples.time
        if time is None:
            time = np.full(len(starts), np.nan)
        elif self.request.seconds:
            starts = starts & np.isfinite(time)
        if starts.any():
            first = int(np.argmax(starts))
            self.first = int(samples.numbers[first]) if self.waits else 1, float(time[first])
            self.is_begun = True
        return self.is_begun

    def measure(self) -> None:
        """Compute the zero from the samples so far, and discard them.

        Raises `InputError` if they are unusable.
        """
        members = self.members or [(np.empty((0, 8)), np.empty(0), np.empty((0, 3), bool))]
        states, temperature, used = map(np.concatenate, zip(*members, strict=True))
        self.forget()
        self.zero = zero_of_samples(self.config, states, temperature, used)

    def finish(self, what: str, rows: int) -> None:
        """Compute the zero at the end of a table, unless it is known already.

        what: the table's name in messages.  rows: number of its rows. Raises `InputError` if the
        table lacks the samples of the zero, or they are unusable.
        """
        if self.zero is not None:
            return
        if not self.count:
            lacks = f"only {rows} rows" if self.request.row else f"{rows} rows, none with a time"
            raise InputError(f"--zero is {self.request.text}, but {what} has {lacks}")
        if self.request.seconds:
            self.request.require_length(self.last - self.first[1], self.count, what)
        self.measure()


def zero_of_samples(
    config: Config,
    states: Floats,
    temperature: Floats | None = None,
    used: Booleans | None = None,
) -> ZeroPose:
    """Make the zero from states (n, 8) that were solved by a configuration's `solve`.

    temperature: (n,) degrees Celsius, for a sensor with `Sensor.thermal`.  used: (n, 3) whether
    each detector took part; None for all. Raises `InputError` if no state is finite, if fewer than
    two detectors took part in all samples, or if a detector has no light at the mean.
    """
    sensor = config.sensor
    warmer = 0.0
    if temperature is not None and len(temperature) and sensor.thermal.is_on:
        warmer = float(np.nanmean(temperature)) - sensor.thermal.reference
    plan = make_plan(sensor, config.solve.knowledge(sensor), config.solve.method)
    return make_zero(sensor, states, plan, used, warmer=warmer)


def zero_of_table(path: Path, config: Config) -> ZeroPose:
    """Make the zero from the poses in a table that fit their readings.

    The errors of the calibration are common to this zero and later poses only if the table's header
    names the same configuration. Raises `InputError` if the table cannot be read, or its poses are
    unusable.
    """
    columns = STATE_COLUMNS[:6], (*STATE_COLUMNS[6:], "misfit")
    states, fitting = [], []
    for chunk in tables.read_chunks(path, *columns):
        zeros = np.zeros(len(chunk.lines))
        rows = np.column_stack([chunk.columns.get(name, zeros) for name in STATE_COLUMNS])
        fits = ~(chunk.columns.get("misfit", zeros) > 0)
        states.append(rows[fits] * STATE_UNITS)
        fitting.append(fits)
    used, words = None, tables.read_words(path, "used")
    if words is not None:
        used = detectors_of(words)[np.concatenate(fitting or [np.zeros(0, bool)])]
    try:
        zero = zero_of_samples(config, np.concatenate(states or [np.empty((0, 8))]), used=used)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    same = tables.read_head(path).get("config_sha256") == config.sha256
    return replace(zero, same_calibration=same)


def zero_text(request: ZeroRequest, zero: ZeroPose) -> str:
    """The zero in words, for the provenance of a table."""
    place = ", ".join(
        f"{name} {round(value / unit, 9) + 0.0:.9g}"  # 1 fm, 1 prad; no -0
        for name, value, unit in zip(STATE_COLUMNS[:6], zero.state, STATE_UNITS, strict=False)
    )
    return f"{request.text}, {count_text(zero.samples, 'sample')}: {place}"


def zero_findings(zero: ZeroPose) -> list[str]:
    """Sentences on a zero's faults: motion of the mirror, another configuration."""
    sentences = []
    worst = int(np.nanargmax(zero.scatter)) if np.isfinite(zero.scatter).any() else 0
    if zero.scatter[worst] > max(MOVED, 1 + CHANCE_TERM / max(zero.samples - 1, 1) ** 0.5):
        sentences.append(
            f"The mirror moved while the zero was measured: its samples scatter "
            f"{short_number(zero.scatter[worst])} times as much in {POSE[worst]} as their noise. "
            "The stated uncertainties of displacements do not include this motion."
        )
    if not zero.same_calibration and zero.sensor.calibration is not None:
        sentences.append(
            "The poses of the zero were not made from this configuration. Therefore the errors of "
            "the calibration are taken as independent at the zero and at the other poses."
        )
    return sentences
