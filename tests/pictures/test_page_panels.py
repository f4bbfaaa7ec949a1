"""The panels of a rig's page: geometry and its file, noise and the solved pose, the range."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from browser import Browser

import facets
from facets.core import STATE_UNITS
from facets.pictures.page.rig_page import estimate_sentences, omitted_keys, rig_page

needs_browser = pytest.mark.skipif(not shutil.which("chromium"), reason="needs Chromium")
STATE = np.array([0.02, -0.03, 0.4, 0.001, 0.002, 0.003, 0.01, 0.0])
MOVE = """(given) => {
  for (const [id, value] of Object.entries(given)) {
    const field = document.getElementById(id);
    field.value = value;
    field.dispatchEvent(new Event("input"));
  }
}"""
ROWS = """(id) => [...document.querySelectorAll(`#${id} tr`)].map((row) =>
  [...row.children].map((cell) => cell.textContent))"""


@pytest.fixture(scope="module", params=["paper", "rig", "bench-light"])
def shown(request, tmp_path_factory):
    """A configuration and its page, without WebGL."""
    config = facets.load(request.param)
    path = tmp_path_factory.mktemp("page") / "rig.html"
    text = rig_page(config.sensor, config.name, STATE, config=config)
    assert len(text.encode()) < 2_000_000
    path.write_text(text, "utf-8")
    with Browser(f"file://{path}") as browser:
        browser.await_true("document.querySelectorAll('#range-rows tr').length === 6")
        yield config, browser
        assert not browser.errors


def number(text):
    return float(text.replace("\u2212", "-"))


@needs_browser
@pytest.mark.slow
def test_the_saved_file_gives_the_readings_and_ranges_that_the_page_shows(shown, tmp_path):
    config, browser = shown
    psd, beam = config.sensor.psds[0], config.sensor.beam
    asked = {
        "radius_mm-number": 0.7 * psd.radius, "inclination_deg-number": 48.5,
        "power_mw-number": 0.41, "diameter_mm-number": 1.3 * beam.diameter_x,
        "size_mm-number": 0.9 * psd.size_y,
    }  # fmt: skip
    before = browser.ask(f"({ROWS})('range-rows')")
    browser.ask(f"({MOVE})({json.dumps(asked)})")
    path = tmp_path / "saved.yaml"
    path.write_text(browser.ask("Geometry.yaml()"), "utf-8")
    saved = facets.load(path)
    found = saved.sensor
    assert [found.psds[0].radius, found.psds[0].size_y, found.beam.power] == pytest.approx(
        [asked["radius_mm-number"], asked["size_mm-number"], 0.41]
    )
    assert np.degrees(found.facets[0].inclination) == pytest.approx(48.5)
    assert (saved.range, found.noise, found.light) == (
        config.range, config.sensor.noise, config.sensor.light,
    )  # fmt: skip
    state = json.dumps(STATE.tolist())
    told = np.array(browser.ask(f"Model.readings({state})"))
    assert np.abs(told - facets.readings(found, STATE)).max() < 1e-9
    sigma = browser.ask(f"Model.solve(Model.readings({state})).uncertainty")
    assert sigma == pytest.approx(facets.solve(found, told).uncertainty, rel=1e-9)
    text = json.dumps(json.dumps(before, ensure_ascii=False, separators=(",", ":")))
    browser.await_true(f"JSON.stringify(({ROWS})('range-rows')) !== {text}")
    axes = facets.axis_ranges(found, saved.range, np.zeros(6))
    for axis, (_, low, high, why), unit in zip(
        axes, browser.ask(f"({ROWS})('range-rows')"), STATE_UNITS, strict=False
    ):
        assert [number(low), number(high)] == pytest.approx(
            [axis.low / unit, axis.high / unit], abs=6e-4
        )
        assert facets.CAUSES[axis.low_cause] in why
    browser.ask("document.getElementById('geometry-reset').click()")
    told = np.array(browser.ask(f"Model.readings({state})"))
    assert np.abs(told - facets.readings(config.sensor, STATE)).max() < 1e-9


@needs_browser
@pytest.mark.slow
def test_the_solved_pose_is_that_of_the_readings_with_noise(shown):
    config, browser = shown
    browser.ask(f"page.moveTo({json.dumps(STATE.tolist())})")
    noisy, again, other = (
        np.array(browser.ask(f"Model.noisy(page.readings(), {seed})")) for seed in (1, 1, 2)
    )
    assert (noisy == again).all()
    assert (noisy != other).all()
    solution = facets.solve(config.sensor, noisy, beam=config.solve.beam)
    rows = browser.ask(f"({ROWS})('pose-rows')")
    unit = np.array(STATE_UNITS)
    assert [number(row[1]) for row in rows] == pytest.approx(STATE / unit, abs=6e-4)
    assert [number(row[2]) for row in rows] == pytest.approx(solution.state / unit, abs=6e-4)
    assert "e-" not in json.dumps(rows)
    assert browser.ask("document.getElementById('estimate-said').textContent").startswith(
        "Converged after "
    )


@needs_browser
@pytest.mark.slow
def test_the_noise_has_the_size_that_the_package_states(shown):
    config, browser = shown
    given = json.dumps(facets.readings(config.sensor, STATE).tolist())
    many = np.array(browser.ask(f"Array.from({{length: 4000}}, (_, n) => Model.noisy({given}, n))"))
    wanted = facets.standard_deviations(config.sensor, json.loads(given))
    assert np.abs(many.std(axis=0) / wanted - 1).max() < 0.06
    assert np.abs(many.mean(axis=0) - json.loads(given)).max() < 0.06 * wanted.max()
    assert np.abs(np.corrcoef(many.T) - np.eye(9)).max() < 0.07


@needs_browser
@pytest.mark.slow
def test_the_cloud_lies_in_its_ellipses(shown):
    config, browser = shown
    if config.solve.beam == "known":
        said = browser.ask("document.getElementById('estimate-said').textContent")
        assert "The beam is not at 0, 0" in said
        for n in range(4):
            browser.ask(f"document.getElementById('cloud-{n}').ariaLabel = ''")
        browser.ask(f"page.moveTo({json.dumps([*STATE[:6].tolist(), 0, 0])})")
    for n in range(4):
        label = f"document.getElementById('cloud-{n}').ariaLabel"
        text = browser.await_true(f"{label}.includes(': 300 solved poses') && {label}")
        poses, inside, _ = (int(word) for word in text.split() if word.isdigit())
        assert 0.9 < inside / poses < 0.99


@needs_browser
@pytest.mark.slow
@pytest.mark.parametrize("width", [360, 768, 1440])
def test_nothing_is_wider_than_the_page(shown, width):
    browser = shown[1]
    browser.send("Emulation.setDeviceMetricsOverride",
                 width=width, height=900, deviceScaleFactor=1, mobile=False)  # fmt: skip
    wide = """[...document.querySelectorAll("#panels *")].filter((one) =>
      one.getBoundingClientRect().right > document.documentElement.clientWidth + 1).length"""
    assert browser.ask(wide) == 0


def test_what_noise_and_uncertainties_leave_out_is_said():
    calibrated = facets.Sensor(calibration=facets.Calibration(("psd_a.height",), ((1e-6,),)))
    assert estimate_sentences(facets.Sensor()) == []
    assert "without the calibration's part" in estimate_sentences(calibrated)[0]
    assert "steps of the converter" in estimate_sentences(facets.load("bench").sensor)[0]
    assert "left out" in omitted_keys(calibrated)[0]


@needs_browser
@pytest.mark.slow
def test_a_noise_that_the_page_does_not_know_is_not_made_up(tmp_path):
    sensor = facets.Sensor(electronics=facets.Electronics(kind="tetra-lateral"))
    path = tmp_path / "rig.html"
    path.write_text(rig_page(sensor, "tetra", np.zeros(8)), "utf-8")
    with Browser(f"file://{path}") as browser:
        said = browser.await_true("document.getElementById('range-said').textContent")
        assert said.startswith("This page cannot tell the range")
        assert browser.ask("document.getElementById('estimate-results').hidden")
        assert browser.ask("document.getElementById('geometry-save').hidden")
        assert not browser.errors


@needs_browser
@pytest.mark.slow
def test_what_the_page_cannot_solve_it_says(tmp_path):
    config = facets.load("singular")
    path = tmp_path / "rig.html"
    path.write_text(rig_page(config.sensor, config.name, np.zeros(8), config=config), "utf-8")
    with Browser(f"file://{path}") as browser:
        said = browser.await_true("document.getElementById('estimate-said').textContent")
        assert said.startswith("Two poses of this sensor can give the same readings.")
        assert browser.ask("document.getElementById('estimate-results').hidden")
        browser.ask(f"({MOVE})({{'estimate-beam': 'known'}})")
        assert not browser.ask("document.getElementById('estimate-results').hidden")
        assert not browser.errors
