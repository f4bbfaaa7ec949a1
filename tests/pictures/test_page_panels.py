"""The panels of a rig's page: geometry and its file, noise and the solved pose, the range."""

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


@pytest.fixture(scope="module", params=["rig", "bench-light"])
def shown(request, open_page):
    """A configuration and its page."""
    config = facets.load(request.param)
    with open_page(config.sensor, config.name, config) as browser:
        browser.await_true("document.querySelectorAll('#range-rows tr').length === 6")
        yield config, browser
        assert not browser.errors


def number(text):
    return float(text.replace("\u2212", "-"))


def ranges_on(browser):
    """The ranges of the axes that a page shows, in the units of tables."""
    return [
        [number(low), number(high)] for _, low, high, _ in browser.ask(f"({ROWS})('range-rows')")
    ]


def test_the_saved_file_gives_the_readings_and_ranges_that_the_page_shows(shown, tmp_path):
    config, browser = shown
    psd, beam = config.sensor.psds[0], config.sensor.beam
    before, radius, size = ranges_on(browser), 0.7 * psd.radius, 0.9 * psd.size_y
    for name, value in {
        "radius_mm": radius, "inclination_deg": 48.5, "power_mw": 0.41,
        "diameter_mm": 1.3 * beam.diameter_x, "size_mm": size,
    }.items():  # fmt: skip
        browser.put(f"{name}-number", value)
    (tmp_path / "saved.yaml").write_text(browser.ask("Geometry.yaml()"), "utf-8")
    saved = facets.load(tmp_path / "saved.yaml")
    sensor = saved.sensor
    assert (sensor.psds[0].radius, sensor.psds[0].size_y) == pytest.approx((radius, size))
    assert (saved.range, sensor.noise) == (config.range, config.sensor.noise)
    assert sensor.light == config.sensor.light
    readings = f"Model.readings({STATE.tolist()})"
    assert np.abs(browser.ask(readings) - facets.readings(sensor, STATE)).max() < 1e-9
    while ranges_on(browser) == before:
        browser.ask("new Promise((done) => setTimeout(done, 20))")
    axes = facets.axis_ranges(sensor, saved.range, np.zeros(6))
    expected = np.array([[axis.low, axis.high] for axis in axes]) / np.array(STATE_UNITS)[:6, None]
    np.testing.assert_allclose(ranges_on(browser), expected, rtol=0, atol=6e-4)
    browser.ask("document.getElementById('geometry-reset').click()")
    assert np.abs(browser.ask(readings) - facets.readings(config.sensor, STATE)).max() < 1e-9


def test_the_solved_pose_is_that_of_the_readings_with_noise(shown):
    config, browser = shown
    browser.ask(f"page.moveTo({STATE.tolist()})")
    noisy, again, other = browser.ask("[1, 1, 2].map((seed) => Model.noisy(page.readings(), seed))")
    assert noisy == again
    assert not np.equal(noisy, other).any()
    solution = facets.solve(config.sensor, noisy, beam=config.solve.beam)
    rows = [row[1:3] for row in browser.ask(f"({ROWS})('pose-rows')")]
    expected = np.array([STATE, solution.state]).T / np.array(STATE_UNITS)[:, None]
    assert [list(map(number, row)) for row in rows] == pytest.approx(expected, abs=6e-4)
    assert browser.text_of("estimate-said").startswith("Converged after ")


def test_the_noise_has_the_size_that_the_package_states(shown):
    config, browser = shown
    readings = facets.readings(config.sensor, STATE)
    draw = f"Array.from({{length: 4000}}, (_, n) => Model.noisy({readings.tolist()}, n))"
    noise = np.array(browser.ask(draw)) - readings
    scaled = noise / facets.standard_deviations(config.sensor, readings)
    assert np.abs(scaled.mean(axis=0)).max() < 0.06
    assert np.abs(np.cov(scaled.T) - np.eye(9)).max() < 0.12


def test_the_cloud_lies_in_its_ellipses(shown):
    config, browser = shown
    if config.solve.beam == "known":
        assert "The beam is not at 0, 0" in browser.text_of("estimate-said")
        browser.ask(
            f"page.moveTo({[*STATE[:6].tolist(), 0, 0]});"
            "document.querySelectorAll('[id^=cloud-]').forEach((one) => one.ariaLabel = '')"
        )
    for n in range(4):
        label = f"document.getElementById('cloud-{n}').ariaLabel"
        text = browser.await_true(f"{label}.includes(': 300 solved poses') && {label}")
        poses, inside, _ = (int(word) for word in text.split() if word.isdigit())
        assert 0.9 < inside / poses < 0.99


@pytest.mark.parametrize(
    ("sensor", "said", "words"),
    [
        (facets.Sensor(electronics=facets.Electronics(kind="tetra-lateral")), "range-said",
         "This page cannot compute the range"),
        (facets.load("singular").sensor, "estimate-said",
         "Two poses of this sensor can give the same readings."),
    ], ids=["noise", "poses"],
)  # fmt: skip
def test_what_the_page_cannot_know_it_says(open_page, sensor, said, words):
    with open_page(sensor, "unknown") as browser:
        text = browser.await_true(f"document.getElementById('{said}').textContent")
        assert text.startswith(words)
        assert browser.ask("document.getElementById('estimate-results').hidden")
        browser.put("estimate-beam", "known")  # by which one of two poses is known
        is_hidden = browser.ask("document.getElementById('estimate-results').hidden")
        assert is_hidden == (said == "range-said")
        assert not browser.errors
