"""A picture shows what the model says: where parts are, where light falls and in which hue.

Nothing here depends on the bytes of a picture, nor on who renders it: positions are those of the
model's own rays, and colours are compared with each other.
"""

from dataclasses import replace

import numpy as np
import pytest
from sensors import SENSORS, states

import facets
from facets.pictures import (
    Picture,
    PictureForm,
    PosedSensor,
    RigModel,
    RigView,
    materials,
    motion_factor,
    range_solid,
    scene,
    sub_beam,
    surface,
)

PAPER = facets.Sensor()
TILTED = np.array([0.08, 0.05, 0, 8e-3, 6e-3, 10e-3, 0, 0])
BESIDE = np.array([40.0, 0, 0, 0, 0, 0, 0, 0])
REST = np.zeros(8)
SIZE = (240, 180)
RIG = PictureForm("rig", SIZE)


def rig_view(sensor):
    """The view of a sensor's rig as data: nothing is rendered."""
    return RigView(RigModel(sensor), materials.THEMES["dark"], SIZE)


@pytest.fixture(scope="module")
def shot():
    """A camera's picture of the parts, with depths."""
    with Picture(PAPER, TILTED, RIG) as picture:
        yield picture.studio.take(picture.view.camera)


def light_in(picture):
    """How much of a picture's colours is the light of the sub-beams, by pixel."""
    lit, look = picture.image(), picture.view.look
    picture.view.look = replace(look, hidden=(0, 1, 2))
    return lit.astype(int) - picture.image()


def nearest_hue(change, hues):
    """Which hue a change of colour is nearest to."""
    colours = np.array([[int(hue[n : n + 2], 16) for n in (1, 3, 5)] for hue in hues])
    ways = colours - colours.mean(axis=1, keepdims=True)
    return int((ways @ (change - change.mean()) / np.linalg.norm(ways, axis=1)).argmax())


@pytest.mark.slow
@pytest.mark.parametrize("theme", ["dark", "light"])
def test_each_sub_beam_is_drawn_along_its_ray_in_its_own_hue(theme):
    with Picture(PAPER, TILTED, PictureForm("rig", SIZE, theme)) as picture:
        change, view = light_in(picture), picture.view
    geometry = view.posed.geometry
    for k, (psi, zeta, _) in enumerate(facets.readings(PAPER, TILTED).reshape(3, 3)):
        spot = geometry.centres[k] + [0, psi, zeta] @ np.array(geometry.axes[k])
        for share in (0.35, 0.55, 0.75):
            x, y = view.camera.project(TILTED[:3] + share * (spot - TILTED[:3]))[:2].astype(int)
            block = change[y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3)
            brightest = block[np.abs(block).sum(axis=1).argmax()]
            assert np.abs(brightest).max() > 11, f"no light along sub-beam {'ABC'[k]}"
            assert nearest_hue(brightest, view.theme.hues) == k
    assert not change[20, 20].any()  # and none where there is none


def test_a_detector_without_light_has_no_sub_beam(shot):
    posed = PosedSensor.from_state(PAPER, BESIDE)
    lit = (facets.readings(PAPER, BESIDE)[2::3] > 1e-6).tolist()
    assert not all(lit)
    assert [bool(sub_beam(posed, shot, k).any()) for k in range(3)] == lit
    near = PosedSensor.from_state(PAPER, BESIDE * 0.075)
    assert 0 < sum(len(scene.cut(near, k)) > 0 for k in range(3)) < 3


def test_parts_are_where_the_camera_sees_their_points_and_fill_the_picture(shot):
    points = shot.camera.project(rig_view(PAPER).points())
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    assert (low / SIZE > 0.04).all()
    assert (high / SIZE < (0.96, 0.89)).all()
    assert ((high - low) / SIZE / (0.9, 0.83)).max() > 0.97
    drawn = np.argwhere(np.isfinite(shot.depth))[:, ::-1]
    np.testing.assert_allclose([drawn.min(axis=0), drawn.max(axis=0)], [low, high], atol=4)


def test_spots_shine_on_the_detectors_where_readings_say(shot):
    """Each face, square on from the mirror, where psi runs to the left: the light's centroid."""
    sensor, size = SENSORS["skewed0"], 500
    state = states(1, seed=5, offset=0.1, angle=0.004)[0]
    state[:3], state[6:] = state[:3] - [*state[6:], state[2] - 0.6], 0  # near rest
    posed = PosedSensor.from_state(sensor, state)
    for k, (psi, zeta, _) in enumerate(facets.readings(sensor, state).reshape(3, 3)):
        camera = rig_view(sensor).face_inset(k, size, "", corner=(0, 0)).camera
        depth = np.zeros((size, size))
        light = surface(posed, replace(shot, camera=camera, depth=depth), k)
        y, x = np.indices((size, size)) + 0.5
        places = np.array(camera.offsets(x, y))
        across, up = (light * places).sum(axis=(1, 2)) / light.sum()
        assert (-across, up) == pytest.approx((psi, zeta), abs=0.01)


@pytest.mark.slow
def test_facets_are_not_black_at_any_inclination():
    """They were at 38, 40, 41 and 43 degrees, where the normals of the drawn facets were lost."""
    inclined = tuple(replace(facet, inclination=np.radians(41)) for facet in PAPER.facets)
    form = PictureForm("mirror", (120, 90), "light")
    with Picture(replace(PAPER, facets=inclined), REST, form) as picture:
        camera, parts = picture.view.camera, picture.view.parts
        colour = picture.studio.take(camera).colour
    for k in (0, 2):  # those that face the camera
        x, y = camera.project(0.05 * parts[k].solid.points[1:].mean(axis=0))[:2].astype(int)
        assert colour[y - 2 : y + 3, x - 2 : x + 3].mean() > 0.15


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "view"),
    [("paper", "cutaway"), ("fig4", "mirror"), ("skewed", "both"), ("skewed", "detector")],
)
def test_views_of_shipped_sensors_are_neither_empty_nor_full(name, view):
    form = PictureForm(view, (200, 150))
    with Picture(facets.load(name).sensor, BESIDE, form) as picture:
        picture.image()  # also where no light falls
        picture.move(REST)
        image = picture.image()
        shot = picture.studio.take(picture.view.camera)
    assert image.std() > 8
    assert 0.03 < np.isfinite(shot.depth).mean() < 0.85


def volume(solid):
    """The volume inside a surface, by the divergence theorem."""
    corners = (solid.points[face] for face in solid.faces)
    fans = [(p[[0, n, n + 1]]) for p in corners for n in range(1, len(p) - 1)]
    return np.linalg.det(fans).sum() / 6


def test_parts_are_closed_and_face_outward_and_facets_lie_in_the_planes_of_the_model():
    """Volumes are positive: else light falls on a part's inside."""
    rig = RigModel(SENSORS["skewed1"])
    parts = rig.parts()
    # the mirror's facets and its body, of which none is closed alone, come first
    volumes = [volume(part.solid) for part in parts]
    assert sum(volumes[:4]) > 0
    assert min(volumes[4:]) > 0
    for facet, normal in zip(parts[:3], rig.posed.at.normals, strict=True):
        assert np.abs(facet.solid.points @ np.array(normal, float)).max() < 1e-9


@pytest.mark.slow
def test_the_range_solid_ends_where_ranges_do():
    config = facets.load("paper")
    solid = range_solid.range_solid(config.sensor, config.range)
    z = facets.axis_ranges(config.sensor, config.range, np.zeros(6))[2]
    # the first and last points are those of the poles
    assert solid.points[[0, -1], 2] == pytest.approx([z.high, z.low], abs=1e-2)
    assert {z.high_cause, z.low_cause} <= set(solid.causes)


def test_equal_radii_have_one_dimension_and_unequal_ones_three():
    other = replace(PAPER, psds=(replace(PAPER.psds[0], radius=200.0), *PAPER.psds[1:]))
    for sensor, radii in ((PAPER, ["250 mm"]), (other, ["200 mm", "250 mm", "250 mm"])):
        assert [dimension.words for dimension in rig_view(sensor).radii()] == radii


def test_a_motion_is_drawn_as_large_as_its_spots_stay_on_their_detectors():
    motion = np.zeros((20, 8))
    motion[:, 5] = np.linspace(-1e-3, 1e-3, 20)
    assert motion_factor(PAPER, motion) == 20  # 250 mm x 20 mrad is 5 mm of 6.5
    assert motion_factor(PAPER, 100 * motion) == 1
