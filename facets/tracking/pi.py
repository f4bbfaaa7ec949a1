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
from .stage import StageError

UNKNOWN_COMMAND, STOPPED = "2", "10"
STOP_ALL = b"\x18"


class Pi:
    """Driver of axes 1 (x) and 2 (y); places of the beam in mm, (2,)."""

    def __init__(self, line: Line, settings: Settings) -> None:
        self.line, self.settings = line, settings
        self.zero = np.array(settings.zero)
        self.cries = self.forgiven = 0  # a cry leaves an error code that is no refusal

    def answers(self, patience: float = PATIENCE_S) -> list[str]:
        lines: list[str] = []
        while len(lines) < 10:
            lines.append(self.line.read_line(patience))
            if not lines[-1].endswith(" "):
                return lines
        raise StageError(f"the stage's answer has no end: {lines}")

    def tell(self, command: str, *allowed: str, patience: float = PATIENCE_S) -> str:
        """Send a command, and require the error code 0 or one of `allowed`."""
        self.line.write(f"{command}\nERR?\n".encode())
        lines = self.answers(patience)
        code = lines[-1].strip()
        if len(lines) != 1 or not code.lstrip("-").isdigit():
            raise StageError(f"the stage's answer cannot be understood: {lines}")
        if code in (UNKNOWN_COMMAND, STOPPED) and self.cries > self.forgiven:
            self.forgiven = self.cries
        elif code not in ("0", *allowed):
            raise StageError(f"the stage refused {command!r}: GCS error {code}")
        return code

    def prepare(self) -> None:
        """Stop the stage, and bound its speed and acceleration by the settings."""
        self.cry()
        self.line.drain()
        self.stop()
        speed, change = self.settings.max_speed, self.settings.acceleration
        self.tell(f"VEL 1 {speed:.6f} 2 {speed:.6f}")
        for word in ("ACC", "DEC"):  # not every controller has these commands
            self.tell(f"{word} 1 {change:.6f} 2 {change:.6f}", UNKNOWN_COMMAND)

    def place(self) -> Floats:
        """The beam's place by the encoders."""
        self.line.write(b"POS? 1 2\n")
        lines = self.answers()
        try:
            found = dict(line.strip().split("=") for line in lines)
            place = np.array([float(found["1"]), float(found["2"])])
        except (ValueError, KeyError):
            place = np.full(2, np.nan)
        if not np.isfinite(place).all():
            raise StageError(f"the stage's position cannot be understood: {lines}")
        there: Floats = self.zero + place
        return there

    def move(self, place: Floats) -> None:
        """Start towards a place, and return before the stage arrives."""
        x, y = place - self.zero
        self.tell(f"MOV 1 {x:.6f} 2 {y:.6f}")

    def stop(self, patience: float = PATIENCE_S) -> None:
        """Stop both axes, and wait until the stage confirms it."""
        self.tell("STP", STOPPED, patience=patience)

    def cry(self) -> None:
        """Stop without waiting for an answer, even within a half-sent command."""
        self.cries += 1
        self.line.write(STOP_ALL + b"?\n" + STOP_ALL)

    def close(self) -> None:
        self.line.close()
