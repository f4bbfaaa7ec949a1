"""The readings, against rays traced one by one."""

import numpy as np
import oracle
import pytest
from scipy.integrate import dblquad
from sensors import SENSORS, states

import facets
from facets import InputError
from facets.model import geometry_of
from facets.optics.forward import readings as plain_readings

NAMED = pytest.mark.parametrize("name", SENSORS)


def worst(sensor: facets.Sensor, some_states: np.ndarray) -> tuple[float, float]:
    """Largest errors: of a place in mm, of a power relative to the beam's."""
    brute = np.array([oracle.by_quadrature(sensor, state) for state in some_states])
    error = np.abs(facets.readings(sensor, some_states) - brute).reshape(-1, 3, 3)
    return error[:, :, :2].max(), error[:, :, 2].max() / sensor.beam.power


COUNTS = pytest.mark.parametrize("count", [100, pytest.param(1000, marks=pytest.mark.study)])


@NAMED
@COUNTS
def test_readings_are_those_of_traced_rays(name, count):
    """1e-12 mm and 1e-12 of the power; both sides carry roundings of 300 mm, 6e-14 mm each."""
    place, power = worst(SENSORS[name], states(count, seed=12))
    assert place < 1e-12
    assert power < 1e-12


def test_the_oracle_has_converged():
    state = states(1, seed=3)[0]
    for sensor in SENSORS.values():
        coarse, fine = (oracle.by_quadrature(sensor, state, refine) for refine in (1, 2))
        assert np.abs(coarse - fine).max() < 3e-13


@pytest.mark.parametrize("name", ["paper", "skewed1", "skewed4"])
def test_which_ray_meets_which_facet(name):
    """262,144 Sobol rays: off by 6e-5 mm and 8e-5 of the beam's power here."""
    for state in states(2, seed=8, angle=0.1):
        brute = oracle.by_random_rays(SENSORS[name], state, 18, seed=1)
        error = np.abs(facets.readings(SENSORS[name], state) - brute).reshape(3, 3)
        assert error[:, :2].max() < 1e-4
        assert error[:, 2].max() / SENSORS[name].beam.power < 1e-4


def test_the_nominal_pose_is_exact():
    reading = facets.readings(facets.Sensor(), np.zeros(8))
    centroid = 0.85 / 4 * 3 * np.sqrt(3 / (8 * np.pi))  # of a third of a Gaussian, closed
    assert reading[2::3] == pytest.approx([0.1] * 3, rel=1e-15)
    assert reading[0::3] == pytest.approx([0] * 3, abs=1e-14)  # of a way of 250 mm
    assert reading[1::3] == pytest.approx([-centroid] * 3, rel=1e-13)


def test_tz_moves_zeta_alone():
    moved = np.zeros(8)
    moved[2] = 3.0
    difference = facets.readings(facets.Sensor(), moved) - facets.readings(
        facets.Sensor(), np.zeros(8)
    )
    assert difference == pytest.approx([0, 3, 0] * 3, abs=1e-13)


@NAMED
def test_powers_add_up_to_the_beam(name):
    """Eq. (4): the facets share the whole beam."""
    total = facets.readings(SENSORS[name], states(200, seed=4))[:, 2::3].sum(axis=1)
    assert total == pytest.approx(SENSORS[name].beam.power, rel=1e-14)


@NAMED
def test_compiled_and_plain_python_agree(name):
    """The same text: only the order of roundings may differ."""
    plain = geometry_of(SENSORS[name])
    for state in states(5, seed=6):
        ours = np.array(plain_readings(plain, tuple(state.tolist()))).ravel()
        assert facets.readings(SENSORS[name], state) == pytest.approx(ours, abs=2e-13)


def test_shapes_do_not_change_bits():
    sensor, some_states = SENSORS["skewed2"], states(12, seed=7)
    batch = facets.readings(sensor, some_states)
    assert (facets.readings(sensor, some_states.reshape(2, 6, 8)).reshape(12, 9) == batch).all()
    assert (facets.readings(sensor, some_states[::2]) == batch[::2]).all()
    for state, row in zip(some_states, batch, strict=True):
        assert (facets.readings(sensor, state) == row).all()
        assert (facets.readings(sensor, state.tolist()) == row).all()
    assert facets.readings(sensor, np.empty((0, 8))).shape == (0, 9)


def test_a_facet_turned_past_the_beam_reads_nan_and_only_it():
    tilted = np.zeros(8)
    tilted[4] = 0.8  # pitch: facet A leans to 45 + 46 degrees
    reading = facets.readings(facets.Sensor(), tilted)
    assert np.isnan(reading[:3]).all()
    assert not facets.reaches(facets.Sensor(), tilted)[0]


def test_a_sub_beam_that_leads_away_from_its_detector_reads_nan():
    up = np.zeros(8)
    up[4] = -0.8  # facet A lies nearly flat: its sub-beam goes back up and inwards
    reading = facets.readings(facets.Sensor(), up)
    assert np.isnan(reading[:3]).all()
    assert not facets.reaches(facets.Sensor(), up)[0]


def test_a_state_that_is_not_finite_reads_nan():
    for place in range(8):
        state = np.zeros(8)
        state[place] = np.nan
        assert np.isnan(facets.readings(facets.Sensor(), state)[0::3]).any()


def test_reaches_ends_at_the_edge_of_the_sensitive_area():
    """Of the height 13 mm; the nominal spot lies at zeta = -0.22 mm."""
    sensor = facets.Sensor()
    nominal = facets.readings(sensor, np.zeros(8))[1]
    for tz, expected in ((6.49 - nominal, True), (6.51 - nominal, False)):
        assert list(facets.reaches(sensor, [0, 0, tz, 0, 0, 0, 0, 0])) == [expected] * 3


def by_paper(sensor: facets.Sensor, state: np.ndarray) -> np.ndarray:
    """Eq. (7) to (9) for detector A, by SciPy's dblquad over the wedge in polar coordinates."""
    at = oracle.setup(sensor, state)
    phi, axes = sensor.beam.diameter_x, at.detectors[0][1]
    normal = at.normals[0]
    px, py, pz = axes.T @ (at.down - 2 * (at.down @ normal) * normal)
    psi, zeta = oracle.land(at, 0, np.zeros((1, 2)))[0]
    apex = oracle.seen(at, at.apex - at.centre)
    corner = oracle.land(at, 0, apex[None])[0]
    edges = [oracle.land(at, 0, (apex + oracle.edge(at, 0, k))[None])[0] - corner for k in (2, 1)]
    first, second = (np.arctan2(z, y) for y, z in edges)
    first, second = min(first, second), max(first, second)
    if second - first > np.pi:
        first, second = second, first + 2 * np.pi

    def integral(weight):
        def integrand(s, angle):
            y, z = corner[0] + s * np.cos(angle), corner[1] + s * np.sin(angle)
            r2 = (y - psi) ** 2 * px**2 / (px**2 + py**2) + (z - zeta) ** 2 * px**2 / (
                px**2 + pz**2
            )
            light = 8 * sensor.beam.power / (np.pi * phi**2) * np.exp(-8 * r2 / phi**2)
            return s * weight(y, z) * light * px / np.sqrt(px**2 + py**2 + pz**2)

        return dblquad(integrand, first, second, 0, 3, epsabs=1e-13, epsrel=1e-12)[0]

    power = integral(lambda y, z: 1)
    return np.array([integral(lambda y, z: y), integral(lambda y, z: z), power * power]) / power


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


def test_bad_arguments_are_named():
    with pytest.raises(InputError, match="irradiance is 'flat'"):
        facets.readings(facets.Sensor(), np.zeros(8), irradiance="flat")
    with pytest.raises(InputError, match=r"shape \(7,\); needed: \(\.\.\., 8\)"):
        facets.readings(facets.Sensor(), np.zeros(7))
    with pytest.raises(InputError, match="round beam"):
        facets.readings(SENSORS["skewed0"], np.zeros(8), irradiance="paper")
