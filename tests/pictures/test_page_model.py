"""The page's model is the package's: equal poses, statuses, uncertainties and ranges."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from browser import Browser
from sensors import SENSORS

import facets
from facets import BenchLight, Rules
from facets.characterization import ranges
from facets.detectors import fullness, least_light
from facets.model import geometry_of
from facets.pictures.page import clearance
from facets.pictures.page.model import full_light, model

CUT = replace(
    SENSORS["skewed0"],
    apertures=facets.Apertures(beam=1.0, detectors=True, rim=5.0, tip=0.01, gap=0.005),
)
COATED = BenchLight(index=(1.4, 7.5), background=((1e-4, 1.0, 2.0),) * 3)
KINDS = {
    "plain": facets.Sensor(),
    "skewed": SENSORS["skewed1"],
    "electronics": facets.load("bench").sensor,
    "light": facets.load("bench-light").sensor,
    "cut": CUT,
    "cut and coated": replace(CUT, light=COATED),
}
ASKED = [("free", "known"), ("known", "known"), ("known", "unknown"), ("free", "unknown")]
needs_browser = pytest.mark.skipif(not shutil.which("chromium"), reason="needs Chromium")
#: Half widths of states in which each kind has poses, and some that it must refuse; mm and rad.
BOX = np.array([0.15, 0.15, 0.4, 0.005, 0.005, 0.012, 0.05, 0.05])
SOLVE = """READINGS.map((values) => ASKED.map(([beam, power]) => {
  const found = Model.solve(values.map(Number), {beam, power});
  return {...found, state: found.state.map(String), uncertainty: found.uncertainty.map(String),
    residual: String(found.residual), limit: String(found.limit), covariance: null};
}))"""


def readings_of(sensor, seed):
    """Readings of 200 states, and as many with noise; some states are far off."""
    rng = np.random.default_rng(seed)
    states = rng.uniform(-1, 1, (200, 8)) * BOX
    states[::10] *= 5
    exact = facets.readings(sensor, states)
    masked = np.where(np.repeat(facets.reaches(sensor, states), 3, axis=1), exact, np.nan)
    return np.concatenate([masked, facets.add_noise(sensor, exact, rng)])


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    page = tmp_path_factory.mktemp("page") / "empty.html"
    page.write_text("<!doctype html><body>", "utf-8")
    with Browser(f"file://{page}") as found:
        yield found
        assert not found.errors


@needs_browser
@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_the_page_solves_as_the_package_does(browser, name):
    """200 states and 200 with noise, by all that can be known of the beam."""
    sensor = KINDS[name]
    combinations = ASKED if name == "plain" else ASKED[:2]
    given = readings_of(sensor, seed=list(KINDS).index(name))
    texts = json.dumps([[str(value) for value in row] for row in given.tolist()])
    asked = SOLVE.replace("READINGS", texts.replace("nan", "NaN")).replace(
        "ASKED", json.dumps(combinations)
    )
    told = browser.ask("(() => {" + model(sensor) + f"return {asked};" + "})()")
    converged = 0
    for n, (beam, power) in enumerate(combinations):
        wanted, found = (
            facets.solve(sensor, given, beam=beam, power=power),
            [row[n] for row in told],
        )
        labels = [facets.Status(int(status)).label for status in wanted.status]
        assert [one["status"] for one in found] == labels
        assert [one["ok"] for one in found] == wanted.ok.tolist()
        for what in ("state", "uncertainty", "residual", "limit"):
            theirs = np.array([one[what] for one in found], float)
            ours = getattr(wanted, what)
            assert np.allclose(theirs, ours, rtol=1e-9, atol=1e-9, equal_nan=True), (what, beam)
        converged += wanted.converged.sum()
    assert converged > 300


def test_a_sensor_whose_solver_cannot_be_carried_says_so():
    electronics = facets.Electronics(kind="tetra-lateral")
    assert "not of tetra-lateral ones" in model(replace(KINDS["plain"], electronics=electronics))


def poses(count, seed):
    """Half of them in the range of a rig, and some far off."""
    found = np.random.default_rng(seed).uniform(-1, 1, (count, 6)) * [0.3, 0.3, 8, 0.02, 0.02, 0.03]
    found[::7] *= 5
    return found


@pytest.mark.parametrize("whole", [True, False])
def test_the_margins_of_one_pose_are_those_of_many(whole):
    electronics = facets.Electronics(transimpedance=3e5)
    sensor = replace(CUT, apertures=facets.Apertures(rim=0.6), electronics=electronics)
    rules = Rules(whole_spot=whole)
    geometry, needed = geometry_of(sensor), least_light(sensor, rules.snr)
    given = poses(60, 3)
    wanted = ranges.clearances(sensor, given, rules)
    for pose, margins in zip(given, wanted, strict=True):
        state = (*pose.tolist(), 0.0, 0.0)
        reading = facets.readings(sensor, state).reshape(3, 3)
        ends = clearance.ends_of_spots(geometry, state)
        assert clearance.spot_clearance(sensor, ends, reading, whole) == pytest.approx(margins[0])
        light = clearance.light_clearance(reading, needed, (0.0, 0.0, 0.0))
        assert light == pytest.approx(margins[1])
        full = clearance.saturation_clearance(sensor, reading, full_light(sensor))
        assert full == pytest.approx(margins[2])


@needs_browser
@pytest.mark.slow
@pytest.mark.parametrize("name", ["plain", "electronics", "light"])
def test_the_page_knows_the_range_as_the_package_does(browser, name):
    sensor = KINDS[name]
    rules = Rules(coarsest=(4e-3, 4e-3, 3.5e-3, np.inf, np.inf, 1.4e-5), condition=3e4)
    rules = Rules() if sensor.light.on else rules
    given = poses(100, 2)
    told = browser.ask(
        "(() => {"
        + model(sensor, rules)
        + f"""
        const text = (pose) => Model.clearances(pose).map(String);
        return {{axes: Model.axisRanges(), causes: Model.causes,
          margins: {json.dumps(given.tolist())}.map(text)}}; }})()"""
    )
    count = 3 if sensor.light.on else 5  # under light, conditioning is that of the solver's steps
    found = np.array(told["margins"]).astype(float)[:, :count]
    wanted = ranges.clearances(sensor, given, rules)[:, :count]
    assert np.allclose(found, wanted, rtol=1e-9, atol=1e-9, equal_nan=True)
    for axis, one in zip(facets.axis_ranges(sensor, rules, np.zeros(6)), told["axes"], strict=True):
        assert [one["low"], one["high"]] == pytest.approx([axis.low, axis.high], abs=1e-7)
        assert [one["lowCause"], one["highCause"]] == [axis.low_cause, axis.high_cause]


@needs_browser
@pytest.mark.slow
@pytest.mark.parametrize("name", ["plain", "electronics"])
def test_a_saturated_detector_reads_nothing(browser, name):
    sensor = KINDS[name]
    given = np.concatenate([np.zeros((41, 5)), np.zeros((41, 3))], axis=1)
    given[:, 0], given[:, 1] = np.linspace(-0.5, 0.5, 41), 0.2
    told = browser.ask(
        "(() => {"
        + model(sensor)
        + f"""
        return {json.dumps(given.tolist())}.map((state) => {{
          const values = Model.readings(state);
          return [Model.saturated(values), Model.noisy(values, 3).map(Number.isNaN)]; }}); }})()"""
    )
    wanted = fullness(sensor, facets.readings(sensor, given)) > 1
    assert [one[0] for one in told] == wanted.tolist()
    assert [one[1] for one in told] == np.repeat(wanted, 3, axis=1).tolist()
    assert wanted.any() == (name == "electronics")
