"""Samples that are solved together."""

from dataclasses import replace

import numpy as np
import pytest
from measured import measure

import facets
from facets import Measurement, Samples
from facets.estimation import PoseColumns, ZeroRequest

SENSOR, OPTIONS = facets.Sensor(), facets.load("paper").solve


def test_a_reading_that_needs_more_steps_from_rest_starts_from_its_neighbour():
    """Readings on a ramp away from rest, with so few steps that the farthest are not reached."""
    states = np.zeros((40, 8))
    states[:, 0] = np.linspace(0, 0.4, 40)
    readings = facets.readings(SENSOR, states)
    alone = facets.solve(SENSOR, readings, max_steps=4)
    together = measure(SENSOR, replace(OPTIONS, max_steps=4), Samples(readings))
    assert together.ok.sum() > alone.ok.sum()
    # as far as the estimate converges: 1e-6 of the noise, 2.6 nm a pm
    np.testing.assert_allclose(together.state[together.ok], states[together.ok], atol=1e-6)
    np.testing.assert_array_equal(together.state[alone.ok], alone.state[alone.ok])


@pytest.mark.parametrize("wrong", [np.nan, 1e30, 0.0])
def test_a_spoilt_reading_gets_its_status_and_spoils_no_other(wrong):
    """Each with what is known of the beam at its time: the mirror follows the beam."""
    states = np.zeros((30, 8))
    states[:, 0] = states[:, 6] = np.linspace(0, 3, 30)
    readings = facets.readings(SENSOR, states)
    readings[7] = wrong
    samples = Samples(readings, place=states[:, 6:])
    solution = measure(SENSOR, replace(OPTIONS, beam="known"), samples)
    assert not solution.ok[7]
    assert np.isnan(solution.state[7]).all()
    others = np.delete(np.arange(30), 7)
    np.testing.assert_allclose(solution.state[others], states[others], atol=1e-9)


@pytest.mark.parametrize("beam", ["known", "free"])
def test_a_sample_whose_place_is_missing_has_no_pose_unless_the_beam_is_free(beam):
    readings = facets.readings(SENSOR, np.zeros((3, 8)))
    place = np.zeros((3, 2))
    place[1, 0] = np.nan
    solution = measure(SENSOR, replace(OPTIONS, beam=beam), Samples(readings, place=place))
    assert solution.ok.tolist() == [True, beam == "free", True]
    if beam == "known":
        assert facets.Status(int(solution.status[1])).label == "non finite"


def test_a_place_of_which_nothing_is_known_leaves_the_beam_free():
    states = np.zeros((3, 8))
    states[:, 0] = states[:, 6] = 0.2
    readings = facets.readings(SENSOR, states)
    options = replace(OPTIONS, beam="known")
    wrong = np.full((3, 2), 5.0)
    wrong[2] = np.nan
    solution = measure(SENSOR, options, Samples(readings, place=wrong, place_sigma=np.inf))
    np.testing.assert_allclose(solution.state, states, atol=1e-9)
    free = facets.solve(SENSOR, readings, beam="free")
    np.testing.assert_array_equal(solution.uncertainty, free.uncertainty)


@pytest.mark.parametrize(("sigma", "is_bounded"), [(None, True), (0.01, True), (np.inf, False)])
def test_unseen_errors_are_those_of_the_knowledge_with_which_samples_were_solved(sigma, is_bounded):
    """A free beam leaves the places of the spots without a check, whatever `solve` says."""
    states = np.zeros((150, 8))
    samples = Samples(facets.readings(SENSOR, states), place=states[:, 6:], place_sigma=sigma)
    options = replace(OPTIONS, beam="known")
    measurement = Measurement(replace(facets.load("paper"), sensor=SENSOR, solve=options))
    measurement.poses(samples)
    assert np.isfinite(measurement.tally.unseen[0]) == is_bounded


def test_a_saturated_sample_is_named_only_where_it_has_no_pose():
    readings = facets.readings(SENSOR, np.zeros((3, 8)))
    readings[1:] = np.nan
    samples = Samples(readings, saturated=np.array([True, True, False]))
    status = measure(SENSOR, OPTIONS, samples).status
    labels = [facets.Status(number).label for number in status.tolist()]
    assert labels == ["converged", "saturated", "non finite"]


def parts_of_a_table(readings, size=10):
    time = 1e-3 * np.arange(len(readings))
    for first in range(0, len(readings), size):
        rows = np.arange(first, min(first + size, len(readings)))
        yield Samples(readings[rows], rows + 1, time[rows])


def test_poses_of_a_table_wait_until_its_zero_is_known():
    """A zero of 25 ms needs three parts of 10 ms; those after it are solved as they come."""
    measurement = Measurement(facets.load("paper"), PoseColumns(ZeroRequest(seconds=0.025)))
    taken = []

    def take():
        for samples in parts_of_a_table(facets.readings(SENSOR, np.zeros((50, 8)))):
            taken.append(samples)
            yield samples

    poses = measurement.poses_of_all(take(), "the table")
    counts = [len(taken) for _ in poses]
    assert counts == [3, 3, 3, 4, 5]
    assert measurement.zero.samples == 25


def test_all_poses_of_a_table_have_displacements():
    measurement = Measurement(facets.load("paper"), PoseColumns(ZeroRequest(row=15)))
    parts = parts_of_a_table(facets.readings(SENSOR, np.zeros((30, 8))))
    poses = list(measurement.poses_of_all(parts, "the table"))
    assert all(np.isfinite(part.object["displacement_tx_mm"]).all() for part in poses)
    members = np.concatenate([part.members for part in poses])
    assert np.flatnonzero(members).tolist() == [14]


def test_a_zero_of_no_use_begins_anew_in_a_run_and_ends_a_table():
    """The samples of the zero have light on B and C, then on A and C: only C is common."""
    config = facets.load("paper")
    config = replace(config, solve=replace(OPTIONS, beam="known", accept_unchecked=True))
    columns = PoseColumns(ZeroRequest(seconds=0.010))
    readings = facets.readings(SENSOR, np.zeros((40, 8)))
    readings[:5, :3] = readings[5:10, 3:6] = np.nan
    run = Measurement(config, columns, waits=True)
    first, second, *_ = (run.poses(samples) for samples in parts_of_a_table(readings, 20))
    (refusal, *told) = run.take_news()
    assert refusal.startswith("is measured again: ")
    assert "different detectors" in refusal
    assert np.isnan(first.object["displacement_tx_mm"]).all()
    assert told == [run.zero_text]
    assert run.zero.samples == 10
    assert np.isfinite(second.object["displacement_tx_mm"]).all()
    assert run.take_news() == []
    with pytest.raises(facets.InputError, match="different detectors"):
        list(Measurement(config, columns).poses_of_all(parts_of_a_table(readings), "the table"))
