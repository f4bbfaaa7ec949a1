"""A recording through the same parser and solver again, or saved from where it was cut off."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import ConfigError, InputError
from ...core.version import __version__
from ...estimation.solution import Status
from ..run.pipeline import FULL, LABELS, SKIPPED, TWO_DETECTORS, Pipeline, Poses
from .index import Damage, name_of_copy
from .pose_table import Columns, pose_columns
from .reader import blocks, meta_of, size_of

if TYPE_CHECKING:
    from ...core.settings import Config


def recorded_config(folder: Path) -> Config:
    """The configuration that a recording was made with, as it keeps it.

    One of a version that knew no `acquire.timing` has its times by arrival, as they were. Raises
    `InputError` where `meta.yaml` holds none that this version can use.
    """
    import tempfile

    from ruamel.yaml import YAML

    from ...config.loading import fingerprint, load, measured

    meta, path = meta_of(folder), folder / "meta.yaml"
    if meta.get("config_sha256") not in (None, fingerprint(meta["resolved"])):
        raise InputError(
            f"{path}: is damaged or was changed, its config_sha256 is not that of its "
            f"configuration; name one: `facets replay {folder} --config CONFIG`"
        )
    try:
        resolved = meta["resolved"]
        if "timing" not in resolved.get("acquire", {}):  # of a version that had no other
            resolved.setdefault("acquire", {})["timing"] = "arrival"
        for keys, name, digest in measured(resolved):
            keys[name] = str((folder / name_of_copy(digest)).resolve())
    except (KeyError, TypeError, AttributeError):
        raise InputError(
            f"{path}: is damaged, its configuration is not whole; name one: "
            f"`facets replay {folder} --config CONFIG`"
        ) from None
    with tempfile.TemporaryDirectory(prefix="facets-") as place:
        copy = Path(place) / f"{Path(str(meta.get('config') or 'recorded')).name}.yaml"
        with copy.open("w", encoding="utf-8") as file:
            YAML(typ="safe").dump(resolved, file)
        try:
            return load(copy)
        except ConfigError as error:
            copied = rf"\S*{re.escape(Path(place).name)}\S*?\.yaml(:\d+)?"
            problems = re.sub(copied, lambda _: str(path), str(error))
            raise InputError(f"{problems}{version_hint(meta)}") from None


def version_hint(meta: dict[str, Any]) -> str:
    """What a configuration that cannot be used may be due to: another version wrote it."""
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
    real_time: bool = False,
    damage: Damage | None = None,
    tell: Callable[[int, int], None] = lambda *_: None,
    salvage: bool = False,
) -> Iterator[Poses]:
    """The poses of a recording, block by block as they came; equal to those of the run.

    All samples are solved, also those that the run had no time for. damage: is told what of the
    recording is not as it was written; of a format without checksums, what is not proven is not
    read, since it could be anything.  tell: is told how many bytes are done, and of how many.
    salvage: see `blocks`.
    """
    begin: tuple[float, float] | None = None
    damage = damage if damage is not None else Damage()
    done, whole, doubtful = 0, size_of(folder), False
    for block in blocks(folder, damage, salvage):
        tell(done, whole)
        done += len(block.data)
        doubtful |= block.doubtful
        if block.doubtful and pipeline.config.acquire.format == "text":
            continue
        if real_time and np.isfinite(block.arrival):
            begin = begin or (time.monotonic(), block.arrival)
            time.sleep(max(0.0, begin[0] + block.arrival - begin[1] - time.monotonic()))
        poses = pipeline.feed(block.data, block.arrival, block.encoder)
        if poses is not None:
            if doubtful and damage.since is None:
                damage.since = int(poses.seq[0])
            yield poses


#: The name by which others know it.
replayed = replay


def label(poses: Poses) -> Columns:
    """The columns of `pose_columns`, the status in words."""
    columns = pose_columns(poses)
    words = np.array([LABELS[status] for status in columns["status"].tolist()], dtype=str)
    return columns | {"status": words}


@dataclass(frozen=True)
class Comparison:
    """Recorded poses beside those of a replay, sample by sample.

    recorded: poses on record.  skipped: samples among them that the run did not solve.  absent:
    those that the replay does not have.  unrecorded: samples of the replay without a pose on
    record, the first and the last of which are `ends`.  different: those that are not the same to
    the last bit, in `columns`.  worst: difference of a pose, in standard uncertainties; infinite
    where only one of the two has a pose.  since: the first sample that is different or absent.
    """

    recorded: int
    skipped: int
    absent: int
    unrecorded: int
    ends: tuple[int, int]
    different: int
    columns: tuple[str, ...]
    worst: float
    since: int | None

    @property
    def same(self) -> bool:
        """Whether all that is there of both is the same."""
        return not self.different


def compare(old: Columns, new: Columns) -> Comparison:
    """old: what a recording holds, new: what its replay gives; both by `pose_columns`.

    A sample that an older version called "non finite" or "two detectors only" and this one
    "saturated" or "unchecked" is the same.
    """
    none: Columns = {"seq": np.zeros(0, np.int64), "status": np.zeros(0, np.int8)}
    old, new = old or none, new or none
    there = np.isin(old["seq"], new["seq"])
    unrecorded = new["seq"][~np.isin(new["seq"], old["seq"])]
    ends = (int(unrecorded[0]), int(unrecorded[-1])) if len(unrecorded) else (0, 0)
    skipped = old["status"] == SKIPPED
    solved = there & ~skipped
    rows = np.searchsorted(new["seq"], old["seq"][solved])
    apart, columns = np.zeros(len(rows), bool), []
    for name in old if len(rows) else ():
        one, other = old[name][solved], new[name][rows]
        if name == "status":
            other = np.where((one == Status.NON_FINITE) & (other == FULL), one, other)
            other = np.where((one == TWO_DETECTORS) & (other == Status.UNCHECKED), one, other)
        differs = (one != other) & ~(is_nan(one) & is_nan(other))
        if differs.any():
            columns.append(name)
        apart |= differs
    absent = ~there & ~skipped
    doubtful = np.append(old["seq"][absent], old["seq"][solved][apart])
    return Comparison(
        len(old["seq"]), int(skipped.sum()), int(absent.sum()), len(unrecorded), ends,
        int(apart.sum()), tuple(columns),
        distance(old, new, np.flatnonzero(solved)[apart], rows[apart]),
        int(doubtful.min()) if len(doubtful) else None,
    )  # fmt: skip


def is_nan(values: Any) -> Any:
    return np.isnan(values) if values.dtype.kind == "f" else np.zeros(len(values), bool)


def distance(old: Columns, new: Columns, rows: Any, others: Any) -> float:
    """The largest difference of a pose, in standard uncertainties."""
    worst = 0.0
    for name in (name for name in old if name.startswith("u_")):
        one, other = old[name[2:]][rows], new[name[2:]][others]
        only_one = np.isnan(one) != np.isnan(other)
        sigma = np.where(old[name][rows] > 0, old[name][rows], 1.0)
        off = np.where(only_one, np.inf, np.nan_to_num(np.abs(one - other) / sigma))
        worst = max(worst, float(off.max(initial=0.0)))
    return worst
