"""Poses that the board has solved itself, beside those that are solved here.

A board with the exported solver (`facets export-c`) sends, after the counts of a sample, a frame of
the kind POSE with the same number. Both are the same estimate where both know the same of the beam,
so that what differs by more than rounding tells of another sensor or of a fault on the board.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.units import Floats
from ...estimation.solution import Solution, Status
from ..sources.clock import Sequence
from ..sources.frames import POSE, RawSamples

#: What a frame of the kind POSE holds in the place of the counts.
SOLVED = np.dtype(
    [
        ("state", "<f4", 8),
        ("power", "<f4"),
        ("residual", "<f4"),
        ("status", "u1"),
        ("used", "u1"),
        ("steps", "u1"),
        ("spare", "u1"),
        ("microseconds", "<u2"),
        ("spare_2", "<u2"),
    ]
)
#: So many samples wait at most for the other of the two solutions.
WAITING = 20_000
#: Poses apart by more of the standard uncertainty than this are not of the same sensor.
ALIKE = 0.1


def is_pose(samples: RawSamples) -> NDArray[np.bool_]:
    found: NDArray[np.bool_] = samples.kind == POSE
    return found


def board_solution(samples: RawSamples) -> NDArray[np.void]:
    """What frames of the kind POSE hold (n,), of the type SOLVED."""
    return np.ascontiguousarray(samples.counts.astype("<i4")).view(SOLVED)[:, 0]


class BoardPoses:
    """Counts the board's poses and compares each with the one that is solved here.

    came: poses of the board.  compared: with those solved here, where both end with a status that
    the estimator gives.  statuses: how many ended differently.  worst: the largest difference, in
    standard uncertainties.  apart: those above ALIKE.  slowest: us, that the board took for one.
    """

    def __init__(self) -> None:
        self.came = self.compared = self.statuses = self.apart = self.slowest = 0
        self.worst = 0.0
        self._board: tuple[NDArray[np.int64], NDArray[np.void]]
        self._here: tuple[NDArray[np.int64], Floats]
        self._forget()

    def add(self, samples: RawSamples, sequence: Sequence, restarted: bool) -> None:
        """Frames of the kind POSE, of a block whose samples `sequence` has followed.

        restarted: whether the board did, in the block; its frames could be of either count then.
        """
        found = board_solution(samples)
        self.came += len(found)
        self.slowest = max(self.slowest, int(found["microseconds"].max()))
        if restarted:
            self._forget()
            return
        seq = samples.seq.astype(np.int64) + (sequence.seq - sequence.raw_seq)
        numbers, waiting = self._board
        self._board = (
            np.concatenate([numbers, seq % 2**32])[-WAITING:],
            np.concatenate([waiting, found])[-WAITING:],
        )

    def _forget(self) -> None:
        """Nothing waits any more."""
        self._board = np.zeros(0, np.int64), np.zeros(0, SOLVED)
        self._here = np.zeros(0, np.int64), np.zeros((0, 17))

    def compare(self, seq: NDArray[np.int64], solution: Solution) -> None:
        """With poses (n,) that were solved here, by the numbers of their samples."""
        if not self.came:
            return
        rows = np.column_stack([solution.status, solution.state, solution.uncertainty])
        numbers, waiting = self._here
        here = np.concatenate([numbers, seq % 2**32])[-WAITING:]
        known = np.concatenate([waiting, rows])[-WAITING:]
        board, found = self._board
        _, mine, theirs = np.intersect1d(here, board, return_indices=True)
        self.add_differences(known[mine], found[theirs])
        self._here = np.delete(here, mine), np.delete(known, mine, axis=0)
        self._board = np.delete(board, theirs), np.delete(found, theirs)

    def add_differences(self, known: Floats, found: NDArray[np.void]) -> None:
        """known: (n, 17) statuses, states and uncertainties; found: (n,) of the board."""
        estimated = known[:, 0] < Status.SKIPPED
        # whether such poses are given is asked of each by itself
        estimated &= (known[:, 0] != Status.UNCHECKED) & (found["status"] != Status.UNCHECKED)
        known, found = known[estimated], found[estimated]
        self.compared += len(found)
        self.statuses += int((known[:, 0] != found["status"]).sum())
        both = (known[:, 0] == Status.CONVERGED) & (found["status"] == Status.CONVERGED)
        if not both.any():
            return
        off = np.abs(found["state"][both] - known[both, 1:9])
        sigma = known[both, 9:]
        share = np.divide(off, sigma, out=np.zeros_like(off), where=sigma > 0).max(axis=1)
        self.worst = max(self.worst, float(share.max()))
        self.apart += int((share > ALIKE).sum())

    @property
    def alike(self) -> bool:
        """Whether the board solves as this program does: all but one in a thousand."""
        return self.apart + self.statuses <= 1e-3 * self.compared

    def sentence(self) -> str:
        """For the end of a run; nothing where the board sent no pose."""
        if not self.came:
            return ""
        return (
            f"the board solved {self.came} poses itself, each in {self.slowest} us at most; "
            f"{self.compared} compared: the largest difference is {self.worst:.2g} of the standard "
            f"uncertainty, {self.statuses} ended with another status"
        )

    def trouble(self) -> str:
        """Why the board's poses are not those that are solved here; nothing where they are."""
        if self.alike:
            return ""
        return (
            f"{self.apart + self.statuses} of {self.compared} poses of the board differ from those "
            "that are solved here: check whether its code was exported for another sensor or "
            "calibration, and whether `solve` knows more about the beam or its power than the "
            "board"
        )

    def complaints(self) -> list[str]:
        """Why a comparison that was asked for is no good one; none where the poses are alike."""
        if not self.compared:
            return ["the board sent no pose that could be compared."]
        return [] if self.alike else [self.trouble()]

    def values(self) -> dict[str, Any]:
        return {"came": self.came, "compared": self.compared, "worst_u": self.worst}
