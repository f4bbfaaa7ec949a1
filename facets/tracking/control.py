"""How the beam follows the mirror: laws, their limits and their stability. One for all commands.

Eq. (14) of the paper makes an index of the three powers that is zero where the beam meets the apex
of an untilted mirror; proportional control takes it away bit by bit. `pi` adds an integral, so that
a mirror in steady motion is met without a lag. `feedforward` aims where the solved apex will be
when the stage gets there: exact where Eq. (14) is not, and without a loop to become unstable.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi, sin, sqrt

import numpy as np

from ..core.sensor import Sensor
from ..core.settings import Stage as Settings
from ..core.units import Floats
from ..model.arrays import readings
from .limits import Limits


@dataclass(frozen=True)
class Seen:
    """What a command is made from.

    time: of the sample, now: of the command, s.  powers: (3,) mW.  apex: (2,) solved, mm, or None.
    beam: (2,) where the stage says that the beam is, mm.
    """

    time: float
    now: float
    powers: Floats
    apex: Floats | None
    beam: Floats


def tracking_error(powers: Floats) -> Floats:
    """chi_x, chi_y of Eq. (14): (..., 3) powers -> (..., 2), where the beam is off."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = powers / powers.sum(axis=-1, keepdims=True)
    x = share[..., 0] - (share[..., 1] + share[..., 2]) / 2
    y = (share[..., 1] - share[..., 2]) * sqrt(3) / 2
    return np.stack([x, y], axis=-1)


def slope_of_error(sensor: Sensor) -> Floats:
    """How Eq. (14) answers to the beam's place at rest: (2, 2), 1/mm."""
    step = 1e-5
    columns = []
    for axis in range(2):
        ends = np.zeros((2, 8))
        ends[:, 6 + axis] = step, -step
        ahead, behind = tracking_error(readings(sensor, ends)[:, 2::3])
        columns.append((ahead - behind) / (2 * step))
    return np.stack(columns, axis=-1)


@dataclass
class Law:
    """Where the beam is to go next. Kept within speed, step and soft limits.

    inverse: of `slope_of_error`, mm.  power: of the beam, mW.  clearance: further off than this,
    mm, the beam does not light all three facets.  goal: the last command.  summed: of the errors.
    limited: how often a limit held one back.
    """

    settings: Settings
    inverse: Floats
    power: float
    clearance: float
    goal: Floats | None = None
    summed: Floats = field(default_factory=lambda: np.zeros(2))
    limited: int = 0
    last: tuple[float, Floats] | None = None
    speed: Floats = field(default_factory=lambda: np.zeros(2))

    @classmethod
    def from_sensor(cls, sensor: Sensor, settings: Settings) -> Law:
        beam = sensor.beam
        inverse = np.asarray(np.linalg.inv(slope_of_error(sensor)))
        return cls(settings, inverse, beam.power, max(beam.diameter_x, beam.diameter_y))

    def command(self, seen: Seen) -> Floats:
        """The next place of the beam (2,), mm."""
        s = self.settings
        if seen.apex is not None:
            self.observe(seen.time, seen.apex)
        if s.law == "feedforward":
            assert seen.apex is not None
            target = self.ahead(seen.now)
        else:
            off = self.inverse @ tracking_error(seen.powers)
            integral = s.integral if s.law == "pi" else 0.0
            goal = seen.beam if self.goal is None else self.goal
            target = goal - s.gain * off - integral * (self.summed + off)
            self.goal = self.hold(target, seen.beam)
            if np.allclose(self.goal, target, rtol=0, atol=1e-9):  # else the sum would only grow
                self.summed = self.summed + off
            return self.goal
        return self.hold(target, seen.beam)

    def locate_apex(self, powers: Floats, beam: Floats, lit: float) -> Floats | None:
        """Where Eq. (14) says that the apex is (2,), mm, however far: its direction is right also
        where a facet is dark, and it never shows more than there is. beam: where the beam was then.
        A power that is infinite, of a saturated detector, is what the others leave of the beam's.
        None where there is less light than a share `lit` of the beam's."""
        full = np.isposinf(powers)
        light = np.maximum(np.where(full, 0.0, powers), 0.0)
        if full.any():
            light[full] = max(light.max(), (self.power - light.sum()) / full.sum())
        if not np.isfinite(light).all() or light.sum() < lit * self.power:
            return None
        place: Floats = beam - self.inverse @ tracking_error(light)
        return place

    def observe(self, time: float, apex: Floats) -> None:
        """Takes the mirror's speed from its places at one time after the other, s."""
        if self.last is not None and time > self.last[0]:
            passed = time - self.last[0]
            share = min(1.0, passed / SPEED_AVERAGING_S)
            self.speed += share * ((apex - self.last[1]) / passed - self.speed)
            most = self.settings.max_speed  # of a faster one the sample is in doubt, or it is lost
            self.speed = np.clip(self.speed, -most, most)
        self.last = time, apex.copy()

    def ahead(self, now: float) -> Floats:
        """Where the apex will be when the stage has answered to a command at a time, s."""
        assert self.last is not None
        time, apex = self.last
        s = self.settings  # the command holds for a period, so on average half of one longer
        horizon = now - time + s.latency + s.lag + 0.5 / s.rate
        place: Floats = apex + horizon * self.speed
        return place

    def hold(self, target: Floats, beam: Floats) -> Floats:
        """A command within step, speed and soft limits."""
        held = Limits.from_settings(self.settings).hold(target, beam)
        self.limited += not np.allclose(held, target, rtol=0, atol=1e-12)
        return held

    def forget(self) -> None:
        """After a loss: what was summed up no longer holds, nor the motion that was seen."""
        self.goal, self.summed = None, np.zeros(2)
        self.last, self.speed = None, np.zeros(2)


#: Time constant of the mean of the mirror's speed, s.
SPEED_AVERAGING_S = 0.02


@dataclass(frozen=True)
class Margin:
    """What is known of a loop before it starts.

    delay: from light to half the stage's answer, s.  most: largest gain that is stable.
    times: by how much the gain can grow.  speed: of the mirror, mm/s, at which the beam is lost.
    """

    delay: float
    most: float
    times: float
    speed: float

    @property
    def words(self) -> str:
        loop = (
            "no loop to become unstable"
            if self.times == float("inf")
            else (f"stable with a margin of {self.times:.2g} in gain")
        )
        return (
            f"{loop}; {1e3 * self.delay:.3g} ms of delay; the beam is lost above "
            f"{self.speed:.3g} mm/s"
        )


def pull_of(sensor: Sensor, clearance: float) -> float:
    """The largest offset that Eq. (14) shows, mm, while the true one is within `clearance` in x.

    It shows less and less of a larger one, since no share can be more than all.
    """
    states = np.zeros((200, 8))
    states[:, 6] = np.linspace(-clearance, clearance, 200)
    shown = tracking_error(readings(sensor, states)[:, 2::3]) @ np.linalg.inv(
        slope_of_error(sensor)
    )
    lengths: Floats = np.hypot(*shown.T)
    return float(min(lengths[:100].max(), lengths[100:].max()))


def margin_of(settings: Settings, pull: float) -> Margin:
    """pull: see `pull_of`, mm.

    The loop is an integrator with a delay of d commands: error(n+1) = error(n) - g error(n-d). It
    is stable for g < 2 sin(pi / (4 d + 2)). A mirror at speed v is met late by v / (g rate) under
    proportional control; under the others by little, until the stage's greatest speed.
    """
    delay = settings.latency + settings.lag
    commands = delay * settings.rate
    most = 2 * sin(pi / (4 * commands + 2))
    gain = settings.gain + (settings.integral if settings.law == "pi" else 0.0)
    if settings.law == "feedforward":
        return Margin(delay, float("inf"), float("inf"), settings.max_speed)
    behind = 1 / (settings.gain * settings.rate)
    speed = min(settings.max_speed, pull / behind)
    if settings.law == "pi" and settings.integral > 0:
        speed = settings.max_speed
    return Margin(delay, most, most / gain, speed)
