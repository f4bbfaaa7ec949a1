"""Outlines of ranges: against the limits themselves, and a grid of causes."""

import numpy as np
import pytest

import facets
from facets import Rules
from facets.characterization import Boundary, clearances, outline_columns, outlines

SENSOR = facets.Sensor()


def are_inside(boundary, points, rules):
    return clearances(SENSOR, boundary.poses(points), rules).min(axis=1) > 0


@pytest.mark.parametrize(
    ("axes", "tracking", "tz"),
    [(("tx", "yaw"), False, 0.0), (("tx", "ty"), True, 0.0), (("roll", "pitch"), False, 5.0)],
)
def test_outlines_hold_their_tolerance_between_their_points(axes, tracking, tz):
    """Beside the middle of each chord, a tolerance inwards is in the range, and outwards not."""
    rules = Rules(tracking=tracking)
    boundary = outlines.trace(SENSOR, rules, axes, tz * np.eye(6)[2])
    fine = outlines.tolerances(axes)
    points = boundary.points / fine
    chords = np.roll(points, -1, axis=0) - points
    outwards = chords[:, ::-1] * [1, -1] / np.hypot(*chords.T)[:, None]
    middles = points + chords / 2
    assert are_inside(boundary, (middles - 1.1 * outwards) * fine, rules).all()
    assert not are_inside(boundary, (middles + 1.1 * outwards) * fine, rules).any()


def test_a_grid_of_causes_differs_from_the_outline_at_its_edge_alone():
    boundary = outlines.trace(SENSOR, Rules(), ("tx", "yaw"))
    assert outlines.count_grid_differences(SENSOR, Rules(), boundary, 150) < 20
    states = outlines.states_inside(Rules(), boundary)
    assert outlines.count_correct_solutions(SENSOR, states) == len(states) > 100


def test_a_table_has_points_in_the_units_of_its_axes():
    edge = Boundary(("tx", "roll"), np.zeros(6), np.array([[0.3, 5e-3]]), np.array([-1]))
    assert [column[0] for column in outline_columns([edge]).values()] == [
        "tx_mm", "roll_mrad", 0.3, 5.0, "nowhere",
    ]  # fmt: skip
