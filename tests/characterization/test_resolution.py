"""Uncertainties: propagation, the solver's own covariance, and the worst poses."""

import numpy as np
import pytest
from sensors import SENSORS

import facets
from facets import Estimator, Knowledge, Rules, budgets, uncertainties
from facets.characterization import (
    density_at_rest,
    estimators,
    resolution_columns,
    resolve,
    sources,
)

SENSOR = facets.Sensor()
PLACES = np.zeros((5, 8))
PLACES[1, 0] = 0.15
PLACES[2, 2] = 5.0
PLACES[3, 3:6] = 5e-3, -4e-3, 8e-3
PLACES[4, [0, 1, 6, 7]] = -0.1, 0.08, 0.02, -0.03

POWER = facets.Prior(SENSOR.beam.power, 0.01)
#: What is known, and the solver's arguments for it.
WAYS = {
    "free": (Knowledge(), {}),
    "paper": (Estimator("paper", Knowledge(), eight=True), {"method": "paper"}),
    "within 5 um": (
        Knowledge(facets.Prior((0, 0), 0.005)),
        {"beam": facets.Prior(PLACES[:, 6:], 0.005)},
    ),
    "known": (Knowledge("known"), {"beam": facets.Prior(PLACES[:, 6:], 0.0)}),
    "free; power unknown": (
        Knowledge(power="unknown"),
        {"power": "unknown", "accept_unchecked": True},
    ),
    "free; power within 10 uW": (
        Knowledge(power=POWER),
        {"power": POWER, "accept_unchecked": True},
    ),
}


@pytest.mark.parametrize(
    ("name", "known"), [*(("paper", known) for known in WAYS), ("skewed3", "within 5 um")]
)
def test_propagation_gives_the_solvers_own_covariance(name, known):
    how, way = WAYS[known]
    sensor = SENSORS[name]
    solution = facets.solve(sensor, facets.readings(sensor, PLACES), **way)
    ours = uncertainties(sensor, PLACES, how)
    assert solution.uncertainty[:, :6] == pytest.approx(ours, rel=1e-9)
    budget = budgets(sensor, PLACES, how)
    assert budget.shape[-1] == len(sources(sensor, getattr(how, "knowledge", how)))
    assert (budget >= 0).all()
    assert np.sqrt(budget.sum(axis=2)) == pytest.approx(ours)
    # a beam that is not known, or exactly, has no part
    assert (budget[:, :, 2] > 0).any() == (known == "within 5 um")


def test_a_beam_known_better_along_one_axis_is_refused():
    beam = facets.Prior((0.0, 0.0), (0.001, 0.002))
    with pytest.raises(facets.InputError, match="the same along x and y"):
        uncertainties(SENSOR, PLACES, Knowledge(beam))


@pytest.fixture(scope="module")
def resolved():
    how = estimators(0.005)
    return resolve(SENSOR, Rules(), [how[0], how[-1]])


def test_the_worst_is_that_of_the_axis_own_range_and_of_the_box(resolved):
    """No denser sample of either finds a worse pose than the search, which stays inside them."""
    row = resolved[0]
    half = [axis.symmetric / 2 for axis in facets.axis_ranges(SENSOR, Rules(), np.zeros(6))]
    for states, ends in ((row.worst_state, np.diag(half)), (row.box_state, row.box)):
        assert (np.abs(states[:, :6]) <= ends).all()
    for i in range(6):
        swept = np.outer(np.linspace(-half[i], half[i], 1001)[1:-1], np.eye(8)[i])
        most = uncertainties(SENSOR, swept, row.how)[:, i].max()
        assert row.worst[i] == pytest.approx(most, rel=5e-3)
        assert row.worst[i] > most * (1 - 1e-5)
    poses = np.zeros((20_000, 8))
    poses[:, :6] = np.random.default_rng(4).uniform(-1, 1, (20_000, 6)) * row.box
    most = uncertainties(SENSOR, poses, row.how).max(axis=0)
    assert (row.worst_in_box >= most).all()
    assert row.worst_in_box == pytest.approx(most, rel=0.05)


def test_a_table_has_um_and_urad(resolved):
    densities = [density_at_rest(SENSOR, row.how, 1e3) for row in resolved]
    table = resolution_columns(resolved, densities)
    known = table["estimator"] == "beam known"
    assert table["axis"][known].tolist() == list(facets.POSE)
    assert table["unit"][known].tolist() == ["um"] * 3 + ["urad"] * 3
    worst, states = resolved[1].worst * np.repeat([1e3, 1e6], 3), resolved[1].worst_state
    assert table["u_worst"][known] == pytest.approx(worst)
    assert table["u_expanded_worst"][known] == pytest.approx(2 * worst)
    assert table["worst_at_tz_mm"][known] == pytest.approx(states[:, 2])
    assert table["worst_at_yaw_mrad"][known] == pytest.approx(1e3 * states[:, 5])


def test_noise_that_outgrows_the_reading_is_not_a_number():
    assert np.isnan(uncertainties(SENSOR, 30 * np.eye(8)[:1], Knowledge())).all()
