"""Solve the samples of a motion together, each from rest, so that blocks can estimate several at a
time."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.knowledge import BeamKnowledge, Knowledge, Prior
from ..core.sensor import Sensor
from ..core.units import Floats
from .solution import Solution, Status
from .solver import solve

#: Ends of an estimate that another start may spare.
LOST = (Status.MAX_STEPS, Status.SINGULAR, Status.STALLED)


def solve_series(
    sensor: Sensor, readings: Floats, knowledge: Knowledge, **options: Any
) -> Solution:
    """The poses of readings (n, 9) that follow each other.  options: of `facets.solve`.

    A reading that is not solved from rest is tried again from the nearest that was. Each pose
    depends on the readings of its series and on no other.
    """
    beam, options = knowledge.beam, {"power": knowledge.power, **options}
    found = solve(sensor, readings, beam=beam, **options)
    if found.converged.all():
        return found
    lost, good = np.flatnonzero(np.isin(found.status, LOST)), np.flatnonzero(found.converged)
    if len(lost) and len(good):
        starts = found.state[nearest(lost, good)]
        part = beam_at(beam, lost)
        put(found, lost, solve(sensor, readings[lost], beam=part, start=starts, **options))
    return found


def nearest(places: NDArray[np.intp], among: NDArray[np.intp]) -> NDArray[np.intp]:
    """The nearest of some ascending numbers to each of others."""
    after = np.clip(np.searchsorted(among, places), 1, len(among) - 1) if len(among) > 1 else 0
    before = np.maximum(after - 1, 0)
    closer = places - among[before] <= among[after] - places
    return among[np.where(closer, before, after)]


def beam_at(beam: BeamKnowledge, which: NDArray[np.intp]) -> BeamKnowledge:
    """The knowledge of the beam at some of the readings."""
    if not isinstance(beam, Prior) or np.ndim(beam.mean) < 2:
        return beam
    return replace(beam, mean=np.asarray(beam.mean)[which])


def put(found: Solution, which: NDArray[np.intp], again: Solution) -> None:
    """Put repeated results in the places of some readings."""
    for field in fields(Solution):
        array = getattr(found, field.name)
        if array is not None:  # covariances may be left out
            array[which] = getattr(again, field.name)
