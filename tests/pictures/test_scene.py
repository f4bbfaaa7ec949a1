"""What is drawn lies where the model says; pictures are not blank; a browser can show them."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from commands import command
from gltf_page import page_of
from sensors import SENSORS, states

import facets
from facets.pictures import Stand, light_on, scene

TILTED = "tx_mm=0.08,ty_mm=0.05,roll_mrad=8,pitch_mrad=6,yaw_mrad=10"


def weighed(places, light):
    """The centroid of light on a grid of points, by triangles: exact for what is drawn."""
    corners = [np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:]]
    total, moment = 0.0, np.zeros(2)
    for a, b, c in ((0, 1, 2), (0, 2, 3)):
        p, q, r = (places[corners[n]] for n in (a, b, c))
        first, second = q - p, r - p
        area = np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]) / 2
        shine = sum(light[corners[n]] for n in (a, b, c)) / 3 * area
        total += shine.sum()
        moment += (shine[..., None] * (p + q + r) / 3).sum(axis=(0, 1))
    return moment / total, total


@pytest.mark.parametrize("name", ["paper", "skewed0", "skewed1"])
def test_spots_are_drawn_where_readings_say(name):
    """The beam being cut at its 1/e^2 circle, as it is drawn. The grid's cells leave 1e-3 mm."""
    sensor = replace(SENSORS[name], apertures=facets.Apertures(beam=1.0))
    for state in states(20, seed=8, offset=0.15, angle=0.01):
        reading = facets.readings(sensor, state)
        stand = Stand.from_state(sensor, state)
        totals = []
        for k in range(3):
            spot = scene.spot(stand, k)
            centroid, total = weighed(spot.grid, spot.light)
            np.testing.assert_allclose(centroid, reading[3 * k : 3 * k + 2], atol=1e-3)
            totals.append(total)
        if name == "paper":  # upright detectors see what shines across the beam, but for the tilt
            shares = np.array(totals) / sum(totals)
            np.testing.assert_allclose(shares, reading[2::3] / reading[2::3].sum(), atol=0.02)


@pytest.mark.parametrize("name", ["paper", "skewed2"])
def test_sub_beams_leave_the_drawn_facets_by_the_reflection_law(name):
    sensor = SENSORS[name]
    state = states(1, seed=9)[0]
    stand = Stand.from_state(sensor, state)
    incoming = np.array(stand.geometry.direction)
    for k, facet in enumerate(scene.mirror(stand)):
        apex, one, other = facet.points
        normal = np.cross(one - apex, other - apex)
        normal /= np.linalg.norm(normal)
        points = scene.sub_beam(stand, k).points
        half = len(points) // 2
        assert np.abs((points[:half] - apex) @ normal).max() < 1e-12  # they begin on the facet
        leaving = points[half:] - points[:half]
        leaving /= np.linalg.norm(leaving, axis=1)[:, None]
        mirrored = incoming - 2 * (incoming @ normal) * normal
        np.testing.assert_allclose(leaving, np.broadcast_to(mirrored, leaving.shape), atol=1e-12)


def test_light_beside_the_mirror_is_not_drawn():
    state = np.array([3.0, 0, 0, 0, 0, 0, 0, 0])
    stand = Stand.from_state(SENSORS["paper"], state)
    lit = [len(scene.cut(stand, k)) > 0 for k in range(3)]
    assert lit.count(True) in (1, 2)
    names = [body.name for body in scene.rig(SENSORS["paper"], state)]
    assert sum(name.startswith("spot") for name in names) == lit.count(True)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    folder = tmp_path_factory.mktemp("render")
    for name in ("scene.gltf",):
        result = command("render", "paper", "--at", TILTED, "-o", name, cwd=folder)
        assert result.returncode == 0, result.stderr
    return folder


def pixels(path):
    from matplotlib.image import imread

    return imread(path)[..., :3]


def orange(image):
    """Pixels in the hue of detector B."""
    return ((image[..., 0] - image[..., 2] > 0.25) & (image[..., 0] > image[..., 1])).mean()


@pytest.mark.slow
def test_gltf_is_a_scene_of_many_bodies(rendered):
    content = json.loads((rendered / "scene.gltf").read_text())
    assert content["asset"]["version"].startswith("2")
    assert len(content["meshes"]) > 10


def seen(page, shot):
    """A page as headless Chromium shows it."""
    subprocess.run(
        ["chromium", "--headless", "--no-sandbox", "--enable-unsafe-swiftshader", "--no-first-run",
         "--disable-background-networking", "--disable-component-update", "--disable-sync",
         f"--user-data-dir={shot.parent / 'profile'}", "--window-size=1000,800",
         "--virtual-time-budget=6000", f"--screenshot={shot}", f"file://{page}"],
        check=True, capture_output=True, timeout=120,
    )  # fmt: skip
    return pixels(shot)


needs_browser = pytest.mark.skipif(not shutil.which("chromium"), reason="needs Chromium")


@needs_browser
@pytest.mark.slow
def test_gltf_opens_in_a_browser(tmp_path):
    result = command("render", "paper", "-o", "close.gltf", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    page = tmp_path / "page.html"
    page.write_text(page_of(json.loads((tmp_path / "close.gltf").read_text())))
    image = seen(page, tmp_path / "shot.png")
    assert image.std() > 0.02
    assert (np.ptp(image, axis=-1) > 0.05).mean() > 0.001


@pytest.mark.slow
def test_films_and_flat_pictures(tmp_path):
    arguments = ("--frames", "3", "--width", "320", "--height", "240")
    for name in ("film.gif", "film.mp4"):
        result = command(
            "render", "bench", "--motion", "wobble", *arguments, "-o", name, cwd=tmp_path
        )
        assert result.returncode == 0, result.stderr
        assert (tmp_path / name).stat().st_size > 2000
    for kind, name in (("--spots", "spots.svg"), ("--plan", "plan.pdf")):
        result = command("render", "paper", kind, "-o", name, cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        assert (tmp_path / name).stat().st_size > 5000


def test_titles_say_where_no_light_falls():
    """No number of watts where there are none, and none without a word where the spot is beside."""
    psd = facets.Sensor().psds[0]
    assert light_on(psd, np.array([1.0, -2.0, 0.1])) == "100.0 µW"
    assert light_on(psd, np.array([1.0, -7.0, 0.1])) == "100.0 µW beside it"
    assert light_on(psd, np.full(3, np.nan)) == "no light"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("-o", "rig.svg"), "must end in .png, .gltf, .html for 3D"),
        (("--spots", "-o", "rig.gltf"), "must end in .png, .svg, .pdf for 2D"),
        (("--motion", "x-steps", "-o", "film.png"), "must end in .mp4, .gif for a film"),
        (("--motion", "nothing", "-o", "film.gif"), "no motion nothing"),
        (("--spots", "--plan"), "give one of"),
        (("--view", "trail"), "give --motion or --recording"),
        (("--view", "range", "--motion", "x-steps", "-o", "film.gif"), "a film needs another view"),
        (("--at", "tx=1"), "allowed: NAME=NUMBER"),
    ],
)
def test_messages(arguments, words, tmp_path):
    result = command("render", "paper", *arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert words in result.stderr
    assert list(tmp_path.iterdir()) == []
