"""Zaber's ASCII protocol, version 3: a driver for two axes of one device, and the device's part.

`/1 1 move abs 1000` is answered `@01 1 OK IDLE -- 0` (or `RJ` and a reason); `/1 get pos` gives
both axes at once. Source: Zaber ASCII Protocol Manual.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.settings import Stage as Settings
from ..tracking.stage import StageError, StageModel

Floats = NDArray[np.float64]


class Zaber:
    """Drives axes 1 (x) and 2 (y) of device 1. line: an open port with `write` and `readline`."""

    def __init__(self, line: Any, settings: Settings) -> None:
        self.line, self.settings = line, settings
        self.zero = np.array(settings.zero)

    def ask(self, command: str) -> list[str]:
        """The data of the reply to a command; alerts in between are passed over."""
        self.line.write(f"/1 {command}\n".encode())
        while True:
            reply = self.line.readline().decode("ascii", "replace").strip()
            if not reply:
                raise StageError("the stage does not answer: is it on, at the right port and baud?")
            if reply.startswith("@"):
                break
        words = reply.split(":")[0].split()
        if len(words) < 6:
            raise StageError(f"the stage's reply can not be understood: {reply!r}")
        if words[2] != "OK":
            raise StageError(f"the stage refused {command!r}: {' '.join(words[5:])}")
        if words[4].startswith("F"):
            raise StageError(f"the stage has a fault, {words[4]}; see its manual")
        answer: list[str] = words[5:]
        return answer

    def place(self) -> Floats:
        data = self.ask("get pos")
        try:
            return self.zero + self.settings.step * np.array([float(word) for word in data[:2]])
        except ValueError:
            raise StageError(f"the stage's place can not be understood: {data}") from None

    def move(self, place: Floats) -> None:
        units = np.round((place - self.zero) / self.settings.step).astype(int)
        for axis, unit in enumerate(units.tolist(), start=1):
            self.ask(f"{axis} move abs {unit}")

    def stop(self) -> None:
        self.ask("stop")

    def close(self) -> None:
        self.line.close()


class ZaberDevice:
    """What a device answers, for a virtual bench. refuse: reject every move."""

    def __init__(self, model: StageModel) -> None:
        self.model = model
        self.refuse = False
        self.target = np.array(model.place)

    def answer(self, line: str) -> str:
        words = line.strip().lstrip("/").partition(":")[0].split()  # a checksum may follow a colon
        numbers = [words.pop(0) for _ in range(3) if words and words[0].isdigit()]
        axis = int(numbers[1]) if len(numbers) > 1 else 0
        head = " ".join([f"@01 {axis}", *numbers[2:]])  # a message's id comes back
        if not words:
            return f"{head} OK {self.status} -- 0\r\n"
        if words[:2] == ["get", "pos"]:
            units = np.round((self.model.place - self.zero) / self.step).astype(int)
            shown = units if axis == 0 else units[axis - 1 : axis]
            return f"{head} OK {self.status} -- {' '.join(map(str, shown))}\r\n"
        if words[:2] == ["move", "abs"] and len(words) == 3 and axis in (1, 2):
            return self.moved(head, axis, words[2])
        if words == ["stop"]:
            self.model.halt()
            self.target = np.array(self.model.place)
            return f"{head} OK {self.status} -- 0\r\n"
        return f"{head} RJ {self.status} -- BADCOMMAND\r\n"

    def moved(self, head: str, axis: int, word: str) -> str:
        try:
            unit = int(word)
        except ValueError:
            return f"{head} RJ {self.status} -- BADDATA\r\n"
        if self.refuse:
            return f"{head} RJ {self.status} -- DRIVERDISABLED\r\n"
        self.target[axis - 1] = self.zero[axis - 1] + self.step * unit
        self.model.command(self.target)
        return f"{head} OK BUSY -- 0\r\n"

    @property
    def zero(self) -> Floats:
        return np.array(self.model.settings.zero)

    @property
    def step(self) -> float:
        return self.model.settings.step

    @property
    def status(self) -> str:
        return "IDLE" if self.model.settled else "BUSY"
