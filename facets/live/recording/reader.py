"""A recording read again: its blocks, and how it was made."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from ...core.errors import InputError
from ...tracking.encoder import Encoder
from ..sources.source import Block
from .index import CLOSED, Damage, are_events_whole, proves, read_rows, unpack_encoder


@dataclass(frozen=True)
class Seal:
    """Sizes of a recording's files when it was closed; see `Recording.seal`."""

    bytes: int
    rows: int
    poses: int
    meta_crc: int
    refused_bytes: int
    refused_poses: int


def seal_of(folder: Path) -> Seal | None:
    """The last event of a recording; None if it was not closed."""
    names = [field.name for field in fields(Seal)]
    lines = (events_of(folder) or b"").splitlines()
    with suppress(StopIteration, ValueError, KeyError, TypeError):
        last = next(json.loads(line) for line in reversed(lines) if line.strip())
        if last["event"] == CLOSED:
            return Seal(*(int(last[name]) for name in names))
    return None


def events_of(folder: Path) -> bytes | None:
    """The bytes of `events.jsonl`; None if the file cannot be read."""
    with suppress(OSError):
        return (folder / "events.jsonl").read_bytes()
    return None


def blocks(folder: Path, damage: Damage | None = None, salvage: bool = False) -> Iterator[Block]:
    """Yield the blocks of a recording, also of one that ended in the middle of a write.

    Bytes that no sound row of the index proves come as separate, `doubtful` blocks; the beam's
    place is then unknown if a stage carried the beam.  damage: counts differences from the written
    state.  salvage: do without an index that is missing or belongs to other bytes; otherwise such
    an index raises `InputError`.
    """
    damage = damage if damage is not None else Damage()
    seal, size = seal_of(folder), size_of(folder)
    damage.events = not are_events_whole(events_of(folder))
    rows, damage.rows = read_rows(read_index(folder, salvage))
    with open_bytes(folder) as file:
        if len(rows) and not any_agrees(rows, file):
            if seal and not salvage:
                raise foreign_index(folder, seal, size, len(rows))
            rows, damage.rows = rows[:0], damage.rows + len(rows)
        if seal:
            damage.absent = max(0, seal.rows - len(rows) - damage.rows)
            damage.missing = max(0, seal.bytes - size)
        carried = not len(rows) or not np.isnan(rows["stage"][:, 0]).all()
        nowhere = Encoder(-np.inf, np.zeros(2), np.zeros(2)) if carried else None
        yield from indexed_blocks(file, rows, size, nowhere, damage)
        rest = file.read()
        damage.unproven += len(rest)
        if rest:
            yield Block(rest, float("nan"), nowhere, doubtful=True)


def open_bytes(folder: Path) -> BinaryIO:
    """Open the file of the received bytes; raises `InputError` if that fails."""
    path = folder / "bytes.bin"
    try:
        return path.open("rb")
    except OSError as error:
        raise missing_file(path, error, "a recording cannot be solved without its bytes") from None


def foreign_index(folder: Path, seal: Seal, size: int, rows: int) -> InputError:
    """The error of a sealed recording in which no row of the index agrees with the bytes."""
    path = folder / "bytes.bin"
    if not size:
        return InputError(f"{path}: is empty, but held {seal.bytes} bytes when it was closed")
    return InputError(
        f"{folder / 'index.bin'}: none of its {rows} rows agrees with {path}: one of the two is "
        f"damaged or of another recording. `facets replay {folder} --recover` solves the bytes "
        "without it"
    )


def indexed_blocks(
    file: BinaryIO, rows: Any, size: int, nowhere: Encoder | None, damage: Damage
) -> Iterator[Block]:
    """Yield the blocks of the index's rows, and the bytes between them.

    size: of the file, bytes.  nowhere: the stage's place for bytes that no row proves.
    """
    place, known_missing = 0, damage.missing
    for row in rows:
        offset, length, arrival = int(row["offset"]), int(row["length"]), float(row["monotonic"])
        if offset < place:  # This program writes no such row.
            damage.rows += 1
            continue
        if offset > place:
            between = file.read(offset - place)
            damage.unproven += len(between)
            if between:
                yield Block(between, arrival, nowhere, doubtful=True)
        data = file.read(min(length, size))
        place = offset + length
        lacking = length - len(data)
        damage.missing += max(0, lacking - known_missing)
        known_missing = max(0, known_missing - lacking)
        sound = proves(row, data)
        damage.unproven += 0 if sound else len(data)
        if data:
            yield Block(data, arrival, unpack_encoder(row["stage"]), doubtful=not sound)


def read_index(folder: Path, salvage: bool) -> bytes:
    """The bytes of the index; raises `InputError` if it cannot be read, unless `salvage`: then it
    is empty."""
    path = folder / "index.bin"
    try:
        return path.read_bytes()
    except OSError as error:
        if salvage:
            return b""
        if not size_of(folder):
            raise InputError(
                f"{folder}: is not a recording: it has no index.bin and no bytes"
            ) from None
        remedy = f"`facets replay {folder} --recover` solves the bytes without it"
        raise missing_file(path, error, remedy) from None


def missing_file(path: Path, error: OSError, remedy: str) -> InputError:
    """The error about a file that is missing or cannot be read, with a remedy."""
    if isinstance(error, FileNotFoundError):
        return InputError(f"{path}: is missing; {remedy}")
    return InputError(f"{path}: cannot be read: {error.strerror}; {remedy}")


def any_agrees(rows: Any, file: BinaryIO) -> bool:
    """Whether the file holds the bytes of any row; then seek the beginning of the file."""

    def agrees(row: Any) -> bool:
        """Whether a row of the index proves the bytes at its place."""
        file.seek(int(row["offset"]))
        return proves(row, file.read(int(row["length"])))

    is_any = any(map(agrees, rows))
    file.seek(0)
    return is_any


def size_of(folder: Path) -> int:
    """Number of bytes that a recording holds; 0 if their file is missing."""
    try:
        return (folder / "bytes.bin").stat().st_size
    except OSError:
        return 0


def utc_offset(folder: Path) -> float | None:
    """The wall clock's time less the host's monotonic time at the recording's beginning, s; None if
    no row states both."""
    rows, _ = read_rows(read_index(folder, salvage=True))
    timed = rows[np.isfinite(rows["monotonic"])]
    return float(timed["utc"][0] - timed["monotonic"][0]) if len(timed) else None


def meta_of(folder: Path, sealed: bool = True) -> dict[str, Any]:
    """The content of `meta.yaml`: how a recording was made.

    sealed: whether to refuse a `meta.yaml` other than that with which the recording was closed.
    Raises `InputError` if the folder is no recording.
    """
    path = folder / "meta.yaml"
    remedy = (
        f"the received bytes are in {folder / 'bytes.bin'}, which `facets acquire CONFIG --port "
        f"file:{folder / 'bytes.bin'}` reads"
    )
    if not path.is_file():
        if (folder / "bytes.bin").is_file():
            raise InputError(f"{path}: is missing; {remedy}")
        what = "it has no meta.yaml" if folder.is_dir() else "the folder does not exist"
        raise InputError(f"{folder}: is not a recording of `facets acquire`: {what}")
    try:
        data = path.read_bytes()
        meta = YAML(typ="safe").load(data.decode())
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (YAMLError, ValueError, RecursionError):
        meta = None
    if not isinstance(meta, dict) or not isinstance(meta.get("resolved"), dict):
        raise InputError(f"{path}: is damaged: it holds no configuration; {remedy}")
    seal = seal_of(folder)
    if sealed and seal and seal.meta_crc != zlib.crc32(data):
        raise InputError(
            f"{path}: is not the file with which this recording was closed: it was changed, or "
            "belongs to another recording. Restore the right file, or name a configuration: "
            f"`facets replay {folder} --config CONFIG`"
        )
    return meta
