"""Solve a table of readings of any length into a table of poses."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError
from ..core.names import (
    DETECTORS,
    POSE,
    READING_COLUMNS,
    STATE_COLUMNS,
    STATE_UNITS,
    TEMPERATURE_COLUMN,
)
from ..core.units import Booleans, Floats, describe_bounds, unit_of
from ..detectors.calibrated import TEMPERATURE
from ..detectors.correction import correct
from ..detectors.skew import align
from ..files import tables
from ..model.arrays import is_near_edge, readings
from .compiling import Task, compile_for
from .misfit import Misfit
from .object_pose import ObjectPose, transform
from .plan import make_plan
from .reliability import unseen_errors
from .solution import Solution, Status, UncertainResult
from .solver import solve
from .uncertainty_parts import uncertainty_parts
from .zero import SolvedPart, ZeroRequest, find_zero, zero_text

if TYPE_CHECKING:
    from ..core.knowledge import Knowledge
    from ..core.rigid_body import MeasuredObject
    from ..core.sensor import Sensor
    from ..core.settings import Config, Solve
    from .differences import ZeroPose

UNPARSABLE = "unparsable"
#: Which readings are places, in the order of `Thermal.places`.
PLACES = [0, 1, 3, 4, 6, 7]
#: Poses of a piece of a table at which `unseen_errors` is asked for.
LOOKED_AT = 100
#: Where the beam is; and how uncertain that is, which a table of poses has beside it.
BEAM_COLUMNS = STATE_COLUMNS[6:]
BEAM_UNCERTAINTIES = tuple(f"u_{name}" for name in BEAM_COLUMNS)


@dataclass
class StatusCounts:
    """What became of the rows.

    unparsable_lines: of the first few that are no numbers.  misfit: rows that were solved, but
    with a residual beyond chance.  unchecked: rows that were solved, on request, though nothing
    checks them.  edges: rows that were solved with a spot near an edge that the model lacks.
    unseen: (2,) by how much one spoilt place and one spoilt power can put a pose off unseen, in
    standard uncertainties, at most; NaN where nothing was solved.  lacks_temperature: whether the
    sensor follows the temperature, and the table does not have it.  unknown_temperatures: rows
    without it, if the table has it.  zero: of the displacements.
    """

    statuses: Counter[str] = field(default_factory=Counter)
    unparsable_lines: list[int] = field(default_factory=list)
    misfit: Misfit = field(default_factory=Misfit)
    unchecked: int = 0
    edges: int = 0
    unseen: Floats = field(default_factory=lambda: np.full(2, np.nan))
    lacks_temperature: bool = False
    unknown_temperatures: int = 0
    zero: ZeroPose | None = None

    def add(
        self,
        sensor: Sensor,
        options: Solve,
        readings: Floats,
        found: Solution,
        status: Any,
        place: Floats | None = None,
        temperature: Floats | None = None,
    ) -> None:
        """Counts some rows.  status: (n,) in words.  readings, place, temperature: as of
        `solve_readings`."""
        self.statuses.update(status.tolist())
        self.lacks_temperature |= sensor.thermal.is_on and temperature is None
        if sensor.thermal.is_on and temperature is not None:
            self.unknown_temperatures += int((~np.isfinite(temperature)).sum())
        place = beam_place(sensor, place, temperature)
        exact = readings
        if found.misfit.any():
            exact = exact_readings(sensor, readings, temperature)
        knowledge = options.knowledge(sensor, None if place is None else np.nan_to_num(place))
        self.misfit.add(found, sensor, knowledge, options.method, exact)
        self.unchecked += int((found.converged & (found.checks == 0)).sum())
        if not sensor.apertures.detectors:
            near = (is_near_edge(sensor, readings) & found.used).any(axis=1)
            self.edges += int((found.converged & near).sum())
        some = np.flatnonzero(found.converged & (found.checks > 0))[:LOOKED_AT]
        if len(some):
            knowledge = options.knowledge(sensor)
            errors = unseen_errors(
                sensor, found.state[some], beam=knowledge.beam, power=knowledge.power
            ).reshape(-1, 3, 3)
            largest = np.array([errors[..., :2].max(), errors[..., 2].max()])
            self.unseen = np.fmax(self.unseen, largest)

    @property
    def rows(self) -> int:
        return self.statuses.total()

    @property
    def solved_count(self) -> int:
        return self.statuses[Status.CONVERGED.label]


def solve_readings(
    sensor: Sensor,
    options: Solve,
    readings: Floats,
    place: Floats | None,
    temperature: Floats | None = None,
) -> Solution:
    """Solves readings (n, 9) of one instant each (`align`) as a config's `solve` block says.

    place: (n, 2) where the beam is, mm, if that is known; else the origin is taken. Where it is not
    finite, there is no pose.
    temperature: (n,) degrees Celsius, for a sensor that follows it (`Sensor.thermal`).
    """
    place = beam_place(sensor, place, temperature)
    if place is not None and options.beam != "free":
        lost = ~np.isfinite(place).all(axis=1)
        if lost.any():
            readings, place = readings.copy(), place.copy()
            readings[lost], place[lost] = np.nan, 0.0
    knowledge = options.knowledge(sensor, place)
    solution = solve(
        sensor,
        exact_readings(sensor, readings, temperature),
        beam=knowledge.beam,
        power=knowledge.power,
        method=options.method,
        start=options.start,
        max_steps=options.max_steps,
        accept_unchecked=options.accept_unchecked,
    )
    if temperature is None or not sensor.thermal.is_on:
        return solution
    return add_temperature_uncertainty(sensor, options, knowledge, solution, temperature)


def beam_place(sensor: Sensor, place: Floats | None, temperature: Floats | None) -> Floats | None:
    """Where the beam is (n, 2), mm, at temperatures (n,); the origin at the reference's one, or
    `place`."""
    if temperature is None or not sensor.thermal.is_on:
        return place
    warmer = temperature - sensor.thermal.reference
    shift: Floats = warmer[:, None] * np.array(sensor.thermal.beam)
    return shift if place is None else place + shift


def shift_per_kelvin(sensor: Sensor, options: Solve) -> Floats:
    """By how much a pose at rest is off (6,), mm and rad, where the sensor is 1 K warmer than its
    reference and the readings are solved without their temperature."""
    state = np.zeros((1, 8))
    state[0, 6:] = sensor.thermal.beam
    seen = readings(sensor, state)
    seen[:, PLACES] += sensor.thermal.places
    knowledge = replace(options, beam_offset=(0.0, 0.0)).knowledge(sensor)
    found = solve(sensor, seen, beam=knowledge.beam, power=knowledge.power, covariance=False)
    shift: Floats = found.state[0, :6]
    return shift


def missing_temperature(sensor: Sensor, options: Solve, source: str) -> str:
    """What it costs that a sensor that follows the temperature is not told it.

    source: what lacks the temperature, as the beginning of the sentence.
    """
    shift = abs(shift_per_kelvin(sensor, options))
    return (
        f"{source}, though sensor.temperature has coefficients: the poses hold at "
        f"{sensor.thermal.reference:.4g} degrees Celsius. Each kelvin above or below shifts them "
        f"by up to {1e3 * shift[:3].max():.2g} um and {1e6 * shift[3:].max():.2g} urad, which the "
        "stated uncertainties do not include."
    )


def unknown_temperatures(count: int, what: str) -> str:
    """What it costs that some rows or samples (`what`) have no temperature; empty for none."""
    if not count:
        return ""
    return (
        f"{count} {what} have no value of {TEMPERATURE_COLUMN} from "
        f"{describe_bounds(TEMPERATURE_COLUMN)}, which sensor.temperature needs, and therefore no "
        "pose."
    )


def add_temperature_uncertainty(
    sensor: Sensor, options: Solve, knowledge: Knowledge, found: Solution, temperature: Floats
) -> Solution:
    """The solution with the uncertainty of the temperature's coefficients."""
    known = sensor.calibration
    if found.covariance is None or known is None or not any(n in TEMPERATURE for n in known.names):
        return found
    assert found.calibration_covariance is not None
    plan = make_plan(sensor, knowledge, options.method, temperature.shape)
    warmer = np.nan_to_num(temperature - sensor.thermal.reference)
    part = uncertainty_parts(
        sensor, found.state, found.used, plan.free, plan.weights, warmer
    ).calibration
    whole = found.covariance + (part - found.calibration_covariance)
    return replace(found, covariance=whole, calibration_covariance=part)


def compile_for_poses(sensor: Sensor, options: Solve, *tasks: Task) -> None:
    """Compiles what `solve_readings` and other tasks take, see `compile_for`."""
    compile_for(sensor, "poses", *tasks, knowledge=options.knowledge(sensor))


def exact_readings(sensor: Sensor, readings: Floats, temperature: Floats | None = None) -> Floats:
    """Convert readings (n, 9) of one instant each to those of the model at the sensor's reference
    temperature."""
    exact = correct(sensor, readings)
    if temperature is not None and sensor.thermal.is_on:
        exact = exact.copy()
        warmer = temperature - sensor.thermal.reference
        exact[:, PLACES] -= warmer[:, None] * np.array(sensor.thermal.places)
    return exact


def readings_in(chunk: tables.Chunk) -> Floats:
    """(n, 9) of a table of readings."""
    return np.column_stack([chunk.columns[name] for name in READING_COLUMNS])


def place_in(sensor: Sensor, options: Solve, chunk: tables.Chunk) -> Floats | None:
    """The beam's position (n, 2) in a table, mm, to which `solve_readings` adds its offset and what
    follows the temperature. A table of poses, which states its uncertainty, contains both."""
    if not all(name in chunk.columns for name in BEAM_COLUMNS):
        return None
    place = np.column_stack([chunk.columns[name] for name in BEAM_COLUMNS])
    if not all(name in chunk.columns for name in BEAM_UNCERTAINTIES):
        return place
    shift = beam_place(sensor, None, chunk.columns.get(TEMPERATURE_COLUMN))
    return place - options.beam_offset - (0.0 if shift is None else shift)


def align_chunks(sensor: Sensor, chunks: Iterable[tables.Chunk]) -> Iterator[tables.Chunk]:
    """Yield the pieces of a table with the readings of each row at one instant; see `align`.

    A row's neighbours may stand in the piece before, or after.
    """
    if not any(sensor.light.delays):
        yield from chunks
        return
    near = deque[tables.Chunk | None]([None], maxlen=3)
    for chunk in chain(chunks, [None]):
        near.append(chunk)
        here = near[1]
        if len(near) < 3 or here is None:
            continue
        if "time_s" not in here.columns:
            raise InputError(
                "sensor.light.delays_us are given, but the readings have no column time_s to tell "
                "how fast they change; add the column, or set the delays to 0"
            )
        rows = zip(near, (slice(-1, None), slice(None), slice(1)), strict=True)
        parts = [(one.columns["time_s"][n], readings_in(one)[n]) for one, n in rows if one]
        time, raw = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        first = int(near[0] is not None)
        aligned = align(sensor, time, raw)[first : first + len(here.lines)]
        named = dict(zip(READING_COLUMNS, aligned.T, strict=True))
        yield replace(here, columns={**here.columns, **named})


def solve_chunk(sensor: Sensor, options: Solve, chunk: tables.Chunk) -> Solution:
    temperature = chunk.columns.get(TEMPERATURE_COLUMN)
    place = place_in(sensor, options, chunk)
    return solve_readings(sensor, options, readings_in(chunk), place, temperature)


def require_known_beam(path: Path, chunk: tables.Chunk, advice: str) -> None:
    """Raise `InputError` if the beam's position in a table is an estimate.

    Tables of poses have u_bx_mm, u_by_mm beside bx_mm, by_mm: where these are not 0, the place came
    out of the readings themselves, and taken for known it would make them seem far better than they
    are. advice: what to do instead.
    """
    for name, uncertainty in zip(BEAM_COLUMNS, BEAM_UNCERTAINTIES, strict=True):
        if name not in chunk.columns or uncertainty not in chunk.columns:
            continue
        estimated = np.flatnonzero(chunk.columns[uncertainty] > 0)
        if len(estimated):
            line, u = chunk.lines[estimated[0]], chunk.columns[uncertainty][estimated[0]]
            raise InputError(
                f"{path}:{line}: {name} is an estimate ({uncertainty} beside it is {u:.3g}), not "
                f"where the beam is known to be; {advice}"
            )


def labels(solution: Solution, unparsable: Booleans) -> Any:
    """The status of each row in words (n,)."""
    names = np.array([status.label for status in Status])
    texts = names[solution.status].astype("U20")
    texts[unparsable] = UNPARSABLE
    return texts


def pose_columns(solution: Solution, status: Any) -> dict[str, Any]:
    """A solution as the columns of a table of poses."""
    letters = np.array(DETECTORS)
    used = np.array(["".join(letters[[bool(n & 4), bool(n & 2), bool(n & 1)]]) for n in range(8)])
    columns: dict[str, Any] = {
        name: solution.state[:, i] / STATE_UNITS[i] for i, name in enumerate(STATE_COLUMNS)
    }
    columns["status"] = status
    columns["used"] = used[solution.used @ np.array([4, 2, 1])]
    columns["residual"] = solution.residual
    columns["power_mw"] = solution.power
    columns |= uncertainty_columns(solution)
    return columns | {"misfit": solution.misfit.astype(int)}


#: The parts of an uncertainty that a table has beside the whole where a calibration is known.
UNCERTAINTY_PARTS = ("noise", "calibration")


def uncertainty_columns(result: UncertainResult, prefix: str = "") -> dict[str, Floats]:
    """Standard uncertainties of a solution, or of poses of an object, as columns: u_tx_mm, ...;
    with a calibration also the parts of these, u_noise_tx_mm, ... and u_calibration_tx_mm, ...

    prefix: of the pose's names, such as object_.
    """
    sizes = {"": result.uncertainty}
    if result.calibration_covariance is not None:
        sizes |= {f"{part}_": getattr(result, f"{part}_uncertainty") for part in UNCERTAINTY_PARTS}
    return {
        f"u_{part}{prefix}{name}": size[:, i] / STATE_UNITS[i]
        for part, size in sizes.items()
        for i, name in enumerate(STATE_COLUMNS[: size.shape[1]])
    }


def expanded_columns(
    result: UncertainResult, probability: float, prefix: str = ""
) -> dict[str, Floats]:
    """Expanded uncertainties as columns, expanded_tx_mm, ..., with their coverage factors k_tx,
    ...; with a calibration also the degrees of freedom, degrees_of_freedom_tx, ..., NaN where
    unknown.  prefix: of the pose's names, such as object_."""
    sizes = result.expanded_uncertainty(probability)
    names = STATE_COLUMNS[: sizes.shape[1]]
    numbers = {"k": result.coverage_factor(probability)}
    if result.calibration_covariance is not None:
        numbers["degrees_of_freedom"] = result.degrees_of_freedom
    columns = {
        f"expanded_{prefix}{name}": sizes[:, i] / STATE_UNITS[i] for i, name in enumerate(names)
    }
    return columns | {
        f"{kind}_{prefix}{name.partition('_')[0]}": values[:, i]
        for kind, values in numbers.items()
        for i, name in enumerate(names)
    }


def covariance_columns(result: UncertainResult, prefix: str = "") -> dict[str, Floats]:
    """The covariance of poses as 21 columns, those on and above its diagonal: cov_tx_tx_mm2,
    cov_tx_roll_mm_mrad, ..., cov_yaw_yaw_mrad2."""
    assert result.covariance is not None
    columns = {}
    for i, j in zip(*np.triu_indices(6), strict=True):
        one, other = (unit_of(POSE[k]).unit for k in (i, j))
        unit = f"{one}2" if one == other else f"{one}_{other}"
        scale = STATE_UNITS[i] * STATE_UNITS[j]
        columns[f"cov_{prefix}{POSE[i]}_{POSE[j]}_{unit}"] = result.covariance[:, i, j] / scale
    return columns


def object_columns(
    solution: Solution,
    body: MeasuredObject | None,
    zero: ZeroPose | None = None,
    *,
    members: Booleans | None = None,
    temperature: Floats | None = None,
    covariance: bool = False,
    coverage: float | None = None,
) -> dict[str, Floats]:
    """The columns of a table of poses that follow from those of the mirror.

    With an object its absolute pose, object_tx_mm, ..., u_object_tx_mm, ...; with a zero its
    displacement (the mirror's without an object), displacement_tx_mm, ...,
    u_displacement_tx_mm, ...; on request covariances, the mirror's first, and expanded
    uncertainties with a coverage probability.
    members, temperature: (n,), as of `transform`.
    """
    columns = covariance_columns(solution) if covariance else {}
    columns |= {} if coverage is None else expanded_columns(solution, coverage)
    poses = {} if body is None else {"object_": transform(solution, body)}
    if zero is not None:
        poses["displacement_"] = transform(
            solution, body, zero, members=members, temperature=temperature
        )
    for prefix, found in poses.items():
        columns |= result_columns(found, prefix, covariance, coverage)
    return columns


def result_columns(
    found: ObjectPose, prefix: str, covariance: bool, coverage: float | None = None
) -> dict[str, Floats]:
    """Poses of an object as columns with their standard uncertainties, and on request their
    covariances and expanded uncertainties."""
    columns = {
        f"{prefix}{name}": found.pose[:, i] / STATE_UNITS[i]
        for i, name in enumerate(STATE_COLUMNS[:6])
    }
    columns |= uncertainty_columns(found, prefix)
    columns |= covariance_columns(found, prefix) if covariance else {}
    return columns | ({} if coverage is None else expanded_columns(found, coverage, prefix))


#: For a table of poses that is solved with a known beam.
KNOWN_ADVICE = (
    "give --beam free, or leave the two columns out if the beam stood still at the origin"
)


def solve_table(
    config: Config,
    options: Solve,
    readings: Path,
    poses: Path,
    about: dict[str, str],
    progress: Callable[[int], None] = lambda _: None,
    rows: int = tables.CHUNK,
    coverage: float | None = None,
    zero: ZeroRequest | None = None,
    covariance: bool = False,
) -> StatusCounts:
    """Solves each row of `readings` into a row of `poses`; a row that is not numbers gets NaN.

    Needed columns: psi_a_mm, zeta_a_mm, power_a_mw, ...; time_s is carried through, and bx_mm,
    by_mm say where the beam is, unless it is free; an estimate of that raises `InputError`, see
    `require_known_beam`. progress: called with the number of bytes read.  coverage: probability of
    the expanded uncertainties, or None for none.  zero, covariance: which columns of
    `object_columns` the poses have.
    """
    tables.ending(poses)
    compile_for_poses(config.sensor, options)
    beside = ("time_s", TEMPERATURE_COLUMN) if config.sensor.thermal.is_on else ("time_s",)
    if options.beam != "free":
        beside = (*beside, *BEAM_COLUMNS, *BEAM_UNCERTAINTIES)
    chunks = tables.read_chunks(readings, READING_COLUMNS, beside, rows)
    chunks = align_chunks(config.sensor, chunks)
    count = StatusCounts()
    parts: Iterator[SolvedPart]
    solved = ((c, solve_chunk(config.sensor, options, c)) for c in known_places(readings, chunks))
    if zero is None:
        parts = (SolvedPart(c, found, np.zeros(len(c.lines), dtype=bool)) for c, found in solved)
    else:
        count.zero, parts = find_zero(zero, config, options, solved)
        about = about | {"zero": zero_text(zero, count.zero)}
    with tables.open_writer(poses, about) as writer:
        for chunk, solution, members in parts:
            status = labels(solution, chunk.unparsable)
            time = {k: v for k, v in chunk.columns.items() if k == "time_s"}
            temperature = chunk.columns.get(TEMPERATURE_COLUMN)
            columns = pose_columns(solution, status)
            columns |= object_columns(
                solution, config.object, count.zero, members=members & solution.ok,
                temperature=temperature, covariance=covariance, coverage=coverage,
            )  # fmt: skip
            writer.write({**time, **columns})
            count.add(
                config.sensor, options, readings_in(chunk), solution, status,
                place_in(config.sensor, options, chunk), temperature,
            )  # fmt: skip
            bad = chunk.lines[chunk.unparsable][: 5 - len(count.unparsable_lines)]
            count.unparsable_lines += bad.tolist()
            progress(chunk.bytes_read)
        if not count.rows:
            raise InputError(f"{readings}: no rows")
    return count


def known_places(path: Path, chunks: Iterable[tables.Chunk]) -> Iterator[tables.Chunk]:
    """Yield the pieces of a table whose places of the beam, if it has any, are known."""
    for chunk in chunks:
        require_known_beam(path, chunk, KNOWN_ADVICE)
        yield chunk
