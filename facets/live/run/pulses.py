"""A board's clock steered by a pulse per second on its input, for times in UTC.

The board marks the first sample after an edge (`frames.MARK`). The edge lies between that sample
and the one before it, at a whole second of UTC; the host's clock says which. A line through the
edges of the last minute gives the time of each sample. Its error does not shrink with their number:
a board whose clock hardly drifts against the pulses errs by the same part of a sample each time.
"""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.clocks import COUNT_SIGMA_S, QUARTZ_RATE
from ...core.units import Booleans, Floats
from .pipeline import MARKED

#: Edges are remembered for this time, s: a quartz drifts with its temperature within minutes.
EDGE_MEMORY_S = 60
#: An edge farther than this from a whole second of the host's clock is refused, s: it could belong
#: to either of two seconds.
MAX_HOST_ERROR_S = 0.25


class Edge(NamedTuple):
    """device: of the board's clock, s.  second: of UTC.  sigma: of `device`, s."""

    device: float
    second: int
    sigma: float


class PulseClock:
    """Follows a board's samples in their order.

    edges: that are used.  refused: marks that are at no whole second, by the host's clock or by the
    edges before.  rate: largest difference of the board's rate that is credible, which a host's
    clock that ran differently since the first sample widens.
    """

    def __init__(self) -> None:
        self.edges: deque[Edge] = deque()
        self.refused = self.used = 0
        self.last: float | None = None
        self.first: tuple[float, float] | None = None  # times of the board and in UTC, s
        self.rate = QUARTZ_RATE

    def follow(
        self, time: NDArray[np.int64], marked: Booleans, utc: Floats
    ) -> tuple[Floats, Floats]:
        """Return times in UTC (n,) and standard uncertainties (n,), s; NaN before the first edge.

        time: (n,) of the board, unwrapped, us.  marked: (n,).  utc: (n,) by the host's clock, s.
        """
        device = 1e-6 * time.astype(np.float64)
        before = np.concatenate([[np.nan if self.last is None else self.last], device[:-1]])
        utc_s, sigma = np.full(len(device), np.nan), np.full(len(device), np.nan)
        start = 0
        if self.first is None and len(device):
            self.first = float(device[0]), float(utc[0])
        for n in np.flatnonzero(marked).tolist():
            utc_s[start:n], sigma[start:n] = self.utc_times(device[start:n])
            start = n
            self.add(float(before[n]), float(device[n]), float(utc[n]))
        utc_s[start:], sigma[start:] = self.utc_times(device[start:])
        if len(device):
            self.last = float(device[-1])
        return utc_s, sigma

    def add(self, before: float, device: float, utc: float) -> None:
        """Add a mark, by the board's times of its sample and the sample before, and by UTC."""
        if not device > before:  # the first sample of all: the edge may be long ago
            return
        if self.first is not None:
            passed, counted = utc - self.first[1], device - self.first[0]
            self.rate = max(QUARTZ_RATE, abs(passed / counted - 1))
        edge = (before + device) / 2
        at = utc - (device - edge)
        second = round(at)
        sigma = float(np.hypot((device - before) / 12**0.5, COUNT_SIGMA_S))
        if abs(at - second) > MAX_HOST_ERROR_S:
            self.refused += 1
            return
        if self.edges and not self.agrees(edge, second, sigma):
            known = self.edges[-1]
            self.refused += 1
            if second - known.second <= EDGE_MEMORY_S and edge > known.device:
                return
            self.edges.clear()  # a board that has begun anew, or a clock that was set
        self.edges.append(Edge(edge, second, sigma))
        self.used += 1
        while self.edges[0].second < second - EDGE_MEMORY_S:
            self.edges.popleft()

    def agrees(self, edge: float, second: int, sigma: float) -> bool:
        """Whether the time since the last edge agrees with the whole seconds since then."""
        last = self.edges[-1]
        passed = second - last.second
        slack = (5 * QUARTZ_RATE + self.rate) * passed + 4 * (sigma + last.sigma)
        return passed > 0 and abs(edge - last.device - passed) < slack

    def utc_times(self, device: Floats) -> tuple[Floats, Floats]:
        """Return UTC for times of the board (n,), s, and its standard uncertainties."""
        if not self.edges or not len(device):
            return np.full(len(device), np.nan), np.full(len(device), np.nan)
        x = np.array([edge.device for edge in self.edges])
        lag = np.array([edge.second - edge.device for edge in self.edges])
        worst = max(edge.sigma for edge in self.edges)
        middle, rate, spread = float(x.mean()), 0.0, self.rate
        if len(x) > 1:
            off = x - middle
            rate = float(off @ lag / (off @ off))
            spread = worst * 2**0.5 / float(x[-1] - x[0])
        utc: Floats = device + float(lag.mean()) + rate * (device - middle)
        sigma: Floats = np.hypot(worst, spread * np.maximum(device - x[-1], 0.0))
        return utc, sigma

    @property
    def sentence(self) -> str:
        """The sentence on how many marks were used and how many were refused."""
        text = f"{self.used} pulses per second steer the times in UTC"
        return text + (f", {self.refused} marks are at no whole second" if self.refused else "")


def pulse_columns(poses: Any, offset: float, clock: PulseClock) -> dict[str, Floats]:
    """`utc_s` and `u_utc_us` of poses.  offset: of UTC over the host's monotonic clock, s."""
    utc, sigma = clock.follow(poses.time, poses.flags & MARKED > 0, poses.host + offset)
    return {"utc_s": utc, "u_utc_us": 1e6 * sigma}
