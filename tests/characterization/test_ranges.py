"""Measurement ranges: limits, and the paper's Table 2."""

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets import CAUSES, Rules
from facets.characterization import LIGHT, PSD, ranges
from facets.core import InputError

SENSOR = facets.Sensor()
REST = np.zeros(6)


def test_table_2_from_one_signal_to_noise_ratio():
    """Ranges as the paper's, measured on a rig with its own tolerances, within 5 %: equally far to
    both sides, where x under a fixed beam is shorter than y, as measured."""
    fixed = {axis.name: axis for axis in ranges.axis_ranges(SENSOR, Rules(), REST)}
    tracked = {axis.name: axis for axis in ranges.axis_ranges(SENSOR, Rules(tracking=True), REST)}
    measured = {"tx": 0.36, "ty": 0.39, "tz": 12.3, "roll": 0.028, "pitch": 0.0245, "yaw": 0.048}
    for name, value in measured.items():
        assert fixed[name].symmetric == pytest.approx(value, rel=0.05)
        cause = LIGHT if name in ("tx", "ty") else PSD
        assert (fixed[name].low_cause, fixed[name].high_cause) == (cause, cause)
    assert tracked["tx"].symmetric == pytest.approx(13.6, rel=0.05)
    assert tracked["ty"].symmetric == pytest.approx(11.8, rel=0.05)


def test_the_cause_is_the_limit_that_is_broken():
    poses = np.zeros((3, 6))
    poses[0, 0] = 0.3  # past the light's reach
    poses[1, 2] = 7.0  # past the detector's edge
    clear = ranges.clearances(SENSOR, poses, Rules())
    assert (clear[2] > 0).all()
    assert [int(row.argmin()) for row in clear[:2]] == [LIGHT, PSD]
    assert CAUSES[LIGHT] == "too little light"


def test_a_limit_on_resolution_ends_the_range_where_it_is_met():
    limit = 3e-3
    rules = Rules(coarsest=(limit, *[np.inf] * 5))
    found = ranges.axis_ranges(SENSOR, rules, REST)[0]
    assert CAUSES[found.high_cause] == "too coarse"
    state = np.zeros(8)
    state[0] = found.high
    solution = facets.solve(SENSOR, facets.readings(SENSOR, state))
    assert solution.uncertainty[0] == pytest.approx(limit, rel=1e-4)
    assert found.high < ranges.axis_ranges(SENSOR, Rules(), REST)[0].high
    assert facets.trace(SENSOR, rules, ("tx", "ty")).points[0, 0] == pytest.approx(
        found.high, abs=1e-4
    )


def test_a_limit_on_the_condition_ends_the_range():
    near = ranges.scaled_jacobian(SENSOR, np.zeros((1, 8)))[0]
    rules = Rules(condition=1.2 * np.linalg.cond(near))
    found = ranges.axis_ranges(SENSOR, rules, REST)[0]
    assert CAUSES[found.high_cause] == "Jacobian near singular"


@pytest.mark.parametrize(
    "rules",
    [
        Rules(),
        pytest.param(Rules(tracking=True), marks=pytest.mark.slow),
        pytest.param(Rules(coarsest=(np.inf, np.inf, 6.0, *[np.inf] * 3), condition=np.inf),
                     marks=pytest.mark.slow),
    ],
    ids=["fixed", "tracked", "coarsest"],
)  # fmt: skip
def test_no_band_inside_a_range_is_stepped_over(rules):
    """Near rest the Jacobian of `singular` is singular, in bands a hundredth of a step wide, with
    regular poses on either side."""
    sensor = facets.load("singular").sensor
    found = ranges.axis_ranges(sensor, rules, REST)
    assert {found[n].low_cause for n in (0, 3, 4)} <= {ranges.SINGULAR, ranges.COARSE}
    ends = np.array([end for axis in found for end in (axis.low, axis.high)])
    poses = np.zeros((12, 1000, 6))
    for n, end in enumerate(ends):
        poses[n, :, n // 2] = np.geomspace(1e-4, 0.9999, 1000) * end
    assert (ranges.clearances(sensor, poses.reshape(-1, 6), rules) > 0).all()
    outline = facets.trace(sensor, rules, ("tx", "yaw"))
    assert outline.points[:, 0].min() > 1.1 * found[0].low


def scale_gain(sensor, factor):
    """The sensor with amplifiers of so many times the gain."""
    gain = factor * sensor.electronics.transimpedance
    return replace(sensor, electronics=replace(sensor.electronics, transimpedance=gain))


@pytest.mark.parametrize(
    ("kind", "gain"), [("duo-lateral", 1.0), ("pincushion", 2.0), ("tetra-lateral", 2.0)]
)
def test_a_range_ends_where_a_detector_saturates(kind, gain):
    """Just inside a detector reads, just outside it does not: as `add_noise` has it."""
    bench = facets.load("bench").sensor
    electronics = replace(bench.electronics, kind=kind)
    sensor = scale_gain(replace(bench, electronics=electronics), gain)
    found = ranges.axis_ranges(sensor, Rules(), REST)[0]
    assert CAUSES[found.low_cause] == "detector saturated"
    states = np.zeros((200, 8))
    for share, is_lost in ((0.99, False), (1.01, True)):
        states[:, 0] = share * found.low
        exact = facets.readings(sensor, states)
        noisy = facets.add_noise(sensor, exact, np.random.default_rng(1))
        assert np.isnan(noisy).any() == is_lost
        assert np.isnan(noisy).any(axis=1).all() == is_lost


def test_a_sensor_that_saturates_at_rest_says_what_to_change():
    sensor = scale_gain(facets.load("bench").sensor, 10)
    with pytest.raises(InputError, match=r"detector saturated; the light on detector [ABC] drives"):
        ranges.axis_ranges(sensor, Rules(), REST)


@pytest.mark.slow
def test_the_box_is_inside_and_touches_a_limit():
    sizes = np.array([axis.symmetric / 2 for axis in ranges.axis_ranges(SENSOR, Rules(), REST)])
    half, cause = ranges.largest_box(SENSOR, Rules(), REST, sizes)
    inside = np.random.default_rng(5).uniform(-half, half, (20_000, 6))
    assert (ranges.clearances(SENSOR, inside, Rules()).min(axis=1) > 0).mean() > 0.9999
    assert CAUSES[cause] == "spot leaves the PSD"


def test_a_centroid_goes_further_than_a_whole_spot_and_a_cut_one_as_far():
    whole = ranges.axis_ranges(SENSOR, Rules(), REST)
    centroid = ranges.axis_ranges(SENSOR, Rules(whole_spot=False), REST)
    assert centroid[2].symmetric > whole[2].symmetric
    cut = replace(SENSOR, apertures=facets.Apertures(detectors=True))
    again = ranges.axis_ranges(cut, Rules(), REST)
    assert again[5].symmetric == pytest.approx(whole[5].symmetric, rel=1e-6)


def test_other_light_on_the_detectors_is_no_light_of_a_spot():
    """Else a range goes on in the dark: a room has more light than `range.snr` asks for."""
    sensor = replace(facets.Sensor(), noise=replace(facets.Noise(), power=1e-6))
    rules = Rules(snr=100)
    room = replace(sensor.light, background=((2e-3, 1, 2), (2e-3, -1, 0.5), (2e-3, 0, -2)))
    dark = ranges.axis_ranges(sensor, rules, np.zeros(6))[0]
    lit = ranges.axis_ranges(replace(sensor, light=room), rules, np.zeros(6))[0]
    assert lit.high_cause == dark.high_cause == LIGHT
    assert lit.high == pytest.approx(dark.high, rel=1e-3)
