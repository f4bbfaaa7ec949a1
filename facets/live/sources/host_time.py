"""The times of a board's samples on the host's clock, from the blocks that came soonest.

A block can only be late: the port, the system and a busy reader delay it, and nothing brings it
early. The earliest arrivals therefore determine the time best. The line touches the arrivals,
plotted against the board's clock, from below, and has the least sum of distances (Moon, Skelly and
Towsley, 1999). It maximises the likelihood for exponential delays and is an edge of the lower
convex hull. Its slope is the drift of the board's clock, which is held within that of a quartz
until the arrivals clearly lie along another line. Then the clock is reported as off.
"""

from __future__ import annotations

import time
from collections import deque
from itertools import pairwise
from math import hypot, inf, log, nan
from typing import NamedTuple

import numpy as np

from ...core.clocks import (
    COUNT_SIGMA_S,
    DELAY_CHANGE_S,
    LARGEST_RATE,
    QUARTZ_RATE,
    STANDSTILL,
    describe_rate,
)
from ...core.units import Floats

#: Arrivals are remembered for this time, s: a quartz drifts with its temperature within minutes.
ARRIVAL_MEMORY_S = 60.0
#: Length of a bucket, s: only the arrival with the least delay in a bucket is remembered.
BUCKET_S = 0.1
#: Standard uncertainty of the change of a clock's rate between two lives of the board.
RATE_CHANGE = 1e-6
#: An arrival that is earlier than possible by more than this shows that a clock was set, s.
EARLY_ARRIVAL_S = 0.05
#: A line is known from this number of buckets on.
KNOWN_BUCKETS = 5
#: Number of newest buckets that must all be late to show that a clock has stood still.
LATE_BUCKETS = 50
#: Ratio of the arrivals' drift to their scatter above which they lie along a line of another rate.
DRIFT_RATIO = 10.0
#: Least number of buckets for accepting a rate beyond that of a quartz.
DRIFT_BUCKETS = 10
#: An arrival with a delay above this counts as late, s.
LATE_ARRIVAL_S = 0.01
#: Errors of a line under n points whose distances from it are exponential with mean m, in units of
#: m/n, by simulation (tests/live/test_host_time.py repeats it). BIAS: at the middle of the points.
#: END, RISE: standard deviations of its value at their end and of its rise over all of them.
BIAS, END, RISE = 1.8, 4.0, 7.0
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
    """host - device = offset + rate (host - middle), all in s."""

    middle: float
    offset: float
    rate: float

    def lag(self, host: float) -> float:
        """The host's time less the board's time, s."""
        return self.offset + self.rate * (host - self.middle)

    def host_times(self, device: Floats) -> Floats:
        """Times (n,) on the host's clock, s, of times (n,) on the board's clock, s."""
        times: Floats = self.middle + (device + self.offset - self.middle) / (1 - self.rate)
        return times


class HostTime:
    """The line between the clocks of a board and of the host, since the board's last start.

    rate, rate_sigma: fraction of the host's time by which the board's clock is slow, and its
    standard uncertainty.  known: the last of both that the arrivals determined; they outlive a
    restart. is_held: whether the arrivals drift by more than a quartz, but not clearly so.
    restarts: number of new lines.  over: the delay of the newest block after the line, s.  late:
    delay of the line after the soonest line so far, s, without the drift of a quartz; a board's
    clock that lost time looks the same as a delay.  moves: how often a known line was moved by more
    than its drift. worst: the largest uncertainty of times that were newest, s.
    """

    def __init__(self) -> None:
        self.rate, self.rate_sigma, self.is_held = 0.0, QUARTZ_RATE, False
        self.known = self.rate, self.rate_sigma
        self.restarts, self.moves = -1, 0
        self.late = self.over = self.worst = 0.0
        self.points: deque[tuple[float, float]] = deque()  # arrivals, and their lags, s
        self.restart()

    def restart(self) -> None:
        """Begin a new line: the clocks' offset changes here, their rates do not."""
        self.restarts += 1
        self.moves += self.is_known
        self.line: ClockLine | None = None
        self.points.clear()
        self.bucket = -inf
        self.lowest: tuple[float, float] | None = None
        self.scale = 0.0
        self.held = self.known[0], hypot(self.known[1], RATE_CHANGE)

    @property
    def is_known(self) -> bool:
        """Whether the line is known, apart from its uncertainty."""
        return len(self.points) >= KNOWN_BUCKETS

    @property
    def stands_still(self) -> bool:
        """Whether the board's clock does not go on, so that it gives no times."""
        return self.rate > 1 - STANDSTILL

    def add(self, device: float, arrival: float) -> None:
        """Add a block: `device` is the board's time of its last sample, s."""
        lag = arrival - device
        if self.line is None:
            self.line = ClockLine(arrival, lag, self.held[0])
            self.bucket = arrival
        over = lag - self.line.lag(arrival)
        self.late = max(self.late + min(over, 0.0), 0.0)
        is_early = over < -EARLY_ARRIVAL_S * max(1.0, 1 - self.line.rate)
        if is_early and self.is_known and not self.is_held:
            self.restart()
            self.add(device, arrival)
            return
        if over < 0:  # known at once, where the fit is only made now and then
            self.line = self.line._replace(offset=self.line.offset + over)
        if self.lowest is None or over < self.lowest[1] - self.line.lag(self.lowest[0]):
            self.lowest = arrival, lag
        if arrival - self.bucket >= BUCKET_S:
            self.points.append(self.lowest)
            self.follow(arrival)
        self.over = max(lag - self.line.lag(arrival), 0.0)

    def follow(self, arrival: float) -> None:
        """Fit the line again after a bucket that ended with an arrival, s."""
        assert self.line is not None
        while len(self.points) > 1 and self.points[0][0] < arrival - ARRIVAL_MEMORY_S:
            self.points.popleft()
        # data that come later and later look like a slow clock: beyond a quartz, they are late
        slow = max(self.line.rate - LARGEST_RATE, 0.0) * (arrival - self.bucket)
        before = self.line.lag(arrival) - slow
        self.lowest, self.bucket = None, arrival
        self.fit()
        self.late = max(self.late + self.line.lag(arrival) - before, 0.0)
        if self.is_known:
            self.worst = max(self.worst, self.uncertainty)

    def fit(self) -> None:
        """Fit the line under the remembered arrivals."""
        at, lag = np.array(self.points).T
        count, middle, length = len(at), float(at.mean()), float(at[-1] - at[0]) or BUCKET_S
        x, (held_rate, sigma) = at - middle, self.held
        free = hull_slope(x, lag, held_rate)
        rate = min(max(free, held_rate - 3 * sigma), held_rate + 3 * sigma)
        excess = abs(free - rate)
        offset, over = touching_line(x, lag, free)
        unclear = DELAY_CHANGE_S + DRIFT_RATIO * median_scale(over)
        self.is_held = excess > 0 and (count < DRIFT_BUCKETS or excess * length < unclear)
        if self.is_held:
            offset, over = touching_line(x, lag, rate)
        else:
            rate = free
        if self.stood_still(over):
            for _ in range(count - LATE_BUCKETS):
                self.points.popleft()
            self.moves += 1
            self.fit()
            return
        self.scale = median_scale(over)
        self.rate, self.rate_sigma = rate, hypot(sigma, excess)
        if self.is_known and not self.is_held:
            # counts of microseconds are as much in doubt at both ends
            fitted_sigma = hypot(RISE * self.scale / count / length, 2 * COUNT_SIGMA_S / length)
            self.rate_sigma = fitted_sigma if excess else min(sigma, fitted_sigma)
            self.known = rate, self.rate_sigma
        self.line = ClockLine(middle, offset - BIAS * self.scale / count, rate)

    def stood_still(self, over: Floats) -> bool:
        """Whether all of the newest buckets are late (over: s above the line, by bucket), because
        the board's clock has lost time."""
        older, newer = over[:-LATE_BUCKETS], over[-LATE_BUCKETS:]
        return len(older) >= 10 and bool(newer.min() > LATE_ARRIVAL_S + 20 * np.median(older))

    @property
    def uncertainty(self) -> float:
        """Standard uncertainty of the newest samples' times, s; NaN before there are any samples.

        It supposes that the soonest arrivals took the least delay, which is in the configuration.
        """
        if self.line is None:
            return nan
        if not self.is_known or self.stands_still:
            return inf
        end = END * self.scale / len(self.points)
        reach = (self.points[-1][0] - self.points[0][0]) / (1 if self.is_held else 2)
        held = self.rate_sigma * reach if self.rate_sigma >= self.held[1] else 0.0
        return float(np.sqrt(end**2 + held**2 + COUNT_SIGMA_S**2)) / (1 - self.rate)

    @property
    def ppm(self) -> float:
        """Fraction of the host's time by which the board's clock is slow, 1e-6; NaN until it is
        known."""
        rate, sigma = self.known
        return 1e6 * rate if sigma < max(QUARTZ_RATE, abs(rate) / 10) else nan

    @property
    def complaint(self) -> str:
        """The sentence on a board's clock that is off by more than a quartz; or nothing."""
        return describe_rate(1e-6 * self.ppm)


def touching_line(x: Floats, y: Floats, slope: float) -> tuple[float, Floats]:
    """The line of a slope under points (n,): its value at zero, and their distances above it."""
    rest = y - slope * x
    offset = float(rest.min())
    return offset, rest - offset


def median_scale(over: Floats) -> float:
    """The mean of exponential distances (n,) from their median, or of few from their mean."""
    return float(np.median(over)) / log(2) if len(over) > 4 else float(over.mean())


def hull_slope(x: Floats, y: Floats, single: float) -> float:
    """The slope, where x is zero, of the lower convex hull of points x, y (n,) with ascending x of
    mean zero; `single` for a single point.

    This is the slope of the line below all points with the least sum of distances.
    """
    hull: list[tuple[float, float]] = []
    for point in zip(x.tolist(), y.tolist(), strict=True):
        while len(hull) > 1 and turns_down(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    for (x_low, y_low), (x_high, y_high) in pairwise(hull):
        if x_high >= 0:
            return (y_high - y_low) / (x_high - x_low)
    return single


def turns_down(
    first: tuple[float, float], second: tuple[float, float], third: tuple[float, float]
) -> bool:
    """Whether the second point is on or above the line from the first to the third."""
    return (second[0] - first[0]) * (third[1] - first[1]) <= (third[0] - first[0]) * (
        second[1] - first[1]
    )
