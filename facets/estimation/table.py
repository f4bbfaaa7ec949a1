"""Solve a table of readings of any length into a table of poses."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import InputError
from ..core.names import READING_COLUMNS, STATE_COLUMNS, TEMPERATURE_COLUMN
from ..core.units import Floats
from ..detectors.skew import align
from ..detectors.temperature import beam_shift, warmer_than_reference
from ..files import tables
from ..files.columns import TIMES
from .measurement import Measurement
from .solution import UNPARSABLE, Samples, worded_columns

if TYPE_CHECKING:
    from ..core.sensor import Sensor
    from ..core.settings import Config, Solve

#: Columns of the beam's position, and of its standard uncertainties in a table of poses.
BEAM_COLUMNS = STATE_COLUMNS[6:]
BEAM_UNCERTAINTIES = tuple(f"u_{name}" for name in BEAM_COLUMNS)
#: Advice for a table of poses that is solved with a known beam.
KNOWN_ADVICE = (
    "give --beam free, or leave the two columns out if the beam stood still at the origin"
)


def solve_table(
    measurement: Measurement,
    readings: Path,
    poses: Path,
    about: dict[str, str],
    progress: Callable[[int], None] = lambda _: None,
    rows: int = tables.CHUNK,
) -> None:
    """Solve each row of the table `readings` into a row of `poses`; NaN for rows without numbers.

    Needed columns: psi_a_mm, zeta_a_mm, power_a_mw, ... Times are copied. The columns bx_mm, by_mm
    give the position of a beam that is not free; estimates raise `InputError`, see
    `require_known_beam`. The measurement's tally counts the lines without numbers.

    about: provenance for the header.  progress: called with the number of bytes read.  rows:
    number of rows in a piece.
    """
    tables.ending(poses)
    config = measurement.config
    optional = (*TIMES, *((TEMPERATURE_COLUMN,) if config.sensor.thermal.is_on else ()))
    if config.solve.beam != "free":
        optional = (*optional, *BEAM_COLUMNS, *BEAM_UNCERTAINTIES)
    read = tables.read_chunks(readings, READING_COLUMNS, optional, rows)
    chunks = deque[tables.Chunk]()

    def samples() -> Iterator[Samples]:
        count = 0
        for chunk in align_chunks(config.sensor, known_places(readings, read)):
            chunks.append(chunk)
            yield samples_in(config, chunk, count)
            count += len(chunk.lines)

    solved = measurement.poses_of_all(samples(), "the table")
    first = next(solved, None)
    if first is None:
        raise InputError(f"{readings}: no rows")
    if measurement.zero is not None:
        about = about | {"zero": measurement.zero_text}
    with tables.open_writer(poses, about) as writer:
        for part in chain([first], solved):
            chunk = chunks.popleft()
            columns = worded_columns(part.columns())
            columns["status"] = np.where(chunk.unparsable, UNPARSABLE, columns["status"])
            lines = chunk.lines[chunk.unparsable]
            measurement.tally.rename(part.solution.status[chunk.unparsable], UNPARSABLE, lines)
            time = time_in(chunk)
            writer.write(({} if time is None else {"time_s": time}) | columns)
            progress(chunk.bytes_read)


def samples_in(config: Config, chunk: tables.Chunk, before: int) -> Samples:
    """Samples in a piece of a table.  before: number of rows in earlier pieces."""
    return Samples(
        readings_in(chunk),
        before + 1 + np.arange(len(chunk.lines)),
        time_in(chunk),
        chunk.columns.get(TEMPERATURE_COLUMN),
        place_in(config.sensor, config.solve, chunk),
    )


def time_in(chunk: tables.Chunk) -> Floats | None:
    """Times (n,) in a piece of a table, s; None without a column of times."""
    for name, unit in TIMES.items():
        if name in chunk.columns:
            return unit * chunk.columns[name]
    return None


def require_time(chunk: tables.Chunk) -> Floats:
    """The times (n,) in a piece of a table, s, for detectors that are read one after the other.

    Raises `InputError` if there are no times.
    """
    time = time_in(chunk)
    if time is None:
        raise InputError(
            "sensor.light.delays_us are given, but the readings have no column time_s, from which "
            "their rate of change follows; add the column, or set the delays to 0"
        )
    return time


def readings_in(chunk: tables.Chunk) -> Floats:
    """Readings (n, 9), mm and mW, in a piece of a table."""
    return np.column_stack([chunk.columns[name] for name in READING_COLUMNS])


def place_in(sensor: Sensor, options: Solve, chunk: tables.Chunk) -> Floats | None:
    """The beam's position (n, 2) in a piece of a table, mm; None without its columns.

    The offset and the shift by the temperature are subtracted from the position in a table of
    poses, recognised by its uncertainties, because a `Measurement` adds them.
    """
    if not all(name in chunk.columns for name in BEAM_COLUMNS):
        return None
    place = np.column_stack([chunk.columns[name] for name in BEAM_COLUMNS])
    if not all(name in chunk.columns for name in BEAM_UNCERTAINTIES):
        return place
    warmer = warmer_than_reference(sensor, chunk.columns.get(TEMPERATURE_COLUMN))
    return place - options.beam_offset - (0.0 if warmer is None else beam_shift(sensor, warmer))


def align_chunks(sensor: Sensor, chunks: Iterable[tables.Chunk]) -> Iterator[tables.Chunk]:
    """Yield the pieces of a table with the readings of each row converted to one instant, see
    `align`; neighbours of a row may be in other pieces.

    Raises `InputError` for a sensor with delays if the table has no times.
    """
    if not any(sensor.light.delays):
        yield from chunks
        return
    near = deque[tables.Chunk | None]([None], maxlen=3)
    for chunk in chain(chunks, [None]):
        near.append(chunk)
        current = near[1]
        if len(near) < 3 or current is None:
            continue
        rows = zip(near, (slice(-1, None), slice(None), slice(1)), strict=True)
        parts = [(require_time(piece)[n], readings_in(piece)[n]) for piece, n in rows if piece]
        time, raw = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        first = int(near[0] is not None)
        aligned = align(sensor, time, raw)[first : first + len(current.lines)]
        named = dict(zip(READING_COLUMNS, aligned.T, strict=True))
        yield replace(current, columns={**current.columns, **named})


def require_known_beam(path: Path, chunk: tables.Chunk, advice: str) -> None:
    """Raise `InputError` if the beam's position in a table is an estimate.

    Tables of poses also have the uncertainties u_bx_mm, u_by_mm. If these are not 0, the position
    was estimated from the readings themselves; using it as known would state far too small
    uncertainties.  advice: what to do instead, for the message.
    """
    for name, uncertainty in zip(BEAM_COLUMNS, BEAM_UNCERTAINTIES, strict=True):
        if name not in chunk.columns or uncertainty not in chunk.columns:
            continue
        estimated = np.flatnonzero(chunk.columns[uncertainty] > 0)
        if len(estimated):
            line, u = chunk.lines[estimated[0]], chunk.columns[uncertainty][estimated[0]]
            raise InputError(
                f"{path}:{line}: {name} is an estimate ({uncertainty} is {u:.3g}), not "
                f"a known position of the beam; {advice}"
            )


def known_places(path: Path, chunks: Iterable[tables.Chunk]) -> Iterator[tables.Chunk]:
    """Yield the pieces of a table after checking that any position of the beam is known."""
    for chunk in chunks:
        require_known_beam(path, chunk, KNOWN_ADVICE)
        yield chunk
