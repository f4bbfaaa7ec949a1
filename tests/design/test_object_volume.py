"""Layouts for an object: volume, limits and uncertainties are those of its displacement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import facets
from facets import design
from facets.core import FINE_UNITS
from facets.design import (
    MEASURES,
    HeadSettings,
    designs,
    measure_design,
    measure_designs,
    mirror_states,
    optimize,
    sensor_of,
    simulate_heads,
    space_of,
    states_of,
)

CONFIG = facets.load("layout")
TIP = facets.MeasuredObject((0.0, 0.0, 20.0), (0.0, 0.0, 0.5))
LAYOUT = replace(CONFIG.layout, object=TIP, starts=1)


def states_by_quaternions(states: np.ndarray) -> np.ndarray:
    """Mirror states at displacements of the tip."""
    own, turn = (Rotation.from_euler("xyz", a) for a in (TIP.orientation, states[:, 3:6]))
    mirror = own * turn * own.inv()
    place = np.array(TIP.point) + own.apply(states[:, :3]) - mirror.apply(TIP.point)
    return np.hstack([place, mirror.as_euler("xyz"), states[:, 6:]])


def fine(sensor, states) -> np.ndarray:
    """Uncertainties of the tip's displacement, um and urad, by the inverse of the whole
    information and differences of the motion."""
    step, found = 1e-5, []
    for state in states:
        sigma = facets.standard_deviations(sensor, facets.readings(sensor, state))
        rows = facets.jacobian(sensor, state) / sigma[:, None]
        covariance = np.linalg.pinv(rows.T @ rows, rcond=1e-18)[:6, :6]
        ends = [
            facets.transform(state[:6] + s * step * np.eye(6), TIP, np.zeros(6)).pose
            for s in (1, -1)
        ]
        slopes = (ends[0] - ends[1]).T / (2 * step)
        found.append(np.sqrt(np.diag(slopes @ covariance @ slopes.T)))
    return np.array(found) / FINE_UNITS[:6]


def test_the_optimum_is_that_of_the_object():
    optimum = optimize(CONFIG.sensor, LAYOUT)
    assert optimum.best.found
    volume = states_by_quaternions(np.array(states_of(LAYOUT, 1.0)))

    sensor = sensor_of(optimum.sensor, optimum.names, optimum.best.x)
    sizes = fine(sensor, volume)
    largest = (sizes / np.array(LAYOUT.unit)).max()
    assert np.sqrt(optimum.best.objective) == pytest.approx(largest, rel=1e-3)
    assert facets.margins(sensor, volume)[:, :, :4].min() > -1e-6
    table = design.results.verification.compare(CONFIG.sensor, sensor, LAYOUT, CONFIG.range, seed=1)
    rows = dict(zip(table["quantity"].tolist(), table["after"].tolist(), strict=True))
    stated = [rows[f"u_{n}"] for n in ("tz_um", "roll_urad", "yaw_urad")]
    np.testing.assert_allclose(stated, sizes.max(axis=0)[[2, 3, 5]], rtol=1e-3)
    np.testing.assert_allclose(table["simulated"][:6], table["after"][:6], rtol=0.05)


def test_a_beam_that_follows_keeps_its_place_on_the_mirror():
    states = np.array(states_of(LAYOUT, 1.0))
    assert mirror_states(states, None, False) is states
    following = mirror_states(states, TIP, True)
    np.testing.assert_allclose(following[:, 6:] - following[:, :2], states[:, 6:] - states[:, :2])


def test_errors_of_heads_are_those_of_the_object():
    """A head whose detectors stand elsewhere than is thought shifts the tip by its turn, too."""
    layout = replace(LAYOUT, accuracy=(5.0,) * 6, calibrated=False)
    loose = replace(CONFIG.calibrate, before={"psd_place_mm": 0.01}, power_per_sample=False)
    built = HeadSettings(layout, CONFIG.range, loose).assembly_of(CONFIG.sensor)
    heads = simulate_heads(built, 1, 3)
    head = built.head(np.random.default_rng(3).normal(size=len(built.choice.names)) * built.varies)
    states = states_by_quaternions(built.requirement.states)
    solved = facets.solve(
        CONFIG.sensor, facets.readings(head, states), start=states, accept_unchecked=True
    )
    poses = facets.transform(solved, TIP).pose
    right = facets.transform(states, TIP).pose
    own = Rotation.from_euler("xyz", TIP.orientation)  # displacements are in the tip's axes
    shifts = own.inv().apply((poses - right)[:, :3]) * 1e3
    largest = np.abs(shifts - shifts[-1]).max(axis=0)  # the last state is at rest
    np.testing.assert_allclose(heads.errors[0, 0, :3], largest, rtol=1e-6)


def test_measures_of_designs_are_those_of_the_object():
    settings = replace(CONFIG, object=TIP, layout=LAYOUT)
    objectives = ("head_mm", "u_pitch_urad", "range_pitch_mrad")
    space = space_of(settings, objectives, 8, 1)
    rows = designs(space)
    why, many = measure_designs(space, rows)
    good = np.flatnonzero(why == 0)[0]
    _, values = measure_design(space, rows[good])
    np.testing.assert_allclose(many[good], values, rtol=1e-3)
    sensor = sensor_of(CONFIG.sensor, space.names, rows[good])
    np.testing.assert_allclose(values[7:13], fine(sensor, np.zeros((1, 8)))[0], rtol=1e-4)
    ends = facets.axis_ranges(sensor, replace(CONFIG.range, object=TIP), np.zeros(6))
    pitch = values[MEASURES.index("range_pitch_mrad")]
    assert pitch == pytest.approx(1e3 * ends[4].symmetric, rel=1e-3)
