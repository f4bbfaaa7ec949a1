"""A picture shows what the model says: where parts are, where light falls and in which hue.

Nothing here depends on the bytes of a picture, nor on who renders it: positions are those of the
model's own rays, and colours are compared with each other.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from commands import command
from sensors import SENSORS, states

import facets
from facets.pictures import (
    Picture,
    Stand,
    ease_camera,
    glow,
    motion_factor,
    rig,
    round_down,
    solids,
    stays_on_detectors,
)
from facets.pictures.camera import Camera, fit
from facets.pictures.lettering import DrawingSheet, overlap
from facets.pictures.materials import THEMES, rgb
from facets.pictures.range_solid import range_solid
from facets.pictures.studio import Shot

TILTED = np.array([0.08, 0.05, 0, 8e-3, 6e-3, 10e-3, 0, 0])
REST = np.zeros(8)
SIZE = (240, 180)


@pytest.fixture(scope="module", params=["dark", "light"])
def drawn(request):
    """The rig, and the same without its light."""
    with Picture(facets.Sensor(), TILTED, "rig", SIZE, request.param) as picture:
        view = picture.view
        camera = view.camera()
        lit, view.dark = picture.image(), (0, 1, 2)
        unlit = picture.image()
        shot = view.studio.take(camera)
        yield request.param, view, camera, lit, unlit, shot


def hue_of(change, theme):
    """Which detector's hue a change of colour is nearest to."""
    theme = THEMES[theme]
    hues = np.array([rgb(hue) for hue in theme.hues])
    ways = hues - hues.mean(axis=1, keepdims=True)
    way = change - change.mean()
    return int((ways @ way / np.linalg.norm(ways, axis=1)).argmax())


@pytest.mark.slow
def test_each_sub_beam_is_drawn_along_its_ray_in_its_own_hue(drawn):
    theme, view, camera, lit, unlit, _ = drawn
    change = lit.astype(float) - unlit
    for k in range(3):
        middle, _ = glow.centroid(view.stand, k)
        start = np.ravel(view.stand.facet_points(k, middle)).astype(float)
        end = np.ravel(view.stand.detector_points(k, middle)).astype(float)
        sample = np.zeros(3)
        for share in np.linspace(0.35, 0.75, 9):
            x, y = camera.project(start + share * (end - start))[:2].astype(int)
            block = change[y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3)
            sample += block[np.abs(block).sum(axis=1).argmax()]
        assert np.abs(sample).max() > 100, f"no light along sub-beam {'ABC'[k]}"
        assert hue_of(sample, theme) == k
    far = np.array([20, 20])
    assert not change[far[1], far[0]].any()  # and none where there is none


def test_parts_are_where_the_camera_sees_their_points(drawn):
    """The silhouette is that of the parts: each point is on it, and its box is the picture's."""
    _, view, camera, _, _, shot = drawn
    points = np.concatenate([part.solid.points for part in view.parts if part.assembly == "frame"])
    seen = camera.project(points)
    x, y = (
        np.clip(seen[:, 0], 0, SIZE[0] - 1).astype(int),
        np.clip(seen[:, 1], 0, SIZE[1] - 1).astype(int),
    )
    hit = np.array([np.isfinite(shot.depth[max(v - 2, 0) : v + 3, max(u - 2, 0) : u + 3]).any()
                    for u, v in zip(x, y, strict=True)])  # fmt: skip
    assert hit.mean() > 0.999
    everything = camera.project(np.concatenate([part.solid.points for part in view.parts]))
    rows, columns = np.nonzero(np.isfinite(shot.depth))
    assert abs(columns.min() - everything[:, 0].min()) < 4
    assert abs(columns.max() - everything[:, 0].max()) < 4
    assert abs(rows.min() - everything[:, 1].min()) < 4
    assert abs(rows.max() - everything[:, 1].max()) < 4


def test_depth_is_that_of_the_nearest_part(drawn):
    _, view, camera, _, _, shot = drawn
    column = next(part for part in view.parts if part.name == "column")
    top = column.solid.points[:, 2].max()
    middle = column.solid.points.mean(axis=0)
    x, y, depth = camera.project([middle[0], middle[1], top])
    assert abs(shot.depth[int(y), int(x)] - depth) < 12


@pytest.mark.parametrize("name", ["paper", "skewed0"])
def test_spots_shine_on_the_detectors_where_readings_say(name):
    """Each face, square on: the centroid of what is brighter than without the light."""
    from facets.pictures.views import face_camera

    sensor = SENSORS[name]
    state = states(1, seed=5, offset=0.1, angle=0.004)[0]
    state[:3], state[6:] = state[:3] - [*state[6:], state[2] - 0.6], 0  # near rest
    reading = facets.readings(sensor, state)
    stand = Stand.from_state(sensor, state)
    for k in range(3):
        camera = face_camera(Stand.from_state(sensor, REST), k, (500, 500))
        _, axes = rig.detector_frame(stand, k)
        depth = np.full((500, 500), camera.distance)
        shot = Shot(camera, np.zeros((500, 500, 3)), np.ones((500, 500)), depth)
        light = glow.surface(stand, shot, k)
        y, x = np.indices(light.shape) + 0.5
        across, up = camera.aside(x.ravel(), y.ravel())
        weight = light.ravel() / light.sum()
        right = float(camera.axes[0] @ axes[0])  # seen from the mirror, psi runs to the left
        assert abs(right * (weight @ across) - reading[3 * k]) < 0.01
        assert abs(weight @ up - reading[3 * k + 1]) < 0.01


def test_the_light_of_a_close_beam_is_its_integral_along_the_camera_s_ray():
    """The closed form against adding up the light of many points, on rays that nothing stops."""
    sensor = facets.Sensor()
    stand = Stand.from_state(sensor, TILTED)
    apex = TILTED[:3]
    camera = Camera(tuple(apex + np.array([5, -6, 4])), tuple(apex), angle=0.3, size=(40, 40))
    shot = Shot(camera, np.zeros((40, 40, 3)), np.zeros((40, 40)), np.full((40, 40), np.inf))
    sigma = glow.width_of(stand)
    found = glow.sub_beam(stand, shot, 0)
    rows, columns = np.nonzero(found > 1e-3)
    assert len(rows) > 100
    for n in np.linspace(0, len(rows) - 1, 12).astype(int):
        x, y = np.array([columns[n] + 0.5]), np.array([rows[n] + 0.5])
        origin, ray = camera.rays(x, y)
        t = np.linspace(0, 2 * camera.distance, 40001)[:, None]
        places = origin + t * ray
        normal = np.array(stand.at.normals[0])
        centre, facing = np.array(stand.geometry.centres[0]), np.array(stand.geometry.axes[0][0])
        before = ((places - apex) @ normal > 0) & ((places - centre) @ facing < 0)
        folded = places - 2 * ((places - apex) @ normal)[:, None] * normal
        cross = glow.sigma_coordinates(stand, folded)
        light = np.exp(-(cross**2).sum(axis=1) / 2) * glow.is_in_wedge(stand, 0, cross) * before
        speed = np.hypot(
            *(
                glow.sigma_coordinates(stand, folded[1:2])
                - glow.sigma_coordinates(stand, folded[:1])
            )[0]
        )
        expected = light.sum() * speed / np.sqrt(2 * np.pi)
        assert abs(found[rows[n], columns[n]] - expected) < 2e-3, sigma


@pytest.mark.parametrize("inclination", [38, 40, 41, 43, 50])
def test_facets_are_not_black_at_any_inclination(inclination, tmp_path):
    """They were at 38, 40, 41 and 43 degrees, where the normals of the drawn facets were lost."""
    slope = np.radians(inclination)
    plain = facets.Sensor()
    sensor = replace(plain, facets=tuple(replace(f, inclination=slope) for f in plain.facets))
    height = 250 / np.tan(2 * slope) * -1
    sensor = replace(sensor, psds=tuple(replace(p, height=-height) for p in plain.psds))
    with Picture(sensor, REST, "mirror", (120, 90), "light") as picture:
        camera = picture.view.camera()
        shot = picture.view.studio.take(camera)
    for k in (0, 2):  # those that face the camera
        down = np.array(rig.parts(picture.view.rest)[k].solid.points)[1:].mean(axis=0)
        x, y, _ = camera.project(0.05 * down)
        block = shot.colour[int(y) - 2 : int(y) + 3, int(x) - 2 : int(x) + 3]
        assert block.mean() > 0.15


@pytest.mark.parametrize("name", ["paper", "fig4", "skewed"])
@pytest.mark.parametrize("view", ["both", "detector", "cutaway", "exploded"])
@pytest.mark.slow
def test_views_of_shipped_sensors_are_neither_empty_nor_full(name, view):
    with Picture(facets.load(name).sensor, REST, view, (200, 150), sharpness=1) as picture:
        image = picture.image()
        shot = picture.view.studio.take(picture.view.camera(), 1)
    assert image.std() > 8
    assert 0.03 < shot.is_covered.mean() < 0.85


@pytest.mark.slow
def test_a_dark_detector_is_said_to_be():
    """Moved off the beam: sub-beams without light are not drawn, and nothing fails."""
    away = np.array([40.0, 0, 0, 0, 0, 0, 0, 0])
    with Picture(facets.Sensor(), away, "both", SIZE) as picture:
        assert picture.image().shape == (180, 240, 3)
    stand = Stand.from_state(facets.Sensor(), away)
    assert [glow.centroid(stand, k)[1] > 1e-6 for k in range(3)].count(True) < 3


def test_parts_are_closed_and_face_outward():
    """Volumes by the divergence theorem are positive: else light falls on a part's inside."""
    for part in rig.parts(Stand.from_state(facets.Sensor(), REST)):
        if part.assembly == "head" and ("facet" in part.name or part.name == "mirror body"):
            continue
        assert volume(part.solid) > 0, part.name
    whole = [p.solid for p in rig.parts(Stand.from_state(facets.Sensor(), REST))
             if "facet" in p.name or p.name == "mirror body"]  # fmt: skip
    assert volume(solids.join(whole)) > 0


def volume(solid):
    total = 0.0
    for face in solid.faces:
        points = solid.points[face] - solid.points[0]
        for n in range(1, len(face) - 1):
            total += np.linalg.det(points[[0, n, n + 1]]) / 6
    return total


def test_the_drawn_facets_lie_in_the_planes_of_the_model():
    stand = Stand.from_state(SENSORS["skewed1"], TILTED)
    for k, letter in enumerate("abc"):
        part = next(p for p in rig.parts(stand) if p.name == f"facet {letter}")
        off = (part.solid.points - TILTED[:3]) @ np.array(stand.at.normals[k], float)
        assert np.abs(off).max() < 1e-9


@pytest.mark.slow
def test_the_range_solid_ends_where_ranges_do():
    config = facets.load("paper")
    solid = range_solid(config.sensor, config.range)
    axes = facets.axis_ranges(config.sensor, config.range, np.zeros(6))
    z = axes[2]
    top = solid.points[0]  # the first of the pole's points
    assert abs(top[2] - z.high) < 1e-2
    assert abs(solid.points[-1, 2] - z.low) < 1e-2
    assert {"PSD", "light"} & {facets.CAUSES[n].split()[-1] for n in set(solid.causes) if n < 4}


def test_labels_do_not_stand_on_each_other():
    sheet = DrawingSheet((1200, 900), THEMES["light"])
    a, b = np.array([200.0, 400.0]), np.array([700.0, 450.0])
    for _ in range(4):
        sheet.dimension(a, b, "250 mm", np.array([0.0, -30.0]))
    assert len(sheet.taken) == 4
    for n, one in enumerate(sheet.taken):
        assert not any(overlap(shrunk(one), shrunk(other)) for other in sheet.taken[:n])


def shrunk(box):
    """Without the margin that a label's box has about its letters."""
    return box[0] + 5, box[1] + 5, box[2] - 5, box[3] - 5


def test_equal_radii_have_one_dimension_and_unequal_ones_three():
    sensor = facets.Sensor()
    other = replace(sensor, psds=(replace(sensor.psds[0], radius=200.0), *sensor.psds[1:]))
    counts = []
    for one in (sensor, other):
        with Picture(one, REST, "rig", (900, 675), sharpness=1) as picture:
            sheet = DrawingSheet((900, 675), THEMES["dark"])
            picture.view.dimension_radii(sheet, picture.view.camera())
            counts.append(len(sheet.taken))
    assert counts == [1, 3]


def test_a_camera_fits_points_into_an_area_and_its_rays_go_through_them():
    points = np.random.default_rng(1).uniform(-50, 50, (200, 3))
    for angle in (0.0, 0.4):
        camera = fit(
            Camera((300, -400, 200), (0, 0, 0), angle=angle, size=(400, 300)),
            points,
            (0.2, 0.1, 0.9, 0.8),
        )
        seen = camera.project(points)
        low, high = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
        assert low[0] > 0.19 * 400
        assert high[0] < 0.91 * 400
        assert low[1] > 0.09 * 300
        assert high[1] < 0.81 * 300
        assert max((high[0] - low[0]) / (0.7 * 400), (high[1] - low[1]) / (0.7 * 300)) > 0.97
        origin, ray = camera.rays(seen[:, 0], seen[:, 1])
        np.testing.assert_allclose(origin + seen[:, 2:] * ray, points, atol=1e-9)


def test_a_film_s_camera_moves_with_ease_and_ends_where_it_began():
    camera = Camera((300, -400, 200), (0, 0, 0))
    places = np.array([ease_camera(camera, share).place for share in np.linspace(0, 1, 61)])
    np.testing.assert_allclose(places[0], places[-1], atol=1e-9)
    steps = np.diff(places, axis=0)
    np.testing.assert_allclose(steps[0], steps[-1], atol=0.06 * np.linalg.norm(steps, axis=1).max())
    assert (
        np.linalg.norm(np.diff(steps, axis=0), axis=1).max()
        < 0.2 * np.linalg.norm(steps, axis=1).max()
    )


def test_a_motion_is_drawn_as_large_as_its_spots_stay_on_their_detectors():
    sensor = facets.Sensor()
    motion = np.zeros((20, 8))
    motion[:, 5] = np.linspace(-1e-3, 1e-3, 20)
    factor = motion_factor(sensor, motion)
    assert factor == 20  # 250 mm x 20 mrad is 5 mm of 6.5
    assert stays_on_detectors(sensor, factor * motion)
    assert not stays_on_detectors(sensor, 50 * motion)
    assert motion_factor(sensor, 100 * motion) == 1
    assert [round_down(x) for x in (1, 1.99, 2, 7, 0.5, 1000)] == [1, 1, 2, 5, 0.5, 1000]


@pytest.mark.slow
def test_pictures_by_the_command(tmp_path):
    small = ("--width", "240", "--height", "200")
    for name, more in (("range.png", ("--view", "range", "--track")),
                       ("trail.png", ("--view", "trail", "--motion", "multi-axis")),
                       ("rig.png", ("--style", "dark", "--at", "yaw_mrad=5"))):  # fmt: skip
        result = command("render", "paper", *more, *small, "-o", name, cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        assert (tmp_path / name).stat().st_size > 8000


@pytest.mark.slow
def test_a_film_says_by_how_much_its_motion_is_drawn_larger(tmp_path):
    arguments = ("--frames", "5", "--width", "240", "--height", "200", "-o", "film.gif")
    result = command("render", "bench", "--motion", "wobble", *arguments, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    said = re.search(
        r"Motion drawn (\d+) times larger, the head's turning (\d+) times", result.stderr
    )
    assert 2 <= int(said[1]) < int(said[2])
    result = command("render", "bench", "--motion", "wobble", "--exaggerate", "1", "--force",
                     *arguments, cwd=tmp_path)  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert "larger" not in result.stderr
