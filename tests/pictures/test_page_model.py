"""The page's model is the package's: ranges, saturation, and poses under light that tests of all
executions leave out. Its readings and other poses are compared there."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from estimators import Question, script, solve_batch, solve_page
from executions import COATED, as_script, ask_page
from sensors import SENSORS

import facets
from facets import Rules, pictures
from facets.characterization import ranges
from facets.detectors import fullness

ELECTRONICS = facets.Electronics(transimpedance=3e4)
CUT = replace(
    SENSORS["skewed0"],
    apertures=facets.Apertures(beam=1.0, detectors=True, rim=0.6, tip=0.01, gap=0.005),
)
FINE = Rules(coarsest=(4e-3, 4e-3, 3.5e-3, np.inf, np.inf, 1.4e-5), condition=3e4)
PAPER, BENCH = facets.Sensor(), facets.load("bench").sensor
needs_node = pytest.mark.skipif(not shutil.which("node"), reason="needs Node")


@needs_node
@pytest.mark.parametrize(
    ("sensor", "rules"),
    [
        (PAPER, FINE),
        (BENCH, FINE),
        (facets.load("bench-light").sensor, Rules()),
        pytest.param(
            replace(CUT, electronics=ELECTRONICS),
            Rules(whole_spot=False),
            marks=pytest.mark.slow,
        ),
    ],
    ids=["plain", "electronics", "light", "cut"],
)
def test_the_page_knows_the_range_as_the_package_does(sensor, rules):
    poses = np.random.default_rng(2).uniform(-1, 1, (60, 6)) * [0.3, 0.3, 8, 0.02, 0.02, 0.03]
    poses[::7] *= 5
    page = ask_page(
        f"{{axes: Model.axisRanges(), margins: {as_script(poses)}.map("
        "(pose) => Model.clearances(pose).map(String))}",
        pictures.page.model.model(sensor, rules),
    )
    count = 3 if sensor.light.on else 5  # under light, conditioning is that of the solver's steps
    margins = np.array(page["margins"], float)[:, :count]
    expected = ranges.clearances(sensor, poses, rules)[:, :count]
    np.testing.assert_allclose(margins, expected, rtol=1e-9, atol=1e-9)
    for axis, shown in zip(
        facets.axis_ranges(sensor, rules, np.zeros(6)), page["axes"], strict=True
    ):
        assert [shown["low"], shown["high"]] == pytest.approx([axis.low, axis.high], abs=1e-7)
        assert [shown["lowCause"], shown["highCause"]] == [axis.low_cause, axis.high_cause]


@needs_node
@pytest.mark.parametrize("sensor", [PAPER, BENCH], ids=["plain", "electronics"])
def test_a_saturated_detector_reads_nothing(sensor):
    states = np.zeros((41, 8))
    states[:, 0], states[:, 1] = np.linspace(-0.5, 0.5, 41), 0.2
    page = ask_page(
        f"""{json.dumps(states.tolist())}.map((state) => {{
          const values = Model.readings(state);
          return [Model.saturated(values), Model.noisy(values, 3).map(Number.isNaN)]; }})""",
        script(sensor),
    )
    expected = fullness(sensor, facets.readings(sensor, states)) > 1
    assert [saturated for saturated, _ in page] == expected.tolist()
    assert [empty for _, empty in page] == np.repeat(expected, 3, axis=1).tolist()
    assert expected.any() == (sensor is BENCH)


@needs_node
@pytest.mark.slow
def test_the_page_finds_poses_from_cut_light_on_a_coating():
    sensor = replace(CUT, light=COATED)
    states = np.random.default_rng(5).uniform(-1, 1, (40, 8))
    states *= [0.15, 0.15, 0.4, 0.005, 0.005, 0.012, 0.05, 0.05]
    states[:, 6:] = 0.0
    question = Question(sensor, facets.readings(sensor, states), beam="known")
    page, expected = solve_page(question), solve_batch(question)
    np.testing.assert_array_equal(page.status, expected.status)
    np.testing.assert_allclose(page.state, expected.state, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(page.residual, expected.residual, rtol=1e-9, atol=1e-9)
    assert (expected.status == facets.Status.CONVERGED).sum() > 20


def test_a_sensor_whose_solver_cannot_be_carried_says_so():
    electronics = facets.Electronics(kind="tetra-lateral")
    assert "not of tetra-lateral ones" in script(replace(PAPER, electronics=electronics))


class Holder(NamedTuple):
    function: Any


def call_of_no_field(thing: Holder):
    return thing.missing(1.0)


def test_a_call_of_what_is_no_field_is_not_translated():
    with pytest.raises(TypeError, match=r"thing\.missing"):
        pictures.page.javascript.javascript(call_of_no_field)
