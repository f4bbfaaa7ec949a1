"""Thorlabs' Kinesis stages, by pylablib: two controllers of one axis, or one of several.

`kinesis:27000001,27000002` are the serial numbers of the controllers of x and y; `kinesis:70000001`
is one controller whose channels 1 and 2 are x and y. `stage.step_um` is one step of the encoder.
pylablib speaks Thorlabs' APT protocol through the controller's USB chip. Not tested on hardware:
written from pylablib's documentation and source (1.4).
"""

from __future__ import annotations

import threading
from contextlib import suppress
from typing import Any

import numpy as np

from ..core.extras import require_extra
from ..core.settings import Stage as Settings
from ..core.units import Floats
from .line import PATIENCE_S
from .native_limits import NativeLimits
from .stage import StageError

#: Longest time for which `emergency_stop` waits for the end of another thread's question, s.
EMERGENCY_STOP_WAIT_S = 0.5


def open_kinesis(name: str, settings: Settings) -> Kinesis:
    """Open the stages of `kinesis:X,Y` or `kinesis:XY`. Raises `StageError` if there are none."""
    numbers = name.partition(":")[2].split(",")
    if not 1 <= len(numbers) <= 2 or not all(number.isdigit() for number in numbers):
        raise StageError(
            f"{name}: give the serial numbers of the controllers of x and y, as in "
            "kinesis:27000001,27000002, or of one with two channels"
        )
    Thorlabs = require_extra("pylablib.devices.Thorlabs", name)
    motors: list[Any] = []
    try:
        for number in numbers:
            motors.append(Thorlabs.KinesisMotor(number, scale=1 / settings.step))
    except Exception as error:
        for motor in motors:
            motor.close()
        raise StageError(f"{name}: cannot be opened: {error}") from None
    axes = (
        [(motors[0], 1), (motors[1], 1)] if len(motors) == 2 else [(motors[0], 1), (motors[0], 2)]
    )
    return Kinesis(axes, settings)


class Kinesis(NativeLimits):
    """Driver of two axes, each a motor of pylablib and its channel; places (2,) of the beam in mm.
    A fault is raised as `StageError` or as an error of pylablib.

    A motor's question and answer must not be interrupted: `turn` lets one thread at a time ask.
    """

    def __init__(self, axes: list[tuple[Any, int]], settings: Settings) -> None:
        self.axes, self.settings = axes, settings
        self.zero = np.array(settings.zero)
        self.turn = threading.RLock()

    def prepare(self) -> None:
        """Stop the stage, and bound speed and acceleration of each axis. Raises `StageError` for an
        axis without a reference, or whose speed cannot be limited."""
        self.stop()
        s = self.settings
        with self.turn:
            for (motor, channel), name in zip(self.axes, "xy", strict=True):
                if motor.get_scale_units() == "internal":
                    raise StageError(
                        f"pylablib does not support the controller of {name} and cannot read its "
                        "speed, so that the speed cannot be limited"
                    )
                if not motor.is_homed(channel=channel):
                    raise StageError(f"the axis {name} has no reference: home it by Kinesis")
            self.hold_back(s.max_speed / s.step, s.acceleration / s.step)

    def read_limits(self) -> Floats:
        """The largest speeds and accelerations (2, 2) in steps/s and steps/s2: row 0 is the speed,
        one column for each axis."""
        with self.turn:
            parameters = [
                motor.get_velocity_parameters(channel=channel) for motor, channel in self.axes
            ]
        limits = np.array([[axis.max_velocity, axis.acceleration] for axis in parameters])
        return limits.T / self.settings.step

    def write_limits(self, limits: Floats) -> None:
        """Set the largest speeds and accelerations; limits: (2, 2), see `read_limits`."""
        values = (limits.T * self.settings.step).tolist()
        with self.turn:
            for (motor, channel), (speed, change) in zip(self.axes, values, strict=True):
                motor.setup_velocity(acceleration=change, max_velocity=speed, channel=channel)

    def place(self) -> Floats:
        """The beam's place by the encoders: (2,) mm."""
        with self.turn:
            place = [motor.get_position(channel=channel) for motor, channel in self.axes]
        there: Floats = self.zero + np.array(place, dtype=float)
        return there

    def move(self, place: Floats) -> None:
        """Start towards a place (2,), mm, and return before the stage arrives."""
        with self.turn:
            for (motor, channel), goal in zip(self.axes, place - self.zero, strict=True):
                motor.move_to(float(goal), channel=channel)

    def stop(self, patience: float = PATIENCE_S) -> None:
        """Stop both axes, and wait until they are at rest, at most `patience`, s."""
        with self.turn:
            for motor, channel in self.axes:
                motor.stop(immediate=True, sync=False, channel=channel)
            for motor, channel in self.axes:
                motor.wait_for_stop(channel=channel, timeout=patience)

    def emergency_stop(self) -> None:
        """Stop without waiting for an answer, even during another thread's long question."""
        held = self.turn.acquire(timeout=EMERGENCY_STOP_WAIT_S)
        try:
            for motor, channel in self.axes:
                with suppress(Exception):  # the other axis must get the command, too
                    motor.stop(immediate=True, sync=False, channel=channel)
        finally:
            if held:
                self.turn.release()

    def close(self) -> None:
        for motor in {id(motor): motor for motor, _ in self.axes}.values():
            with suppress(Exception):
                motor.close()
