"""What is drawn lies where the model says; pictures are not blank; a browser can show them."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from browser import CHROMIUM, Browser
from gltf_page import page_of
from sensors import SENSORS, states

import facets
from facets.pictures import PosedSensor, light_on, scene


def middles(corners):
    """The mean of what a grid has at the corners of each cell."""
    return (corners[:-1, :-1] + corners[1:, :-1] + corners[:-1, 1:] + corners[1:, 1:]) / 4


def centroid(places, light):
    """The centroid of light on a grid of points."""
    (x, y), (u, v) = (places[1:, 1:] - places[:-1, :-1]).T, (places[1:, :-1] - places[:-1, 1:]).T
    power = middles(light) * np.abs(x * v - y * u).T / 2  # a cell's area by its diagonals
    return np.einsum("ij,ijk->k", power, middles(places)) / power.sum()


@pytest.mark.parametrize("name", ["paper", "skewed1"])
def test_spots_are_drawn_where_readings_say(name):
    """The beam being cut at its 1/e^2 circle, as it is drawn. The grid's cells leave 1e-3 mm."""
    sensor = replace(SENSORS[name], apertures=facets.Apertures(beam=1.0))
    for state in states(4, seed=8, offset=0.15, angle=0.01):
        reading = facets.readings(sensor, state).reshape(3, 3)
        posed = PosedSensor.from_state(sensor, state)
        spots = [scene.spot(posed, k) for k in range(3)]
        centroids = [centroid(spot.grid, spot.light) for spot in spots]
        np.testing.assert_allclose(centroids, reading[:, :2], atol=1e-3)


def test_sub_beams_leave_the_drawn_facets_by_the_reflection_law():
    posed = PosedSensor.from_state(SENSORS["skewed2"], states(1, seed=9)[0])
    incoming = np.array(posed.geometry.direction)
    for k, (apex, *others) in enumerate(scene.mirror(posed)):
        normal = np.cross(*(others - apex))
        normal /= np.linalg.norm(normal)
        on_facet, on_detector = scene.rims(posed, k)
        assert np.abs((on_facet - apex) @ normal).max() < 1e-12
        leaving = on_detector - on_facet
        leaving /= np.linalg.norm(leaving, axis=1)[:, None]
        mirrored = incoming - 2 * (incoming @ normal) * normal
        np.testing.assert_allclose(leaving, np.broadcast_to(mirrored, leaving.shape), atol=1e-12)


#: The share of a picture's pixels that are coloured, and how much its brightness scatters.
LOOK = """(() => {
  const gl = document.querySelector("canvas").getContext("webgl");
  const data = new Uint8Array(4 * 900 * 700);
  gl.readPixels(0, 0, 900, 700, gl.RGBA, gl.UNSIGNED_BYTE, data);
  let coloured = 0, sum = 0, squares = 0;
  for (let n = 0; n < data.length; n += 4) {
    const rgb = data.subarray(n, n + 3), light = (rgb[0] + rgb[1] + rgb[2]) / 765;
    coloured += Math.max(...rgb) - Math.min(...rgb) > 13;
    sum += light;
    squares += light * light;
  }
  const count = data.length / 4;
  return [coloured / count, Math.sqrt(squares / count - (sum / count) ** 2)];
})()"""


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_gltf_is_a_scene_of_many_bodies_and_opens_in_a_browser(run_in_process, tmp_path):
    status, _, errors = run_in_process("render", "paper", "-o", "close.gltf")
    assert status == 0, errors
    content = json.loads((tmp_path / "close.gltf").read_text())
    assert len(content["meshes"]) > 10
    (tmp_path / "page.html").write_text(page_of(content))
    with Browser(f"file://{tmp_path}/page.html", webgl=True) as browser:
        browser.await_true("document.readyState === 'complete'")
        coloured, deviation = browser.ask(LOOK)
    assert deviation > 0.02
    assert coloured > 0.001


@pytest.mark.slow
def test_pictures_and_films_by_the_command(run_in_process, tmp_path):
    """Those that no chain of commands draws."""
    small = ("--width", "240", "--height", "200")
    for name, words in (
        ("range.png", ("paper", "--view", "range", "--track", *small)),
        ("trail.png", ("paper", "--view", "trail", "--motion", "multi-axis", *small)),
        ("film.gif", ("bench", "--motion", "wobble", "--frames", "3", *small)),
        ("film.mp4", ("bench", "--motion", "wobble", "--frames", "2", "--exaggerate", "1", *small)),
        ("plan.pdf", ("paper", "--plan")),
    ):
        status, _, errors = run_in_process("render", *words, "-o", name)
        assert status == 0, errors
        assert (tmp_path / name).stat().st_size > 2000, name
        factors = re.findall(r"Motion drawn (\d+) times larger, the head's turning (\d+)", errors)
        assert len(factors) == (name == "film.gif")
        assert all(2 <= int(motion) < int(turning) for motion, turning in factors)


@pytest.mark.parametrize(
    ("zeta", "power", "title"),
    [(-2.0, 0.1, "100.0 µW"), (-7.0, 0.1, "100.0 µW, outside it"), (np.nan, np.nan, "no light")],
)
def test_titles_say_where_no_light_falls(zeta, power, title):
    """No number of watts where there are none, and a word where the spot is outside."""
    assert light_on(facets.Sensor().psds[0], np.array([1.0, zeta, power])) == title


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("-o", "rig.svg"), "must end in .png, .gltf, .html for 3D"),
        (("--motion", "x-steps", "-o", "film.png"), "must end in .mp4, .gif for a film"),
        (("--view", "range", "--motion", "x-steps", "-o", "film.gif"), "a film needs another view"),
    ],
)
def test_messages(arguments, words, run_in_process, tmp_path):
    status, _, errors = run_in_process("render", "paper", *arguments)
    assert status == 2
    assert words in errors
    assert list(tmp_path.iterdir()) == []
