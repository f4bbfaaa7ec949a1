"""The estimator: exact on exact readings, honest on everything else."""

import copy
import pickle
from dataclasses import fields, replace

import numpy as np
import pytest

import facets
from facets import InputError, Prior, Status
from facets.estimation import blocks

SENSOR = facets.Sensor()
HALF_RANGE = np.array([0.1, 0.1, 6.0, 12e-3, 12e-3, 24e-3, 0.05, 0.05])
STATE = np.array([0.02, -0.03, 0.5, 1e-3, -2e-3, 3e-3, 0, 0])


def states_in_range(count, seed):
    """Uniform in a box, of which those are kept whose spots all lie on their detectors."""
    states = np.random.default_rng(seed).uniform(-HALF_RANGE, HALF_RANGE, (8 * count, 8))
    return states[facets.reaches(SENSOR, states).all(axis=1)][:count]


@pytest.fixture(scope="module")
def states():
    return states_in_range(2000, seed=5)


@pytest.fixture(scope="module")
def readings(states):
    return facets.readings(SENSOR, states)


def check_exact(solution, states):
    """Readings carry 1e-13 mm of rounding; a free beam amplifies it to some 1e-12 mm in x, y."""
    assert solution.ok.all()
    error = np.abs(solution.state - states).max(axis=0)
    assert error.max() < 1e-10
    assert error[3:6].max() < 1e-12


@pytest.mark.installed
def test_exact_readings_of_100000_states_solve_from_zero():
    states = states_in_range(100_000, seed=1)
    check_exact(facets.solve(SENSOR, facets.readings(SENSOR, states)), states)


@pytest.mark.parametrize(
    "options",
    [
        {"power": "unknown", "accept_unchecked": True},
        {"method": "paper"},
        {"start": "previous"},
        {"covariance": False},
        {"power": Prior((0.3,) * 2000, 1e-3)},
    ],
    ids=str,
)
def test_every_way_finds_the_exact_state(states, readings, options):
    check_exact(facets.solve(SENSOR, readings, **options), states)


def test_a_table_goes_on_from_its_last_pose_as_a_solver_does(readings):
    """Also past readings that have no pose from there, or none at all."""
    rows, options = readings[:60].copy(), {"start": "previous", "max_steps": 5}
    rows[::7], rows[3::11] = np.nan, -rows[3::11]
    table, solver = facets.solve(SENSOR, rows, **options), facets.Solver(SENSOR, **options)
    assert 0.5 < table.ok.mean() < 0.9
    assert table.iterations.max() > 5  # those from the last pose, and those from zero
    for n, row in enumerate(rows):
        one = solver.solve(row)
        assert (table.status[n], table.iterations[n]) == (one.status, one.iterations)
        np.testing.assert_array_equal(table.state[n], one.state)


@pytest.mark.parametrize("start", ["zero", "previous"])
def test_a_known_beam_is_taken_as_known(states, readings, start):
    solution = facets.solve(SENSOR, readings, beam=Prior(states[:, 6:], 0.0), start=start)
    check_exact(solution, states)
    assert (solution.state[:, 6:] == states[:, 6:]).all()
    assert (solution.covariance[:, 6:] == 0).all()


def test_the_papers_method_goes_on_through_a_rise_as_plain_steps_do():
    """Damped steps, which must not rise, take nearly twice as many from here."""
    start, reading = np.array([0.25, 0, 0, 0.01, 0, 0, 0, 0]), facets.readings(SENSOR, np.zeros(8))
    plain = facets.solve(SENSOR, reading, method="paper", start=start)
    check_exact(plain, np.zeros((1, 8)))
    assert plain.iterations < facets.solve(SENSOR, reading, start=start).iterations


def test_readings_of_any_shape_and_none_at_all_give_solutions_of_theirs(readings):
    shaped = facets.solve(SENSOR, readings[:12].reshape(3, 4, 9))
    assert (shaped.state.reshape(12, 8) == facets.solve(SENSOR, readings[:12]).state).all()
    assert shaped.covariance.shape == (3, 4, 8, 8)
    known = replace(SENSOR, calibration=facets.Calibration(("psd_a.height",), ((1e-6,),)))
    nothing = facets.solve(known, np.empty((3, 0, 9)))
    for numbers in (nothing.state, nothing.uncertainty, nothing.calibration_uncertainty):
        assert numbers.shape == (3, 0, 8)


@pytest.mark.parametrize(
    ("place", "value", "status"),
    [
        (0, np.nan, Status.NON_FINITE),
        (2, 0.0, Status.NO_LIGHT),
        (8, -1.0, Status.NO_LIGHT),
        (1, 6.51, Status.OUT_OF_RANGE),
        (3, -7.0, Status.OUT_OF_RANGE),
    ],
)
def test_a_bad_detector_gives_a_status_and_never_a_number(place, value, status):
    """Six readings cannot tell eight unknowns: no step is made."""
    reading = facets.readings(SENSOR, np.zeros(8))
    reading[place] = value
    for solution in (facets.solve(SENSOR, reading), facets.Solver(SENSOR).solve(reading)):
        assert solution.status == status
        assert not solution.ok
        assert solution.iterations == 0
        for numbers in (solution.state, solution.covariance, solution.power, solution.residual):
            assert np.isnan(numbers).all()
        assert list(solution.used) == [k != place // 3 for k in range(3)]


@pytest.mark.parametrize(
    ("way", "spoilt"),
    [
        ({"beam": "known"}, [5]),
        ({"beam": Prior((0, 0), 1.0)}, [5]),  # takes steps by reflections
        ({"beam": "known", "power": Prior(0.3, 0.003)}, [5]),
        ({"power": "unknown"}, []),
    ],
)
@pytest.mark.parametrize("start", ["zero", "previous"])
def test_a_pose_that_nothing_checks_is_given_on_request_only(way, spoilt, start):
    """As many numbers and priors as unknowns: of two detectors, or of three for nine unknowns."""
    rows = np.tile(facets.readings(SENSOR, STATE), (5, 1))
    rows[:, spoilt] = np.nan
    for accepts in (False, True):
        options = {"start": start, "accept_unchecked": accepts, **way}
        single = facets.Solver(SENSOR, **options).solve(rows[0])
        for solution in (facets.solve(SENSOR, rows, **options), single):
            assert (solution.ok == accepts).all()
            if accepts:
                assert (solution.checks == 0).all()
                assert np.abs(solution.state - STATE).max() < 1e-9
                assert np.isfinite(solution.uncertainty).all()
            else:
                assert (solution.status == Status.UNCHECKED).all()
                assert np.isnan(solution.state).all()
                assert np.isnan(solution.covariance).all()


def test_a_spoilt_number_that_others_check_is_a_misfit_and_not_ok():
    """Where the beam is known: three numbers check the others, and each takes part."""
    rows = np.tile(facets.readings(SENSOR, STATE), (10, 1))
    rows[np.arange(9), np.arange(9)] += np.tile([0.3, 0.3, 0.003], 3)
    solution = facets.solve(SENSOR, rows, beam="known")
    assert solution.converged.all()
    assert solution.misfit.tolist() == [True] * 9 + [False]
    assert solution.ok.tolist() == [False] * 9 + [True]
    single = facets.Solver(SENSOR, beam="known").solve(rows[0])
    assert (single.converged, single.misfit, single.ok) == (True, True, False)


@pytest.mark.parametrize("sigma", [np.inf, 0.005, 1e-4, 1e-7, 0.0])
@pytest.mark.parametrize("finer", [1, 1e-3])
def test_noisy_readings_converge_whatever_is_known_of_the_beam(states, readings, sigma, finer):
    """Next to the optimum rounding decides whether a step helps; that must not stop it."""
    noise = facets.Noise(position=2.6e-3 * finer, at_power=0.1, power=4e-5 * finer)
    sensor = facets.Sensor(noise=noise)
    noisy = facets.add_noise(sensor, readings, np.random.default_rng(9))
    on = (np.abs(np.delete(noisy, [2, 5, 8], axis=1)) < 6.5).all(axis=1)
    solution = facets.solve(sensor, noisy[on], beam=Prior(states[on, 6:], sigma))
    assert solution.converged.all()
    assert solution.misfit.sum() < 4
    assert solution.iterations.max() < 12


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"beam": "fixed"}, "beam is 'fixed'"),
        ({"power": 0.0}, "power is"),
        ({"start": "there"}, "start is 'there'"),
        ({"start": np.zeros((3, 8))}, "start does not fit"),
        ({"method": "magic"}, "method is 'magic'"),
        ({"method": "paper", "beam": "known"}, "paper"),
        ({"max_steps": 0}, "max_steps is 0"),
        ({"beam": Prior(np.zeros((3, 2)), 1.0)}, "does not fit readings"),
    ],
)
def test_bad_arguments_are_named(options, words):
    for readings in (np.zeros(9), np.zeros((2, 9))):
        with pytest.raises(InputError, match=words):
            facets.solve(SENSOR, readings, **options)
    if "fit" not in words:
        with pytest.raises(InputError, match=words):
            facets.Solver(SENSOR, **options)


def test_a_prior_has_numbers_and_a_solver_takes_one_reading():
    with pytest.raises(InputError, match="mean is"):
        Prior((np.nan, 0), 1)
    with pytest.raises(InputError, match="needed"):
        facets.Solver(SENSOR).solve(np.zeros((1, 9)))


def test_a_copy_of_a_prepared_solver_has_memory_of_its_own(readings):
    solver = facets.Solver(SENSOR, beam="known")
    expected = solver.solve(readings[0])
    for other in (copy.deepcopy(solver), pickle.loads(pickle.dumps(solver))):
        solver.solve(readings[4])
        np.testing.assert_array_equal(other.solve(readings[0]).state, expected.state)


def test_a_solution_of_one_reading_is_a_solution(readings):
    """Its fields are made when they are asked for; nobody need know."""
    solver = facets.Solver(SENSOR, start="previous")
    single, plain = solver.solve(readings[0]), facets.solve(SENSOR, readings[:1])
    solver.solve(readings[1])  # in the memory that the first one was found in
    other = solver.solve(readings[0])
    other.state[:] *= 1e3  # as somebody does who wants micrometres: nothing follows from it
    assert solver.solve(readings[0]).iterations <= 2
    for each in (single, copy.copy(single), pickle.loads(pickle.dumps(single))):
        assert isinstance(each, facets.Solution)
        for field in fields(facets.Solution):
            expected = getattr(plain, field.name)
            if expected is not None:
                np.testing.assert_array_equal(getattr(each, field.name), expected[0])
    bare = facets.Solver(SENSOR, covariance=False).solve(readings[0])
    assert bare.covariance is None
    with pytest.raises(InputError, match="covariance"):
        bare.uncertainty  # noqa: B018


def test_threads_do_not_change_bits_and_what_fails_in_one_is_raised(readings, monkeypatch):
    monkeypatch.setattr("facets.model.threads.MIN_ROWS_PER_THREAD", 1000)
    one, two = (facets.solve(SENSOR, readings, threads=count) for count in (1, 2))
    np.testing.assert_array_equal(one.state, two.state)
    np.testing.assert_array_equal(one.covariance, two.covariance)
    plain = blocks.estimate_blocks

    def fail_in_the_second(code, numbers, some, *rest):
        if some.values[0, 0] == readings[1000, 0]:
            raise MemoryError
        return plain(code, numbers, some, *rest)

    monkeypatch.setattr(blocks, "estimate_blocks", fail_in_the_second)
    with pytest.raises(MemoryError):
        facets.solve(SENSOR, readings, threads=2)


@pytest.mark.parametrize(("place", "value"), [(3, 3.51), (4, -2.01)])
def test_a_spot_beside_the_usable_area_is_left_out(place, value):
    """Both sides have limits of their own."""
    psds = list(SENSOR.psds)
    psds[1] = psds[1].limit(0, -9.0, 3.5).limit(1, -2.0, 9.0)
    sensor = replace(SENSOR, psds=tuple(psds))
    reading = facets.readings(SENSOR, np.zeros(8))
    rows = np.tile(reading, (3, 1))
    rows[1, place], rows[2, place] = value, -value
    for solution in (facets.solve(sensor, rows), facets.solve(sensor, np.tile(rows, (40, 1)))):
        assert list(solution.used[:3, 1]) == [True, False, True]
        assert solution.status[1] == Status.OUT_OF_RANGE
    with pytest.raises(InputError, match="lowest psi below highest"):
        replace(psds[1], usable=(1.0, 0.0, -1.0, 1.0))
