"""PI's General Command Set, GCS 2.0: a driver for axes 1 and 2, and the controller's part.

Places are in mm. `MOV 1 0.5 2 0.25` is not answered; `POS? 1 2` is, with a line an axis, all but
the last of which end in a space. `ERR?` tells and clears the last error; 0 is none.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.settings import Stage as Settings
from ..tracking.stage import StageError, StageModel

Floats = NDArray[np.float64]

UNKNOWN_COMMAND, OUT_OF_LIMITS, SERVO_OFF = 2, 7, 5


class Pi:
    """Drives axes 1 (x) and 2 (y). line: an open port with `write` and `readline`."""

    def __init__(self, line: Any, settings: Settings) -> None:
        self.line = line
        self.zero = np.array(settings.zero)

    def say(self, command: str) -> None:
        self.line.write(f"{command}\n".encode())

    def answers(self) -> list[str]:
        lines = []
        while True:
            line = self.line.readline().decode("ascii", "replace").rstrip("\r\n")
            if not line:
                raise StageError("the stage does not answer: is it on, at the right port and baud?")
            lines.append(line)
            if not line.endswith(" "):
                return lines

    def check(self, command: str) -> None:
        self.say("ERR?")
        code = self.answers()[-1].strip()
        if code != "0":
            raise StageError(f"the stage refused {command!r}: GCS error {code}")

    def place(self) -> Floats:
        self.say("POS? 1 2")
        lines = self.answers()
        try:
            found = dict(line.strip().split("=") for line in lines)
            place: Floats = self.zero + np.array([float(found["1"]), float(found["2"])])
        except (ValueError, KeyError):
            raise StageError(f"the stage's place can not be understood: {lines}") from None
        return place

    def move(self, place: Floats) -> None:
        x, y = place - self.zero
        command = f"MOV 1 {x:.6f} 2 {y:.6f}"
        self.say(command)
        self.check(command)

    def stop(self) -> None:
        self.say("STP")
        self.say("ERR?")  # a stop reports itself as error 10
        self.answers()

    def close(self) -> None:
        self.line.close()


class PiController:
    """What a controller answers, for a virtual bench. refuse: its servos are off."""

    def __init__(self, model: StageModel) -> None:
        self.model = model
        self.refuse = False
        self.error = 0

    def answer(self, line: str) -> str:
        words = line.split()
        zero = np.array(self.model.settings.zero)
        if not words:
            return ""
        if words[0] == "ERR?":
            code, self.error = self.error, 0
            return f"{code}\n"
        if words[0] == "*IDN?":
            return "(c) virtual stage, GCS 2.0\n"
        if words[0] == "POS?":
            axes = words[1:] or ["1", "2"]
            places = [f"{a}={self.model.place[int(a) - 1] - zero[int(a) - 1]:.6f}" for a in axes]
            return " \n".join(places) + "\n"
        if words[0] == "MOV":
            self.moved(words[1:], zero)
        elif words[0] in ("STP", "HLT"):
            self.model.halt()
            self.error = 10
        else:
            self.error = UNKNOWN_COMMAND
        return ""

    def moved(self, words: list[str], zero: Floats) -> None:
        target = np.array(self.model.waiting[-1][1] if self.model.waiting else self.model.target)
        try:
            for axis, place in zip(words[::2], words[1::2], strict=True):
                target[int(axis) - 1] = zero[int(axis) - 1] + float(place)
        except (ValueError, IndexError):
            self.error = UNKNOWN_COMMAND
            return
        if self.refuse:
            self.error = SERVO_OFF
            return
        self.model.command(target)
