"""The estimator: exact on exact readings, honest on everything else."""

import copy
import pickle
from dataclasses import FrozenInstanceError, fields, replace

import numpy as np
import pytest

import facets
from facets import InputError, Prior, Status
from facets.estimation import problem
from facets.estimation.least_squares import back_substitute, triangularise
from facets.estimation.normal_equations import (
    LAST,
    covariance_of,
    factorise,
    multiply,
    solve_cholesky,
)

SENSOR = facets.Sensor()
HALF_RANGE = np.array([0.1, 0.1, 6.0, 12e-3, 12e-3, 24e-3, 0.05, 0.05])


def states_in_range(count: int, seed: int) -> np.ndarray:
    """Uniform in a box, of which those are kept whose spots all lie on their detectors."""
    drawn = np.random.default_rng(seed).uniform(-HALF_RANGE, HALF_RANGE, (8 * count, 8))
    kept = drawn[facets.reaches(SENSOR, drawn).all(axis=1)]
    assert len(kept) >= count
    return kept[:count]


@pytest.fixture(scope="module")
def states() -> np.ndarray:
    return states_in_range(2000, seed=5)


@pytest.fixture(scope="module")
def readings(states: np.ndarray) -> np.ndarray:
    return facets.readings(SENSOR, states)


def worst_error(solution: facets.Solution, states: np.ndarray) -> tuple[float, float]:
    assert solution.ok.all()
    error = np.abs(solution.state - states).max(axis=0)
    return error[[0, 1, 2, 6, 7]].max(), error[3:6].max()


@pytest.mark.installed
def test_exact_readings_of_100000_states_solve_from_zero():
    """Readings carry 1e-13 mm of rounding; a free beam amplifies it to some 1e-12 mm in x, y."""
    states = states_in_range(100_000, seed=1)
    solution = facets.solve(SENSOR, facets.readings(SENSOR, states))
    length, angle = worst_error(solution, states)
    assert length < 1e-10
    assert angle < 1e-12


@pytest.mark.parametrize(
    "options",
    [
        {"power": "unknown", "accept_unchecked": True},
        {"method": "paper"},
        {"start": "previous"},
        {"covariance": False},
        {"power": Prior(0.3, 1e-3)},
    ],
    ids=str,
)
def test_every_way_finds_the_exact_state(states, readings, options):
    length, angle = worst_error(facets.solve(SENSOR, readings, **options), states)
    assert length < 1e-10
    assert angle < 1e-12


def plain_steps(reading, start):
    """The costs of twenty steps without any damping, by NumPy, and where they lead."""
    noise, state, costs = facets.standard_deviations(SENSOR, reading), start, []
    for _ in range(20):
        rest = (reading - facets.readings(SENSOR, state)) / noise
        costs.append((rest**2).sum())
        if not np.isfinite(costs[-1]):
            break
        slopes = facets.jacobian(SENSOR, state) / noise[:, None]
        state = state + np.linalg.lstsq(slopes, rest, rcond=None)[0]
    return np.array(costs), state


def test_the_papers_method_goes_on_through_a_rise_and_arrives_where_plain_steps_do():
    rng = np.random.default_rng(2)
    size = np.array([0.1, 0.1, 1, 4e-3, 4e-3, 5e-3, 0.05, 0.05])
    true = rng.uniform(-1, 1, (60, 8)) * size
    starts = true + 3 * rng.uniform(-1, 1, (60, 8)) * size * [0.5, 0.5, *[1] * 6]
    rises = 0
    for state, start, reading in zip(true, starts, facets.readings(SENSOR, true), strict=True):
        costs, end = plain_steps(reading, start)
        arrives = bool(np.isfinite(costs[-1]) and np.abs(end - state).max() < 1e-6)
        found = facets.solve(SENSOR, reading, method="paper", start=start)
        assert bool(found.converged) == arrives
        rises += arrives and bool((np.diff(costs) > 1).any())
    assert rises


def test_a_known_beam_is_taken_as_known(states, readings):
    beam = Prior(states[:, 6:], 0.0)
    solution = facets.solve(SENSOR, readings, beam=beam)
    length, angle = worst_error(solution, states)
    assert length < 1e-11
    assert angle < 1e-12
    assert (solution.state[:, 6:] == states[:, 6:]).all()
    assert (solution.covariance[:, 6:] == 0).all()


def test_beam_known_means_at_the_origin(states):
    centred = states.copy()
    centred[:, :2] -= centred[:, 6:]
    centred[:, 6:] = 0
    readings = facets.readings(SENSOR, centred)
    on = facets.reaches(SENSOR, centred).all(axis=1)
    solution = facets.solve(SENSOR, readings[on], beam="known")
    assert worst_error(solution, centred[on])[0] < 1e-11


def test_a_prior_pulls_the_beam_to_its_mean():
    state = np.zeros(8)
    reading = facets.readings(SENSOR, state)
    wide, narrow = (
        facets.solve(SENSOR, reading, beam=Prior((0.01, 0.0), sigma)).state[6]
        for sigma in (10.0, 1e-6)
    )
    assert abs(wide) < 1e-7
    assert abs(narrow - 0.01) < 1e-6


def test_an_unknown_power_is_found():
    brighter = facets.Sensor(beam=facets.Beam(power=0.45))
    state = np.array([0.02, -0.03, 0.5, 1e-3, -2e-3, 3e-3, 0.01, 0])
    reading = facets.readings(brighter, state)
    solution = facets.solve(SENSOR, reading, power="unknown", accept_unchecked=True)
    assert solution.ok
    assert solution.power == pytest.approx(0.45, rel=1e-12)
    assert np.abs(solution.state - state).max() < 1e-10


def test_single_batch_and_shaped_give_the_same_bits(readings):
    batch = facets.solve(SENSOR, readings[:12])
    shaped = facets.solve(SENSOR, readings[:12].reshape(3, 4, 9))
    assert (shaped.state.reshape(12, 8) == batch.state).all()
    assert shaped.covariance.shape == (3, 4, 8, 8)
    for n in range(12):
        one = facets.solve(SENSOR, readings[n])
        assert one.state.shape == (8,)
        assert (one.state == batch.state[n]).all()


def test_no_readings_give_no_solutions():
    known = replace(SENSOR, calibration=facets.Calibration(("psd_a.height",), ((1e-6,),)))
    solution = facets.solve(known, np.empty((3, 0, 9)))
    assert solution.state.shape == solution.uncertainty.shape == (3, 0, 8)
    assert solution.calibration_uncertainty.shape == (3, 0, 8)
    assert solution.ok.shape == (3, 0)
    without = facets.solve(known, np.empty((0, 9)), covariance=False)
    assert without.covariance is without.noise_covariance is None


@pytest.mark.parametrize(
    ("place", "value", "status"),
    [
        (0, np.nan, Status.NON_FINITE),
        (4, np.inf, Status.NON_FINITE),
        (2, 0.0, Status.NO_LIGHT),
        (8, -1.0, Status.NO_LIGHT),
        (1, 6.51, Status.OUT_OF_RANGE),
        (3, -7.0, Status.OUT_OF_RANGE),
    ],
)
def test_a_bad_detector_gives_a_status_and_never_a_number(place, value, status):
    """Six readings cannot tell eight unknowns."""
    reading = facets.readings(SENSOR, np.zeros(8))
    reading[place] = value
    solution = facets.solve(SENSOR, reading)
    assert solution.status == status
    assert not solution.ok
    assert np.isnan(solution.state).all()
    assert np.isnan(solution.covariance).all()
    assert np.isnan(solution.uncertainty).all()
    assert np.isnan(solution.power)
    assert np.isnan(solution.residual)
    assert list(solution.used) == [k != place // 3 for k in range(3)]


AS_MANY = [
    ({"beam": "known"}, 5),
    ({"beam": Prior((0, 0), 0.005)}, 5),
    ({"beam": "known", "power": Prior(0.3, 0.003)}, 5),
    ({"power": "unknown"}, None),
]


@pytest.mark.parametrize(("way", "spoilt"), AS_MANY, ids=str)
@pytest.mark.parametrize("start", ["zero", "previous"])
def test_a_pose_that_nothing_checks_is_given_on_request_only(way, spoilt, start):
    """As many numbers and priors as unknowns: of two detectors, or of three for nine unknowns."""
    state = np.array([0.02, -0.03, 0.5, 1e-3, -2e-3, 3e-3, 0, 0])
    rows = np.tile(facets.readings(SENSOR, state), (5, 1))
    if spoilt is not None:
        rows[:, spoilt] = np.nan
    found = facets.solve(SENSOR, rows, start=start, **way)
    one = facets.Solver(SENSOR, start=start, **way).solve(rows[0])
    for solution in (found, one, facets.solve(SENSOR, rows[0], **way)):
        assert (solution.status == Status.UNCHECKED).all()
        assert not solution.ok.any()
        assert np.isnan(solution.state).all()
        assert np.isnan(solution.covariance).all()
    asked = facets.solve(SENSOR, rows, start=start, accept_unchecked=True, **way)
    same = facets.Solver(SENSOR, start=start, accept_unchecked=True, **way).solve(rows[0])
    for solution in (asked, same):
        assert solution.ok.all()
        assert (solution.checks == 0).all()
        assert np.abs(solution.state - state).max() < 1e-9
        assert np.isfinite(solution.uncertainty).all()


@pytest.mark.parametrize("value", [np.nan, 0.0])
def test_two_detectors_are_enough_where_the_beam_is_known(value):
    state = np.array([0.02, -0.03, 0.5, 1e-3, -2e-3, 3e-3, 0, 0])
    reading = facets.readings(SENSOR, state)
    reading[5] = value
    solution = facets.solve(SENSOR, reading, beam="known", accept_unchecked=True)
    assert solution.ok
    assert list(solution.used) == [True, False, True]
    assert np.abs(solution.state - state).max() < 1e-10
    whole = facets.solve(SENSOR, facets.readings(SENSOR, state), beam="known")
    assert (solution.uncertainty[:6] > whole.uncertainty[:6]).all()


def test_bad_samples_do_not_disturb_their_neighbours(readings):
    spoiled = readings[:50].copy()
    spoiled[::7, 0] = np.nan
    solution = facets.solve(SENSOR, spoiled, start="previous")
    clean = facets.solve(SENSOR, readings[:50])
    good = np.arange(50) % 7 != 0
    assert (solution.ok == good).all()
    assert np.abs(solution.state[good] - clean.state[good]).max() < 1e-10


def test_readings_no_pose_can_make_leave_a_large_residual():
    """Three times the beam's power: no pose explains it, and the residual says so."""
    reading = facets.readings(SENSOR, np.zeros(8))
    reading[2::3] *= 3
    solution = facets.solve(SENSOR, reading)
    assert not solution.ok
    assert not solution.converged or solution.residual > 1000
    brighter = facets.solve(SENSOR, reading, power="unknown", accept_unchecked=True)
    assert brighter.residual < 1e-6


def test_a_spoilt_number_that_others_check_is_a_misfit_and_not_ok():
    """Where the beam is known: three numbers check the others, and each takes part."""
    state = np.array([0.02, 0.01, 0.5, 1e-3, -2e-3, 3e-3, 0, 0])
    rows = np.tile(facets.readings(SENSOR, state), (10, 1))
    rows[np.arange(9), np.arange(9)] += np.tile([0.3, 0.3, 0.003], 3)
    found = facets.solve(SENSOR, rows, beam="known")
    assert found.converged.all()
    assert found.misfit.tolist() == [True] * 9 + [False]
    assert found.ok.tolist() == [False] * 9 + [True]
    one = facets.Solver(SENSOR, beam="known").solve(rows[0])
    assert (one.converged, one.misfit, one.ok) == (True, True, False)


def test_the_covariance_is_that_of_the_linearised_problem():
    """(J' W J)^-1 from the public Jacobian, and by a Monte Carlo of 20,000 draws (1 %, 4 sigma)."""
    state = np.array([0.02, 0.01, 0.5, 1e-3, -2e-3, 3e-3, 0, 0])
    reading = facets.readings(SENSOR, state)
    noise = SENSOR.noise
    sigma = np.full(9, noise.power)
    sigma[0::3] = sigma[1::3] = noise.position * noise.at_power / reading[2::3]
    scaled = facets.jacobian(SENSOR, state) / sigma[:, None]
    expected = np.linalg.inv(scaled.T @ scaled)
    solution = facets.solve(SENSOR, reading)
    np.testing.assert_allclose(solution.covariance, expected, rtol=1e-6, atol=1e-12)
    draws = reading + sigma * np.random.default_rng(2).standard_normal((20_000, 9))
    spread = facets.solve(SENSOR, draws, covariance=False).state.std(axis=0)
    np.testing.assert_allclose(spread, solution.uncertainty, rtol=0.02)


@pytest.mark.parametrize("sigma", [np.inf, 0.005, 1e-4, 1e-7, 0.0])
@pytest.mark.parametrize("finer", [1, 1e-3])
def test_noisy_readings_converge_whatever_is_known_of_the_beam(states, readings, sigma, finer):
    """Next to the optimum rounding decides whether a step helps; that must not stop it."""
    noise = facets.Noise(position=2.6e-3 * finer, at_power=0.1, power=4e-5 * finer)
    sensor = facets.Sensor(noise=noise)
    sigmas = np.full(readings.shape, noise.power)
    sigmas[:, 0::3] = sigmas[:, 1::3] = noise.position * noise.at_power / readings[:, 2::3]
    noisy = readings + sigmas * np.random.default_rng(9).standard_normal(readings.shape)
    on = (np.abs(noisy.reshape(-1, 3, 3)[:, :, :2]) < 6.5).all(axis=(1, 2))
    solution = facets.solve(sensor, noisy[on], beam=Prior(states[on, 6:], sigma))
    assert solution.ok.all()
    assert solution.iterations.max() < 12


def test_a_known_beam_makes_x_and_y_fine():
    """The power shares then measure the offset alone."""
    reading = facets.readings(SENSOR, np.zeros(8))
    free = facets.solve(SENSOR, reading).uncertainty
    known = facets.solve(SENSOR, reading, beam="known").uncertainty
    assert free[0] / known[0] > 10


def test_dependent_columns_are_noticed():
    matrix = np.array([[1.0, 2.0, 1.0], [1.0, 2.0, 2.0], [3.0, 6.0, 3.0]])
    assert not triangularise(matrix, 3, 2)


def test_least_squares_agree_with_lapack():
    rng = np.random.default_rng(3)
    matrix, right = rng.standard_normal((9, 8)), rng.standard_normal(9)
    work, solution = np.column_stack([matrix, right]), np.empty(8)
    assert triangularise(work, 9, 8)
    back_substitute(work, 8, solution)
    np.testing.assert_allclose(solution, np.linalg.lstsq(matrix, right)[0], rtol=1e-11)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"beam": "fixed"}, "beam is 'fixed'"),
        ({"power": "some"}, "power is 'some'"),
        ({"start": "there"}, "start is 'there'"),
        ({"start": np.zeros((2, 8))}, "start does not fit"),
        ({"method": "magic"}, "method is 'magic'"),
        ({"method": "paper", "beam": "known"}, "paper"),
        ({"max_steps": 0}, "max_steps is 0"),
        ({"beam": Prior(np.zeros((3, 2)), 1.0)}, "does not fit readings"),
    ],
)
def test_bad_arguments_are_named(options, words):
    with pytest.raises(InputError, match=words):
        facets.solve(SENSOR, np.zeros(9), **options)


def test_bad_priors_are_named():
    with pytest.raises(InputError, match="sigma is -1"):
        Prior((0, 0), -1)
    with pytest.raises(InputError, match="mean is"):
        Prior((np.nan, 0), 1)


def test_a_prior_may_differ_by_reading_and_be_a_tuple():
    readings = facets.readings(SENSOR, np.zeros((3, 8)))
    means = [SENSOR.beam.power] * 3
    for mean in (means, tuple(means)):
        found = facets.solve(SENSOR, readings, power=facets.Prior(mean, 0.01))
        assert found.ok.all()


@pytest.mark.parametrize("nonsense", [None, 0.0, (0.0, 0.0), [0.0, 0.0]])
@pytest.mark.parametrize("count", [1, 3])
def test_what_is_no_prior_is_named(nonsense, count):
    readings = np.squeeze(facets.readings(SENSOR, np.zeros((count, 8))))
    for name in ("beam", "power"):
        with pytest.raises(InputError, match=f"{name} is"):
            facets.solve(SENSOR, readings, **{name: nonsense})


def test_bad_shapes_are_named():
    with pytest.raises(InputError, match=r"needed: \(\.\.\., 9\)"):
        facets.solve(SENSOR, np.zeros(8))


@pytest.mark.parametrize(
    "options", [{}, {"beam": "known"}, {"power": "unknown"}, {"method": "paper"}], ids=str
)
def test_a_prepared_solver_gives_the_same_bits(states, readings, options):
    solver = facets.Solver(SENSOR, **options)
    for reading in (*readings[:5], np.full(9, np.nan), readings[5]):
        batch = facets.solve(SENSOR, reading[None], **options)
        for one in (solver.solve(reading), facets.solve(SENSOR, reading, **options)):
            assert one.status.shape == ()
            assert one.status == batch.status[0]
            for name in ("state", "covariance", "power", "residual", "iterations", "used"):
                np.testing.assert_array_equal(getattr(one, name), getattr(batch, name)[0])


def test_a_copy_of_a_prepared_solver_has_memory_of_its_own(states, readings):
    solver = facets.Solver(SENSOR, beam="known")
    expected = [facets.solve(SENSOR, reading, beam="known").state for reading in readings[:3]]
    for other in (copy.deepcopy(solver), pickle.loads(pickle.dumps(solver))):
        for reading, state in zip(readings[:3], expected, strict=True):
            solver.solve(readings[4])
            np.testing.assert_array_equal(other.solve(reading).state, state)


def test_a_solution_of_one_reading_is_a_solution(readings):
    """Its fields are made when they are asked for; nobody need know."""
    solver = facets.Solver(SENSOR, start="previous")
    one, plain = solver.solve(readings[0]), facets.solve(SENSOR, readings[:1])
    names = [field.name for field in fields(facets.Solution)]
    assert one.noise_covariance is one.calibration_covariance is plain.noise_covariance is None
    names = [name for name in names if getattr(plain, name) is not None]
    kept = {name: np.copy(getattr(plain, name)[0]) for name in names}
    solver.solve(readings[1])  # in the memory that the first one was found in
    other = solver.solve(readings[0])
    other.state[:] *= 1e3  # as somebody does who wants micrometres: nothing follows from it
    assert solver.solve(readings[0]).iterations <= 2
    copied = replace(one, power=2 * one.power)
    for found in (one, copy.copy(one), copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        assert isinstance(found, facets.Solution)
        for name in names:
            np.testing.assert_array_equal(getattr(found, name), kept[name])
    assert copied.power == 2 * kept["power"]
    assert repr(one).startswith("Solution(state=array(")
    with pytest.raises(AttributeError, match="pose"):
        one.pose  # noqa: B018
    with pytest.raises(FrozenInstanceError):
        one.status = 0
    bare = facets.Solver(SENSOR, covariance=False).solve(readings[0])
    assert bare.covariance is None
    with pytest.raises(InputError, match="covariance"):
        bare.uncertainty  # noqa: B018


def test_one_reading_from_where_it_is_said_to_start(readings):
    there = facets.solve(SENSOR, readings[0])
    again = facets.solve(SENSOR, readings[0], start=there.state)
    assert again.iterations < there.iterations
    with pytest.raises(InputError, match="start"):
        facets.solve(SENSOR, readings[0], start="there")
    with pytest.raises(InputError, match="threads"):
        facets.solve(SENSOR, readings[0], threads=-1)


def test_a_prepared_solver_goes_on_from_the_last_pose_and_finds_back():
    """Warm, it takes fewer steps; a reading far from the last one is solved from zero again."""
    path = np.zeros((40, 8))
    path[:, 0], path[:, 3], path[:, 5] = 0.08, 8e-3, np.linspace(0, 10e-3, 40)
    path[-1, :2] = -0.1
    readings = facets.readings(SENSOR, path)
    solver = facets.Solver(SENSOR, start="previous")
    found = [solver.solve(reading) for reading in readings]
    assert all(one.ok for one in found)
    assert np.abs(np.array([one.state for one in found]) - path).max() < 1e-10
    cold = facets.solve(SENSOR, readings).iterations
    assert sum(int(one.iterations) for one in found) < cold.sum()


def test_a_warm_solver_finds_whatever_is_found_from_zero():
    """Under the light of a bench, too, where what stalls is tried again without approximations."""
    light = facets.BenchLight(
        wavelength=6e-4, rolloff=(2e-3,) * 6, rolloff_width=0.05, strips=(0.02,) * 3, tip=1e-3,
        background=((1e-3, 0.1, 0.0),) * 3,
    )  # fmt: skip
    sensor, rng = replace(SENSOR, light=light), np.random.default_rng(1)
    path = rng.normal(size=(150, 8)) * [0.3, 0.3, 1.5, 3e-3, 3e-3, 3e-3, 0.2, 0.2]
    readings = facets.readings(sensor, path) + rng.normal(size=(150, 9)) * ([5e-3, 5e-3, 1e-4] * 3)
    readings[::3] += rng.normal(size=(50, 9)) * ([0.3, 0.3, 5e-3] * 3)
    solver = facets.Solver(sensor, start="previous")
    warm = np.array([bool(solver.solve(reading).ok) for reading in readings])
    cold = facets.solve(sensor, readings).ok
    assert 30 < cold.sum() < 120
    assert warm[cold].all()


@pytest.mark.parametrize(
    ("arguments", "reading"),
    [({"start": "there"}, None), ({"max_steps": 0}, None), ({}, [0] * 8), ({}, [[0] * 9])],
    ids=str,
)
def test_a_prepared_solver_refuses_what_it_can_not_take(arguments, reading):
    with pytest.raises(InputError):
        facets.Solver(SENSOR, **arguments).solve(reading)


def test_normal_equations_agree_with_lapack_or_refuse():
    """The same least squares as LAPACK's; where the columns nearly depend, a refusal."""
    rng = np.random.default_rng(3)
    for count in (6, 8, 9):
        matrix, residuals = rng.normal(size=(9, count)), rng.normal(size=9)
        layers = np.zeros((problem.LAYERS, 10, 10))
        layers[problem.COLUMNS, :count, :9] = matrix.T
        layers[problem.COLUMNS, LAST, :9] = residuals
        multiply(layers, problem.COLUMNS, problem.HERE, count)
        assert factorise(layers, problem.HERE, problem.FACTOR, count, 0.0)
        solve_cholesky(layers, problem.HERE, problem.FACTOR, count)
        exact = np.linalg.lstsq(matrix, residuals, rcond=None)[0]
        np.testing.assert_allclose(layers[problem.FACTOR, LAST, :count], exact, rtol=1e-8)
        covariance_of(layers, problem.FACTOR, problem.INVERSE, problem.COVARIANCE, count)
        found = layers[problem.COVARIANCE, :count, :count]
        np.testing.assert_allclose(found, np.linalg.inv(matrix.T @ matrix), rtol=1e-7)
        layers[problem.COLUMNS, count - 1, :9] = matrix[:, 0] * (1 + 1e-6 * rng.normal(size=9))
        multiply(layers, problem.COLUMNS, problem.HERE, count)
        assert not factorise(layers, problem.HERE, problem.FACTOR, count, 0.0)


def test_an_estimate_far_from_the_beam_ends_early_and_says_how():
    """A millimetre off the beam two detectors see little: no estimate goes on to the last step."""
    rng = np.random.default_rng(1)
    states = np.zeros((300, 8))
    around = rng.uniform(0, 2 * np.pi, 300)
    states[:, 0], states[:, 1] = np.cos(around), np.sin(around)
    states[:, 2:6] = rng.uniform(-1, 1, (300, 4)) * [2, 8e-3, 8e-3, 15e-3]
    readings = facets.add_noise(SENSOR, facets.readings(SENSOR, states), np.random.default_rng(2))
    found = facets.solve(SENSOR, readings, beam="known", max_steps=500, accept_unchecked=True)
    assert found.ok.sum() > 50
    assert (found.status != Status.MAX_STEPS).all()
    assert found.iterations.max() < 100
    assert np.isnan(found.state[found.status == Status.STALLED]).all()
    assert Status.STALLED.label == "stalled"
    assert int(Status.STALLED) == 6
