"""Exploration of a design space: ranges and resolutions of many layouts, on one machine or many.

Designs are numbered, so that any part of them can be made again anywhere: a part is some hundred
designs, goes to a worker as a number, and comes back as a table that is written at once. A run that
was interrupted continues with the missing parts.

Designs of a sensor with ideal light and simple noise are measured many at once (`survey`), others
one by one.
"""

from __future__ import annotations

import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..characterization.ranges import axis_ranges, clearances
from ..characterization.resolution import uncertainties
from ..characterization.singularity import measures
from ..core.errors import InputError, OutputError
from ..core.extras import require_extra
from ..core.knowledge import Knowledge
from ..core.names import FINE_COLUMNS, FINE_UNITS, RANGE_COLUMNS, STATE_UNITS
from ..core.rules import Rules
from ..core.sensor import Sensor
from ..core.units import Booleans, Floats
from ..detectors.noise import fullness
from ..files.provenance import require_origin
from ..files.tables import read_columns, read_head, write_table
from ..files.whole import write_text
from ..model.arrays import margins, readings
from ..model.threads import cores
from .requirement import Requirement, margins_of, worst_places_of
from .survey import (
    CHUNK,
    OUTSIDE,
    SKIPPED,
    designs_of,
    is_plain,
    measure,
    rest_reasons,
)
from .variables import FULL, sensor_of
from .volume import mirror_states, states_of

if TYPE_CHECKING:
    from ..characterization.sensitivity import Index
    from ..core.layout import Layout
    from ..core.settings import Config

#: Number of designs that a worker measures at a time, unless they are plain.
DESIGNS_PER_TASK = 200
#: A task of plain designs has up to this many times as many designs, if at least this many tasks
#: remain.
LARGEST_FACTOR, LEAST_TASKS = 50, 100
#: The file that identifies the search whose parts a folder holds.
MARK = "search.txt"
#: Interval at which a worker checks that its parent still runs, s.
PARENT_CHECK_INTERVAL_S = 1.0
#: Tolerance of a design's ranges, in units of `ranges.FARTHEST_MM_RAD`.
FINE_ENOUGH = 1e-5
#: Factors from mm and rad to the tables' units, by axis of the pose: mm and mrad, um and urad.
FAR, FINE = 1 / np.array(STATE_UNITS[:6]), 1 / np.array(FINE_UNITS[:6])
#: The measures of a design. Ranges are symmetric, both sides together; uncertainties and the
#: condition number are at rest; regular is 1 where the determinant of Eq. (11) has one sign over
#: the volume's corners, faces and centre, else 0.
MEASURES = ("head_mm", *RANGE_COLUMNS, *FINE_COLUMNS, "condition", "regular")
AT_RANGES = slice(1, 7)


@dataclass(frozen=True)
class Space:
    """The design space and how it is sampled.

    sampling: "sobol", "lhs" or "grid".  count: of designs, at least.  part: designs a task.
    objectives: of the front.  required: whether designs must keep the layout's requirements over
    its volume.
    """

    sensor: Sensor
    rules: Rules
    layout: Layout
    sampling: str
    count: int
    seed: int
    objectives: tuple[str, ...] = ("head_mm", "u_roll_urad", "range_roll_mrad")
    required: bool = False
    part: int = DESIGNS_PER_TASK

    @property
    def names(self) -> list[str]:
        return list(self.layout.variables)

    @cached_property
    def volume(self) -> Floats:
        """States (n, 8): corners, faces and centre of the layout's volume, as of `volume`."""
        return np.array(states_of(self.layout, 1.0), dtype=float)

    @property
    def mirror_volume(self) -> Floats:
        """States (n, 8) of the mirror over the volume."""
        return mirror_states(self.volume, self.layout.object, self.layout.following)

    @property
    def plain(self) -> bool:
        """Whether its designs are measured many at once (`survey`)."""
        return not self.required and is_plain(self.sensor, self.rules)


@dataclass(frozen=True)
class DesignDraw:
    """How the designs of a space are drawn, see `Space`."""

    sampling: str
    count: int
    seed: int


def space_of(
    settings: Config,
    objectives: Sequence[str],
    drawn: DesignDraw,
    required: bool = False,
) -> Space:
    """The space of a configuration; a task has as many designs as take about a second.

    required: see `Space`. Raises `InputError` for an unknown objective.
    """
    require_measures(objectives)
    space = Space(
        settings.sensor, replace(settings.range, object=settings.layout.object), settings.layout,
        drawn.sampling, drawn.count, drawn.seed, tuple(objectives), required,
    )  # fmt: skip
    if not space.plain:
        return space
    times = min(LARGEST_FACTOR, max(1, space.count // (LEAST_TASKS * DESIGNS_PER_TASK)))
    return replace(space, part=times * DESIGNS_PER_TASK)


def designs(space: Space) -> Floats:
    """Return all designs (n, variables), in the units of the variables' names."""
    require_variables(space)
    bounds = tuple(space.layout.variables[name] for name in space.names)
    return draw(space.sampling, bounds, space.count, space.seed)


def require_variables(space: Space) -> None:
    """Raise `InputError` if no variable may vary."""
    if not space.names:
        raise InputError(
            "optimize.variables is empty: name what may vary, as radius_mm: [150, 260]"
        )


@lru_cache(1)  # one table serves all parts of a worker
def draw(sampling: str, bounds: tuple[tuple[float, float], ...], count: int, seed: int) -> Floats:
    from scipy.stats import qmc

    dimension, rng = len(bounds), np.random.default_rng(seed)
    if sampling == "grid":
        side = int(np.ceil(count ** (1 / dimension)))
        axes = [np.linspace(low, high, side) for low, high in bounds]
        places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dimension)
        return rng.permutation(places)  # so that a part of them samples all
    if sampling == "lhs":
        shares = qmc.LatinHypercube(dimension, rng=rng).random(count)
    else:
        power = int(np.ceil(np.log2(max(count, 2))))
        shares = qmc.Sobol(dimension, rng=rng).random_base2(power)[:count]
    low, high = np.array(bounds).T
    values: Floats = low + shares * (high - low)
    return values


def measure_rest(space: Space, x: Floats) -> tuple[int, Floats, Sensor | None]:
    """Measure all but the ranges: the reason to skip the design, its measures, and the sensor or
    None."""
    values = np.full(len(MEASURES), np.nan)
    try:
        sensor = sensor_of(space.sensor, space.names, x)
    except InputError:
        return 3, values, None
    values[0] = 2 * max(psd.radius for psd in sensor.psds)
    rest, least = np.zeros((1, 8)), space.layout.least_power
    if why := int(rest_reasons(margins(sensor, rest), readings(sensor, rest), least)[0]):
        return why, values, None
    if saturates(sensor, rest):
        return 7, values, None
    if space.required and not meets(sensor, space.layout, space.volume):
        return 4, values, None
    values[7:13] = FINE * uncertainties(sensor, rest, Knowledge(), space.layout.object)[0]
    values[13] = measures(sensor, rest)[0, 2]
    signs = np.sign(measures(sensor, space.mirror_volume, spectra=False)[:, 0])
    values[14] = float(abs(signs.sum()) == len(signs))
    return 0, values, sensor


def saturates(sensor: Sensor, states: Floats) -> bool:
    """Whether an electrode's current exceeds the share of the amplifier's full scale that the
    optimiser allows; never without electronics."""
    return bool((fullness(sensor, readings(sensor, states)) > FULL).any())


def meets(sensor: Sensor, layout: Layout, states: Floats) -> bool:
    """Return whether the design keeps all the layout's requirements at states of the volume."""
    if 2 * max(psd.radius for psd in sensor.psds) > layout.head:
        return False
    if saturates(sensor, states):
        return False
    asked = Requirement(layout, states, rim=bool(np.isfinite(sensor.apertures.rim)))
    if not margins_of(asked, sensor).min() > 0:
        return False
    between = replace(asked, states=worst_places_of(asked, sensor))
    return not len(between.states) or bool(margins_of(between, sensor).min() > 0)


def measure_design(
    space: Space, x: Floats, tolerance: float = FINE_ENOUGH
) -> tuple[int, Floats]:
    """Measure a design: the place in SKIPPED of why it is skipped, and its measures, else NaN.

    tolerance: of its ranges, in units of `ranges.FARTHEST_MM_RAD`.
    """
    why, values, sensor = measure_rest(space, x)
    if sensor is None:
        return why, values
    rules = replace(space.rules, condition=np.inf)
    clear = clearances(sensor, np.zeros((1, 6)), rules)[0]
    if not clear.min() > 0:
        return OUTSIDE[int(clear.argmin())], values
    ranges = axis_ranges(sensor, rules, np.zeros(6), tolerance)
    values[AT_RANGES] = FAR * np.array([axis.symmetric for axis in ranges])
    return 0, values


def part_of(space: Space, first: int) -> dict[str, Any]:
    """Return the table of the part that begins with design number `first`."""
    some = designs(space)[first : first + space.part]
    if space.plain:
        return part_table(space, first, some, *measure_designs(space, some))
    reasons, values, seconds = [], [], []
    for x in some:
        begin = time.perf_counter()
        why, measured = measure_design(space, x)
        seconds.append(time.perf_counter() - begin)
        reasons.append(why)
        values.append(measured)
    return part_table(space, first, some, np.array(reasons), np.array(values), np.array(seconds))


def part_table(
    space: Space, first: int, some: Floats, why: NDArray[Any], values: Floats, seconds: Floats
) -> dict[str, Any]:
    """The table of the designs (n, variables) from number `first` on, with their measures."""
    columns: dict[str, Any] = {"design": first + np.arange(len(some))}
    columns |= {name: some[:, i] for i, name in enumerate(space.names)}
    columns["skipped"] = np.array(SKIPPED)[why]
    columns |= {name: values[:, i] for i, name in enumerate(MEASURES)}
    return columns | {"seconds": seconds}


def measure_designs(space: Space, some: Floats) -> tuple[NDArray[Any], Floats, Floats]:
    """Measure plain designs (n, variables): why each is skipped, its measures, and its seconds.

    A design that is not a valid sensor is measured individually.
    """
    begin = time.perf_counter()
    designs, heads, possible = designs_of(space.sensor, space.rules, space.names, some)
    why, values = np.zeros(len(some), dtype=np.int64), np.full((len(some), len(MEASURES)), np.nan)
    numbers = np.flatnonzero(possible)
    for first in range(0, len(numbers), CHUNK):
        rows = slice(first, first + CHUNK)
        part, which = designs.subset(rows), numbers[rows]
        why[which], values[which, 1:] = measure(
            part, space.mirror_volume, space.layout.least_power, FINE_ENOUGH
        )
    values[:, AT_RANGES] *= FAR
    values[possible, 0] = heads[possible]
    seconds = np.full(len(some), (time.perf_counter() - begin) / max(1, len(some)))
    for n in np.flatnonzero(~possible).tolist():
        why[n], values[n] = measure_design(space, some[n])
    return why, values, seconds


def identity(space: Space, about: dict[str, str]) -> str:
    """The text that must be the same for a run to continue in a folder."""
    asked = f"{space.sampling} {space.count} {space.seed} {space.required}"
    asked += f" parts of {space.part}" if space.part != DESIGNS_PER_TASK else ""
    return f"{about.get('config_sha256', '')} {asked} {' '.join(space.objectives)}\n"


def forget(folder: Path) -> None:
    """Delete the designs of an older search."""
    shutil.rmtree(folder / "parts", ignore_errors=True)
    (folder / MARK).unlink(missing_ok=True)


def require_same(settings: Config, folder: Path, force: bool) -> None:
    """Raise `InputError` if a folder has designs of another configuration, unless `force`, which
    deletes them."""
    tabled = [folder / name for name in ("front.csv", "pareto.csv")]
    remedy = "use --force to start again, or --folder to name another folder"
    for file in [
        *parts_in(folder)[:1],
        *(file for file in tabled if file.exists()),
    ]:
        try:
            require_origin(file, read_head(file), settings, remedy)
        except InputError:
            if not force:
                raise
            forget(folder)


def prepare(folder: Path, space: Space, about: dict[str, str], force: bool) -> None:
    """Check whether a search can continue in a folder; `force` deletes an older search.

    Raises `OutputError` if the folder holds another search.
    """
    mark, mine = folder / MARK, identity(space, about)
    if force and mark.exists():
        forget(folder)
    if mark.exists() and mark.read_text() != mine:
        raise OutputError(
            f"{folder}: holds another search; use --force to start again, or --folder to name "
            "another folder"
        )


def write_part(
    space: Space, folder: Path, first: int, table: dict[str, Any], about: dict[str, str]
) -> None:
    """Write a part, and before the first part the file that identifies the search."""
    if not (folder / MARK).exists():
        write_text(folder / MARK, identity(space, about))
    prepare(folder, space, about, force=False)  # another process may have been faster
    write_table(part_path(folder, first), table, about)


def explore(
    space: Space,
    folder: Path,
    about: dict[str, str],
    scheduler: str | None = None,
    tell: Callable[[int, int], None] = lambda done, whole: None,
) -> None:
    """Write a Parquet file for each missing part.

    scheduler: address of a Dask cluster; by default all cores of this machine compute.
    """
    for torn in (folder / "parts").glob(".*.parquet"):  # by a run that was killed
        torn.unlink()
    firsts = parts(space)
    missing = [first for first in firsts if not part_path(folder, first).exists()]
    done = len(firsts) - len(missing)
    tell(done, len(firsts))
    made = run_on_cluster if scheduler else run_in_processes
    for first, table in made(space, missing, scheduler or ""):
        write_part(space, folder, first, table, about)
        done += 1
        tell(done, len(firsts))


def parts(space: Space) -> range:
    """The number of the first design of each part."""
    return range(0, len(designs(space)), space.part)


def part_path(folder: Path, first: int) -> Path:
    return folder / "parts" / f"{first:010d}.parquet"


def run_in_processes(
    space: Space, firsts: list[int], _: str
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield parts as they are finished, from a process on each core."""
    if not firsts:
        return
    measure_design(space, designs(space)[0])  # compiled once, before the processes begin
    workers = min(cores(), len(firsts))
    if workers == 1:
        yield from ((first, part_of(space, first)) for first in firsts)
        return
    with ProcessPoolExecutor(
        workers, mp_context=get_context("spawn"), initializer=serve, initargs=(os.getpid(),)
    ) as pool:
        jobs = {pool.submit(part_of, space, first): first for first in firsts}
        try:
            for job in as_completed(jobs):
                yield jobs[job], job.result()
        except BaseException:
            for worker in active_children():  # the next run makes their unfinished parts again
                worker.terminate()
            pool.shutdown(cancel_futures=True)
            raise


def serve(parent: int) -> None:
    """Make a worker ignore signals, which its parent handles, and end when the parent has ended."""
    for name in ("SIGINT", "SIGHUP"):  # a terminal sends them to all; the parent ends its workers
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_CHECK_INTERVAL_S)
        os._exit(1)

    threading.Thread(target=watch, name="watch the parent", daemon=True).start()


def run_on_cluster(
    space: Space, firsts: list[int], address: str
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield parts as a cluster finishes them; parts of a lost worker are made again, and a new
    worker takes part."""
    with client_of(address) as client:
        from dask.distributed import as_completed as completed

        jobs = client.map(partial(part_of, space), firsts, pure=False, retries=5)
        numbers = {job.key: first for job, first in zip(jobs, firsts, strict=True)}
        for job in completed(jobs):  # type: ignore[no-untyped-call]
            yield numbers[job.key], job.result()
            job.release()


def client_of(address: str) -> Any:
    """Connect to a Dask cluster. Raises `InputError` if none answers."""
    distributed = require_extra("distributed", "--scheduler")
    try:
        return distributed.Client(address, timeout="10s")
    except OSError as error:
        raise InputError(f"--scheduler {address}: no cluster answers: {error}") from None


def cluster_words(address: str) -> str:
    """Describe a cluster: its number of workers and its dashboard's address."""
    with client_of(address) as client:
        known = client.scheduler_info(n_workers=-1)
        place = f"{len(known['workers'])} workers at {address}"
        if "dashboard" not in known.get("services", {}):
            return f"{place}; the scheduler has no dashboard"
        return f"{place}; dashboard {client.dashboard_link}"


def parts_in(folder: Path) -> list[Path]:
    """List the complete parts; the name of an incomplete one begins with a dot."""
    return sorted(p for p in (folder / "parts").glob("*.parquet") if not p.name.startswith("."))


def collect(folder: Path, firsts: Iterable[int] | None = None) -> dict[str, NDArray[Any]]:
    """Join the existing parts, or those of the given numbers, in the designs' order."""
    files = parts_in(folder)
    if firsts is not None:
        files = [path for path in (part_path(folder, first) for first in firsts) if path in files]
    if not files:
        raise InputError(f"{folder}: holds no designs")
    tables = [read_columns(file) for file in files]
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}


def collect_older(space: Space, folder: Path) -> dict[str, NDArray[Any]] | None:
    """Read the designs of an earlier run in a folder; None if none of them has the space's
    variables and objectives."""
    if not parts_in(folder):
        return None
    table = collect(folder)
    return table if {*space.names, *space.objectives} <= table.keys() else None


def require_measures(names: Sequence[str]) -> None:
    """Raise `InputError` for a name that cannot be an objective."""
    able = MEASURES[:-1]
    unknown = [name for name in names if name not in able]
    if unknown:
        raise InputError(f"unknown measure {', '.join(unknown)}; allowed: {', '.join(able)}")


def front(table: dict[str, NDArray[Any]], objectives: list[str]) -> Booleans:
    """Which designs no other one beats in all objectives; ranges are maximised, others
    minimised."""
    signs = [-1.0 if name.startswith("range") else 1.0 for name in objectives]
    costs = np.stack([s * table[n] for s, n in zip(signs, objectives, strict=True)], axis=1)
    best = np.zeros(len(costs), dtype=bool)
    known = np.flatnonzero(np.isfinite(costs).all(axis=1))
    left = known[np.lexsort(costs[known].T[::-1])]
    while len(left):  # the first is beaten by none that follow; what it beats goes
        first = left[0]
        best[first] = True
        beaten = (costs[left] >= costs[first]).all(axis=1)
        left = left[~beaten]
    return best


def summary(
    table: dict[str, NDArray[Any]], best: Booleans, objectives: Sequence[str],
    indices: dict[str, dict[str, Index]], seconds: float,
) -> list[str]:  # fmt: skip
    """Summarise a table of designs: how many were skipped and why, how many are on the front, and
    which variable affects which objective.

    seconds: duration of the run.
    """
    skipped, spent = table["skipped"], table["seconds"]
    lines = [f"{len(skipped)} designs, {seconds:.1f} s in this run"]
    for reason in np.unique(skipped):
        each = spent[skipped == reason]
        typical = f"{1e3 * np.median(each):.2f} ms each"
        lines.append(f"  {len(each):7} {reason or 'looked at'} ({typical})")
    lines.append(f"{int(best.sum())} are beaten by none in {', '.join(objectives)}")
    for name, effects in indices.items():
        shown = ", ".join(f"{key} {s.value:.2f} +- {s.half:.2f}" for key, s in effects.items())
        lines.append(f"  {name} follows: {shown}")
    return lines
