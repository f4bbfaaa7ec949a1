"""The panels of a rig's page: geometry and its file, noise and the solved pose, the range."""

from __future__ import annotations

import json

import numpy as np
import pytest
from browser import CHROMIUM, Browser

import facets
from facets.core import STATE_UNITS
from facets.pictures import rig_page

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium"),
]
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


@pytest.fixture(scope="module")
def open_page(tmp_path_factory):
    """Open the page of a sensor, without WebGL."""
    folder = tmp_path_factory.mktemp("page")

    def open_page(sensor, name, config=None):
        text = rig_page(sensor, name, STATE, config=config)
        assert len(text.encode()) < 2_000_000
        (folder / f"{name}.html").write_text(text, "utf-8")
        return Browser(f"file://{folder}/{name}.html")

    return open_page


@pytest.fixture(scope="module", params=["paper", "rig", "bench-light"])
def shown(request, open_page):
    """A configuration and its page."""
    config = facets.load(request.param)
    with open_page(config.sensor, config.name, config) as browser:
        browser.await_true("document.querySelectorAll('#range-rows tr').length === 6")
        yield config, browser
        assert not browser.errors


def number(text):
    return float(text.replace("\u2212", "-"))


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
    sensor = saved.sensor
    assert [sensor.psds[0].radius, sensor.psds[0].size_y, sensor.beam.power] == pytest.approx(
        [asked["radius_mm-number"], asked["size_mm-number"], 0.41]
    )
    assert np.degrees(sensor.facets[0].inclination) == pytest.approx(48.5)
    assert (saved.range, sensor.noise, sensor.light) == (
        config.range, config.sensor.noise, config.sensor.light,
    )  # fmt: skip
    state = json.dumps(STATE.tolist())
    readings = np.array(browser.ask(f"Model.readings({state})"))
    assert np.abs(readings - facets.readings(sensor, STATE)).max() < 1e-9
    sigma = browser.ask(f"Model.solve(Model.readings({state})).uncertainty")
    assert sigma == pytest.approx(facets.solve(sensor, readings).uncertainty, rel=1e-9)
    text = json.dumps(json.dumps(before, ensure_ascii=False, separators=(",", ":")))
    browser.await_true(f"JSON.stringify(({ROWS})('range-rows')) !== {text}")
    axes = facets.axis_ranges(sensor, saved.range, np.zeros(6))
    for axis, (_, low, high, why), unit in zip(
        axes, browser.ask(f"({ROWS})('range-rows')"), STATE_UNITS, strict=False
    ):
        assert [number(low), number(high)] == pytest.approx(
            [axis.low / unit, axis.high / unit], abs=6e-4
        )
        assert facets.CAUSES[axis.low_cause] in why
    browser.ask("document.getElementById('geometry-reset').click()")
    readings = np.array(browser.ask(f"Model.readings({state})"))
    assert np.abs(readings - facets.readings(config.sensor, STATE)).max() < 1e-9


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


def test_the_noise_has_the_size_that_the_package_states(shown):
    config, browser = shown
    given = json.dumps(facets.readings(config.sensor, STATE).tolist())
    many = np.array(browser.ask(f"Array.from({{length: 4000}}, (_, n) => Model.noisy({given}, n))"))
    wanted = facets.standard_deviations(config.sensor, json.loads(given))
    assert np.abs(many.std(axis=0) / wanted - 1).max() < 0.06
    assert np.abs(many.mean(axis=0) - json.loads(given)).max() < 0.06 * wanted.max()
    assert np.abs(np.corrcoef(many.T) - np.eye(9)).max() < 0.07


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


def test_nothing_is_wider_than_the_page(shown):
    browser = shown[1]
    wider = """[...document.querySelectorAll("#panels *")].filter((part) =>
      part.getBoundingClientRect().right > document.documentElement.clientWidth + 1).length"""
    for width in (360, 768, 1440):
        browser.resize(width, 900)
        assert browser.ask(wider) == 0, width


def test_a_noise_that_the_page_does_not_know_is_not_made_up(open_page):
    sensor = facets.Sensor(electronics=facets.Electronics(kind="tetra-lateral"))
    with open_page(sensor, "tetra") as browser:
        words = browser.await_true("document.getElementById('range-said').textContent")
        assert words.startswith("This page cannot tell the range")
        assert browser.ask("document.getElementById('estimate-results').hidden")
        assert browser.ask("document.getElementById('geometry-save').hidden")
        assert not browser.errors


def test_what_the_page_cannot_solve_it_says(open_page):
    config = facets.load("singular")
    with open_page(config.sensor, config.name, config) as browser:
        words = browser.await_true("document.getElementById('estimate-said').textContent")
        assert words.startswith("Two poses of this sensor can give the same readings.")
        assert browser.ask("document.getElementById('estimate-results').hidden")
        browser.ask(f"({MOVE})({{'estimate-beam': 'known'}})")
        assert not browser.ask("document.getElementById('estimate-results').hidden")
        assert not browser.errors
