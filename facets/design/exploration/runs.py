"""Exploration of a design space on one machine or many.

Designs are numbered, so that any process can make any part of them. A part consists of some hundred
designs; a worker gets its number and returns a table, which is written at once. An interrupted run
continues with the missing parts.
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

#: Least work of a process, s of processor time, because its start takes about one second.
LEAST_WORK_S = 2.0
#: Interval at which a worker checks that its parent still runs, s.
PARENT_CHECK_INTERVAL_S = 1.0


def search_of(space: Space) -> dict[str, str]:
    """The settings, in addition to the configuration, that two runs in one folder must share."""
    numbers = f"{space.count} {space.seed} {space.required} parts of {space.part}"
    return {"search": f"{numbers} {' '.join(space.objectives)}"}


def require_same(settings: Config, folder: Path, force: bool) -> None:
    """Raise `InputError` if a folder has designs of another configuration; with `force`, delete
    them instead."""
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
    """Raise `OutputError` if the folder holds another search; `force` deletes an older search."""
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
    """Write the measured designs of a part, the first of which has this number, to its file."""
    prepare(folder, space)  # another process may have been faster
    write_table(part_path(folder, first), table, about | search_of(space))


def explore(
    space: Space,
    folder: Path,
    about: dict[str, str],
    scheduler: str | None = None,
    on_progress: Callable[[int, int], None] = lambda finished_count, total: None,
) -> None:
    """Write a Parquet file for each missing part.

    scheduler: address of a Dask cluster; None for the cores of this machine.
    """
    for incomplete in (folder / "parts").glob(".*.parquet"):  # from a run that was killed
        incomplete.unlink()
    firsts = range(0, len(designs(space)), space.part)
    missing = [first for first in firsts if not part_path(folder, first).exists()]
    finished_count = len(firsts) - len(missing)
    on_progress(finished_count, len(firsts))
    tables = run_on_cluster if scheduler else run_in_processes
    for first, table in tables(space, missing, scheduler or ""):
        write_part(space, folder, first, table, about)
        finished_count += 1
        on_progress(finished_count, len(firsts))


def part_path(folder: Path, first: int) -> Path:
    """The file of the part whose first design has this number."""
    return folder / "parts" / f"{first:010d}.parquet"


def run_in_processes(
    space: Space, firsts: list[int], _: str
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield parts as they are finished, from this process, or from several if there is enough
    work."""
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
            for worker in active_children():  # the next run makes the unfinished parts
                worker.terminate()
            pool.shutdown(cancel_futures=True)
            raise


def serve(parent: int) -> None:
    """Make a worker ignore signals, which its parent handles, and end with its parent."""
    for name in ("SIGINT", "SIGHUP"):  # a terminal sends them to all processes
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)

    def watch() -> None:
        """End the process when its parent has ended."""
        while os.getppid() == parent:
            time.sleep(PARENT_CHECK_INTERVAL_S)
        os._exit(1)

    threading.Thread(target=watch, name="watch the parent", daemon=True).start()


def run_on_cluster(
    space: Space, firsts: list[int], address: str
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield parts as a cluster finishes them; it repeats the parts of a lost worker and uses new
    workers."""
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
        information = client.scheduler_info(n_workers=-1)
        place = f"{len(information['workers'])} workers at {address}"
        if "dashboard" not in information.get("services", {}):
            return f"{place}; the scheduler has no dashboard"
        return f"{place}; dashboard {client.dashboard_link}"


def parts_in(folder: Path) -> list[Path]:
    """List the complete parts; the name of an incomplete one begins with a dot."""
    return sorted(p for p in (folder / "parts").glob("*.parquet") if not p.name.startswith("."))


def collect(folder: Path) -> dict[str, NDArray[Any]]:
    """Join the existing parts, in the designs' order. Raises `InputError` if there are none."""
    files = parts_in(folder)
    if not files:
        raise InputError(f"{folder}: holds no designs")
    return join_columns([read_columns(file) for file in files])


def collect_older(space: Space, folder: Path) -> dict[str, NDArray[Any]] | None:
    """Read the designs of an earlier run in a folder; None if there are none, or if they lack the
    space's variables or objectives."""
    if not parts_in(folder):
        return None
    table = collect(folder)
    return table if {*space.names, *space.objectives} <= table.keys() else None


def summary(
    table: dict[str, NDArray[Any]], best: Booleans, objectives: Sequence[str],
    indices: dict[str, dict[str, Index]], seconds: float,
) -> list[str]:  # fmt: skip
    """Sentences on a table of designs: numbers of skipped designs by reason, number of designs on
    the front, and the sensitivity of each objective to the variables.

    seconds: duration of the run.
    """
    skipped, duration = table["skipped"], 1e3 * np.median(table["seconds"])
    lines = [f"{len(skipped)} designs, {seconds:.1f} s in this run, {duration:.2f} ms each"]
    for reason in np.unique(skipped):
        lines.append(f"  {(skipped == reason).sum():7} {reason or 'looked at'}")
    lines.append(f"{int(best.sum())} are beaten by none in {', '.join(objectives)}")
    for name, effects in indices.items():
        shown = ", ".join(f"{key} {s.value:.2f} +- {s.half:.2f}" for key, s in effects.items())
        lines.append(f"  {name} follows: {shown}")
    return lines
