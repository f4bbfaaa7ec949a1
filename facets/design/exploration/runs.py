"""Exploration of a design space on one machine or many.

Designs are numbered, so that any part of them can be made again anywhere: a part is some hundred
designs, goes to a worker as a number, and comes back as a table that is written at once. A run that
was interrupted continues with the missing parts.
"""

from __future__ import annotations

import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError, OutputError
from ...core.extras import require_extra
from ...core.units import Booleans
from ...files.columns import join_columns
from ...files.provenance import require_origin
from ...files.tables import read_columns, read_head, write_table
from ...model.threads import cores
from .space import Space, designs, measure_design, part_of

if TYPE_CHECKING:
    from ...characterization.sensitivity import Index
    from ...core.settings import Config

#: A process gets this much work at least, s of processor time: its start takes about one.
LEAST_WORK_S = 2.0
#: Interval at which a worker checks that its parent still runs, s.
PARENT_CHECK_INTERVAL_S = 1.0


def search_of(space: Space) -> dict[str, str]:
    """What must be the same, beside the configuration, for a run to continue in a folder."""
    asked = f"{space.count} {space.seed} {space.required} parts of {space.part}"
    return {"search": f"{asked} {' '.join(space.objectives)}"}


def require_same(settings: Config, folder: Path, force: bool) -> None:
    """Raise `InputError` if a folder has designs of another configuration, unless `force`, which
    deletes them."""
    tabled = [folder / name for name in ("front.csv", "pareto.csv")]
    remedy = "use --force to start again, or --folder to name another folder"
    for file in [*parts_in(folder)[:1], *(file for file in tabled if file.exists())]:
        try:
            require_origin(file, read_head(file), settings, remedy)
        except InputError:
            if not force:
                raise
            shutil.rmtree(folder / "parts", ignore_errors=True)


def prepare(folder: Path, space: Space, force: bool = False) -> None:
    """Check whether a search can continue in a folder; `force` deletes an older search.

    Raises `OutputError` if the folder holds another search.
    """
    if force:
        shutil.rmtree(folder / "parts", ignore_errors=True)
    for part in parts_in(folder)[:1]:
        if read_head(part).get("search") != search_of(space)["search"]:
            raise OutputError(
                f"{folder}: holds another search; use --force to start again, or --folder to name "
                "another folder"
            )


def write_part(
    space: Space, folder: Path, first: int, table: dict[str, Any], about: dict[str, str]
) -> None:
    prepare(folder, space)  # another process may have been faster
    write_table(part_path(folder, first), table, about | search_of(space))


def explore(
    space: Space,
    folder: Path,
    about: dict[str, str],
    scheduler: str | None = None,
    on_progress: Callable[[int, int], None] = lambda done, whole: None,
) -> None:
    """Write a Parquet file for each missing part.

    scheduler: address of a Dask cluster; by default all cores of this machine compute.
    """
    for torn in (folder / "parts").glob(".*.parquet"):  # by a run that was killed
        torn.unlink()
    firsts = range(0, len(designs(space)), space.part)
    missing = [first for first in firsts if not part_path(folder, first).exists()]
    done = len(firsts) - len(missing)
    on_progress(done, len(firsts))
    made = run_on_cluster if scheduler else run_in_processes
    for first, table in made(space, missing, scheduler or ""):
        write_part(space, folder, first, table, about)
        done += 1
        on_progress(done, len(firsts))


def part_path(folder: Path, first: int) -> Path:
    return folder / "parts" / f"{first:010d}.parquet"


def run_in_processes(
    space: Space, firsts: list[int], _: str
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield parts as they are finished, from this process, or from several if there is enough to
    do."""
    if not firsts:
        return
    measure_design(space, designs(space)[0])  # compiled once, before the processes begin
    begin, rest = time.process_time(), firsts[1:]
    table = part_of(space, firsts[0])
    work = (time.process_time() - begin) * len(rest)
    yield firsts[0], table
    workers = min(cores(), int(work / LEAST_WORK_S))
    if workers < 2:
        yield from ((first, part_of(space, first)) for first in rest)
        return
    with ProcessPoolExecutor(
        workers, mp_context=get_context("spawn"), initializer=serve, initargs=(os.getpid(),)
    ) as pool:
        jobs = {pool.submit(part_of, space, first): first for first in rest}
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
        for job in completed(jobs):
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


def collect(folder: Path) -> dict[str, NDArray[Any]]:
    """Join the existing parts, in the designs' order."""
    files = parts_in(folder)
    if not files:
        raise InputError(f"{folder}: holds no designs")
    return join_columns([read_columns(file) for file in files])


def collect_older(space: Space, folder: Path) -> dict[str, NDArray[Any]] | None:
    """Read the designs of an earlier run in a folder; None if none of them has the space's
    variables and objectives."""
    if not parts_in(folder):
        return None
    table = collect(folder)
    return table if {*space.names, *space.objectives} <= table.keys() else None


def summary(
    table: dict[str, NDArray[Any]], best: Booleans, objectives: Sequence[str],
    indices: dict[str, dict[str, Index]], seconds: float,
) -> list[str]:  # fmt: skip
    """Summarise a table of designs: how many were skipped and why, how many are on the front, and
    which variable affects which objective.

    seconds: duration of the run.
    """
    skipped, each = table["skipped"], 1e3 * np.median(table["seconds"])
    lines = [f"{len(skipped)} designs, {seconds:.1f} s in this run, {each:.2f} ms each"]
    for reason in np.unique(skipped):
        lines.append(f"  {(skipped == reason).sum():7} {reason or 'looked at'}")
    lines.append(f"{int(best.sum())} are beaten by none in {', '.join(objectives)}")
    for name, effects in indices.items():
        shown = ", ".join(f"{key} {s.value:.2f} +- {s.half:.2f}" for key, s in effects.items())
        lines.append(f"  {name} follows: {shown}")
    return lines
