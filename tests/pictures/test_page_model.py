"""The page's model is the package's: ranges, saturation, and poses under light that tests of all
executions leave out. Its readings and other poses are compared there."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from estimators import Question, script, solve_batch, solve_page
from executions import COATED, as_script, ask_page
from sensors import SENSORS, states

import facets
from facets import Rules, pictures
from facets.characterization import ranges
from facets.detectors import fullness
from facets.pictures import PosedSensor, scene

ELECTRONICS = facets.Electronics(transimpedance=3e4)
CUT = replace(
    SENSORS["skewed0"],
    apertures=facets.Apertures(beam=1.0, detectors=True, rim=0.6, tip=0.01, gap=0.005),
)
FINE = Rules(coarsest=(4e-3, 4e-3, 3.5e-3, np.inf, np.inf, 1.4e-5), condition=3e4)
PAPER, BENCH = facets.Sensor(), facets.load("bench").sensor
pytestmark = pytest.mark.skipif(not shutil.which("node"), reason="needs Node")


@pytest.mark.parametrize(
    ("sensor", "rules"),
    [
        (BENCH, FINE),
        (facets.load("bench-light").sensor, Rules()),
        (replace(CUT, electronics=ELECTRONICS), Rules(whole_spot=False)),
    ],
    ids=["electronics", "light", "cut"],
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
    axes = facets.axis_ranges(sensor, rules, np.zeros(6))
    for axis, shown in zip(axes, page["axes"], strict=True):
        assert (shown["lowCause"], shown["highCause"]) == (axis.low_cause, axis.high_cause)
        assert (shown["low"], shown["high"]) == pytest.approx((axis.low, axis.high), abs=1e-7)


def test_a_saturated_detector_reads_nothing():
    given = np.zeros((41, 8))
    given[:, 0], given[:, 1] = np.linspace(-0.5, 0.5, 41), 0.2
    saturated, empty = ask_page(
        f"((all) => [all.map(Model.saturated), all.map((values) => "
        f"Model.noisy(values, 3).map(Number.isNaN))])({as_script(given)}.map(Model.readings))",
        script(BENCH),
    )
    expected = fullness(BENCH, facets.readings(BENCH, given)) > 1
    assert expected.any()
    assert saturated == expected.tolist()
    assert empty == np.repeat(expected, 3, axis=1).tolist()


def test_what_is_drawn_lies_where_the_model_has_it():
    """The spots of the apex and of the beam, and the facets that the beam meets."""
    sensor = SENSORS["skewed1"]
    given = [*states(5, 1), *states(5, 2, offset=1.5, angle=0.2)]
    page = ask_page(
        f"{as_script(given)}.map((state) => Model.drawing(state).facets)", script(sensor)
    )
    for state, drawn in zip(given, page, strict=True):
        posed = PosedSensor.from_state(sensor, state)
        for k, facet in enumerate(drawn):
            spot = scene.spot(posed, k)
            assert facet["meets"]
            assert facet["apexSpot"] == pytest.approx(spot.apex, abs=1e-9)
            assert facet["beamSpot"] == pytest.approx(spot.beam, abs=1e-9)


@pytest.mark.slow
def test_the_page_finds_poses_from_cut_light_on_a_coating():
    sensor = replace(CUT, light=COATED)
    ends = [0.15, 0.15, 0.4, 0.005, 0.005, 0.012, 0, 0]
    given = np.random.default_rng(5).uniform(-1, 1, (40, 8)) * ends
    question = Question(sensor, facets.readings(sensor, given), beam="known")
    page, expected = solve_page(question), solve_batch(question)
    np.testing.assert_array_equal(page.status, expected.status)
    np.testing.assert_allclose(page.state, expected.state, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(page.residual, expected.residual, rtol=1e-9, atol=1e-9)
    assert (expected.status == facets.Status.CONVERGED).sum() > 20
