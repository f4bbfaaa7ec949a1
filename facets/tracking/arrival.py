"""Detect a stage that does not go where it is sent, from its encoders and from the readings.

A stage that answers every command may still not move, move elsewhere, or be moved by another
program. Within `settling_time` it must be near the places to which it was sent since, or on its way
there, that is inside the box of these places and its start. The second check is the light: the
beam's place from the readings must move as the encoder does.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from ..core.settings import Stage as Settings
from ..core.units import Floats
from .encoder import Encoder
from .limits import Limits

#: A prediction does not start from a position of the stage that is older than this, s.
MAX_PLACE_AGE_S = 0.03
#: A stage that is nearer than this to its goal is at rest, mm.
REST_DISTANCE_MM = 1e-4
#: Largest distance of a sound stage from its expected place, mm.
POSITION_SLACK_MM = 0.05
#: Time that a stage may need beyond its settling time, s: its position may arrive late.
SPARE_S = 0.1
#: Largest difference between the motions of the beam by the readings and by the encoder, mm, and
#: for a moving stage the largest difference of their times, s.
BEAM_SLACK_MM, BEAM_TIMING_S = 0.1, 0.02


def settling_time(settings: Settings) -> float:
    """The longest time after a command for which a sound stage moves, s.

    The move begins after the latency, covers `reach` at the largest speed from the stage's place up
    to MAX_PLACE_AGE_S ago, and ends by the stage's lag and acceleration.
    """
    s = settings
    reach = Limits.from_settings(s).reach
    settling = (
        s.lag * math.log(max(reach / REST_DISTANCE_MM, 1.0)) + 2 * s.max_speed / s.acceleration
    )
    return s.latency + MAX_PLACE_AGE_S + reach / s.max_speed + settling


def excursion(settings: Settings) -> float:
    """The largest distance that a disobedient controller moves before it is at rest, mm.

    It moves by `POSITION_SLACK_MM` unnoticed, then at the largest speed until the loop has asked
    for its position, received the answer and sent a stop; then it brakes. Keep this distance
    between the soft limits and anything hard.
    """
    s = settings
    noticed = 1 / s.rate + 2 * MAX_PLACE_AGE_S + s.latency
    return POSITION_SLACK_MM + s.step + s.max_speed * (noticed + s.max_speed / (2 * s.acceleration))


def distance_to_box(place: Floats, corners: Floats) -> float:
    """Distance of a place (2,) from the smallest box that holds places (n, 2)."""
    outside = np.maximum(corners.min(axis=0) - place, place - corners.max(axis=0))
    return float(np.hypot(*np.maximum(outside, 0.0)))


class Arrival:
    """The check that a stage arrives.  patience: time within which it must execute a command, s."""

    def __init__(self, settings: Settings) -> None:
        self.patience = settling_time(settings) + SPARE_S
        self.slack = POSITION_SLACK_MM + settings.step
        self.goals: deque[tuple[float, Floats]] = deque()
        self.places: deque[tuple[float, Floats]] = deque()
        self.offset: Floats | None = None
        self.apart = math.inf

    def begin(self, place: Floats) -> None:
        """Start with a stage at a place (2,), mm; from now on only `send` moves it."""
        self.goals = deque([(-math.inf, place)])
        self.places = deque([(-math.inf, place)])
        self.offset, self.apart = None, math.inf

    def send(self, place: Floats, now: float) -> None:
        """Note a command, to a place (2,), mm, that the stage has accepted at a time, s."""
        self.goals.append((now, place))

    def complaint(self, now: float, place: Floats) -> str:
        """The fault of a stage that is now at a place (2,); empty if there is none."""
        self.places.append((now, place))
        for entries in (self.goals, self.places):  # the first entry was valid when the time began
            while len(entries) > 1 and entries[1][0] <= now - self.patience:
                entries.popleft()
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
        """The fault if the readings at a time place the beam at (2,) mm; empty if there is none."""
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
    """Format a place (2,), mm, to a micrometre."""
    return "({:.3f}, {:.3f})".format(*place)
