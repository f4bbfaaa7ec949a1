"""PI's General Command Set, GCS 2.0: a driver for axes 1 and 2.

Places are in mm. `MOV 1 0.5 2 0.25` has no answer; `POS? 1 2` is answered with one line for each
axis, all but the last of which end in a space. `ERR?` returns and clears the last error; 0 is none.
The single character 24 stops all axes. Source: PI, GCS 2.0 commands manual.
"""

from __future__ import annotations

import numpy as np

from ..core.settings import Stage as Settings
from ..core.units import Floats
from .line import PATIENCE_S, Line
from .native_limits import NativeLimits
from .stage import StageError

UNKNOWN_COMMAND, STOPPED = "2", "10"
STOP_ALL = b"\x18"
LIMITS = ("VEL", "ACC", "DEC")


class Pi(NativeLimits):
    """Driver of axes 1 (x) and 2 (y); places (2,) of the beam in mm. Methods that send a command
    raise `StageError` if the stage does not answer or refuses it."""

    def __init__(self, line: Line, settings: Settings) -> None:
        self.line, self.settings = line, settings
        self.zero = np.array(settings.zero)
        # An emergency stop leaves an error code that is no refusal.
        self.emergency_stops = self.forgiven = 0

    def read_answers(self, patience: float = PATIENCE_S) -> list[str]:
        """Read the lines of one answer; raises `StageError` if it has no end."""
        lines: list[str] = []
        while len(lines) < 10:
            lines.append(self.line.read_line(patience))
            if not lines[-1].endswith(" "):
                return lines
        raise StageError(f"the stage's answer has no end: {lines}")

    def execute(self, command: str, *allowed: str, patience: float = PATIENCE_S) -> str:
        """Send a command and return its error code; raises `StageError` if that is neither 0 nor
        one of `allowed`."""
        self.line.write(f"{command}\nERR?\n".encode())
        lines = self.read_answers(patience)
        code = lines[-1].strip()
        if len(lines) != 1 or not code.lstrip("-").isdigit():
            raise StageError(f"the stage's answer cannot be understood: {lines}")
        if code in (UNKNOWN_COMMAND, STOPPED) and self.emergency_stops > self.forgiven:
            self.forgiven = self.emergency_stops
        elif code not in ("0", *allowed):
            raise StageError(f"the stage refused {command!r}: GCS error {code}")
        return code

    def prepare(self) -> None:
        """Stop the stage, and bound its speed and acceleration by the settings."""
        self.emergency_stop()
        self.line.drain()
        self.stop()
        s = self.settings
        self.hold_back(s.max_speed, s.acceleration)

    def read_limits(self) -> Floats:
        """Speeds, accelerations and decelerations (3, 2) in mm/s and mm/s2, one column for each
        axis; NaN where the controller does not have the limit."""
        return np.array([self.read_limit(name) for name in LIMITS])

    def read_limit(self, name: str) -> Floats:
        """A limit of both axes (2,) by its name; NaN if the controller does not have it. Raises
        `StageError` for a missing speed, or a missing limit that `stage.native_limits` needs."""
        self.line.write(f"{name}? 1 2\nERR?\n".encode())
        lines = self.read_answers()
        if "=" in lines[0]:
            self.read_answers()  # the error code
            return self.parse_numbers(lines)
        unknown = lines[0].strip() == UNKNOWN_COMMAND and name != "VEL"
        if not unknown or self.settings.native_limits:
            raise StageError(f"the stage does not say its {name}, so that it cannot be limited")
        return np.full(2, np.nan)

    def write_limits(self, limits: Floats) -> None:
        """Set the limits (3, 2) that the controller has."""
        for name, (x, y) in zip(LIMITS, limits, strict=True):
            self.execute(f"{name} 1 {x:.6f} 2 {y:.6f}", UNKNOWN_COMMAND)

    def parse_numbers(self, lines: list[str]) -> Floats:
        """The numbers (2,) of both axes in an answer; raises `StageError` if they are not there."""
        try:
            by_axis = dict(line.strip().split("=") for line in lines)
            numbers = np.array([float(by_axis["1"]), float(by_axis["2"])])
        except (ValueError, KeyError):
            numbers = np.full(2, np.nan)
        if not np.isfinite(numbers).all():
            raise StageError(f"the stage's answer cannot be understood: {lines}")
        return numbers

    def place(self) -> Floats:
        """The beam's place by the encoders: (2,) mm."""
        self.line.write(b"POS? 1 2\n")
        there: Floats = self.zero + self.parse_numbers(self.read_answers())
        return there

    def move(self, place: Floats) -> None:
        """Start towards a place (2,), mm, and return before the stage arrives."""
        x, y = place - self.zero
        self.execute(f"MOV 1 {x:.6f} 2 {y:.6f}")

    def stop(self, patience: float = PATIENCE_S) -> None:
        """Stop both axes, and wait until the stage confirms it, at most `patience`, s."""
        self.execute("STP", STOPPED, patience=patience)

    def emergency_stop(self) -> None:
        """Stop without waiting for an answer, even within a half-sent command."""
        self.emergency_stops += 1
        self.line.write(STOP_ALL + b"?\n" + STOP_ALL)

    def close(self) -> None:
        self.line.close()
