"""Solve the bytes of a recording again, with its own configuration or another one."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import ConfigError, InputError
from ...core.settings import resolved_text
from ...core.version import __version__
from ..run.pipeline import Pipeline, RunPoses
from ..sources.source import Block
from .index import Damage, name_of_copy
from .reader import blocks, meta_of, size_of
from .together import solve_blocks

if TYPE_CHECKING:
    from ...core.settings import Config

#: Blocks are taken in together until they have more bytes than this.
BYTES_TOGETHER = 300_000


def recorded_config(folder: Path) -> Config:
    """Return the configuration with which a recording was made, from its `meta.yaml`.

    Raises `InputError` if `meta.yaml` holds no configuration that this version can use.
    """
    import tempfile

    from ...config.loading import fingerprint, load, measured_files

    meta, path = meta_of(folder), folder / "meta.yaml"
    if meta.get("config_sha256") not in (None, fingerprint(meta["resolved"])):
        raise InputError(
            f"{path}: is damaged or was changed: its config_sha256 is not that of its "
            f"configuration; name a configuration: `facets replay {folder} --config CONFIG`"
        )
    try:
        resolved = meta["resolved"]
        for keys, name, digest in measured_files(resolved):
            keys[name] = str((folder / name_of_copy(digest)).resolve())
    except (KeyError, TypeError, AttributeError):
        raise InputError(
            f"{path}: is damaged: its configuration is incomplete; name one: `facets replay "
            f"{folder} --config CONFIG`"
        ) from None
    with tempfile.TemporaryDirectory(prefix="facets-") as place:
        copy = Path(place) / f"{Path(str(meta.get('config') or 'recorded')).name}.yaml"
        copy.write_text(resolved_text(resolved), "utf-8")  # JSON is YAML, and keeps the order
        try:
            return load(copy)
        except ConfigError as error:
            copied = rf"\S*{re.escape(Path(place).name)}\S*?\.yaml(:\d+)?"
            problems = re.sub(copied, lambda _: str(path), str(error))
            raise InputError(f"{problems}{version_hint(meta)}") from None


def version_hint(meta: dict[str, Any]) -> str:
    """Name the version that made a recording, whose configuration this version cannot use."""
    version = str(meta.get("facets", "an unknown version"))
    if version == __version__:
        return ""
    return (
        f"\nfacets {version} made this recording, and this is facets {__version__}: use that "
        "version, or name a configuration: `facets replay RECORDING --config CONFIG`"
    )


def replay(
    folder: Path,
    pipeline: Pipeline,
    damage: Damage | None = None,
    on_progress: Callable[[int, int], None] = lambda *_: None,
    salvage: bool = False,
) -> Iterator[RunPoses]:
    """Yield the poses of a recording, those of many blocks at once; they equal those of the run.

    All samples are solved, also those that the run had no time for. Bytes that nothing proves are
    not read in a format without checksums, since they could be anything.  damage: counts
    differences from the written state.  on_progress: called with the number of bytes read
    and their total.  salvage: see `blocks`.
    """
    damage = damage if damage is not None else Damage()
    done, size, total, doubtful = 0, 0, size_of(folder), False
    held: list[Block] = []

    def solve_together() -> Iterator[RunPoses]:
        """Solve the blocks that wait, together, and yield their poses."""
        for poses in solve_blocks(pipeline, held) if held else ():
            if doubtful and damage.since is None:
                damage.since = int(poses.seq[0])
            yield poses
        held.clear()

    for block in blocks(folder, damage, salvage):
        on_progress(done, total)
        done += len(block.data)
        if block.doubtful and not doubtful:
            yield from solve_together()
            doubtful = True
        if block.doubtful and pipeline.config.acquire.format == "text":
            continue
        held.append(block)
        size += len(block.data)
        if size > BYTES_TOGETHER:
            yield from solve_together()
            size = 0
    yield from solve_together()
    yield from map(pipeline.solve, pipeline.release())
