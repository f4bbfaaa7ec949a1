"""Recorded poses compared with those of a replay, bit by bit, and the comparison in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.names import STATE_COLUMNS
from ...core.version import __version__
from ...estimation.solution import Status
from .index import Damage
from .pose_table import Columns
from .reader import Seal

#: The sentence on a recording that has no seal.
UNSEALED = (
    "  how many poses were recorded is unknown, because the end of events.jsonl, which says that, "
    "is missing: the run was killed, the power failed, or it was cut off"
)


@dataclass(frozen=True)
class PoseComparison:
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
    def is_same(self) -> bool:
        """Whether all that is there of both is the same."""
        return not self.different


def compare(old: Columns, new: Columns) -> PoseComparison:
    """Compare recorded poses with those of a replay; both are columns of `Poses.columns`."""
    none: Columns = {"seq": np.zeros(0, np.int64), "status": np.zeros(0, np.int8)}
    old, new = old or none, new or none
    there = np.isin(old["seq"], new["seq"])
    unrecorded = new["seq"][~np.isin(new["seq"], old["seq"])]
    ends = (int(unrecorded[0]), int(unrecorded[-1])) if len(unrecorded) else (0, 0)
    skipped = old["status"] == Status.SKIPPED
    solved = there & ~skipped
    rows = np.searchsorted(new["seq"], old["seq"][solved])
    apart, columns = np.zeros(len(rows), bool), []
    for name in [name for name in old if name in new] if len(rows) else ():
        recorded, replayed = old[name][solved], new[name][rows]
        differs = ~np.isclose(recorded, replayed, rtol=0, atol=0, equal_nan=True)
        if differs.any():
            columns.append(name)
        apart |= differs
    absent = ~there & ~skipped
    doubtful = np.append(old["seq"][absent], old["seq"][solved][apart])
    return PoseComparison(
        len(old["seq"]), int(skipped.sum()), int(absent.sum()), len(unrecorded), ends,
        int(apart.sum()), tuple(columns),
        largest_difference(old, new, np.flatnonzero(solved)[apart], rows[apart]),
        int(doubtful.min()) if len(doubtful) else None,
    )  # fmt: skip


def largest_difference(old: Columns, new: Columns, rows: Any, others: Any) -> float:
    """The largest difference of a pose, in standard uncertainties."""
    worst = 0.0
    for name in (f"u_{name}" for name in STATE_COLUMNS if f"u_{name}" in old):
        recorded, replayed = old[name[2:]][rows], new[name[2:]][others]
        only_one = np.isnan(recorded) != np.isnan(replayed)
        sigma = np.where(old[name][rows] > 0, old[name][rows], 1.0)
        off = np.where(only_one, np.inf, np.nan_to_num(np.abs(recorded - replayed) / sigma))
        worst = max(worst, float(off.max(initial=0.0)))
    return worst


def comparison_sentences(
    result: PoseComparison,
    seal: Seal | None,
    damage: Damage,
    folder: Path,
    version: str | None,
    config_name: str | None,
) -> tuple[list[str], bool]:
    """Return the sentences on a comparison, and whether everything is the same and whole.

    seal, damage: those of the recording in `folder`.  version: the version of facets that recorded
    it.  config_name: name of the configuration that solved it again, unless the recording's own.
    """
    # poses that were written and cannot be read
    lost = max(0, seal.poses - result.recorded) if seal else 0
    was_refused = bool(seal and seal.refused_bytes and not damage.words)
    losses = {
        f"{result.skipped} samples were skipped in the run and are solved now": result.skipped,
        f"  {folder / 'poses.arrows'}: {lost} poses are missing or damaged": lost,
        f"  {result.absent} were recorded {absence_reason(was_refused, damage)}": result.absent,
        unrecorded_sentence(result, seal, lost): result.unrecorded,
        UNSEALED: seal is None,
    }
    sentences = [verdict(result, seal, lost), *(text for text, count in losses.items() if count)]
    sentences += difference_sentences(result, damage, version, config_name)
    is_whole = seal is not None and not lost and not damage.words
    is_explained = (was_refused or not result.absent) and (
        not result.unrecorded or bool(seal and seal.refused_poses)
    )
    return sentences, is_whole and is_explained and result.is_same


def verdict(result: PoseComparison, seal: Seal | None, lost: int) -> str:
    """Say how many poses were compared, and whether they are the same.

    lost: number of recorded poses that cannot be read.
    """
    count = result.recorded - result.skipped - result.absent
    of_all = f" of {seal.poses}" if seal and lost else ""
    text = "identical" if result.is_same else f"NOT equal in {result.different} samples"
    return f"{count}{of_all} recorded poses: {text if count else 'nothing can be compared'}"


def absence_reason(was_refused: bool, damage: Damage) -> str:
    """Say why recorded poses have no sample any more."""
    if was_refused:
        return "without their bytes, which the disk refused"
    if damage.words:
        return "and their bytes cannot be read any more"
    return "but the bytes hold no such samples, and the cause is unknown"


def unrecorded_sentence(result: PoseComparison, seal: Seal | None, lost: int) -> str:
    """Say which samples have no recorded pose, and why if that is known."""
    first, last = result.ends
    text = f"  {result.unrecorded} samples, from {first} to {last}, have no recorded pose"
    reason = "the disk refused them" if seal and seal.refused_poses else "the cause is unknown"
    return text if lost or seal is None else f"{text}; {reason}"


def difference_sentences(
    result: PoseComparison, damage: Damage, version: str | None, config_name: str | None
) -> Iterator[str]:
    """Yield the columns in which recorded and new poses differ, if any, and the likely cause."""
    if result.is_same:
        return
    names = ", ".join(result.columns[:8]) + (", ..." if len(result.columns) > 8 else "")
    yield f"  they differ in {names}"
    if any(name in result.columns for name in STATE_COLUMNS):
        yield (
            f"  the largest difference of a pose is {result.worst:.2g} of the standard uncertainty"
        )
    if config_name is not None:
        yield f"the poses are solved with {config_name}, not with the recording's own configuration"
    elif version != __version__:
        yield f"facets {version} recorded the poses, and facets {__version__} solved them again"
    elif damage.since is not None and result.since is not None and damage.since <= result.since:
        yield (
            f"  the recording is damaged (see above) from sample {damage.since} on, before the "
            "first difference: what an arrival time or a lost byte changes, changes later samples"
        )
    else:
        yield f"  the cause is unknown; the first difference is in sample {result.since}"
