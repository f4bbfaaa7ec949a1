"""Whether a stage goes where it is sent, by its own word and by the readings.

A stage that answers every command may still not move, move elsewhere, or be moved by somebody else.
Within `settling_time` it must be near the places it was sent to since, or on its way there; where
it is outside the box of these places and of where it came from, it is not on its way. A second
witness is the light: the place of the beam that the readings tell must move as the encoder does.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from ..core.settings import Stage as Settings
from ..core.units import Floats
from .encoder import Encoder
from .limits import Limits

#: A position of the stage that is older than this is no start of a prediction, s.
MAX_PLACE_AGE_S = 0.03
#: A stage that is nearer than this to its goal is at rest, mm.
REST_DISTANCE_MM = 1e-4
#: Maximum distance of a stage that works well from where it should stand, mm.
POSITION_SLACK_MM = 0.05
#: A stage is given so much longer than it needs, s: its place may be told late.
SPARE_S = 0.1
#: How far the beam that the readings show may part from the encoder, mm, and for a moving stage the
#: time by which the two may be apart, s.
BEAM_SLACK_MM, BEAM_TIMING_S = 0.1, 0.02


def settling_time(settings: Settings) -> float:
    """How long after a command a stage can move at most, s, where nothing is wrong with it.

    Its move begins after the latency, has `reach` to go at the largest speed, from where the stage
    was up to MAX_PLACE_AGE_S ago, and ends by the stage's lag and acceleration.
    """
    s = settings
    reach = Limits.from_settings(s).reach
    settling = (
        s.lag * math.log(max(reach / REST_DISTANCE_MM, 1.0)) + 2 * s.max_speed / s.acceleration
    )
    return s.latency + MAX_PLACE_AGE_S + reach / s.max_speed + settling


def distance_to_box(place: Floats, corners: Floats) -> float:
    """From a place (2,) to the smallest box that holds places (n, 2)."""
    outside = np.maximum(corners.min(axis=0) - place, place - corners.max(axis=0))
    return float(np.hypot(*np.maximum(outside, 0.0)))


class Arrival:
    """patience: within which a command must have been executed, s."""

    def __init__(self, settings: Settings) -> None:
        self.patience = settling_time(settings) + SPARE_S
        self.slack = POSITION_SLACK_MM + settings.step
        self.goals: deque[tuple[float, Floats]] = deque()
        self.places: deque[tuple[float, Floats]] = deque()
        self.offset: Floats | None = None
        self.apart = math.inf

    def begin(self, place: Floats) -> None:
        """From now on the stage is at a place, and is sent elsewhere by `send` alone."""
        self.goals = deque([(-math.inf, place)])
        self.places = deque([(-math.inf, place)])
        self.offset, self.apart = None, math.inf

    def send(self, place: Floats, now: float) -> None:
        """The stage has accepted a command."""
        self.goals.append((now, place))

    def complaint(self, now: float, place: Floats) -> str:
        """What is wrong with a stage that is now at a place (2,), or nothing."""
        self.places.append((now, place))
        for kept in (self.goals, self.places):  # the first is what held when the time began
            while len(kept) > 1 and kept[1][0] <= now - self.patience:
                kept.popleft()
        start, goals = self.places[0][1], np.array([goal for _, goal in self.goals])
        short = distance_to_box(place, goals)
        if short <= self.slack:
            return ""
        if distance_to_box(place, np.vstack([goals, start])) > self.slack:
            what = "was not sent there" if len(goals) > 1 else "was not sent anywhere"
            return (
                f"the stage is at {words(place)} mm and {what}: check whether it moves the wrong "
                "way or too far, or whether another program moves it"
            )
        commanded = distance_to_box(start, goals)
        if short <= commanded / 2:
            return ""
        return (
            f"the stage accepted a move of {commanded:.3f} mm and has moved "
            f"{max(commanded - short, 0.0):.3f} mm of it in {self.patience:.2f} s: check whether "
            "another program stopped it"
        )

    def compare(self, now: float, beam: Floats, encoder: Encoder, time: float) -> str:
        """What is wrong where the readings of a time place the beam at (2,) mm, or nothing."""
        there = encoder.places(np.array([time]))[0]
        if self.offset is None:
            self.offset = beam - there
        parted = beam - there - self.offset
        most = BEAM_SLACK_MM + BEAM_TIMING_S * float(np.hypot(*encoder.speed))
        if np.hypot(*parted) <= most:
            self.apart = math.inf
            return ""
        self.apart = min(self.apart, now)
        if now - self.apart < self.patience:
            return ""
        return (
            f"the encoder disagrees with the readings: the beam is {words(parted)} mm from where "
            "the stage says"
        )


def words(place: Floats) -> str:
    """A place as text, to a micrometre."""
    return "({:.3f}, {:.3f})".format(*place)
