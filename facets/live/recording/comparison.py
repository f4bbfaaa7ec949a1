"""Recorded poses compared with those of a replay, bit by bit, and the comparison in words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.names import STATE_COLUMNS
from ...core.version import __version__
from ...estimation.solution import Status
from ...files.columns import join_columns
from ..run.pipeline import RunPoses
from .index import Damage
from .pose_table import Columns
from .reader import Seal

#: The sentence on a recording that has no seal.
UNSEALED = (
    "  how many poses were recorded is unknown, because the end of events.jsonl, which says that, "
    "is missing: the run was killed, the power failed, or it was cut off"
)


@dataclass
class PoseComparison:
    """Compares recorded poses with those of a replay, sample by sample, as both come.

    stored: the recorded poses, in the order in which they were written.  recorded: number of
    recorded poses.  skipped: number of recorded samples that the run did not solve.  absent: number
    of recorded poses that the replay does not have.  unrecorded: number of samples of the replay
    without a recorded pose; `ends` has the first and the last.  different: number of poses that are
    not the same to the last bit; `columns` names the columns.  worst: largest difference of a pose,
    in standard uncertainties; infinite if only one of the two has a pose.  since: the first sample
    that is different or absent.  waiting: poses of the replay whose recorded ones may still come.
    early: recorded poses that the replay may still reach.  last, newest: the largest number of a
    sample in the replay and in the recording so far.
    """

    stored: Iterator[Columns]
    recorded: int = 0
    skipped: int = 0
    absent: int = 0
    unrecorded: int = 0
    ends: tuple[int, int] = (0, 0)
    different: int = 0
    columns: list[str] = field(default_factory=list)
    worst: float = 0.0
    since: int | None = None
    waiting: Columns = field(default_factory=dict)
    early: Columns = field(default_factory=dict)
    last: float = -inf
    newest: float = -inf

    @property
    def is_same(self) -> bool:
        """Whether all poses that both have are the same."""
        return not self.different

    def following(self, replayed: Iterable[RunPoses]) -> Iterator[RunPoses]:
        """Yield the same poses, and compare all of them with the recorded ones."""
        for poses in replayed:
            self.add(poses.columns())
            yield poses
        self.finish()

    def add(self, replayed: Columns) -> None:
        """Compare the next poses of a replay, whose numbers increase."""
        self.waiting = join_columns([self.waiting, replayed]) if self.waiting else replayed
        self.last = int(replayed["seq"][-1])
        self.read()

    def finish(self) -> None:
        """Compare the rest, once all poses of a replay are added."""
        self.last = inf
        self.read()

    def read(self) -> None:
        """Compare the recorded poses up to the last one of the replay."""
        if self.early:
            self.match(self.early)
        while self.newest < self.last:
            part = next(self.stored, None)
            if part is None:  # no more recorded poses come
                self.count_missing()
                break
            self.recorded += len(part["seq"])
            self.skipped += int((part["status"] == Status.SKIPPED).sum())
            self.newest = max(self.newest, int(part["seq"].max()))
            self.match(part)

    def match(self, recorded: Columns) -> None:
        """Compare recorded poses with those of the replay that have the same numbers."""
        numbers = self.waiting.get("seq", np.zeros(0, np.int64))
        is_replayed = np.isin(recorded["seq"], numbers)
        is_solved = recorded["status"] != Status.SKIPPED
        old = select_rows(recorded, is_replayed & is_solved)
        self.compare_rows(old, select_rows(self.waiting, np.searchsorted(numbers, old["seq"])))
        self.waiting = select_rows(self.waiting, ~np.isin(numbers, recorded["seq"]))
        is_ahead = recorded["seq"] > self.last
        absent = recorded["seq"][~(is_replayed | is_ahead) & is_solved]
        self.absent += len(absent)
        self.doubt(absent)
        self.early = select_rows(recorded, is_ahead)

    def compare_rows(self, old: Columns, new: Columns) -> None:
        """Compare recorded poses with those of the replay of the same samples."""
        differs_anywhere = np.zeros(len(old["seq"]), bool)
        for name in [name for name in old if name in new]:
            recorded, replayed = old[name], new[name]
            are_nan = (recorded != recorded) & (replayed != replayed)
            differs = (recorded != replayed) & ~are_nan
            if differs.any() and name not in self.columns:
                self.columns = [each for each in old if each in (*self.columns, name)]
            differs_anywhere |= differs
        if differs_anywhere.any():
            self.different += int(differs_anywhere.sum())
            self.doubt(old["seq"][differs_anywhere])
            off = largest_difference(
                select_rows(old, differs_anywhere), select_rows(new, differs_anywhere)
            )
            self.worst = max(self.worst, off)

    def doubt(self, numbers: NDArray[np.int64]) -> None:
        """Note the number of the first of samples that are different or absent."""
        if len(numbers):
            self.since = int(min(numbers.min(), inf if self.since is None else self.since))

    def count_missing(self) -> None:
        """Count the waiting poses as samples without a recorded pose."""
        numbers = self.waiting.get("seq", np.zeros(0, np.int64))
        if len(numbers):
            first = self.ends[0] if self.unrecorded else int(numbers[0])
            self.ends = first, int(numbers[-1])
            self.unrecorded += len(numbers)
        self.waiting = {}


def select_rows(columns: Columns, rows: Any) -> Columns:
    """Select rows of all columns."""
    return {name: column[rows] for name, column in columns.items()}


def largest_difference(old: Columns, new: Columns) -> float:
    """The largest difference of a pose, in standard uncertainties."""
    worst = 0.0
    for name in (f"u_{name}" for name in STATE_COLUMNS if f"u_{name}" in old):
        recorded, replayed = old[name[2:]], new[name[2:]]
        only_one = np.isnan(recorded) != np.isnan(replayed)
        sigma = np.where(old[name] > 0, old[name], 1.0)
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
