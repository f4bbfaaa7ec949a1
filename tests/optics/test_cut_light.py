"""A coating and other light beside what cuts the light: strips of traced rays, and Fresnel."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
from sensors import SENSORS, states

import facets
from facets import Apertures, BenchLight, ConfigError, InputError

CUTS = {
    "beam": Apertures(beam=0.7),
    "gap": Apertures(gap=0.02),
    "detectors": Apertures(detectors=True),
    "all": Apertures(beam=1.1, detectors=True, tip=0.03, rim=0.4, gap=0.01),
}
OTHER = ((5e-4, 1, 2), (4e-4, -1, 0.5), (6e-4, 0, -2))
LIGHT = BenchLight(index=(1.37, 7.62), polarization=0.3, background=OTHER, delays=(0, 5e-6, 1e-5))
PAPER = facets.Sensor()


def drawn(cut: Apertures, count: int) -> np.ndarray:
    some = states(count, 5)
    if cut.detectors:  # with spots on the detectors' edges
        some[:, 2] = np.random.default_rng(5).uniform(-6.5, 6.5, count)
    return some


def reflected(sensor, state) -> np.ndarray:
    """What each facet reflects of light polarised along `LIGHT.polarization`, over what it does of
    unpolarised light at 45 degrees; by Fresnel's amplitudes, with complex numbers: (3,)."""
    at = oracle.setup(sensor, state)
    index, found = complex(*LIGHT.index), []
    level = oracle.setup(replace(sensor, beam=replace(sensor.beam, rotation=0.0)), state)
    field = level.across @ [np.cos(LIGHT.polarization), np.sin(LIGHT.polarization)]

    def powers(cosine):
        inside = np.sqrt(1 - (1 - cosine**2) / index**2)
        s = (cosine - index * inside) / (cosine + index * inside)
        p = (index * cosine - inside) / (index * cosine + inside)
        return abs(s) ** 2, abs(p) ** 2

    for normal in at.normals:
        s, p = powers(-(normal @ at.down))
        across = np.cross(at.down, normal)
        share = (across @ field) ** 2 / (across @ across)
        found.append((share * s + (1 - share) * p) / (sum(powers(np.sqrt(0.5))) / 2))
    return np.array(found)


@pytest.mark.parametrize("name", ["paper", "skewed1"])
@pytest.mark.parametrize("cut", CUTS.values(), ids=CUTS)
def test_readings(name, cut):
    sensor = replace(SENSORS[name], apertures=cut, light=LIGHT)
    for state in drawn(cut, 6):
        spots = oracle.by_strips(replace(sensor, light=BenchLight()), state).reshape(3, 3)
        share, other = spots[:, 2:] * reflected(sensor, state)[:, None], np.array(OTHER)
        whole = share + other[:, :1]
        places = (spots[:, :2] * share + other[:, 1:] * other[:, :1]) / whole
        exact = np.column_stack([places, whole])
        ours = facets.readings(sensor, state).reshape(3, 3)
        np.testing.assert_allclose(ours, exact, atol=1e-11, rtol=1e-11)


@pytest.mark.parametrize("cut", CUTS.values(), ids=CUTS)
@pytest.mark.slow
def test_derivatives(cut):
    sensor = replace(SENSORS["skewed2"], apertures=cut, light=LIGHT)
    for state in drawn(cut, 3):
        closed = facets.jacobian(sensor, state)
        for n, step in enumerate(1e-6 * np.eye(8)):
            ahead, behind = facets.readings(sensor, [state + step, state - step])
            slope = (ahead - behind) / 2e-6
            np.testing.assert_allclose(closed[:, n], slope, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("power", ["known", "unknown"])
def test_poses(power):
    sensor = replace(PAPER, apertures=CUTS["beam"], light=LIGHT)
    truth = np.zeros((20, 8))
    box = [0.12, 0.12, 2, 6e-3, 6e-3, 6e-3]
    truth[:, :6] = np.random.default_rng(6).uniform(-1, 1, (20, 6)) * box
    solution = facets.solve(sensor, facets.readings(sensor, truth), beam="known", power=power)
    assert solution.ok.all()
    assert np.abs(solution.state - truth)[:, :3].max() < 1e-9


@pytest.mark.parametrize(
    ("light", "remedy"),
    [
        ({"strips": (0.01, 0.01, 0.01)}, r"light\.strips.*apertures\.gap"),
        ({"tip": 1e-3}, r"light\.tip.*apertures\.tip"),
        ({"wavelength": 6e-4}, r"light\.wavelength.*diffract"),
        ({"curvature_yy": 1e-4}, r"light\.curvature_yy.*collimated"),
        ({"rolloff": (1e-5,) * 6}, r"light\.rolloff.*edge"),
    ],
)
def test_what_happens_at_edges_is_refused(light, remedy):
    with pytest.raises(InputError, match=remedy):
        replace(PAPER, light=BenchLight(**light), apertures=Apertures(gap=0.01))


def test_a_configuration_is_told_where(tmp_path):
    file = tmp_path / "both.yaml"
    file.write_text(
        "extends: paper\nsensor:\n  apertures: {gap_um: 10}\n  light:\n    index: [1.37, 7.62]\n"
        "    wavelength_nm: 632.8\n    strips_um: [1, 2, 3]\n"
    )
    with pytest.raises(ConfigError) as error:
        facets.load(file)
    told = str(error.value)
    assert ":6: sensor.light.wavelength_nm cannot be combined with sensor.apertures.gap_um" in told
    assert f"{file}:7: sensor.light.strips_um" in told
    assert "apertures.gap_um alone" in told


def test_a_calibration_of_it_is_refused():
    sensor = replace(PAPER, apertures=CUTS["gap"], light=LIGHT)
    for function in (facets.parameter_jacobian, facets.model.arrays.effect_jacobian):
        with pytest.raises(InputError, match="leave one of the two out"):
            function(sensor, states(1, 1))
