"""The columns of tables: numbers in the units of their names."""

from __future__ import annotations

import numpy as np
import pytest

import facets
from facets.characterization import Boundary, estimators, resolve
from facets.characterization.tables import outline_columns, resolution_columns, state_columns

CONFIG = facets.load("paper")


def test_a_resolution_is_that_of_the_jacobian_in_um_and_urad():
    """With the beam known: the six columns of the pose alone, by normal equations."""
    found = resolve(CONFIG.sensor, CONFIG.range, estimators(0.005))
    table = resolution_columns(found)
    known = table["estimator"] == "beam known"
    assert table["axis"][known].tolist() == ["tx", "ty", "tz", "roll", "pitch", "yaw"]
    assert table["unit"][known].tolist() == ["um"] * 3 + ["urad"] * 3
    readings = facets.readings(CONFIG.sensor, np.zeros(8))
    noise = facets.standard_deviations(CONFIG.sensor, readings)
    slopes = facets.jacobian(CONFIG.sensor, np.zeros(8))[:, :6] / noise[:, None]
    sigma = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
    at_rest = sigma * [1e3, 1e3, 1e3, 1e6, 1e6, 1e6]
    assert table["u_at_rest"][known] == pytest.approx(at_rest, rel=1e-6)
    worst = table["u_worst"][known]
    assert (worst >= at_rest * (1 - 1e-9)).all()
    assert table["u_expanded_worst"][known] == pytest.approx(2 * worst)
    (row,) = (row for row in found if row.how.name == "beam known")
    for i, state in enumerate(row.worst_state):
        again = facets.uncertainties(CONFIG.sensor, state, facets.Knowledge(beam="known"))
        assert worst[i] == pytest.approx(again[i] * (1e3 if i < 3 else 1e6), rel=1e-6)
        place = np.array([table[f"worst_at_{name}"][known][i] for name in ("tz_mm", "yaw_mrad")])
        assert place == pytest.approx(state[[2, 5]] * [1, 1e3])


def test_places_are_in_the_units_of_their_names():
    states = np.array([[0.1, -0.2, 3.0, 1e-3, 2e-3, -4e-3, 0.01, 0.02]])
    table = state_columns(states, np.array([[5.0, 6.0, 7.0]]))
    assert [column[0] for column in table.values()] == pytest.approx(
        [0.1, -0.2, 3.0, 1.0, 2.0, -4.0, 0.01, 0.02, np.hypot(0.09, 0.22), 5.0, 6.0, 7.0]
    )
    edge = Boundary(("tx", "roll"), np.zeros(6), np.array([[0.3, 5e-3]]), np.array([-1]), 1)
    assert [column[0] for column in outline_columns([edge]).values()] == [
        "tx_mm", "roll_mrad", 0.3, 5.0, "nowhere",
    ]  # fmt: skip
