"""A design space searched: many layouts with their ranges and resolutions, on one machine or many.

Designs are drawn by a number, so that any part of them can be made again anywhere: a part is some
hundred designs, goes to a worker as a number, and comes back as a table that is written at once.
A run that was cut off goes on with the parts that are missing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .layout import FACETS, PSDS, varied
from .model import margins, readings
from .names import ANGLES, POSE
from .ranges import axis_ranges
from .resolution import Estimator, uncertainties
from .rules import Rules
from .sensor import Sensor
from .threads import cores

if TYPE_CHECKING:
    from .config.values import Layout

Floats = NDArray[np.float64]

#: Designs a task: about a second of work.
PART = 200
#: To what share of its length a range is followed.
FINE_ENOUGH = 1e-5
#: What is told of a design; ranges are symmetric and in all, uncertainties at rest.
RANGES = tuple(f"range_{n}_mrad" if n in ANGLES else f"range_{n}_mm" for n in POSE)
FINE = tuple(f"u_{n}_urad" if n in ANGLES else f"u_{n}_um" for n in POSE)
MEASURES = ("head_mm", *RANGES, *FINE)
#: Why a design was not looked at further; "" for those that were.
SKIPPED = ("", "spot beside the PSD at rest", "too little light at rest", "no sensor")


@dataclass(frozen=True)
class Space:
    """What is searched.

    sampling: "sobol", "lhs" or "grid".  count: of designs, at least.  part: designs a task.
    """

    sensor: Sensor
    rules: Rules
    layout: Layout
    sampling: str
    count: int
    seed: int
    part: int = PART

    @property
    def names(self) -> list[str]:
        return list(self.layout.variables)


def designs(space: Space) -> Floats:
    """All designs (n, variables), in the units of the variables' names."""
    from scipy.stats import qmc

    bounds = np.array([space.layout.variables[name] for name in space.names])
    if not len(bounds):
        raise InputError("optimize.variables is empty: nothing may change")
    dimension = len(bounds)
    if space.sampling == "grid":
        side = int(np.ceil(space.count ** (1 / dimension)))
        axes = [np.linspace(low, high, side) for low, high in bounds]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dimension)
    rng = np.random.default_rng(space.seed)
    if space.sampling == "lhs":
        shares = qmc.LatinHypercube(dimension, rng=rng).random(space.count)
    else:
        power = int(np.ceil(np.log2(max(space.count, 2))))
        shares = qmc.Sobol(dimension, rng=rng).random_base2(power)[: space.count]
    drawn: Floats = bounds[:, 0] + shares * (bounds[:, 1] - bounds[:, 0])
    return drawn


def sensor_of(sensor: Sensor, names: list[str], x: Floats) -> Sensor:
    """The sensor with the named variables at x."""
    p, sizes = varied(sensor, names, x.tolist())
    facets = [
        replace(facet, inclination=p[i], azimuth=p[i + 1])
        for facet, i in zip(sensor.facets, FACETS, strict=True)
    ]
    psds = [
        replace(psd, radius=p[i], azimuth=p[i + 1], height=p[i + 2], pitch=p[i + 4],
                size_y=size, size_z=size)
        for psd, i, size in zip(sensor.psds, PSDS, sizes, strict=True)
    ]  # fmt: skip
    beam = replace(sensor.beam, power=p[0], diameter_x=p[1], diameter_y=p[2])
    return replace(
        sensor,
        beam=beam,
        facets=(facets[0], facets[1], facets[2]),
        psds=(psds[0], psds[1], psds[2]),
    )


def looked_at(space: Space, x: Floats) -> tuple[int, Floats]:
    """Why a design is skipped, by its place in SKIPPED, and its measures, NaN where it is."""
    values = np.full(len(MEASURES), np.nan)
    try:
        sensor = sensor_of(space.sensor, space.names, x)
    except InputError:
        return 3, values
    values[0] = 2 * max(psd.radius for psd in sensor.psds)
    rest = np.zeros((1, 8))
    room = margins(sensor, rest)
    if not np.nanmin(np.where(np.isnan(room), -1, room)) > 0:
        return 1, values
    if not readings(sensor, rest)[:, 2::3].min() > space.layout.least_power:
        return 2, values
    units = np.array([1e3 if name in ANGLES else 1.0 for name in POSE])
    try:
        found = axis_ranges(
            sensor, replace(space.rules, condition=np.inf), np.zeros(6), FINE_ENOUGH
        )
    except InputError:
        return 2, values
    values[1:7] = units * np.array([axis.symmetric for axis in found])
    sigma = uncertainties(sensor, rest, Estimator("", np.inf))[0]
    values[7:] = 1e3 * units * sigma
    return 0, values


def part_of(space: Space, first: int) -> dict[str, Any]:
    """A table of some designs, from number `first` on."""
    drawn = designs(space)[first : first + space.part]
    rows = [looked_at(space, x) for x in drawn]
    columns: dict[str, Any] = {"design": first + np.arange(len(drawn))}
    columns |= {name: drawn[:, i] for i, name in enumerate(space.names)}
    columns["skipped"] = np.array([SKIPPED[why] for why, _ in rows])
    values = np.array([row for _, row in rows])
    return columns | {name: values[:, i] for i, name in enumerate(MEASURES)}


def explore(
    space: Space,
    folder: Path,
    about: dict[str, str],
    scheduler: str | None = None,
    tell: Callable[[int, int], None] = lambda done, whole: None,
) -> None:
    """Writes a Parquet file for each part that is not there yet.

    scheduler: address of a Dask cluster; else all cores of this machine.
    """
    from .tables import write_table

    count = len(designs(space))
    firsts = range(0, count, space.part)
    missing = [first for first in firsts if not part_path(folder, first).exists()]
    done = len(firsts) - len(missing)
    tell(done, len(firsts))
    made = clustered if scheduler else pooled
    for first, table in made(space, missing, scheduler or ""):
        write_table(part_path(folder, first), table, about)
        done += 1
        tell(done, len(firsts))


def part_path(folder: Path, first: int) -> Path:
    return folder / "parts" / f"{first:010d}.parquet"


def pooled(space: Space, firsts: list[int], _: str) -> Iterator[tuple[int, dict[str, Any]]]:
    """Parts as they come, from a process on each core."""
    if not firsts:
        return
    looked_at(space, designs(space)[0])  # compiled once, before the processes begin
    workers = min(cores(), len(firsts))
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        jobs = {pool.submit(part_of, space, first): first for first in firsts}
        try:
            for job in as_completed(jobs):
                yield jobs[job], job.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def clustered(
    space: Space, firsts: list[int], address: str
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Parts as they come, from a cluster; those of a worker that is lost are made again."""
    try:
        from dask.distributed import Client
        from dask.distributed import as_completed as completed
    except ImportError:
        raise InputError("--scheduler needs the extra `cluster`: facets-6dof[cluster]") from None
    try:
        client = Client(address, timeout="10s")
    except OSError as error:
        raise InputError(f"--scheduler {address}: no cluster answers: {error}") from None
    with client:
        jobs = client.map(lambda first: part_of(space, first), firsts, pure=False, retries=5)
        numbers = {job.key: first for job, first in zip(jobs, firsts, strict=True)}
        for job in completed(jobs):
            yield numbers[job.key], job.result()
            job.release()


def collected(folder: Path) -> dict[str, NDArray[Any]]:
    """All parts that are there, as one table in the designs' order."""
    import pyarrow.parquet as pq

    files = sorted((folder / "parts").glob("*.parquet"))
    if not files:
        raise InputError(f"{folder}: holds no designs")
    tables = [pq.read_table(file) for file in files]
    names = tables[0].column_names
    return {
        name: np.concatenate([table[name].to_numpy(zero_copy_only=False) for table in tables])
        for name in names
    }


def require_measures(names: list[str]) -> None:
    unknown = [name for name in names if name not in MEASURES]
    if unknown:
        raise InputError(f"no measure {', '.join(unknown)}; there are: {', '.join(MEASURES)}")


def front(table: dict[str, NDArray[Any]], objectives: list[str]) -> NDArray[np.bool_]:
    """Which designs are not beaten in all objectives; ranges are to be large, all else small."""
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


def sensitivity(
    table: dict[str, NDArray[Any]], names: list[str], objectives: list[str]
) -> dict[str, dict[str, float]]:
    """First-order Sobol indices of each objective by each variable, by SALib's RBD-FAST."""
    from SALib.analyze import rbd_fast

    good = np.isfinite(table["range_tz_mm"])
    if good.sum() < 100:
        return {}
    x = np.stack([table[name][good] for name in names], axis=1)
    bounds = [[float(low), float(high)] for low, high in zip(x.min(0), x.max(0), strict=True)]
    problem = {"num_vars": len(names), "names": names, "bounds": bounds}
    found = {}
    for objective in objectives:
        if np.ptp(table[objective][good]) == 0:
            continue
        result = rbd_fast.analyze(problem, x, table[objective][good], seed=1)
        found[objective] = dict(zip(names, (float(s) for s in result["S1"]), strict=True))
    return found
