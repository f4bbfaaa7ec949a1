"""The times of a board's samples on the host's clock, from the blocks that came soonest.

A block can only be late: the port, the system and a busy reader keep it for a while, and nothing
brings it early. The earliest of all arrivals therefore tell the time best. The line under the
arrivals against the board's clock that touches them from below, with the least sum of distances
(Moon, Skelly and Towsley, 1999), is the maximum of the likelihood for exponential delays; it is
an edge of the lower convex hull. Its slope is the drift of the board's clock.
"""

from __future__ import annotations

import time
from collections import deque
from itertools import pairwise
from math import hypot, inf, isfinite, log, nan
from typing import NamedTuple

import numpy as np

from ...core.units import Floats

#: Arrivals are remembered for this time, s: a quartz drifts with its temperature within minutes.
ARRIVAL_MEMORY_S = 60.0
#: Length of a bucket, s: only the arrival with the least delay in a bucket is remembered.
BUCKET_S = 0.1
#: Standard uncertainty of the rate of any board's clock; the slope is held within three of it.
WORST_RATE = 100e-6
#: Standard uncertainty of the change of a clock's rate between two lives of the board.
RATE_CHANGE = 1e-6
#: An arrival that is earlier than possible by more than this shows that a clock was set, s.
EARLY_ARRIVAL_S = 0.05
#: A line is known from this number of buckets on.
KNOWN_BUCKETS = 5
#: Number of newest buckets that must all be late to show that a clock has stood still.
LATE_BUCKETS = 50
#: An arrival with a delay above this counts as late, s.
LATE_ARRIVAL_S = 0.01
#: For a line under n points whose distances from it are exponential with mean m: its bias at the
#: middle of the points, and the standard deviations of its value at their end and of its rise over
#: all of them, in units of m/n; by simulation (tests/live/test_host_time.py repeats it).
BIAS, END, RISE = 1.8, 4.0, 7.0
#: Standard uncertainty of a time that a board's clock counts in whole microseconds, s.
COUNT_SIGMA_S = 1e-6 / 12**0.5
#: Pairs of times of the two clocks of which the closest one counts.
CLOCK_READINGS = 3


def wall_clock_offset() -> float:
    """The present offset of the wall clock over the host's monotonic clock, s.

    It is that of the pair of times with the least time between them, because a busy machine may
    stop between two.
    """
    pairs = ((time.monotonic(), time.time(), time.monotonic()) for _ in range(CLOCK_READINGS))
    before, utc, after = min(pairs, key=lambda times: times[2] - times[0])
    return utc - (before + after) / 2


class ClockLine(NamedTuple):
    """host = device + offset + rate (device - middle), all in s."""

    middle: float
    offset: float
    rate: float

    def lag(self, device: float) -> float:
        """The host's time less the board's time, s."""
        return self.offset + self.rate * (device - self.middle)

    def host_times(self, device: Floats) -> Floats:
        times: Floats = device + self.offset + self.rate * (device - self.middle)
        return times


class HostTime:
    """The line between the clocks of a board and of the host, since the board's last start.

    rate, rate_sigma: of the host's clock against the board's, with its standard uncertainty; they
    outlive a restart.  restarts: number of new lines.  over: the delay of the newest block after
    the line, s.  late: delay of the line after the soonest line so far, s, without the drift;
    a board's clock that lost time looks the same as a delay.  moves: how often a known line was
    moved by more than its drift.
    """

    def __init__(self) -> None:
        self.rate, self.rate_sigma = 0.0, WORST_RATE
        self.restarts, self.moves = -1, 0
        self.late = self.over = 0.0
        self.points: deque[tuple[float, float]] = deque()  # board's time, and the lag of arrival
        self.restart()

    def restart(self) -> None:
        """Begin a new line: the clocks' offset changes here, their rates do not."""
        self.restarts += 1
        self.moves += len(self.points) >= KNOWN_BUCKETS
        self.line: ClockLine | None = None
        self.points.clear()
        self.bucket = -inf
        self.lowest: tuple[float, float] | None = None
        self.scale = 0.0
        self.held = self.rate, hypot(self.rate_sigma, RATE_CHANGE)

    def add(self, device: float, arrival: float) -> None:
        """Add a block: `device` is the board's time of its last sample, s."""
        lag = arrival - device
        if self.line is None:
            self.line = ClockLine(device, lag, self.rate)
            self.bucket = device
        over = lag - self.line.lag(device)
        self.late = max(self.late + min(over, 0.0), 0.0)
        if over < -EARLY_ARRIVAL_S:
            self.restart()
            self.add(device, arrival)
            return
        if over < 0:  # known at once, where the fit is only made now and then
            self.line = self.line._replace(offset=self.line.offset + over)
        if self.lowest is None or over < self.lowest[1] - self.line.lag(self.lowest[0]):
            self.lowest = device, lag
        if device - self.bucket >= BUCKET_S:
            self.points.append(self.lowest)
            self.lowest, self.bucket = None, device
            while len(self.points) > 1 and self.points[0][0] < device - ARRIVAL_MEMORY_S:
                self.points.popleft()
            before = self.line.lag(device)
            self.fit()
            self.late = max(self.late + self.line.lag(device) - before, 0.0)
        self.over = max(lag - self.line.lag(device), 0.0)

    def fit(self) -> None:
        """Fit the line under the remembered arrivals."""
        at, lag = np.array(self.points).T
        middle = float(at.mean())
        known, sigma = self.held
        offset, rate, free = touching_line(at - middle, lag, known - 3 * sigma, known + 3 * sigma)
        over = lag - offset - rate * (at - middle)
        if self.stood_still(over):
            for _ in range(len(over) - LATE_BUCKETS):
                self.points.popleft()
            self.moves += 1
            self.fit()
            return
        count, length = len(over), float(at[-1] - at[0]) or BUCKET_S
        self.scale = float(np.median(over)) / log(2) if count > 4 else float(over.mean())
        self.rate = rate
        spread = RISE * self.scale / count / length
        # counts of microseconds are as much in doubt at both ends
        self.rate_sigma = min(sigma, hypot(spread, 2 * COUNT_SIGMA_S / length)) if free else sigma
        self.line = ClockLine(middle, offset - BIAS * self.scale / count, rate)

    def stood_still(self, over: Floats) -> bool:
        """Whether all of the newest buckets are late, because the board's clock has lost time."""
        older, newer = over[:-LATE_BUCKETS], over[-LATE_BUCKETS:]
        return len(older) >= 10 and bool(newer.min() > LATE_ARRIVAL_S + 20 * np.median(older))

    @property
    def uncertainty(self) -> float:
        """Standard uncertainty of the newest samples' times, s; NaN before there are any samples.

        It supposes that the soonest arrivals took the least delay, which is in the configuration.
        """
        if self.line is None:
            return nan
        if len(self.points) < KNOWN_BUCKETS:
            return inf
        end = END * self.scale / len(self.points)
        reach = (self.points[-1][0] - self.points[0][0]) / 2
        held = self.rate_sigma * reach if self.rate_sigma >= self.held[1] else 0.0
        return float(np.sqrt(end**2 + held**2 + COUNT_SIGMA_S**2))

    @property
    def ppm(self) -> float:
        """Relative rate of the host's clock over the board's, 1e-6; NaN until it is known."""
        return 1e6 * self.rate if self.rate_sigma < WORST_RATE else nan


def touching_line(x: Floats, y: Floats, least: float, most: float) -> tuple[float, float, bool]:
    """The line under points (n,) with the least sum of distances, its slope between two ends.

    x: ascending, of mean zero. Returns the line's value at zero, its slope, and whether the slope
    lies between its ends.
    """
    slope = hull_slope(x, y)
    free = isfinite(slope) and least < slope < most
    if not free:
        slope = min(max(slope, least), most) if isfinite(slope) else (least + most) / 2
    return float((y - slope * x).min()), slope, free


def hull_slope(x: Floats, y: Floats) -> float:
    """The slope of the lower convex hull where x is zero; NaN for a single point."""
    hull: list[tuple[float, float]] = []
    for point in zip(x.tolist(), y.tolist(), strict=True):
        while len(hull) > 1 and turns_down(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    for (left, low), (right, high) in pairwise(hull):
        if right >= 0:
            return (high - low) / (right - left)
    return nan


def turns_down(
    first: tuple[float, float], second: tuple[float, float], third: tuple[float, float]
) -> bool:
    """Whether the second point is on or above the line from the first to the third."""
    return (second[0] - first[0]) * (third[1] - first[1]) <= (third[0] - first[0]) * (
        second[1] - first[1]
    )
