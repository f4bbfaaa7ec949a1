"""The readings, against rays traced one by one."""

import numpy as np
import oracle
import pytest
from sensors import SENSORS, states

import facets
from facets import InputError

COUNTS = pytest.mark.parametrize("count", [12, pytest.param(1000, marks=pytest.mark.study)])


@COUNTS
def test_readings_are_those_of_traced_rays(count):
    """1e-12 mm and 1e-12 of the power; both sides carry roundings of 300 mm, 6e-14 mm each."""
    for name, sensor in SENSORS.items():
        some = states(count, seed=12)
        rays = np.array([oracle.by_strips(sensor, state) for state in some])
        error = np.abs(facets.readings(sensor, some) - rays)
        error[:, 2::3] /= sensor.beam.power
        assert error.max() < 1e-12, name


def test_which_ray_meets_which_facet():
    """262,144 Sobol rays: off by 6e-5 mm and 8e-5 of the beam's power here."""
    for name in ("paper", "skewed4"):
        state = states(1, seed=8, angle=0.1)[0]
        rays = oracle.by_random_rays(SENSORS[name], state, 18, seed=1)
        error = np.abs(facets.readings(SENSORS[name], state) - rays).reshape(3, 3)
        assert error[:, :2].max() < 1e-4
        assert error[:, 2].max() / SENSORS[name].beam.power < 1e-4


def test_the_nominal_pose_is_exact_and_tz_moves_zeta_alone():
    nominal, raised = facets.readings(facets.Sensor(), [[0] * 8, [0, 0, 3, 0, 0, 0, 0, 0]])
    centroid = 0.85 / 4 * 3 * np.sqrt(3 / (8 * np.pi))  # of a third of a Gaussian, closed
    assert nominal[2::3] == pytest.approx([0.1] * 3, rel=1e-15)
    assert nominal[0::3] == pytest.approx([0] * 3, abs=3e-14)  # a rounding of a way of 250 mm
    assert nominal[1::3] == pytest.approx([-centroid] * 3, rel=1e-13)
    assert raised - nominal == pytest.approx([0, 3, 0] * 3, abs=1e-13)


@pytest.mark.parametrize("pitch", [0.8, -0.8])
def test_a_facet_without_a_spot_reads_nan_and_only_it(pitch):
    """Facet A leans to 45 + 46 degrees, past the beam, or lies nearly flat, so that its sub-beam
    goes back up and inwards."""
    sensor, turned = facets.Sensor(), [0, 0, 0, 0, pitch, 0, 0, 0]
    assert not facets.reaches(sensor, turned)[0]
    for function in (
        facets.readings, facets.jacobian, facets.parameter_jacobian, facets.margins,
    ):  # fmt: skip
        on_a, *others = np.split(np.asarray(function(sensor, turned)), 3)
        assert np.isnan(on_a).all()
        assert not np.isnan(others).any() or function is facets.margins


def test_a_state_that_is_not_finite_reads_nan():
    for sensor in (facets.Sensor(), facets.load("bench-light").sensor):
        spoilt = facets.readings(sensor, np.where(np.eye(8, dtype=bool), np.nan, 0.0))
        assert np.isnan(spoilt[:, 0::3]).any(axis=1).all()


def test_shapes():
    sensor = facets.Sensor()
    for function, shape in (
        (facets.readings, (9,)), (facets.jacobian, (9, 8)), (facets.footprints, (3, 5)),
        (facets.parameter_jacobian, (9, 30)), (facets.margins, (3, 5)), (facets.reaches, (3,)),
    ):  # fmt: skip
        assert function(sensor, np.empty((0, 8))).shape == (0, *shape)
        assert function(sensor, np.zeros((2, 3, 8))).shape == (2, 3, *shape)


def test_reaches_ends_at_the_edge_of_the_sensitive_area():
    """Of the height 13 mm; the nominal spot lies at zeta = -0.22 mm."""
    sensor = facets.Sensor()
    nominal = facets.readings(sensor, np.zeros(8))[1]
    for tz, expected in ((6.49 - nominal, True), (6.51 - nominal, False)):
        assert list(facets.reaches(sensor, [0, 0, tz, 0, 0, 0, 0, 0])) == [expected] * 3


def by_paper(sensor: facets.Sensor, state: np.ndarray) -> np.ndarray:
    """Eq. (7) to (9) for detector A, by nodes in polar coordinates about the apex's image."""
    at = oracle.setup(sensor, state)
    normal, axes = at.normals[0], at.detectors[0][1]
    px, py, pz = axes.T @ (at.down - 2 * (at.down @ normal) * normal)
    apex = oracle.seen(at, at.apex - at.centre)
    ends = [apex, *(apex + oracle.edge(at, 0, k) for k in (1, 2))]
    centre, corner, *edges = oracle.land(at, 0, np.array([[0, 0], *ends]))
    first, second = (np.arctan2(*(edge - corner)[::-1]) for edge in edges)
    opening = (second - first + np.pi) % (2 * np.pi) - np.pi
    angle, angle_weight = oracle.panels(first, first + opening, 6)
    radius, radius_weight = oracle.panels(0, 3, 30)
    y, z = (corner + radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)).T
    far = (y - centre[0]) ** 2 / (px**2 + py**2) + (z - centre[1]) ** 2 / (px**2 + pz**2)
    phi = sensor.beam.diameter_x
    light = 8 * sensor.beam.power / (np.pi * phi**2) * np.exp(-8 * px**2 * far / phi**2)
    share = abs(px) * light * np.outer(abs(angle_weight), radius * radius_weight)
    return np.array([(share * y).sum(), (share * z).sum(), share.sum() ** 2]) / share.sum()


def test_the_papers_irradiance_is_integrated_right():
    for state in ([0.0] * 8, [0.1, 0.05, 1, 0.012, 0.02, 0.02, 0, 0]):
        ours = facets.readings(facets.Sensor(), state, irradiance="paper")[:3]
        assert ours == pytest.approx(by_paper(facets.Sensor(), np.array(state)), abs=1e-11)


def test_the_papers_irradiance_is_exact_for_a_level_sub_beam_only():
    sensor = facets.Sensor()
    level, oblique = np.zeros(8), np.zeros(8)
    level[:2], oblique[3:6] = 0.1, 0.02
    for state, low, high in ((level, 0, 1e-13), (oblique, 1e-5, 1e-3)):
        paper = facets.readings(sensor, state, irradiance="paper")
        assert low <= np.abs(paper - facets.readings(sensor, state)).max() <= high


def test_the_papers_irradiance_takes_no_oval_beam():
    with pytest.raises(InputError, match="round beam"):
        facets.readings(SENSORS["skewed0"], np.zeros(8), irradiance="paper")
