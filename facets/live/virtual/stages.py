"""The controllers of a virtual stage, which answer as a Zaber device or a PI controller does."""

from __future__ import annotations

import numpy as np

from ...core.units import Floats
from ...tracking.pi import STOP_ALL
from ...tracking.stage import StageModel
from ...tracking.zaber import ACCELERATION_UNIT_STEPS_PER_S2, SPEED_UNIT_STEPS_PER_S, checksum

PI_UNKNOWN, PI_SERVO_OFF, PI_STOPPED = 2, 5, 10


class VirtualController:
    """A controller of two axes, which answers lines.

    refuse: whether to reject every move.  referenced: whether the axes have been homed since the
    last restart.  moves: number of moves that were obeyed.  held: bytes of an unfinished line.
    """

    def __init__(self, model: StageModel) -> None:
        self.model = model
        self.refuse, self.referenced, self.moves = False, True, 0
        self.zero = np.array(model.settings.zero)
        self.held = b""

    def receive(self, data: bytes) -> bytes:
        """Take bytes, and return the answers to the lines that they complete."""
        *lines, self.held = (self.held + data).split(b"\n")
        return b"".join(self.answer(line.decode("ascii", "replace")).encode() for line in lines)

    def answer(self, line: str) -> str:
        """The answer to one line; empty if there is none."""
        raise NotImplementedError

    def restart(self) -> None:
        """Lose power and get it back: the axes are at rest, cannot move, and have lost their
        reference."""
        self.model.halt()
        self.held, self.referenced = b"", False
        self.zero = np.array(self.model.place)


class ZaberDevice(VirtualController):
    """A Zaber device of two axes."""

    def __init__(self, model: StageModel) -> None:
        super().__init__(model)
        self.step = model.settings.step
        self.target = np.array(model.place)
        self.limits = {
            "maxspeed": np.full(2, model.max_speed / self.step / SPEED_UNIT_STEPS_PER_S),
            "accel": np.full(2, model.acceleration / self.step / ACCELERATION_UNIT_STEPS_PER_S2),
        }

    def restart(self) -> None:
        """Restart the device; its target is then the place at which it is at rest."""
        super().restart()
        self.target = np.array(self.model.place)

    def answer(self, line: str) -> str:
        """The answer to one line; empty if the line is no message or has a wrong checksum."""
        _, slash, message = line.strip().rpartition("/")
        if not slash:
            return ""
        message, _, sent_checksum = message.partition(":")
        if sent_checksum and sent_checksum != checksum(message):
            return ""
        words = message.split()
        numbers = [words.pop(0) for _ in range(3) if words and words[0].isdigit()]
        axis = int(numbers[1]) if len(numbers) > 1 else 0
        reply = self.obey(axis, words)
        good = "RJ" if reply.startswith("!") else "OK"
        head = " ".join([f"@01 {axis}", *numbers[2:]])  # a message's number comes back
        flag = "--" if self.referenced else "WR"
        return f"{head} {good} {self.status} {flag} {reply.lstrip('!')}\r\n"

    def obey(self, axis: int, words: list[str]) -> str:
        """The data of the answer; `!` and a reason if the command is rejected."""
        if not words:
            return "0"
        if words[0] == "get" and len(words) == 2:
            return self.get(axis, words[1])
        if words[:2] == ["move", "abs"] and len(words) == 3 and axis in (1, 2):
            return self.move(axis, words[2])
        if words[0] == "set" and len(words) == 3:
            return self.set(axis, words[1], words[2])
        if words == ["stop"]:
            self.model.halt()
            self.target = np.array(self.model.place)
            return "0"
        return "!BADCOMMAND"

    def get(self, axis: int, name: str) -> str:
        """The answer to a query: the value of one axis, or of both for axis 0; "!BADCOMMAND" for an
        unknown name."""
        position = (self.model.place - self.zero) / self.step
        table = {"pos": position, **self.limits}
        if name not in table:
            return "!BADCOMMAND"
        values = np.round(table[name]).astype(int)
        return " ".join(map(str, values if axis == 0 else values[axis - 1 : axis]))

    def set(self, axis: int, name: str, value: str) -> str:
        """Set a limit of an axis; returns "0", or "!BADDATA" for an impossible one."""
        if name not in self.limits or axis not in (1, 2) or not value.isdigit():
            return "!BADDATA"
        self.limits[name][axis - 1] = int(value)
        return "0"

    def move(self, axis: int, word: str) -> str:
        """Start a move of an axis to a position in steps; returns "0", or the reason to refuse
        it."""
        try:
            unit = int(word)
        except ValueError:
            return "!BADDATA"
        if self.refuse or not self.referenced:
            return "!DRIVERDISABLED"
        most, change = (float(limit[axis - 1]) * self.step for limit in self.limits.values())
        self.model.max_speed = most * SPEED_UNIT_STEPS_PER_S
        self.model.acceleration = change * ACCELERATION_UNIT_STEPS_PER_S2
        self.target[axis - 1] = self.zero[axis - 1] + self.step * unit
        self.moves += 1
        self.model.command(self.target)
        return "0"

    @property
    def status(self) -> str:
        """The word that says whether the device moves."""
        return "IDLE" if self.model.is_settled else "BUSY"


class PiController(VirtualController):
    """A PI controller of two axes, which refuses moves while its servos are off."""

    def __init__(self, model: StageModel) -> None:
        super().__init__(model)
        self.most = model.max_speed, model.acceleration
        self.error = 0

    def receive(self, data: bytes) -> bytes:
        """Take in bytes and return the answers; a stop acts at once, even in the middle of a
        line."""
        for _ in range(data.count(STOP_ALL)):  # acts at once, in the middle of a line
            self.stop()
        return super().receive(data.replace(STOP_ALL, b""))

    def restart(self) -> None:
        """Restart the controller without an error code."""
        super().restart()
        self.error = 0

    def stop(self) -> None:
        """Stop the motion, and set the error code that a stop leaves."""
        self.model.halt()
        self.error = PI_STOPPED

    def answer(self, line: str) -> str:
        """The answer to a line; empty for a command."""
        words = line.split()
        if not words:
            return ""
        if words[0] == "ERR?":
            code, self.error = self.error, 0
            return f"{code}\n"
        if words[0] == "*IDN?":
            return "(c) virtual stage, GCS 2.0\n"
        if words[0] in ("POS?", "VEL?", "ACC?", "DEC?"):
            axes = words[1:] or ["1", "2"]
            values = self.values(words[0])
            if set(axes) <= {"1", "2"}:
                return " \n".join(f"{a}={values[int(a) - 1]:.6f}" for a in axes) + "\n"
        if words[0] in ("MOV", "VEL", "ACC", "DEC"):
            self.set(words[0], words[1:])
        elif words[0] in ("STP", "HLT"):
            self.stop()
        else:
            self.error = PI_UNKNOWN
        return ""

    def values(self, query: str) -> Floats:
        """The values (2,) of both axes that a query asks for."""
        if query == "POS?":
            position: Floats = self.model.place - self.zero
            return position
        return np.full(2, self.model.max_speed if query == "VEL?" else self.model.acceleration)

    def set(self, name: str, words: list[str]) -> None:
        """Execute a command that sets targets, speeds or accelerations of axes; sets the error code
        for a malformed one."""
        values = {}
        try:
            for axis, value in zip(words[::2], words[1::2], strict=True):
                values[int(axis) - 1] = float(value)
        except ValueError:
            values = {-1: 0.0}
        if not values or not set(values) <= {0, 1} or not np.isfinite(list(values.values())).all():
            self.error = PI_UNKNOWN
        elif name == "MOV":
            self.move(values)
        elif name == "VEL":
            self.model.max_speed = min(max(values.values()), self.most[0])
        else:
            self.model.acceleration = min(max(values.values()), self.most[1])

    def move(self, values: dict[int, float]) -> None:
        """Start a move of axes to positions, mm; sets the error code if the controller refuses
        it."""
        if self.refuse or not self.referenced:
            self.error = PI_SERVO_OFF
            return
        target = np.array(self.model.waiting[-1][1] if self.model.waiting else self.model.target)
        for axis, value in values.items():
            target[axis] = self.zero[axis] + value
        self.moves += 1
        self.model.command(target)


#: The virtual controller of each driver of this package.
CONTROLLERS = {"zaber": ZaberDevice, "pi": PiController}
