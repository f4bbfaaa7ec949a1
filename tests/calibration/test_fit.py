"""How a fit gets to its end: in short fits, from far away, from any side; and the laser in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from facets.experiments import rigs

import facets
from facets import add_noise
from facets.calibration import (
    LOWER_BOUNDS_MM,
    PLACE,
    Data,
    Task,
    add_power_polynomials,
    choice,
    search,
    states_of,
)
from facets.calibration.candidates import POLARISATIONS
from facets.calibration.fit import fit
from facets.calibration.laser import fit_steady_laser
from facets.detectors import invert_correction

CONFIG = facets.load("paper")
NOMINAL, SETTINGS = CONFIG.sensor, CONFIG.calibrate
OFF = dict.fromkeys(SETTINGS.effects, "off")
BOX = np.array([0.25, 0.25, *rigs.BOX[2:]])


def samples(count, light=NOMINAL.light, power=1.0, seed=5):
    """Readings of a rig with some light, of a laser whose power changes."""
    rng = np.random.default_rng(seed)
    rig = rigs.draw_rig(NOMINAL, rng)
    pose = rng.uniform(-1, 1, (count, 6)) * BOX
    data = Data(np.empty((count, 9)), pose, rigs.REFERENCE, np.zeros((count, 2)))
    sensor = replace(rig.sensor, light=light)
    exact = facets.readings(sensor, states_of(data, np.zeros((count, 9)), rig.values))
    exact[:, 2::3] *= np.broadcast_to(power, count)[:, None]
    raw = invert_correction(sensor, add_noise(sensor, exact, rng))
    return rig, add_power_polynomials(data._replace(raw=raw))


def test_short_fits_end_where_a_long_one_does():
    """A fit cut short says so, and goes on from where it was."""
    _, data = samples(40)
    whole = fit(NOMINAL, data, rigs.choice(), None)
    short = fit(NOMINAL, data, rigs.choice(), None, most=1, enough=1e-6)
    assert whole.ended
    assert not short.ended
    assert "still falls by" in short.cause
    assert "hold them" not in short.cause  # the samples tell these unknowns
    assert short.loss > whole.loss + 1
    again = fit(NOMINAL, data, rigs.choice(), None, start=short)
    assert again.loss == pytest.approx(whole.loss, abs=0.01)
    off = (again.values - whole.values) / whole.uncertainty
    assert np.abs(off).max() < 0.1
    known = whole.sensor.calibration.degrees_of_freedom
    assert known == whole.freedom
    assert 260 < known < 330  # of 360 numbers, less what the unknowns take up


def test_a_fit_comes_back_from_far_away():
    """Ten tolerances off in everything, where a plain step leads nowhere."""
    _, data = samples(40)
    chosen = rigs.choice()
    whole = fit(NOMINAL, data, chosen, None)
    every = whole.every.copy()
    rng = np.random.default_rng(1)
    every[chosen.places] += 10 * chosen.sigma * rng.uniform(-1, 1, len(chosen.names))
    back = fit(NOMINAL, data, chosen, None, start=replace(whole, every=every))
    assert back.ended
    assert back.loss == pytest.approx(whole.loss, abs=0.01)


def test_fits_of_a_coating_begin_all_over_half_a_turn():
    between = np.diff(np.sort([*POLARISATIONS, min(POLARISATIONS) + np.pi]))
    assert between == pytest.approx(np.pi / 4)


@pytest.mark.parametrize("turn", [20, 65, 110, 155])
@pytest.mark.slow
def test_a_coating_is_found_whatever_the_polarisation(turn):
    """Half a turn is a whole period: from one start, some would end on the wrong side."""
    true = np.radians(turn)
    light = replace(NOMINAL.light, index=(1.37, 7.62), polarization=float(true))
    _, data = samples(80, light)
    asked = replace(SETTINGS, effects=OFF | {"coating": "auto"}, power_per_sample=False)
    done = search(NOMINAL, data, asked, fit(NOMINAL, data, choice(NOMINAL, asked)))
    assert [row.accepted for row in done.rows] == [True]
    found = done.found.every[PLACE["light.polarization"]]
    sigma = done.found.uncertainty[done.found.choice.names.index("light.polarization")]
    off = (found - true + np.pi / 2) % np.pi - np.pi / 2
    assert abs(off) < 4 * sigma
    assert sigma < 0.1


@pytest.mark.parametrize("jitter", [0.0, 2e-3])
def test_a_laser_s_steadiness_is_taken_from_the_readings(jitter):
    """Not from the powers that a fit finds, whose scatter is mostly the fit's own."""
    count = 60
    rng = np.random.default_rng(4)
    power = 1 + 0.01 * np.sin(np.linspace(0, 3, count)) + jitter * rng.normal(size=count)
    _, data = samples(count, power=power)
    free = fit(NOMINAL, data, choice(NOMINAL, SETTINGS))
    found = fit_steady_laser(NOMINAL, data, free, SETTINGS.outliers)
    assert found.choice.power == pytest.approx(max(jitter, 2e-4), rel=0.8)
    if not jitter:
        place = found.choice.names.index("apex.x")
        assert found.uncertainty[place] < 0.5 * free.uncertainty[free.choice.names.index("apex.x")]


def test_a_fit_that_misses_something_does_not_advise_to_hold_what_it_creeps_along():
    _, data = samples(40)
    wrong = data.raw.copy()
    wrong[:, 3] *= -1
    found = fit(NOMINAL, data._replace(raw=wrong), rigs.choice(), most=3)
    assert not found.ended
    assert "the model does not follow these readings" in found.cause
    assert "hold" not in found.cause


def test_an_unknown_at_its_bound_stops_no_other():
    """A width of rolled-off edges that would become negative stays where it has a derivative."""
    _, data = samples(40)
    chosen = rigs.choice().add_unknowns({"rolloff.width": 0.05})
    task = Task(NOMINAL, data, chosen, None)
    start = task.start.copy()
    start[PLACE["rolloff.width"]] = 0.03
    at = task.guess(start, np.zeros((40, 9)))
    _, _, normal = task.linearise(at, np.inf)
    step = np.where(np.array(chosen.names) == "rolloff.width", -1.0, 1e-4)
    there = task.take_step(at, normal, step)
    assert there is not None
    assert there.values[PLACE["rolloff.width"]] == LOWER_BOUNDS_MM["rolloff.width"]
    others = there.values[chosen.places][:-1] - at.values[chosen.places][:-1]
    assert others == pytest.approx(1e-4)
    matrix, side = task.hold_at_bounds(there, *task.add_prior(there, normal))
    assert np.linalg.solve(matrix, side)[-1] >= 0


@pytest.mark.parametrize(("chi_square", "excess"), [(700.0, 0.0), (950.0, 0.0), (1200.0, 0.3)])
def test_chi_square_exceeds_what_chance_allows_by_four_deviations(chi_square, excess):
    """Of 800 degrees of freedom the reduced chi-square has the standard deviation 0.05."""
    _, data = samples(12)
    found = replace(fit(NOMINAL, data, rigs.choice(), most=1), chi_square=chi_square, freedom=800.0)
    assert found.reduced_chi_square == pytest.approx(chi_square / 800)
    assert found.excess == pytest.approx(excess)


def test_a_power_that_a_fit_puts_below_zero_is_named():
    _, data = samples(24)
    found = fit(NOMINAL, data, choice(NOMINAL, SETTINGS))
    astray = found.open.copy()
    astray[:, 6] = -1e5
    with pytest.raises(facets.InputError, match="these 24 samples do not determine it"):
        fit_steady_laser(NOMINAL, data, replace(found, open=astray), SETTINGS.outliers)
