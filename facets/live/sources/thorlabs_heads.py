"""Thorlabs' position-sensing heads behind three K-Cubes or T-Cubes, by pylablib.

`thorlabs:69000001,69000002,69000003?rate=30` asks three controllers (KPA101, TPA101) with
lateral-effect heads, of detectors A, B, C, one after the other: X and Y difference and sum, so that
X / SUM is the place in half sizes. Each USB query takes some milliseconds, so that the
three detectors of a sample have different times: use it for adjustment and slow motions. The
difference that a quadrant head gives is no position. `bits` and `range` are as for `ni_card`. Not
tested on hardware: written from pylablib's documentation and source (1.4).
"""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Any

import numpy as np

from ...core.closing import ClosedAtExit
from ...core.extras import require_extra
from .frames import XY_SUM
from .ni_card import counts_of_volts, frames_of, numbers_of
from .source import PortError, PortInUse


class Heads(ClosedAtExit):
    """Three controllers, asked at a rate."""

    ended = waits = False

    def __init__(self, name: str, baud: int) -> None:
        """baud: ignored, because a controller on USB is no serial line."""
        self.name = name
        place, options, words = numbers_of(name, {"rate": 30, "bits": 16, "range": 10})
        numbers = place.split(",")
        if words or len(numbers) != 3 or not all(number.isdigit() for number in numbers):
            raise PortInUse(
                f"{name}: give the serial numbers of three controllers, of A, B, C, as in "
                "thorlabs:69000001,69000002,69000003, and of the options rate, bits, range"
            )
        self.period, self.bits, self.full = 1 / options["rate"], options["bits"], options["range"]
        Thorlabs = require_extra("pylablib.devices.Thorlabs", name)
        self.heads: list[Any] = []
        try:
            for number in numbers:
                self.heads.append(Thorlabs.KinesisQuadDetector(number))
        except Exception as error:
            self.close()
            raise PortError(f"{name}: cannot be opened: {error}") from None
        self.made, self.due = 0, time.monotonic()

    def read(self) -> bytes:
        """Wait until a sample is due, and return its frame. Raises `PortError` if a head does not
        answer."""
        time.sleep(max(0.0, self.due - time.monotonic()))
        begin = time.monotonic()
        self.due = max(self.due + self.period, begin)
        volts = np.zeros((3, 4))
        try:
            for row, head in zip(volts, self.heads, strict=True):
                signals = head.get_readings()
                row[:3] = signals.xdiff, signals.ydiff, signals.sum
        except Exception as error:
            raise PortError(f"{self.name}: went away: {error}") from None
        middle = (begin + time.monotonic()) / 2
        number = np.array([self.made])
        self.made += 1
        counts = counts_of_volts(volts.reshape(1, 12), self.bits, self.full)
        return frames_of(counts, number, np.array([1e6 * middle]), XY_SUM)

    def close(self) -> None:
        heads, self.heads = self.heads, []
        for head in heads:
            with suppress(Exception):
                head.close()
