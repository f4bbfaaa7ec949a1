"""The times of a stream's samples on the host's clock, by the board's counters and the arrivals."""

from __future__ import annotations

from math import inf, isnan, nan

import numpy as np
from numpy.typing import NDArray

from ...core.clocks import IMPOSSIBLE_RATE
from ...core.settings import Acquire
from ...core.units import Floats
from ..sources.clock import Sequence
from ..sources.host_time import HostTime


class SampleTimes:
    """The two clocks of a stream: the board's, which `sequence` unwraps, and the host's."""

    def __init__(self, settings: Acquire) -> None:
        self.settings = settings
        self.sequence, self.host_time = Sequence(), HostTime()
        self.last = nan, 0  # arrival, s, and board's time, us, of the last sample
        self.latest = -inf  # host's time of the last sample, s

    def follow(self, time: NDArray[np.int64], arrival: float, restarted: bool) -> Floats:
        """Return the samples' times on the host's clock (n,), s, which only grow.

        time: times of the board, us.  arrival: of the samples, s; NaN if it is not known.
        restarted: whether the board restarted before one of them.
        """
        device: Floats = 1e-6 * time.astype(np.float64)
        before = self.host_time.line
        if restarted:
            self.host_time.restart()
        if isnan(arrival):  # as late after its sample as the last arrival
            arrival = self.last[0] + 1e-6 * (int(time[-1]) - self.last[1])
        else:
            self.host_time.add(float(device[-1]), arrival)
        self.last = arrival, int(time[-1])
        line, clock = self.host_time.line, self.host_time
        if self.settings.timing == "arrival" or line is None or clock.stands_still:
            age: Floats = (device[-1] - device) / (1 if clock.stands_still else 1 - clock.rate)
            return arrival - self.settings.delay - age
        host = line.host_times(device)
        if restarted and before is not None:
            host[: self.sequence.fresh] = before.host_times(device[: self.sequence.fresh])
        host -= self.settings.least_delay
        # the line moves as it is known better, and later samples are not earlier for that
        host = np.maximum(host, self.latest + 1e-9 * np.arange(1, len(host) + 1))
        host = np.maximum.accumulate(host)
        self.latest = float(host[-1])
        return host

    @property
    def arrival(self) -> float:
        """When the last samples arrived, s."""
        return self.last[0]

    @property
    def late(self) -> float:
        """Delay of the newest samples after the earliest line of the board's clock so far, s."""
        over = self.host_time.over if self.settings.timing == "arrival" else 0.0
        return self.host_time.late + over

    @property
    def messages(self) -> list[str]:
        """Sentences on a board's clock that leaps or is off."""
        return [text for text in (self.sequence.leap_sentence, self.host_time.complaint) if text]

    @property
    def fault(self) -> str:
        """The sentence on a board's clock that cannot be a clock; or nothing."""
        clock, sequence = self.host_time, self.sequence
        if sequence.leaps > 1 and not clock.is_known:
            return sequence.leap_sentence
        return clock.complaint if abs(clock.ppm) > 1e6 * IMPOSSIBLE_RATE else ""
