"""The faults of a virtual bench: how often they come, and how long they last."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import inf
from typing import ClassVar

import numpy as np

from ...core.errors import InputError
from ...core.plain_numbers import assignments, plain_number

FORM = "NAME=NUMBER"


@dataclass(frozen=True)
class Faults:
    """Probabilities of faults; 0 is never.

    For each sample: flip: one bit of its bytes is turned.  lose, double: one of its bytes is lost,
    or comes twice.  drop: the board loses the sample.

    For each second: stall: the board sends nothing for 50 ms.  block: the beam is blocked for
    50 ms.  saturate: a converter is at its end for 50 ms.  unplug: the port disappears for 300 ms.
    restart: the board restarts and counts from zero again after 300 ms.  refuse: the stage refuses
    to move for 100 ms.  jam: the stage does not move for 100 ms.  permit: the board's input for the
    stage's permit is off for 100 ms.

    Of the board's time: jitter_ms: the port delays each packet by up to this time; none overtakes
    another.  drift_ppm: by how much the board's clock is slow.  uptime_s: how long the board has
    been on when the bench begins; its clock wraps every 4294.967296 s.
    """

    flip: float = 0.0
    lose: float = 0.0
    double: float = 0.0
    drop: float = 0.0
    stall: float = 0.0
    block: float = 0.0
    saturate: float = 0.0
    unplug: float = 0.0
    restart: float = 0.0
    refuse: float = 0.0
    jam: float = 0.0
    permit: float = 0.0
    jitter_ms: float = 0.0
    drift_ppm: float = 0.0
    uptime_s: float = 0.0

    #: Duration of each fault that comes per second, s.
    LASTING: ClassVar[dict[str, float]] = {
        "stall": 0.05,
        "block": 0.05,
        "saturate": 0.05,
        "unplug": 0.3,
        "restart": 0.3,
        "refuse": 0.1,
        "jam": 0.1,
        "permit": 0.1,
    }

    @classmethod
    def from_text(cls, text: str) -> Faults:
        """The faults that a command line names: `flip=1e-4,drop=1e-3`."""
        return cls.from_words(assignments(text, "--faults", cls.names(), FORM) if text else {})

    @classmethod
    def from_words(cls, words: dict[str, str], option: str = "--faults") -> Faults:
        """The faults with numbers in text.  option: where they were given, for messages. Raises
        `InputError` for an unknown or impossible one."""
        chances = {}
        for name, value in words.items():
            try:
                chances[name] = plain_number(value)
            except ValueError:
                chances[name] = -1.0
            if not 0 <= chances[name] < inf:
                raise InputError(
                    f"{option} has '{name}={value}'; allowed: {FORM} with NAME one of "
                    f"{', '.join(cls.names())}"
                )
        return cls(**chances)

    @classmethod
    def names(cls) -> list[str]:
        """The names of all faults."""
        return [field.name for field in fields(cls)]


class Schedule:
    """Draws when the lasting faults begin, and knows which of them are present."""

    def __init__(self, faults: Faults, rng: np.random.Generator) -> None:
        self.faults, self.rng = faults, rng
        self.until: dict[str, float] = {}
        self.last = 0.0

    def draw(self, now: float) -> None:
        """Draw the faults that begin between the last call and the time `now`, s."""
        passed, self.last = max(0.0, now - self.last), now
        for name, duration in Faults.LASTING.items():
            rate = getattr(self.faults, name)
            if rate > 0 and self.rng.random() < rate * passed and not self.is_on(name, now):
                self.until[name] = now + duration

    def is_on(self, name: str, now: float) -> bool:
        """Whether a fault is present at the time `now`, s."""
        return now < self.until.get(name, -1.0)
