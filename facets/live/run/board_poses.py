"""Poses that the board has solved itself, compared with those that the host solves.

A board with the exported solver (`facets export-c`) sends, after the counts of a sample, a frame of
the kind POSE with the same number. Both are the same estimate if both have the same prior
knowledge of the beam, so that a difference beyond rounding indicates another sensor or a fault on
the board.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.units import Floats
from ...estimation.solution import Solution, Status
from ..sources.clock import Sequence
from ..sources.frames import RawSamples

#: Content of a frame of the kind POSE in place of the counts.
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
#: Maximum number of samples that wait for the other one of the two solutions.
WAITING = 20_000
#: Poses that differ by more than this fraction of the standard uncertainty count as different.
ALIKE = 0.1


def board_solution(samples: RawSamples) -> NDArray[np.void]:
    """Return the solutions (n,) in frames of the kind POSE, of the type SOLVED."""
    return np.ascontiguousarray(samples.counts.astype("<i4")).view(SOLVED)[:, 0]


class BoardPoses:
    """Counts the board's poses and compares each with the host's pose of the same sample.

    came: number of poses of the board.  compared: number of comparisons, of samples for which both
    estimators ran.  statuses: number of different statuses.  worst: largest difference, in standard
    uncertainties.  apart: number of differences above ALIKE.  slowest: longest time in which the
    board solved a pose, us.
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
        """Compare the board's poses with poses (n,) of the host that have the same numbers."""
        if not self.came:
            return
        rows = np.column_stack([solution.status, solution.state, solution.uncertainty])
        numbers, waiting = self._here
        host_numbers = np.concatenate([numbers, seq % 2**32])[-WAITING:]
        host_rows = np.concatenate([waiting, rows])[-WAITING:]
        board, solutions = self._board
        _, mine, theirs = np.intersect1d(host_numbers, board, return_indices=True)
        self.add_differences(host_rows[mine], solutions[theirs])
        self._here = np.delete(host_numbers, mine), np.delete(host_rows, mine, axis=0)
        self._board = np.delete(board, theirs), np.delete(solutions, theirs)

    def add_differences(self, host_rows: Floats, solutions: NDArray[np.void]) -> None:
        """Count the differences of pairs of solutions.

        host_rows: (n, 17) the host's statuses, states and uncertainties.  solutions: (n,) the
        board's.
        """
        estimated = host_rows[:, 0] < Status.SKIPPED
        # board and host may differ in whether they accept poses without redundancy
        estimated &= (host_rows[:, 0] != Status.UNCHECKED) & (
            solutions["status"] != Status.UNCHECKED
        )
        host_rows, solutions = host_rows[estimated], solutions[estimated]
        self.compared += len(solutions)
        self.statuses += int((host_rows[:, 0] != solutions["status"]).sum())
        both = (host_rows[:, 0] == Status.CONVERGED) & (solutions["status"] == Status.CONVERGED)
        if not both.any():
            return
        off = np.abs(solutions["state"][both] - host_rows[both, 1:9])
        sigma = host_rows[both, 9:]
        ratio = np.divide(off, sigma, out=np.zeros_like(off), where=sigma > 0).max(axis=1)
        self.worst = max(self.worst, float(ratio.max()))
        self.apart += int((ratio > ALIKE).sum())

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
        """Return the faults of a requested comparison: no pose was compared, or more than one in
        a thousand differs. The list is empty otherwise."""
        if not self.compared:
            return ["the board sent no pose that could be compared."]
        return list(filter(None, [self.trouble()]))

    def values(self) -> dict[str, Any]:
        """The entries of a status: numbers of poses received and compared, and the worst
        difference."""
        return {"came": self.came, "compared": self.compared, "worst_u": self.worst}
