"""Zaber's ASCII protocol, version 3: a driver for two axes of one device.

`/1 1 07 move abs 1000:C5` is answered `@01 1 07 OK IDLE -- 0` (or `RJ` and a reason); `/1 0 08 get
pos` returns both axes at once. 07 is the message's number, which distinguishes late answers; C5 is
its checksum, without which a damaged command would be executed. Source: Zaber ASCII Protocol
Manual.
"""

from __future__ import annotations

import numpy as np

from ..core.settings import Stage as Settings
from ..core.units import Floats
from .line import PATIENCE_S, Line
from .native_limits import NativeLimits
from .stage import StageError

#: One native unit of speed, microsteps/s.
SPEED_UNIT_STEPS_PER_S = 1 / 1.6384
#: One native unit of acceleration, microsteps/s².
ACCELERATION_UNIT_STEPS_PER_S2 = 1e4 / 1.6384
#: The settings of an axis that hold its moves back; a device stores them.
LIMITS = ("maxspeed", "accel")
#: The numbers of messages are below this, and repeat.
MESSAGE_NUMBERS = 90


def checksum(message: str) -> str:
    """Checksum of a message without its first character: two hexadecimal digits, total sum zero."""
    return f"{-sum(message.encode()) & 0xFF:02X}"


class Zaber(NativeLimits):
    """Driver of axes 1 (x) and 2 (y) of device 1; places (2,) of the beam in mm. Methods that send
    a command raise `StageError` if the stage does not answer, refuses it or has a fault."""

    def __init__(self, line: Line, settings: Settings) -> None:
        self.line, self.settings = line, settings
        self.zero = np.array(settings.zero)
        self.number = 0

    def send(self, command: str, axis: int = 0) -> str:
        """Write a command; return its number."""
        self.number = (self.number + 1) % MESSAGE_NUMBERS
        text = f"1 {axis} {self.number:02d} {command}"
        self.line.write(f"/{text}:{checksum(text)}\n".encode())
        return f"{self.number:02d}"

    def receive(self, number: str, command: str, patience: float = PATIENCE_S) -> list[str]:
        """The data of the answer to a command; alerts and late answers are discarded. Raises
        `StageError` if no answer comes within `patience`, s, or the device refuses."""
        until = self.line.clock() + patience
        while self.line.clock() <= until:
            reply = self.line.read_line(patience)
            if reply[:1] in ("!", "#"):
                continue
            body, _, sent_checksum = reply.partition(":")
            words = body.split()
            sound = not sent_checksum or sent_checksum == checksum(body[1:])
            if not (sound and reply[:1] == "@" and len(words) >= 7 and words[2].isdigit()):
                raise StageError(f"the stage's answer cannot be understood: {reply!r}")
            if words[2] == number:
                return self.data_of(words, command)
        raise StageError(f"the stage sends data, but does not answer {command!r}")

    def data_of(self, words: list[str], command: str) -> list[str]:
        """The data of an answer; raises `StageError` for a refusal or a fault."""
        if words[3] != "OK":
            raise StageError(f"the stage refused {command!r}: {' '.join(words[6:])}")
        if words[5].startswith("F"):
            raise StageError(f"the stage has a fault, {words[5]}; see its manual")
        if words[5] == "WR":
            raise StageError(
                "the stage has lost its reference (WR): check whether it was restarted, and home it"
            )
        return words[6:]

    def ask(self, command: str, patience: float = PATIENCE_S) -> list[str]:
        """Send a command and return the data of its answer. patience: longest wait, s."""
        return self.receive(self.send(command), command, patience)

    def query_numbers(self, command: str) -> Floats:
        """Query one number for each of the two axes: (2,), in the device's units. Raises
        `StageError` for another answer."""
        data = self.ask(command)
        try:
            values = np.array([float(word) for word in data])
        except ValueError:
            values = np.zeros(0)
        if values.shape != (2,) or not np.isfinite(values).all():
            raise StageError(f"the stage's answer to {command!r} cannot be understood: {data}")
        return values

    def prepare(self) -> None:
        """Stop the stage, and bound its speed and acceleration by the settings."""
        self.emergency_stop()
        self.line.drain()
        self.stop()
        s, original = self.settings, self.read_limits()
        original[original == 0] = np.inf  # an acceleration of 0 sets no limit
        speed = round(s.max_speed / s.step / SPEED_UNIT_STEPS_PER_S)
        acceleration = round(s.acceleration / s.step / ACCELERATION_UNIT_STEPS_PER_S2)
        self.hold_back(*np.minimum(original, [[max(1, speed)], [max(1, acceleration)]]))

    def read_limits(self) -> Floats:
        """The largest speeds and accelerations (2, 2) in the device's units: row 0 is the speed,
        row 1 the acceleration, one column for each axis."""
        return np.array([self.query_numbers(f"get {name}") for name in LIMITS])

    def write_limits(self, limits: Floats) -> None:
        """Set the largest speeds and accelerations; limits: (2, 2), see `read_limits`."""
        for name, values in zip(LIMITS, limits, strict=True):
            for axis, value in enumerate(values, start=1):
                command = f"set {name} {int(value)}"
                self.receive(self.send(command, axis), command)

    def place(self) -> Floats:
        """The beam's place by the encoders: (2,) mm."""
        return self.zero + self.settings.step * self.query_numbers("get pos")

    def move(self, place: Floats) -> None:
        """Start towards a place (2,), mm, and return before the stage arrives."""
        units = np.round((place - self.zero) / self.settings.step).astype(int).tolist()
        sent = []
        for axis, unit in enumerate(units, start=1):
            command = f"move abs {unit}"
            sent.append((self.send(command, axis), command))
        for number, command in sent:
            self.receive(number, command)

    def stop(self, patience: float = PATIENCE_S) -> None:
        """Stop both axes, and wait until the stage confirms it, at most `patience`, s."""
        self.ask("stop", patience)

    def emergency_stop(self) -> None:
        """Stop without waiting for an answer, even within a half-sent command."""
        self.line.write(b"?\n/1 0 99 stop\n")

    def close(self) -> None:
        self.line.close()
