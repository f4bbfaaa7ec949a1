"""The Pareto front by continuation: against fronts that are known, and against a cloud."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets import InputError, Knowledge, design, uncertainties
from facets.design import (
    MEASURES,
    Space,
    pareto_front,
    part_of,
    sensor_of,
)

CONFIG = facets.load("layout")


def space_of(objectives, names, **more):
    variables = {name: CONFIG.layout.variables[name] for name in names}
    layout = replace(CONFIG.layout, variables=variables)
    return Space(CONFIG.sensor, CONFIG.range, layout, 100, 1, objectives, **more)


def beaten_by_cloud(front, space, count):
    """Points of a front that one of the first designs of a space beats by more than a thousandth,
    which is the tolerance of the designs' ranges."""
    table = part_of(replace(space, part=count), 0)
    trade = front.walk.trade
    costs = trade.costs_of_measures(np.stack([table[name] for name in MEASURES], axis=1))
    mine = trade.costs_of_measures(front.measures)
    limits = mine - 1e-3 * np.abs(mine)
    return sum((costs < limit).all(axis=1).any() for limit in limits)


def test_radius_against_resolution_is_the_curve_that_it_is():
    """All else fixed, the front is u_roll as a function of the radius, and its slope the price."""
    space = space_of(("u_roll_urad", "head_mm"), ["radius_mm"])
    front = pareto_front(space, 7, 1)
    assert len(front.designs) >= 6
    assert front.left_out == 0
    roll, head = (MEASURES.index(name) for name in space.objectives)
    prices = front.prices[:, front.objectives.index("head_mm")]
    steps = np.diff(front.measures[:, head])[1:-1]
    np.testing.assert_allclose(steps, steps.mean(), rtol=1e-4)

    def roll_at(diameter):
        sensor = sensor_of(space.sensor, ["radius_mm"], np.array([diameter / 2]))
        return 1e6 * uncertainties(sensor, np.zeros((1, 8)), Knowledge())[0, 3]

    for measures, price in list(zip(front.measures, prices, strict=True))[1:-1]:
        assert measures[roll] == pytest.approx(roll_at(measures[head]), rel=1e-9)
        slope = (roll_at(measures[head] + 0.01) - roll_at(measures[head] - 0.01)) / 0.02
        assert price == pytest.approx(-slope, rel=1e-4)


@pytest.mark.slow
def test_no_design_of_a_cloud_beats_the_front():
    space = space_of(("u_roll_urad", "range_roll_mrad"), ["radius_mm", "pitch_mrad", "diameter_mm"])
    front = pareto_front(space, 8, 1)
    assert len(front.designs) >= 7
    assert beaten_by_cloud(front, space, 100) == 0
    table = design.exploration.front.columns(front)
    assert (np.diff(table["u_roll_urad"]) > 0).all()
    assert (np.diff(table["range_roll_mrad"]) > 0).all()
    assert any("spot on PSD" in words for words in table["holds_it_back"])
    assert not any("as low as it can be" in words for words in table["holds_it_back"])


TIP = facets.MeasuredObject((0.0, 0.0, 20.0), (0.0, 0.0, 0.5))


@pytest.mark.parametrize(
    ("objectives", "names", "more"),
    [
        (("u_roll_urad", "head_mm", "range_yaw_mrad"), ["radius_mm", "diameter_mm"],
         {"sensor": facets.load("skewed").sensor}),
        (("u_pitch_urad", "range_pitch_mrad"), ["diameter_mm"],
         {"rules": replace(CONFIG.range, object=TIP)}),
        (("head_mm", "u_roll_urad"), ["radius_mm"],
         {"sensor": replace(CONFIG.sensor, electronics=facets.Electronics(bandwidth=5e3))}),
    ],
    ids=["three of a skewed head", "of an object", "of amplifiers"],
)  # fmt: skip
@pytest.mark.slow
def test_points_of_a_front_have_the_measures_that_were_found_for_them(objectives, names, more):
    """Also at the ends of the ranges; else they were left out."""
    space = replace(space_of(objectives, names), **more)
    space = replace(space, layout=replace(space.layout, object=space.rules.object))
    front = pareto_front(space, 7, 1)
    assert len(front.designs) >= 3
    assert front.left_out == 0
    assert beaten_by_cloud(front, space, 20) == 0


@pytest.mark.slow
def test_what_is_required_holds_on_the_front():
    """The volume keeps a head from being as small as it could be by itself."""
    space = space_of(("u_roll_urad", "head_mm"), ["radius_mm"], required=True)
    limit = (np.inf, np.inf, np.inf, 9.0, np.inf, np.inf)
    space = replace(space, layout=replace(space.layout, limit=limit))
    front, free = (pareto_front(replace(space, required=must), 3, 1) for must in (True, False))
    place = MEASURES.index("head_mm")
    assert free.measures[:, place].min() < front.measures[:, place].min() - 1
    assert beaten_by_cloud(front, space, 8) == 0  # along a line


@pytest.mark.parametrize(
    ("objectives", "words"),
    [
        (("u_roll_urad", "condition"), "cannot follow condition"),
        (("u_roll_urad",), "two or three"),
    ],
)
def test_what_has_no_front_is_refused(objectives, words):
    with pytest.raises(InputError, match=words):
        pareto_front(space_of(objectives, ["radius_mm"]), 3, 1)


@pytest.mark.slow
def test_the_command_follows_a_front_and_writes_one_of_its_designs(run_in_process, tmp_path):
    (tmp_path / "mine.yaml").write_text(
        "extends: paper\n"
        "optimize: {variables: {radius_mm: [150, 260], inclination_deg: [40, 50]}}\n"
    )
    words = ("explore", "mine.yaml", "--front", "--objective", "u_roll_urad", "--objective",
             "range_roll_mrad", "-d", "out")  # fmt: skip
    status, printed, errors = run_in_process(*words, "--points", "6")
    assert status == 0, errors
    assert "u_roll_urad per range_roll_mrad" in printed
    assert "as it is: u_roll_urad 4.24" in printed
    assert (tmp_path / "out" / "pareto.png").exists()
    status, printed, errors = run_in_process(*words, "--pick", "2", "-o", "two.yaml")
    assert status == 0, errors
    assert "psd.height_mm" in printed  # everything that moved is told
    text = (tmp_path / "two.yaml").read_text()
    assert "extends: mine.yaml" in text
    assert len([line for line in text.splitlines() if line and line[0] != "#"]) < 12
    psds = facets.load(tmp_path / "two.yaml").sensor.psds
    assert psds[1].height == psds[0].height != 0
