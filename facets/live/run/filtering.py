"""Poses filtered as they come: the forward half of `smoothing`, for those who cannot wait.

The motion's model is that of `smoothing`, and so is the noise of each sample; an estimate is made
from the samples until then. It is never sooner than the motion: what a mirror does suddenly is
followed after a delay, which is stated. How strongly each axis is shaken is learnt from the first
samples, and learnt again where the innovations are larger than chance has it; until then, and for
as long as they are, there is no filtered pose. The raw poses stay as they are.

A motion of another kind than the learnt one is told when it shows in the innovations. Until then a
filtered pose may be off by a few standard deviations of a raw sample, whatever its own are.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...core.units import Booleans, Floats
from ...estimation.uncertainty_parts import carry_over, propagate
from .smoothing import (
    DOUBT,
    MODELS,
    first_spread,
    motion,
    noise_of_part,
    plan_of,
    strengths,
    transition,
)

if TYPE_CHECKING:
    from ...core.settings import Config

#: Samples from which the strength is learnt.
LEARNT_FROM = 2_000
#: Innovations of so many samples are looked at together.
WATCHED = 100
#: How many of its own standard deviations a mean of innovations may be off by chance.
CHANCE = 6.0
#: Samples over which innovations are averaged, by weights that fade. A filter errs by less than a
#: sample's noise for long before single innovations show it; means over as many samples as the
#: filter remembers do.
SHARES: Floats = 1 / np.array([3.0, 10.0, 30.0, 100.0, 300.0, 1000.0])
WEIGHTS: Floats = SHARES[:, None]
#: Noise whose standard deviations change by less than this is taken for the same.
SAME = 0.02
#: A gain that changes by less than this from sample to sample has settled, as a share.
SETTLED = 1e-7
#: A step of time that is off by less than this is the usual one, as a share.
USUAL = 0.02
#: A step response that is not half way after so many samples is not looked at any longer.
LONGEST = 20_000


@dataclass(frozen=True)
class Filtered:
    """places: (n, d), NaN where there is none.  speeds: (n, d) a second, 0 for model "place".
    variance: (n, d), covariance: (n, d, d), by noise and motion alone."""

    places: Floats
    speeds: Floats
    variance: Floats
    covariance: Floats


class Filter:
    """A Kalman filter of d axes, whose samples come in lots.

    squares: mean normalised square of the newest innovations, 1 where the model holds.  learnt: how
    often the strength was.  doubtful: samples that were given no filtered pose since the
    innovations before them were larger than chance has it.
    """

    def __init__(self, model: str = "acceleration", strength: Floats | None = None) -> None:
        """model: of `smoothing.MODELS`.  strength: (d,) of the white noise, in variances of a
        sample's noise per sample; learnt if it is not given."""
        self.order = MODELS[model]
        self.strength = strength
        self.given = strength is not None
        self.learnt = self.doubtful = 0
        self.period = self.last = np.nan
        self.recent: deque[tuple[float, Floats, Floats]] = deque(maxlen=LEARNT_FROM)
        self.waited = 0
        self.forget()

    def forget(self) -> None:
        """The next sample is the first one."""
        self.begun = self.settled = False
        self.noise = self.newest = np.zeros((0, 0))
        self.innovations: deque[float] = deque()
        self.total = 0.0  # of them
        self.means: Floats = np.zeros((len(SHARES), 1))
        self.moves: dict[float, tuple[Floats, Floats]] = {}

    #: Of the means of SHARES, where innovations are independent and have a variance of one.
    allowed: Floats = CHANCE * np.sqrt(SHARES / (2 - SHARES))[:, None]

    @property
    def squares(self) -> float:
        return self.total / len(self.innovations) if self.innovations else np.nan

    @property
    def largest(self) -> float:
        """The largest mean of innovations, in its own standard deviation."""
        return float((np.abs(self.means) / self.allowed).max() * CHANCE)

    @property
    def is_beyond_chance(self) -> bool:
        """Whether the newest innovations, or their means, are larger than chance has it."""
        if (np.abs(self.means) > self.allowed).any():
            return True
        if len(self.innovations) < WATCHED // 10:
            return False
        spread = (2 / len(self.innovations) / self.width) ** 0.5
        return bool(self.squares > 1 + DOUBT + CHANCE * spread)

    def add(self, time: Floats, poses: Floats, noise: Floats) -> Filtered:
        """A lot of samples.

        time: (n,) s; samples that are not later than all before get no estimate.  poses: (n, d),
        NaN where there is none.  noise: (d, d), covariance of each sample of the lot.
        """
        count, self.width = poses.shape
        shapes = (*[poses.shape] * 3, (count, self.width, self.width))
        found = Filtered(*(np.full(shape, np.nan) for shape in shapes))
        there: Booleans = np.asarray(np.isfinite(poses).all(axis=1) & np.isfinite(noise).all())
        self.recent.extend((float(time[n]), poses[n], noise) for n in np.flatnonzero(there))
        self.waited += int(there.sum())
        if self.can_step():
            for n in range(count):
                if self.begun:
                    self.step(float(time[n]), poses[n], bool(there[n]), noise, found, n)
                elif there[n]:
                    self.begin(float(time[n]), poses[n], noise)
                    self.tell(found, n)
        return found

    def can_step(self) -> bool:
        """Whether the strength and the usual step of time are known; learns what can be learnt."""
        if self.strength is None and len(self.recent) < LEARNT_FROM:
            return False
        if self.strength is None or (self.is_beyond_chance and self.waited > LEARNT_FROM):
            self.learn()
            return False
        if np.isfinite(self.period):
            return True
        if len(self.recent) < 3:
            return False
        self.period = usual_step(np.array([row[0] for row in self.recent]))
        return True

    def learn(self) -> None:
        """The likeliest strength of the samples that came last; begins anew with it."""
        time = np.array([row[0] for row in self.recent])
        order = np.argsort(time, kind="stable")
        poses = np.array([row[1] for row in self.recent])[order]
        noise = np.array([row[2] for row in self.recent])[order]
        self.period = usual_step(time[order])
        self.waited = 0
        self.forget()
        if self.given:
            return
        units = np.sqrt(np.median(np.diagonal(noise, axis1=1, axis2=2), axis=0))
        steps = np.diff(time[order], prepend=time[order][0]) / self.period
        there = np.ones(len(poses), bool)
        self.strength = strengths(
            steps, poses / units, noise / np.outer(units, units), there, self.order
        )
        self.units = units
        self.learnt += 1

    def begin(self, time: float, pose: Floats, noise: Floats) -> None:
        """From the first sample, of which nothing but its place is known."""
        if self.given:
            self.units = np.sqrt(noise.diagonal())
        size = self.order * self.width
        self.places = slice(0, None, self.order)
        assert self.strength is not None
        self.shaken: Floats = np.kron(
            np.diag(self.strength), np.ones((self.order, self.order))
        ).astype(np.float64)
        self.mean, self.spread = np.zeros(size), np.zeros((size, size))
        self.mean[self.places] = pose / self.units
        self.take_noise(noise)
        seen = np.array([row[1] for row in self.recent]) / self.units
        wide = first_spread(seen, np.ones(len(seen), bool)) if len(seen) > 1 else np.ones(size)
        for n in range(self.order):
            place = range(n, size, self.order)
            self.spread[place, place] = wide
        self.last, self.begun = time, True
        self.speeds = self.units / self.period
        self.means = np.zeros((len(SHARES), self.width))
        self.update(np.eye(size), np.zeros((size, size)), True)

    def take_noise(self, noise: Floats) -> None:
        """Of the samples that come; where it has hardly changed, that of those before."""
        scaled = noise / np.outer(self.units, self.units)
        if self.noise.shape == scaled.shape:
            ratio = np.sqrt(scaled.diagonal() / self.noise.diagonal())
            if np.abs(ratio - 1).max() < SAME:
                return
        self.noise, self.settled = scaled, False

    def step(
        self, time: float, pose: Floats, there: bool, noise: Floats, found: Filtered, n: int
    ) -> None:
        """A sample after the first: what was expected of it, and what it changes."""
        passed = (time - self.last) / self.period
        if not passed > 0:
            return
        self.last = time
        steady = abs(passed - 1) < USUAL and there
        move, shake = motion(
            self.moves, float(round(passed, 6)), self.order, self.width, self.shaken
        )
        self.mean = move @ self.mean
        if there and noise is not self.newest:
            self.newest = noise
            self.take_noise(noise)
        if not (self.settled and steady):
            self.settled = self.update(move, shake, there) and steady
        if there:
            apart = pose / self.units - self.mean[self.places]
            white = self.whiten @ apart
            self.remember(float(white @ white) / self.width)
            self.means += WEIGHTS * (white - self.means)
            self.mean = self.mean + self.gain @ apart
        if self.is_beyond_chance:
            self.doubtful += 1
        else:
            self.tell(found, n)

    def remember(self, square: float) -> None:
        """The newest mean square of an innovation's components, in place of the oldest."""
        self.innovations.append(square)
        self.total += square
        if len(self.innovations) > WATCHED:
            self.total -= self.innovations.popleft()

    def tell(self, found: Filtered, n: int) -> None:
        """What is known of the newest sample, in the unit of the poses."""
        found.places[n] = self.mean[self.places] * self.units
        found.speeds[n] = self.mean[1 :: self.order] * self.speeds if self.order > 1 else 0.0
        found.variance[n], found.covariance[n] = self.variance, self.covariance

    def update(self, move: Floats, shake: Floats, there: bool) -> bool:
        """The covariance and the gain of the next sample; whether they are as of the last one."""
        before = self.spread
        spread = move @ before @ move.T + shake
        if there:
            total = spread[self.places, self.places] + self.noise
            gain = spread[:, self.places] @ np.linalg.inv(total)
            self.whiten = np.linalg.inv(np.linalg.cholesky(total))
            kept = np.eye(len(spread))
            kept[:, self.places] -= gain
            self.gain = gain
            spread = kept @ spread @ kept.T + gain @ self.noise @ gain.T
        self.spread = spread
        self.variance = spread.diagonal()[self.places] * self.units**2
        self.covariance = spread[self.places, self.places] * np.outer(self.units, self.units)
        change = np.abs(spread - before).diagonal()
        return bool((change <= SETTLED * before.diagonal()).all())

    def delays(self) -> tuple[float, float]:
        """How late the filter is, s: in a steady motion of one axis (for "place" only; the other
        models have no delay then), and at the half of its sudden step; of the slowest axis."""
        if not (self.begun and hasattr(self, "gain")):
            return np.nan, np.nan
        size, places = len(self.mean), self.places
        move = np.kron(np.eye(self.width), transition(self.order, 1.0))
        kept = np.eye(size)
        kept[:, places] -= self.gain
        state: Floats = np.zeros((size, self.width))
        steady = 0.0
        if self.order == 1:  # the mean of what is still to come of a step
            steady = float((np.linalg.inv(self.gain).diagonal() - 1).max() * self.period)
        for n in range(LONGEST):
            state = kept @ move @ state + self.gain
            if state[places].diagonal().min() >= 0.5:
                return steady, n * self.period
        return steady, LONGEST * self.period

    def sentence(self) -> str:
        """How late it is, and what the innovations say."""
        if not self.begun:
            return "the filter has not estimated the mirror's motion yet"
        steady, sudden = self.delays()
        text = f"the filter follows half of a sudden step after {1e3 * sudden:.3g} ms"
        text += f", a steady motion {1e3 * steady:.3g} ms late" if self.order == 1 else ""
        if self.is_beyond_chance:
            text += (
                "; its innovations are larger than expected (mean normalised square "
                f"{self.squares:.3g}, largest mean {self.largest:.2g} of its standard deviation): "
                "the mirror moves differently than before, and no filtered poses are given"
            )
        return text


def usual_step(time: Floats) -> float:
    """The median step of times (n,), s."""
    return float(np.median(np.diff(np.sort(time))))


class FilteredPoses(NamedTuple):
    """Poses (n, 6), their standard uncertainties (n, 6) and covariances (n, 6, 6) or None; mm,
    rad."""

    poses: Floats
    uncertainty: Floats
    covariance: Floats | None


class PoseFilter:
    """The filter of a sensor's six axes; its uncertainty holds what no filter takes away.

    That is what is the same in all samples (the beam, the laser's power, the calibration) and, by
    the speed that the mirror has, what the electronics' bandwidth holds back.
    """

    def __init__(
        self,
        config: Config,
        model: str = "acceleration",
        carried: bool = False,
        covariance: bool = False,
    ) -> None:
        """carried: whether a stage carries the beam.  covariance: whether filtered poses have
        covariances."""
        self.config, self.carried, self.with_covariance = config, carried, covariance
        self.filter = Filter(model)
        electronics = config.sensor.electronics
        #: How late the electronics are, s.
        self.late = 0.0 if electronics is None else 1 / (2 * np.pi * electronics.bandwidth)

    def add(
        self, time: Floats, states: Floats, uncertainty: Floats, used: Booleans
    ) -> FilteredPoses:
        """The filtered poses of samples.

        time: (n,) s.  states: (n, 8), NaN where there is none.  uncertainty: (n, 8).  used: (n, 3),
        the detectors that a pose is from.
        """
        good = np.flatnonzero(np.isfinite(states).all(axis=1) & used.any(axis=1))
        noise, common = np.full((6, 6), np.nan), np.full(6, np.nan)
        middle = slice(0, 0)
        if len(good):
            first = good[len(good) // 2]
            middle = slice(first, first + 1)
            noise = noise_of_part(self.config, states[middle], used[middle], self.carried)[0]
            common = np.maximum(uncertainty[first, :6] ** 2 - noise.diagonal(), 0.0)
        found = self.filter.add(time, states[:, :6], noise)
        held_back = np.nan_to_num(found.speeds) * self.late
        sigma = np.sqrt(found.variance + common + held_back**2)
        covariance = None
        if self.with_covariance:
            alike = np.full((6, 6), np.nan)
            if len(good):
                alike = self.correlation_of_common(states[middle], used[middle])
            covariance = found.covariance + alike * np.sqrt(np.outer(common, common))
            covariance += held_back[:, :, None] * held_back[:, None, :]
        return FilteredPoses(found.places, sigma, covariance)

    def correlation_of_common(self, state: Floats, used: Booleans) -> Floats:
        """Correlations (6, 6) of what is the same in all samples, at a state (1, 8)."""
        sensor, plan = self.config.sensor, plan_of(self.config, self.carried)
        found = propagate(sensor, sensor.calibration, state, used, plan.free, plan.weights)
        common = found.statistical - found.noise
        if sensor.calibration is not None:
            common += carry_over(sensor.calibration, found.slopes)
        sizes = np.sqrt(np.maximum(common[0, :6, :6].diagonal(), np.finfo(float).tiny))
        return np.asarray(common[0, :6, :6] / np.outer(sizes, sizes))
