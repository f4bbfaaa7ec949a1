"""Plausible differences between the clocks of a detector board and of the computer."""

from __future__ import annotations

from math import isfinite

#: Standard uncertainty of the rate of a board's clock with a quartz.
QUARTZ_RATE = 100e-6
#: Largest difference of rates that the tolerance of a quartz explains.
LARGEST_RATE = 4 * QUARTZ_RATE
#: A larger difference cannot come from an oscillator: the board's times are wrong.
IMPOSSIBLE_RATE = 0.05
#: The least delay of a port can change by this, s, for example by the latency timer of a USB
#: converter (16 ms). A smaller drift of the arrivals is no evidence against the clock.
DELAY_CHANGE_S = 0.015
#: Standard uncertainty of a time that a board counts in integer microseconds, s.
COUNT_SIGMA_S = 1e-6 / 12**0.5
#: Wrong units of a board's times, by the resulting ratio of its clock to the computer's.
UNITS = {1e3: "nanoseconds", 1e-3: "milliseconds"}
#: A clock that is slower than this ratio does not run.
STANDSTILL = 1e-5


def describe_rate(rate: float) -> str:
    """Describe a difference of the board's clock that no quartz explains, in a sentence; "" for a
    smaller difference.

    rate: fraction of the computer's time by which the board's clock is slow; NaN if unknown.
    """
    if not isfinite(rate) or abs(rate) <= LARGEST_RATE:
        return ""
    subject, clock_ratio = "the detector board's clock (t_us)", 1 - rate
    if clock_ratio < STANDSTILL:
        return f"{subject} does not advance: check the counter that the firmware reads"
    if abs(rate) <= IMPOSSIBLE_RATE:
        size, late = f"{1e6 * abs(rate):.4g} ppm", "; or its data come later and later"
        return (
            f"{subject} is {size} {'slow' if rate > 0 else 'fast'} by the arrivals of its data, "
            f"more than a quartz is: check its oscillator{late if rate > 0 else ''}"
        )
    unit = next((name for ratio, name in UNITS.items() if abs(clock_ratio / ratio - 1) < 0.05), "")
    cause = f"t_us counts {unit}" if unit else "check its unit and its prescaler"
    return f"{subject} runs {clock_ratio:.3g} times as fast as its data arrive: {cause}"
