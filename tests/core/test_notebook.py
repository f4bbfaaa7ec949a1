"""What notebooks and terminals show of objects: a line of words, and a table with units."""

import numpy as np
import pytest

import facets

PAPER = "0.3 mW, beam 0.85 mm, facets 45 deg, PSDs 13 x 13 mm at 250 mm"


@pytest.mark.parametrize(
    ("thing", "line"),
    [
        (facets.Sensor(), f"Sensor: {PAPER}"),
        (facets.Beam(power=0.4), "Beam(power=0.4)"),
        (facets.Samples(np.zeros((20, 9))), "Samples(readings=array(20, 9), numbers=array(20))"),
        (facets.load("paper"), f"Config: paper, 3 motions, {PAPER}"),
    ],
)
def test_an_object_is_one_line_of_what_differs_from_its_defaults(thing, line):
    assert repr(thing) == line


def test_a_solution_says_how_many_poses_are_right():
    sensor, noise = facets.Sensor(), np.random.default_rng(1)
    readings = facets.add_noise(sensor, facets.readings(sensor, np.zeros((1000, 8))), noise)
    readings[:2] = np.nan
    solution = facets.solve(sensor, readings)
    expected = (
        "Solution: 1,000 poses, 997 ok, residual 1.02 of 1.00 expected; the first misfits: [65]"
    )
    assert repr(solution) == expected
    table = solution._repr_html_()
    assert table.count("<tr") == 6
    for text in ("<td>non finite", "\u00a0±\u00a00.00", "... 995 more rows"):
        assert text in table


def test_a_sensor_shows_the_keys_that_differ_with_units_and_a_plan_of_its_head():
    sensor = facets.load("bench-light").sensor
    assert repr(sensor).endswith("250 mm; differs from the paper's in beam, light")
    page = sensor._repr_html_()
    for cell in ("sensor.beam.diameter_mm[0]", "0.86", "mm", "light.background_uw", "<svg"):
        assert cell in page
    assert "psd" not in page
    assert "<td>sensor.psd.b.height_mm" in facets.load("rig").sensor._repr_html_()
