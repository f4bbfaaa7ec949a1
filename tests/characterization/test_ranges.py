"""Measurement ranges: limits, and the paper's Table 2."""

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets import CAUSES, InputError, Rules
from facets.characterization import LIGHT, PSD, ranges

SENSOR = facets.Sensor()
REST = np.zeros(6)


def axis_ranges(sensor=SENSOR, rules=None):
    return ranges.axis_ranges(sensor, rules or Rules(), REST)


def test_table_2_from_one_signal_to_noise_ratio():
    """Ranges as the paper's, measured on a rig with its own tolerances, within 5 %: equally far to
    both sides, where x under a fixed beam is shorter than y, as measured."""
    fixed, tracked = axis_ranges(), axis_ranges(rules=Rules(tracking=True))
    measured = [0.36, 0.39, 12.3, 0.028, 0.0245, 0.048]
    assert [axis.symmetric for axis in fixed] == pytest.approx(measured, rel=0.05)
    assert [axis.symmetric for axis in tracked[:2]] == pytest.approx([13.6, 11.8], rel=0.05)
    causes = [(axis.low_cause, axis.high_cause) for axis in fixed]
    assert causes == [(LIGHT, LIGHT)] * 2 + [(PSD, PSD)] * 4


@pytest.mark.parametrize(
    "rules", [Rules(), Rules(coarsest=(np.inf, np.inf, 6.0, *[np.inf] * 3), condition=np.inf)]
)
def test_no_band_inside_a_range_is_stepped_over(rules):
    """Near rest the Jacobian of `singular` is singular, in bands a hundredth of a step wide, with
    regular poses on either side."""
    sensor = facets.load("singular").sensor
    axes = axis_ranges(sensor, rules)
    assert {axes[n].low_cause for n in (0, 3, 4)} <= {ranges.SINGULAR, ranges.COARSE}
    for n, axis in enumerate(axes):
        for end in (axis.low, axis.high):
            poses = np.zeros((1000, 6))
            poses[:, n] = np.geomspace(1e-4, 0.9999, 1000) * end
            assert (ranges.clearances(sensor, poses, rules) > 0).all()
    outline = facets.trace(sensor, rules, ("tx", "yaw"))
    assert outline.points[:, 0].min() > 1.1 * axes[0].low


def test_a_range_ends_where_a_detector_saturates():
    """Just inside a detector reads, just outside it does not: as `add_noise` has it."""
    sensor = facets.load("bench").sensor
    axis = axis_ranges(sensor)[0]
    assert CAUSES[axis.low_cause] == "detector saturated"
    states = np.zeros((200, 8))
    for share, is_lost in ((0.99, False), (1.01, True)):
        states[:, 0] = share * axis.low
        exact = facets.readings(sensor, states)
        noisy = facets.add_noise(sensor, exact, np.random.default_rng(1))
        assert np.isnan(noisy).any(axis=1).tolist() == [is_lost] * 200
    gain = 10 * sensor.electronics.transimpedance
    loud = replace(sensor, electronics=replace(sensor.electronics, transimpedance=gain))
    with pytest.raises(InputError, match=r"detector saturated; the light on detector [ABC] drives"):
        axis_ranges(loud)


def test_a_centroid_goes_further_than_a_whole_spot_and_a_cut_one_as_far():
    whole, centroid = axis_ranges(), axis_ranges(rules=Rules(whole_spot=False))
    assert centroid[2].symmetric > whole[2].symmetric
    cut = axis_ranges(replace(SENSOR, apertures=facets.Apertures(detectors=True)))
    assert cut[5].symmetric == pytest.approx(whole[5].symmetric, rel=1e-6)


def test_other_light_on_the_detectors_is_no_light_of_a_spot():
    """Else a range goes on in the dark: a room has more light than `range.snr` asks for."""
    sensor = replace(SENSOR, noise=replace(SENSOR.noise, power=1e-6))
    room = replace(sensor.light, background=((2e-3, 1, 2), (2e-3, -1, 0.5), (2e-3, 0, -2)))
    dark, lit = (
        axis_ranges(replace(sensor, light=light), Rules(snr=100))[0]
        for light in (sensor.light, room)
    )
    assert lit.high_cause == dark.high_cause == LIGHT
    assert lit.high == pytest.approx(dark.high, rel=1e-3)
