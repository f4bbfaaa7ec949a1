"""Layouts: the symbols are the model; optima are optima; what cannot be met is named."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

import facets
from facets import BenchLight, ConfigError, InputError, Knowledge, design, optimize, uncertainties
from facets.characterization import measures
from facets.core import AmplifierPart, PsdPart
from facets.design import (
    add_worst_states,
    expand_objective,
    expand_rows,
    meets,
    present_values,
    problem_of,
    round_design,
    sensor_of,
    span_of,
    states_of,
    step_of,
)

CONFIG = facets.load("layout")
TWO = {name: CONFIG.layout.variables[name] for name in ("radius_mm", "diameter_mm")}
SCALE = np.array([1e3, 1e3, 1e3, 1e6, 1e6, 1e6])


@pytest.mark.parametrize("aim", ["mean-resolution", "condition", "range", "weighted"])
def test_derivatives_are_those_of_values(aim):
    """Beside differences with other steps, at layouts within and at the ends of the bounds."""
    weights = {"mean-resolution": 1.0, "resolution": 0.5, "size": 2.0} if aim == "weighted" else {}
    problem = problem_of(CONFIG.sensor, replace(CONFIG.layout, aim=aim, weights=weights))
    rng = np.random.default_rng(1)
    rows = problem.rows.subset(rng.permutation(len(problem.rows))[:40])
    for shares in (rng.random(5), np.zeros(5), np.ones(5)):
        unknowns = problem.first_guess(problem.low + (problem.high - problem.low) * shares)
        way = rng.normal(size=problem.count)
        for expand, weights in (
            (lambda x: expand_rows(problem, x, rows), rng.random(40)),
            (lambda x: expand_objective(problem, x), np.full(1, 0.7)),
        ):
            here, ahead, behind = (expand(unknowns + step * way) for step in (0, 3e-5, -3e-5))
            slopes = (ahead.values - behind.values) / 6e-5
            bends = weights @ (ahead.slopes - behind.slopes) / 6e-5
            size = np.abs(slopes).max()
            np.testing.assert_allclose(here.slopes @ way, slopes, rtol=1e-5, atol=1e-6 * size)
            hessian, size = here.curvature(weights), np.abs(bends).max()
            np.testing.assert_array_equal(hessian, hessian.T)
            np.testing.assert_allclose(hessian @ way, bends, rtol=3e-3, atol=1e-3 * size)


VOLUME = np.array(states_of(CONFIG.layout, 1.0), dtype=float)


def worst(x, names):
    """The objective and the least of the constraints by the float model alone."""
    sensor, layout = sensor_of(CONFIG.sensor, names, np.asarray(x, dtype=float)), CONFIG.layout
    sigma = uncertainties(sensor, VOLUME, Knowledge()) * SCALE
    reading = facets.readings(sensor, VOLUME)
    room = float(facets.margins(sensor, VOLUME)[:, :, :4].min())
    power = float(reading[:, 2::3].min() / layout.least_power - 1)
    head = 1 - 2 * sensor.psds[0].radius / layout.head
    return float((sigma / np.array(layout.unit)).max()), min(room, power, head)


def worst_over(sensor, layout):
    """The largest standard uncertainties (6,) over the volume, um and urad, by the float model."""

    def fineness(places):
        return -uncertainties(sensor, places, Knowledge()) * SCALE

    return -fineness(add_worst_states(span_of(layout), fineness)).min(axis=0)


def test_all_starts_end_at_the_same_optimum_which_numbers_that_can_be_made_keep():
    optimum = optimize(CONFIG.sensor, replace(CONFIG.layout, starts=2))
    best, names = optimum.best, optimum.names
    assert all(end.found for end in optimum.results)
    assert np.ptp([end.objective for end in optimum.results]) < 1e-6
    made = round_design(optimum.problem, best.x)
    for name, value, step in zip(names, made.x, made.steps, strict=True):
        assert step == pytest.approx(step_of(name))
        assert value / step == pytest.approx(round(value / step), abs=1e-6)
    present = [present_values(CONFIG.sensor)[name] for name in names]
    for x, objective in ((best.x, best.objective), (made.x, made.objective),
                         (present, optimum.before)):  # fmt: skip
        value, room = worst(x, names)
        assert value == pytest.approx(np.sqrt(objective), rel=1e-6)
        assert room > -1e-6 or x is present
    assert best.objective - 1e-7 < made.objective < 1.02 * best.objective
    assert best.objective < 0.56 * optimum.before


@pytest.mark.slow
def test_an_independent_optimiser_finds_no_better():
    """Two variables, Nelder and Mead's simplex on the float model with a penalty for the worst
    violated constraint."""
    from scipy.optimize import minimize

    layout = replace(CONFIG.layout, variables=TWO)
    problem = problem_of(CONFIG.sensor, layout)

    def penalised(x):
        short = problem.values(problem.first_guess(np.asarray(x))).min()
        return worst(x, [*TWO])[0] + 100 * max(-short, 0)

    best = np.sqrt(optimize(CONFIG.sensor, layout).best.objective)
    rival = minimize(penalised, [200, 1.0], method="Nelder-Mead", options={"xatol": 1e-4}).fun
    assert rival > 0.999 * best
    assert rival == pytest.approx(best, rel=5e-3)


@pytest.mark.parametrize("aim", ["size", "condition", "mean-resolution", "range"])
def test_every_aim_gets_better(aim):
    limit = (np.inf, np.inf, 2.3, 8.0, 8.0, np.inf) if aim != "range" else (np.inf,) * 6
    optimum = optimize(CONFIG.sensor, replace(CONFIG.layout, aim=aim, starts=1, limit=limit))
    objective = optimum.best.objective
    assert optimum.best.found
    assert objective < optimum.before - 0.01
    better = sensor_of(CONFIG.sensor, optimum.names, optimum.best.x)
    sigma = uncertainties(better, VOLUME, Knowledge()) * SCALE / CONFIG.layout.unit
    meaning = {"size": better.psds[0].radius / 50, "mean-resolution": (sigma**2).mean()}
    assert objective == pytest.approx(meaning.get(aim, objective), rel=1e-6)
    if aim == "condition":  # the largest singular value is a part of all, here
        old, new = (measures(s, VOLUME)[:, 2].max() for s in (CONFIG.sensor, better))
        assert new < old
        assert new <= 10**objective <= 8 * new


def test_a_weighted_sum_lies_between_its_parts():
    """All the weight on one aim is that aim; some on the other gives some of the other."""
    layout = replace(CONFIG.layout, aim="weighted", starts=1, variables=TWO)
    best = {}
    for size in (0.0, 0.2, 1.0):
        weights = {"resolution": 1.0, "size": size}
        best[size] = optimize(CONFIG.sensor, replace(layout, weights=weights)).best
        assert best[size].found
    alone = optimize(CONFIG.sensor, replace(layout, aim="resolution")).best
    assert best[0.0].objective == pytest.approx(np.sqrt(alone.objective), rel=1e-6)
    assert best[1.0].x[0] < best[0.2].x[0] < best[0.0].x[0] - 0.1


def test_one_detector_alone_can_vary():
    """Symmetric otherwise, so nothing is gained by the third detector's place but by its turn."""
    names = {"psd_c_radius_mm": (200.0, 250.0), "psd_c_pitch_mrad": (-200.0, 200.0)}
    optimum = optimize(CONFIG.sensor, replace(CONFIG.layout, variables=names, starts=2))
    x, objective = optimum.best.x, optimum.best.objective
    *others, third = sensor_of(CONFIG.sensor, optimum.names, x).psds
    assert others == [*CONFIG.sensor.psds[:2]]
    assert (third.radius, third.pitch) == pytest.approx((x[0], 1e-3 * x[1]))
    assert objective < optimum.before + 1e-6
    assert np.sqrt(objective) == pytest.approx(worst(x, [*names])[0])


def test_a_layout_is_checked_again_by_what_shares_nothing_with_the_optimiser():
    sensor, layout = CONFIG.sensor, CONFIG.layout
    table = design.results.verification.compare(sensor, sensor, layout, CONFIG.range, 1)
    np.testing.assert_allclose(table["before"], table["after"], rtol=0.05)
    row = dict(zip(table["quantity"], table["after"], strict=True))
    spread = dict(zip(table["quantity"], table["simulated"], strict=True))
    for name in ("u_tx_um", "u_tz_um", "u_roll_urad", "u_yaw_urad"):
        assert spread[name] == pytest.approx(row[name], rel=0.05)  # 5000 draws: 1 % of 1 sigma
    assert row["u_roll_urad"] == pytest.approx(worst_over(sensor, layout)[3], rel=1e-3)
    assert row["range_roll_mrad"] == pytest.approx(28.0, abs=0.1)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("variables: {size_mm: [5, 20]}", "size_mm cannot both vary and come from optimize.parts"),
        ("aim: weighted", "every one of optimize.weights is 0"),
        ("variables: {psd_d_radius_mm: [5, 20]}", "unknown key"),
        ("variables: {radius_mm: [300, 100]}", "bad.yaml:3.*least must be below"),
    ],
)
def test_contradictions_are_told(tmp_path, text, words):
    path = tmp_path / "bad.yaml"
    path.write_text(f"extends: [layout, parts]\noptimize:\n  {text}\n")
    with pytest.raises(ConfigError, match=words):
        facets.load(path)


def test_what_can_not_be_met_is_named():
    limit = (np.inf, np.inf, 0.1, np.inf, np.inf, np.inf)
    layout = replace(CONFIG.layout, limit=limit, starts=1, variables=TWO)
    found = optimize(CONFIG.sensor, layout)
    assert not found.best.found
    assert "uncertainty of tz" in found.best.shortfalls


ELECTRONICS = facets.Electronics()


@pytest.mark.parametrize(
    ("effects", "asked", "words"),
    [
        ({"electronics": facets.Electronics(kind="tetra-lateral")}, {}, "tetra-lateral one is a"),
        ({"apertures": facets.Apertures(beam=1.0)}, {}, "does not support sensor.apertures.beam_r"),
        ({"light": BenchLight(tip=1e-5)}, {}, "does not support sensor.light"),
        ({"calibration": facets.Calibration((), ())}, {}, "belongs to an existing rig"),
        ({"electronics": ELECTRONICS}, {"amplifiers": {"a": AmplifierPart(1e-5, 1.0)}}, "noise of"),
        ({"electronics": ELECTRONICS}, {"psds": {"a": PsdPart(10.0, 0.001, 1.0)}}, "noise of"),
        ({"electronics": ELECTRONICS},
         {"psds": {str(n): PsdPart(10.0 + n, None, 1.0) for n in range(25)}}, "larger detector"),
        ({}, {"variables": {"transimpedance_kohm": (5.0, 5000.0)}}, "needs sensor.noise.model"),
        ({}, {"variables": {}}, "state what may vary"),
    ],
)  # fmt: skip
def test_what_can_not_be_optimised_is_an_error(effects, asked, words):
    with pytest.raises(InputError, match=words):
        optimize(replace(CONFIG.sensor, **effects), replace(CONFIG.layout, **asked))


#: A volume in which the beam's place has a width, and angles are large.
WIDE = replace(CONFIG.layout, volume=(0.05, 0.05, 1.5, 0.012, 0.012, 0.02, 0.05, 0.1), starts=1)


@pytest.mark.slow
def test_the_worst_over_the_volume_is_the_worst_anywhere_in_it():
    """64 of the 256 corners had 1.1439 for 1.1525."""
    found = optimize(CONFIG.sensor, WIDE)
    sensor = sensor_of(found.sensor, found.names, found.best.x)
    corners = list(itertools.product((-1, 1), repeat=8))
    drawn = np.clip(np.random.default_rng(1).uniform(-1.5, 1.5, (20_000, 8)), -1, 1)
    states = np.concatenate([corners, drawn]) * WIDE.volume
    largest = (uncertainties(sensor, states, Knowledge()) * SCALE / WIDE.unit).max()
    assert 1 - 1e-2 <= largest / np.sqrt(found.best.objective) <= 1 + 1e-6
    assert facets.margins(sensor, states)[:, :, :4].min() >= -1e-6


def test_a_limit_that_is_broken_between_the_corners_alone_is_broken():
    volume = (0.05, 0.05, 1.5, 0.006, 0.006, 0.012, 0.05, 0.1)
    layout = replace(CONFIG.layout, volume=volume, least_power=0.01)
    places = np.array(states_of(layout, 1.0))
    roll = uncertainties(CONFIG.sensor, places, Knowledge())[:, 3].max() * SCALE[3]
    anywhere = worst_over(CONFIG.sensor, layout)[3]
    assert anywhere > roll * (1 + 1e-5)
    for limit, met in ((roll * (1 + 1e-6), False), (anywhere * (1 + 1e-6), True)):
        limited = replace(layout, limit=(*[np.inf] * 3, limit, *[np.inf] * 2))
        assert meets(CONFIG.sensor, limited, places) is met
