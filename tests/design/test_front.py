"""The Pareto front by continuation: against fronts that are known, and against a cloud."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from commands import command

import facets
from facets import InputError, Knowledge, design, uncertainties
from facets.design import (
    MEASURES,
    NO_RIVALS,
    Space,
    compare_with_designs,
    pareto_front,
    part_of,
    sensor_of,
)

CONFIG = facets.load("layout")


def space_of(objectives, names, **more):
    variables = {name: CONFIG.layout.variables[name] for name in names}
    layout = replace(CONFIG.layout, variables=variables)
    return Space(CONFIG.sensor, CONFIG.range, layout, "sobol", 200, 1, objectives, **more)


def roll_at(sensor):
    return 1e6 * uncertainties(sensor, np.zeros((1, 8)), Knowledge())[0, 3]


def test_radius_against_resolution_is_the_curve_that_it_is():
    """All else fixed, the front is u_roll as a function of the radius, and its slope the price."""
    space = space_of(("u_roll_urad", "head_mm"), ["radius_mm"])
    found = pareto_front(space, 9, 1)
    assert len(found.designs) >= 8
    assert found.left_out == 0
    roll, head = (MEASURES.index(name) for name in space.objectives)
    prices = found.prices[:, found.objectives.index("head_mm")]
    heads = found.measures[:, head]
    np.testing.assert_allclose(np.diff(heads)[1:-1], np.diff(heads)[1:-1].mean(), rtol=1e-4)
    for measures, price in list(zip(found.measures, prices, strict=True))[1:-1]:

        def at(diameter):
            return roll_at(sensor_of(space.sensor, ["radius_mm"], np.array([diameter / 2])))

        assert measures[roll] == pytest.approx(at(measures[head]), rel=1e-9)
        slope = (at(measures[head] + 0.01) - at(measures[head] - 0.01)) / 0.02
        assert price == pytest.approx(-slope, rel=1e-4)


@pytest.mark.slow
def test_no_design_of_a_cloud_beats_the_front():
    space = space_of(("u_roll_urad", "range_roll_mrad"), ["radius_mm", "pitch_mrad", "diameter_mm"])
    found = pareto_front(space, 12, 1)
    assert len(found.designs) >= 10
    cloud = part_of(replace(space, every=True), 0, NO_RIVALS)
    beside = compare_with_designs(found, cloud)
    assert beside.beaten == 0
    assert (beside.gains > -0.1).all()
    assert np.median(beside.gains) > 0.5
    table = design.front.columns(found)
    assert (np.diff(table["u_roll_urad"]) > 0).all()
    assert (np.diff(table["range_roll_mrad"]) > 0).all()
    assert any("spot on PSD" in words for words in table["holds_it_back"])
    assert not any("as low as it can be" in words for words in table["holds_it_back"])


@pytest.mark.slow
def test_three_objectives_have_a_front_also_of_a_skewed_head():
    space = space_of(("u_roll_urad", "head_mm", "range_yaw_mrad"), ["radius_mm", "diameter_mm"])
    space = replace(space, sensor=facets.load("skewed").sensor)
    found = pareto_front(space, 9, 1)
    assert len(found.designs) >= 3
    assert found.left_out == 0
    cloud = part_of(replace(space, every=True, part=60), 0, NO_RIVALS)
    assert compare_with_designs(found, cloud).beaten == 0


@pytest.mark.slow
def test_what_is_required_holds_on_the_front():
    """The volume keeps a head from being as small as it could be by itself."""
    space = space_of(("u_roll_urad", "head_mm"), ["radius_mm"], required=True)
    limit = (np.inf, np.inf, np.inf, 9.0, np.inf, np.inf)
    space = replace(space, layout=replace(space.layout, limit=limit))
    found = pareto_front(space, 4, 1)
    free = pareto_front(replace(space, required=False), 4, 1)
    place = MEASURES.index("head_mm")
    assert free.measures[:, place].min() < found.measures[:, place].min() - 1
    cloud = part_of(replace(space, every=True, part=16), 0, NO_RIVALS)  # along a line
    assert compare_with_designs(found, cloud).beaten == 0


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
def test_the_command_follows_a_front_and_writes_one_of_its_designs(tmp_path):
    goals = ("--objective", "u_roll_urad", "--objective", "range_roll_mrad")
    (tmp_path / "mine.yaml").write_text(
        "extends: paper\n"
        "optimize: {variables: {radius_mm: [150, 260], inclination_deg: [40, 50]}}\n"
    )
    result = command("explore", "mine.yaml", "--front", "--points", "6", *goals, "-d", "out",
                     cwd=tmp_path)  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert "u_roll_urad per range_roll_mrad" in result.stdout
    assert "as it is: u_roll_urad 4.24" in result.stdout
    assert (tmp_path / "out" / "pareto.png").stat().st_size > 10_000
    picked = command("explore", "mine.yaml", "--front", "--pick", "2", "--folder", "out", *goals,
                     "-o", "two.yaml", cwd=tmp_path)  # fmt: skip
    assert picked.returncode == 0, picked.stderr
    assert "psd.height_mm" in picked.stdout  # everything that moved is told
    text = (tmp_path / "two.yaml").read_text()
    assert "extends: mine.yaml" in text
    assert len([line for line in text.splitlines() if line and line[0] != "#"]) < 12
    sensor = facets.load(tmp_path / "two.yaml").sensor
    assert (10 * sensor.psds[0].radius) == pytest.approx(round(10 * sensor.psds[0].radius))
    assert sensor.psds[1].height == sensor.psds[0].height != 0
    for wrong, says in ((("--pick", "999"), "has no point 999"), (("--pick", "1"), "--force")):
        again = command("explore", "mine.yaml", "--front", *wrong, "--folder", "out",
                        *goals, "-o", "two.yaml" if says == "--force" else "three.yaml",
                        cwd=tmp_path)  # fmt: skip
        assert again.returncode == 2
        assert says in again.stderr
