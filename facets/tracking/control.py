"""Control laws by which the beam follows the mirror, their limits and their stability.

Eq. (14) of the paper makes an index of the three powers that is zero if the beam meets the apex of
an untilted mirror; proportional control reduces it step by step. `pi` adds an integral, which
removes the lag behind a mirror in steady motion. `feedforward` aims at the predicted place of the
solved apex: it is exact where Eq. (14) is not, and has no feedback that could be unstable.
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
class ControlInput:
    """The input of a control law.

    time: of the sample, now: of the command, s.  powers: (3,) mW.  apex: (2,) solved, mm, or None.
    beam: (2,) the beam's place by the stage, mm.
    """

    time: float
    now: float
    powers: Floats
    apex: Floats | None
    beam: Floats


def tracking_error(powers: Floats) -> Floats:
    """chi_x, chi_y of Eq. (14), (..., 2), from powers (..., 3): a measure of the offset."""
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = powers / powers.sum(axis=-1, keepdims=True)
    x = fraction[..., 0] - (fraction[..., 1] + fraction[..., 2]) / 2
    y = (fraction[..., 1] - fraction[..., 2]) * sqrt(3) / 2
    return np.stack([x, y], axis=-1)


def slope_of_error(sensor: Sensor) -> Floats:
    """Derivative of Eq. (14) by the beam's place at rest: (2, 2), 1/mm."""
    step = 1e-5
    columns = []
    for axis in range(2):
        ends = np.zeros((2, 8))
        ends[:, 6 + axis] = step, -step
        plus, minus = tracking_error(readings(sensor, ends)[:, 2::3])
        columns.append((plus - minus) / (2 * step))
    return np.stack(columns, axis=-1)


@dataclass
class Law:
    """The control law that computes the beam's next place, within speed, step and soft limits.

    inverse: of `slope_of_error`, mm.  power: of the beam, mW.  clearance: largest distance from the
    apex, mm, at which the beam can light all three facets.  goal: the last command.  summed: sum of
    the errors.
    """

    settings: Settings
    inverse: Floats
    power: float
    clearance: float
    goal: Floats | None = None
    summed: Floats = field(default_factory=lambda: np.zeros(2))
    last: tuple[float, Floats] | None = None
    speed: Floats = field(default_factory=lambda: np.zeros(2))

    @classmethod
    def from_sensor(cls, sensor: Sensor, settings: Settings) -> Law:
        """The control law for a sensor and the settings of its stage."""
        beam = sensor.beam
        inverse = np.asarray(np.linalg.inv(slope_of_error(sensor)))
        return cls(settings, inverse, beam.power, max(beam.diameter_x, beam.diameter_y))

    def command(self, measured: ControlInput) -> Floats:
        """The next place of the beam (2,), mm."""
        s = self.settings
        if measured.apex is not None:
            self.observe(measured.time, measured.apex)
        if s.law == "feedforward":
            assert measured.apex is not None
            target = self.predict_apex(measured.now)
        else:
            off = self.inverse @ tracking_error(measured.powers)
            integral = s.integral if s.law == "pi" else 0.0
            goal = measured.beam if self.goal is None else self.goal
            target = goal - s.gain * off - integral * (self.summed + off)
            self.goal = self.limit(target, measured.beam)
            if np.allclose(self.goal, target, rtol=0, atol=1e-9):  # else the sum would only grow
                self.summed = self.summed + off
            return self.goal
        return self.limit(target, measured.beam)

    def locate_apex(self, powers: Floats, beam: Floats, lit: float) -> Floats | None:
        """Return the place of the apex by Eq. (14) (2,), mm.

        The direction is right even if a facet is dark, and the distance is never too large. The
        infinite power of a saturated detector is replaced by the rest of the beam's power. Returns
        None if the light is less than the fraction `lit` of the beam's power.  beam: its place, mm.
        """
        full = np.isposinf(powers)
        light = np.maximum(np.where(full, 0.0, powers), 0.0)
        if full.any():
            light[full] = max(light.max(), (self.power - light.sum()) / full.sum())
        if not np.isfinite(light).all() or light.sum() < lit * self.power:
            return None
        place: Floats = beam - self.inverse @ tracking_error(light)
        return place

    def observe(self, time: float, apex: Floats) -> None:
        """Update the mirror's speed (2,), mm/s, from its place (2,), mm, at a time, s."""
        if self.last is not None and time > self.last[0]:
            passed = time - self.last[0]
            weight = min(1.0, passed / SPEED_AVERAGING_S)
            self.speed += weight * ((apex - self.last[1]) / passed - self.speed)
            most = self.settings.max_speed  # a higher speed means a doubtful sample or a loss
            self.speed = np.clip(self.speed, -most, most)
        self.last = time, apex.copy()

    def predict_apex(self, now: float) -> Floats:
        """The predicted place (2,) of the apex, mm, when the stage has executed a command of a
        time, s."""
        assert self.last is not None
        time, apex = self.last
        s = self.settings  # a command lasts for one period, on average half of one more
        horizon = now - time + s.latency + s.lag + 0.5 / s.rate
        place: Floats = apex + horizon * self.speed
        return place

    def limit(self, target: Floats, beam: Floats) -> Floats:
        """Limit a command to a place (2,), mm, by step, speed and soft limits. beam: the beam's
        place (2,)."""
        return Limits.from_settings(self.settings).hold(target, beam)

    def forget(self) -> None:
        """Reset the sum of errors and the motion after a loss of the mirror."""
        self.goal, self.summed = None, np.zeros(2)
        self.last, self.speed = None, np.zeros(2)


#: Time constant of the average of the mirror's speed, s.
SPEED_AVERAGING_S = 0.02


@dataclass(frozen=True)
class Margin:
    """The stability of a loop before its start.

    delay: from light to half the stage's response, s.  most: largest stable gain.  times: largest
    stable gain over the gain.  speed: of the mirror, mm/s, at which the beam is lost.
    """

    delay: float
    most: float
    times: float
    speed: float

    @property
    def words(self) -> str:
        """The margin in words: gain, delay and the largest speed of the mirror."""
        loop = (
            "no loop to become unstable"
            if self.times == float("inf")
            else (f"stable with a margin of {self.times:.2g} in gain")
        )
        return (
            f"{loop}; {1e3 * self.delay:.3g} ms of delay; the beam is lost above "
            f"{self.speed:.3g} mm/s"
        )


def capture_range(sensor: Sensor, clearance: float) -> float:
    """The largest offset by Eq. (14), mm, for true offsets within `clearance` in x.

    Eq. (14) saturates with a growing offset, since no fraction of the power exceeds one.
    """
    states = np.zeros((200, 8))
    states[:, 6] = np.linspace(-clearance, clearance, 200)
    shown = tracking_error(readings(sensor, states)[:, 2::3]) @ np.linalg.inv(
        slope_of_error(sensor)
    )
    lengths: Floats = np.hypot(*shown.T)
    return float(min(lengths[:100].max(), lengths[100:].max()))


def margin_of(settings: Settings, pull: float) -> Margin:
    """The stability of a loop.  pull: the offset of `capture_range`, mm.

    The loop is an integrator with a delay of d commands: error(n+1) = error(n) - g error(n-d). It
    is stable for g < 2 sin(pi / (4 d + 2)). Proportional control lags behind a mirror at speed v by
    v / (g rate); the other laws lag little up to the stage's largest speed.
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
