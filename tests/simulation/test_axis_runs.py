"""An axis with known errors: where it stands, which errors it has there, and what it is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facets.core import STATE, Runs
from facets.simulation import command_columns, run_states, way_point_states, way_points


def state(**values):
    return tuple(values.get(name, 0.0) for name in STATE)


AXIS = Runs(
    start=state(tz=-1.0), stop=state(tz=1.0), steps=5, runs=2, dwell=0.02, move=0.01, rate=1000.0
)


def test_the_stands_are_commanded_in_their_order_from_both_sides():
    commands = command_columns(AXIS)
    up, down = [-1, -0.5, 0, 0.5, 1], [1, 0.5, 0, -0.5, -1]
    np.testing.assert_allclose(commands["position_mm"], 2 * [*up, *down])
    np.testing.assert_array_equal(commands["direction"], 2 * [*[1] * 5, *[-1] * 5])
    turned = replace(AXIS, start=state(yaw=0.01, tz=1e-3), stop=state(yaw=-0.01))
    commands = command_columns(turned)
    np.testing.assert_allclose(commands["position_mrad"][:5], [10, 5, 0, -5, -10])
    assert commands["direction"][0] == -1


@pytest.mark.parametrize(
    ("keys", "axis", "expected"),
    [
        ({"scale": 0.01}, 2, [-0.01, -0.005, 0, 0.005, 0.01]),
        ({"bow": state(tx=4e-3)}, 0, [0, 3e-3, 4e-3, 3e-3, 0]),
        ({"backlash": state(tz=2e-3)}, 2, [*[1e-3] * 5, *[-1e-3] * 5]),
        ({"wave": state(roll=1e-5), "periods": 1.0}, 3, [0, 1e-5, 0, -1e-5, 0]),
    ],
)
def test_each_error_has_its_form(keys, axis, expected):
    errors = errors_of(**keys)[: len(expected), axis]
    np.testing.assert_allclose(errors, expected, atol=1e-15)


def test_stands_scatter_by_the_size_given():
    assert 0.3e-3 < errors_of(scatter=state(ty=1e-3))[:, 1].std() < 3e-3


def errors_of(**keys):
    """The errors (10, 8) of an axis at the stands of its first run."""
    moved, plain = (
        way_point_states(axis, np.random.default_rng(1)) for axis in (replace(AXIS, **keys), AXIS)
    )
    return (moved - plain)[way_points(AXIS).is_dwell][:10]


def test_it_stands_at_its_places_and_overruns_the_ends():
    _, states = run_states(AXIS, np.random.default_rng(1))
    stands = (states[:, 2, None] == command_columns(AXIS)["position_mm"][:5]).sum(axis=0)
    assert (np.abs(stands - 4 * 20) <= 8).all()  # two runs there and back, of 20 samples
    assert states[:, 2].max() > 1.2
    assert states[:, 2].min() < -1.2
