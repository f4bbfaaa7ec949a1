"""What notebooks and terminals show of objects: a line of words, and a table with units."""

import numpy as np
import pytest

import facets


@pytest.mark.parametrize(
    ("thing", "line"),
    [
        (facets.Sensor(), "Sensor()"),
        (facets.Sensor(beam=facets.Beam(power=0.4)), "Sensor(beam=Beam(power=0.4))"),
        (facets.Samples(np.zeros((20, 9))), "Samples(readings=array(20, 9), numbers=array(20))"),
        (facets.load("paper"), "Config: paper, 3 motions, Sensor()"),
    ],
)
def test_an_object_is_one_line_of_what_differs_from_its_defaults(thing, line):
    assert repr(thing) == line


def test_a_solution_says_how_many_poses_are_right():
    sensor, noise = facets.Sensor(), np.random.default_rng(1)
    readings = facets.add_noise(sensor, facets.readings(sensor, np.zeros((1000, 8))), noise)
    readings[:2] = np.nan
    solution = facets.solve(sensor, readings)
    assert repr(solution) == "Solution: 1,000 poses, 997 ok, residual 1.02 of 1.00 expected"
    table = solution._repr_html_()
    assert table.count("<tr") == 6
    assert "u_tx_mm" in table


def test_a_sensor_shows_the_keys_that_differ_with_units_and_a_plan_of_its_head():
    page = facets.load("bench-light").sensor._repr_html_()
    for cell in ("beam.diameter_mm[0]", "0.86", "mm", "light.background_uw", "<svg"):
        assert cell in page
    assert "radius_mm" not in page
    assert len(repr(facets.load("bench-light").sensor)) <= 161
