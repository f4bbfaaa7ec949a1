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
from ..sources.frames import RawSamples

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


def board_solution(samples: RawSamples) -> NDArray[np.void]:
    """Return the solutions (n,) in frames of the kind POSE, of the type SOLVED."""
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
        """Add the frames of the kind POSE of a block whose samples `sequence` has followed.

        restarted: whether the board restarted in the block: frames could then be of either count.
        """
        solutions = board_solution(samples)
        self.came += len(solutions)
        self.slowest = max(self.slowest, int(solutions["microseconds"].max()))
        if restarted:
            self._forget()
            return
        seq = samples.seq.astype(np.int64) + (sequence.seq - sequence.board.seq)
        numbers, waiting = self._board
        self._board = (
            np.concatenate([numbers, seq % 2**32])[-WAITING:],
            np.concatenate([waiting, solutions])[-WAITING:],
        )

    def _forget(self) -> None:
        """Drop all solutions that wait for a comparison."""
        self._board = np.zeros(0, np.int64), np.zeros(0, SOLVED)
        self._here = np.zeros(0, np.int64), np.zeros((0, 17))

    def compare(self, seq: NDArray[np.int64], solution: Solution) -> None:
        """Compare the board's poses with poses (n,) that were solved here, by their numbers."""
        if not self.came:
            return
        rows = np.column_stack([solution.status, solution.state, solution.uncertainty])
        numbers, waiting = self._here
        here = np.concatenate([numbers, seq % 2**32])[-WAITING:]
        known = np.concatenate([waiting, rows])[-WAITING:]
        board, solutions = self._board
        _, mine, theirs = np.intersect1d(here, board, return_indices=True)
        self.add_differences(known[mine], solutions[theirs])
        self._here = np.delete(here, mine), np.delete(known, mine, axis=0)
        self._board = np.delete(board, theirs), np.delete(solutions, theirs)

    def add_differences(self, known: Floats, solutions: NDArray[np.void]) -> None:
        """Count the differences of pairs of solutions.

        known: (n, 17) statuses, states and uncertainties solved here.  solutions: (n,) the board's.
        """
        estimated = known[:, 0] < Status.SKIPPED
        # whether such poses are given is asked of each by itself
        estimated &= (known[:, 0] != Status.UNCHECKED) & (solutions["status"] != Status.UNCHECKED)
        known, solutions = known[estimated], solutions[estimated]
        self.compared += len(solutions)
        self.statuses += int((known[:, 0] != solutions["status"]).sum())
        both = (known[:, 0] == Status.CONVERGED) & (solutions["status"] == Status.CONVERGED)
        if not both.any():
            return
        off = np.abs(solutions["state"][both] - known[both, 1:9])
        sigma = known[both, 9:]
        share = np.divide(off, sigma, out=np.zeros_like(off), where=sigma > 0).max(axis=1)
        self.worst = max(self.worst, float(share.max()))
        self.apart += int((share > ALIKE).sum())

    def sentence(self) -> str:
        """The sentence for the end of a run; empty if the board sent no pose."""
        if not self.came:
            return ""
        return (
            f"the board solved {self.came} poses itself, each in {self.slowest} us at most; "
            f"{self.compared} compared: the largest difference is {self.worst:.2g} of the standard "
            f"uncertainty, {self.statuses} ended with another status"
        )

    def trouble(self) -> str:
        """The sentence on poses that differ from those solved here; empty if all but one in a
        thousand are alike."""
        count = self.apart + self.statuses
        if count <= 1e-3 * self.compared:
            return ""
        return (
            f"{count} of {self.compared} poses of the board differ from those "
            "that are solved here: check whether its code was exported for another sensor or "
            "calibration, and whether `solve` knows more about the beam or its power than the "
            "board"
        )

    def complaints(self) -> list[str]:
        """Return the faults of a comparison on request; none if the poses are alike."""
        if not self.compared:
            return ["the board sent no pose that could be compared."]
        return list(filter(None, [self.trouble()]))

    def values(self) -> dict[str, Any]:
        return {"came": self.came, "compared": self.compared, "worst_u": self.worst}
