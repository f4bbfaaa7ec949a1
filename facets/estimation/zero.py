"""The zero of a table: which samples are the reference pose from which displacements are given."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core.errors import InputError
from ..core.names import POSE, STATE_COLUMNS, STATE_UNITS, TEMPERATURE_COLUMN
from ..core.units import Booleans, Floats, Integers
from ..files import tables
from .differences import ZeroPose, make_zero
from .plan import make_plan

if TYPE_CHECKING:
    from ..core.settings import Config, Solve
    from .solution import Solution

#: Scatter of a zero's samples over their noise above which the mirror did not stand still; and what
#: chance adds to 1 once in 10,000, times the root of one less than their number.
MOVED, BY_CHANCE = 1.5, 3.0


@dataclass(frozen=True)
class ZeroRequest:
    """What the zero is: the samples of the first `seconds`, the sample `row` (from 1), or the mean
    of the poses in a file."""

    seconds: float = 0.0
    row: int = 0
    file: Path | None = None

    def members(self, rows: Integers, time: Floats | None, start: float) -> Booleans:
        """Whether each sample belongs to the zero: (n,).

        rows: (n,) numbers of the samples, from 1.  time: (n,) s.  start: time of the first sample.
        Samples after the first one that is later than `seconds` do not belong to it.
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

    @property
    def text(self) -> str:
        """The request as a phrase."""
        if self.file is not None:
            return f"the poses of {self.file}"
        return f"row {self.row}" if self.row else f"the first {self.seconds:g} s"


class SolvedPart(NamedTuple):
    """A piece of a table, its solution, and whether each row is a sample of the zero."""

    chunk: tables.Chunk
    solution: Solution
    members: Booleans


def find_zero(
    request: ZeroRequest,
    config: Config,
    options: Solve,
    solved: Iterable[tuple[tables.Chunk, Solution]],
) -> tuple[ZeroPose, Iterator[SolvedPart]]:
    """The zero, and all pieces of the table; those that the zero needs are held in memory."""
    parts = mark_members(request, solved)
    if request.file is not None:
        return zero_of_table(request.file, config, options), parts
    held = []
    for part in parts:
        held.append(part)
        if not part.members[-1] and any(one.members.any() for one in held):
            break
    if not any(part.members.any() for part in held):
        count = sum(len(part.members) for part in held)
        raise InputError(f"--zero is {request.text}, but the table has {count} rows without it")
    if request.seconds and held[-1].members[-1]:
        require_length(request, np.concatenate([part.chunk.columns["time_s"] for part in held]))
    return zero_of_parts(config, options, held), chain(held, parts)


def zero_of_parts(config: Config, options: Solve, held: Sequence[SolvedPart]) -> ZeroPose:
    """The zero of pieces of a table."""
    some = [(part.chunk.columns, part.solution, part.members & part.solution.ok) for part in held]
    temperature = [
        columns[TEMPERATURE_COLUMN][rows]
        for columns, _, rows in some
        if TEMPERATURE_COLUMN in columns
    ]
    return zero_of_samples(
        config,
        options,
        np.concatenate([solution.state[rows] for _, solution, rows in some]),
        np.concatenate(temperature) if temperature else None,
        np.concatenate([solution.used[rows] for _, solution, rows in some]),
    )


def require_length(request: ZeroRequest, time: Floats, what: str = "the table") -> None:
    """Raise `InputError` where samples at these times (n,), s, end before the seconds of their
    zero, but for the time to the next sample; a live run has no zero then."""
    known = time[np.isfinite(time)]
    lasts = known[-1] - known[0]
    if lasts + 2 * lasts / max(len(known) - 1, 1) < request.seconds:
        raise InputError(
            f"--zero is {request.text}, but {what} lasts {lasts:.4g} s; give a shorter time, or "
            "row:N"
        )


def mark_members(
    request: ZeroRequest, solved: Iterable[tuple[tables.Chunk, Solution]]
) -> Iterator[SolvedPart]:
    """Yield the pieces of a table with their samples of the zero."""
    count, start, is_over = 0, np.nan, False
    for chunk, solution in solved:
        time = chunk.columns.get("time_s")
        rows = count + 1 + np.arange(len(chunk.lines))
        if time is not None and not np.isfinite(start):
            start = next((t for t in time.tolist() if np.isfinite(t)), np.nan)
        members = request.members(rows, time, start) & (not is_over)
        is_over |= bool(request.seconds) and not members.all()
        yield SolvedPart(chunk, solution, members)
        count += len(rows)


def zero_of_samples(
    config: Config,
    options: Solve,
    states: Floats,
    temperature: Floats | None = None,
    used: Booleans | None = None,
) -> ZeroPose:
    """The zero of states (n, 8) that were solved as a config's `solve` block says.

    temperature: (n,) degrees Celsius, if the sensor follows it.  used: (n, 3) detectors; None where
    they are not known, and taken to be all.
    """
    sensor = config.sensor
    warmer = 0.0
    if temperature is not None and len(temperature) and sensor.thermal.is_on:
        warmer = float(np.nanmean(temperature)) - sensor.thermal.reference
    plan = make_plan(sensor, options.knowledge(sensor), options.method)
    return make_zero(sensor, states, plan, used, warmer=warmer)


def zero_of_table(path: Path, config: Config, options: Solve) -> ZeroPose:
    """The mean of the poses of a table that fit their readings.

    The errors of the calibration are common to this zero and later poses only if the table says
    that it was made from the same configuration.
    """
    columns = STATE_COLUMNS[:6], (*STATE_COLUMNS[6:], "misfit")
    states = []
    for chunk in tables.read_chunks(path, *columns):
        zeros = np.zeros(len(chunk.lines))
        rows = np.column_stack([chunk.columns.get(name, zeros) for name in STATE_COLUMNS])
        fits = ~(chunk.columns.get("misfit", zeros) > 0)
        states.append(rows[fits] * STATE_UNITS)
    try:
        zero = zero_of_samples(config, options, np.concatenate(states or [np.empty((0, 8))]))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    same = tables.read_head(path).get("config_sha256") == config.sha256
    return replace(zero, same_calibration=same)


def zero_text(request: ZeroRequest, zero: ZeroPose) -> str:
    """The zero in words, for the provenance of a table."""
    place = ", ".join(
        f"{name} {value / unit:.9g}"
        for name, value, unit in zip(STATE_COLUMNS[:6], zero.state, STATE_UNITS, strict=False)
    )
    many = "s" if zero.samples > 1 else ""
    return f"{request.text}, {zero.samples} sample{many}: {place}"


def zero_findings(zero: ZeroPose) -> list[str]:
    """What a user of a zero should know, as sentences."""
    found = []
    worst = int(np.nanargmax(zero.scatter)) if np.isfinite(zero.scatter).any() else 0
    if zero.scatter[worst] > max(MOVED, 1 + BY_CHANCE / max(zero.samples - 1, 1) ** 0.5):
        found.append(
            f"The mirror moved while the zero was measured: its samples scatter "
            f"{zero.scatter[worst]:.3g} times as much in {POSE[worst]} as their noise. The stated "
            "uncertainties of displacements do not include this motion."
        )
    if not zero.same_calibration and zero.sensor.calibration is not None:
        found.append(
            "The poses of the zero were not made from this configuration. Therefore the errors of "
            "the calibration are taken as independent at the zero and at the other poses."
        )
    return found
