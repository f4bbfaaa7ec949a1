"""A recording through the same parser and solver again, or saved from where it was cut off."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..estimation.solution import Status
from .pipeline import FULL, LABELS, SKIPPED, Pipeline, Poses
from .pose_table import Columns, pose_columns
from .recording import Damage, blocks, kept, meta_of

if TYPE_CHECKING:
    from ..core.settings import Config


def recorded_config(folder: Path) -> Config:
    """The configuration that a recording was made with, as it keeps it.

    One of a version that knew no `acquire.timing` has its times by arrival, as they were.
    """
    import tempfile

    from ruamel.yaml import YAML

    from ..config.loading import load, measured

    meta = meta_of(folder)
    if "timing" not in meta["resolved"].get("acquire", {}):  # of a version that had no other
        meta["resolved"].setdefault("acquire", {})["timing"] = "arrival"
    for keys, name, total in measured(meta["resolved"]):
        keys[name] = str((folder / kept(total)).resolve())
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / f"{meta['config']}.yaml"
        with path.open("w", encoding="utf-8") as file:
            YAML(typ="safe").dump(meta["resolved"], file)
        return load(path)


def replay(
    folder: Path, pipeline: Pipeline, real_time: bool = False, damage: Damage | None = None
) -> Iterator[Poses]:
    """The poses of a recording, block by block as they came; equal to those of the run.

    All samples are solved, also those that the run had no time for. damage: is told what of the
    recording is not as it was written; of a format without checksums, what is not proven is not
    read, since it could be anything.
    """
    begin: tuple[float, float] | None = None
    for block in blocks(folder, damage):
        if block.doubtful and pipeline.config.acquire.format == "text":
            continue
        if real_time and np.isfinite(block.arrival):
            begin = begin or (time.monotonic(), block.arrival)
            time.sleep(max(0.0, begin[0] + block.arrival - begin[1] - time.monotonic()))
        poses = pipeline.feed(block.data, block.arrival, block.encoder)
        if poses is not None:
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
    that the replay does not have, since their bytes are not recorded.  different: that are not the
    same to the last bit.  worst: of their pose, in standard uncertainties; infinite where only one
    of the two has a pose.
    """

    recorded: int
    skipped: int
    absent: int
    different: int
    worst: float

    @property
    def same(self) -> bool:
        """Whether all that the run solved, and whose bytes there are, is the same."""
        return not self.different


def compare(old: Columns, new: Columns) -> Comparison:
    """old: what a recording holds, new: what its replay gives; both by `pose_columns`.

    A sample that an older version called "non finite" and this one "saturated" is the same.
    """
    if not old or not new:
        count = len(old["seq"]) if old else 0
        return Comparison(count, 0, count, 0, 0.0)
    place = np.clip(np.searchsorted(new["seq"], old["seq"]), 0, len(new["seq"]) - 1)
    there = new["seq"][place] == old["seq"]
    skipped = old["status"] == SKIPPED
    rows, solved = place[there & ~skipped], there & ~skipped
    apart = np.zeros(len(rows), bool)
    for name in old:
        one, other = old[name][solved], new[name][rows]
        if name == "status":
            other = np.where((one == Status.NON_FINITE) & (other == FULL), one, other)
        apart |= (one != other) & ~(is_nan(one) & is_nan(other))
    return Comparison(
        len(old["seq"]), int(skipped.sum()), int((~there & ~skipped).sum()), int(apart.sum()),
        distance(old, new, np.flatnonzero(solved)[apart], rows[apart]),
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
