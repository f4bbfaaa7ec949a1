"""Causes that a fit has no unknowns for: each is named beside the others, or bounded."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pytest
from rig_samples import (
    NOMINAL,
    WIDE,
    accepted_effects,
    error_slope,
    judge,
    sample_rig,
    settings,
    words_of,
)

import facets
from facets.detectors import correct

SIGMA = NOMINAL.beam.diameter_x / 4
PLACES = [0, 1, 3, 4, 6, 7]
HUM = np.array([8e-3, -5e-3, 4e-3, 3e-3, -2e-3, 1e-3])
COUNT = 240
#: Where something jumps.
BEHIND = np.arange(COUNT) >= 150


def chip(sensor, state, exact):
    place = state[:, :2] - state[:, 6:]
    irradiance = np.exp(-(place**2).sum(axis=1) / 2 / SIGMA**2) / (2 * np.pi * SIGMA**2)
    exact[:, 2] -= 3e-4 * sensor.beam.power * irradiance
    return exact


def add_light(exact, power, places):
    """Add light of powers (n, 3) at places (n, 3, 2): powers, and places times powers, add up."""
    rows = exact.reshape(-1, 3, 3)
    moments = rows[..., 2:] * rows[..., :2] + power[..., None] * places
    rows[..., 2] += power
    rows[..., :2] = moments / rows[..., 2:]
    return exact


def reflex(sensor, state, exact):
    """One per cent of the light comes from beside the beam."""
    aside = state.copy()
    aside[:, 6:] += SIGMA * np.array([1.5, -1.0])
    other = facets.readings(sensor, aside).reshape(-1, 3, 3)
    exact[:, 2::3] *= 0.99
    return add_light(exact, 0.01 * other[..., 2], other[..., :2])


def fringe(sensor, state, exact):
    phase = 2 * np.pi * state[:, :1] / 0.2
    exact[:, 2::3] *= 1 + 1e-3 * np.cos(phase + np.arange(3))
    return exact


def window(sensor, state, exact):
    exact[:, 5] *= 1 + 2e-3 * np.cos(2 * np.pi * exact[:, 4] / 0.7)
    return exact


def oblique_window(sensor, state, exact):
    """Fringes that shift the spot by 4 um, 0.9 mm apart along a diagonal of the detector."""
    phase = 2 * np.pi * exact[:, 3:5] @ [0.6, -0.8] / 0.9
    exact[:, 3:5] += 4e-3 * np.outer(np.sin(phase), [0.8, 0.6])
    return exact


def leak(sensor, state, exact):
    """0.5 % of the currents of detector A in the channels of B."""
    return add_light(exact, 5e-3 * np.outer(exact[:, 2], [0, 1, 0]), exact[:, None, :2])


def set_zero_again(sensor, state, exact):
    """Other offsets of all electrodes, some 0.2 uW, after every 40 rows."""
    offsets = 2e-4 * np.random.default_rng(6).standard_normal((COUNT // 40, 3, 3))
    extra = np.repeat(offsets, 40, axis=0)
    return add_light(exact, extra[..., 2], 6.5 * extra[..., :2] / extra[..., 2:])


def tarnish(sensor, state, exact):
    """Facet A reflects 5 % less for each mm along x; the beam is a sum of narrow ones."""
    thin = replace(sensor, beam=replace(sensor.beam, diameter_x=4 / 3 * SIGMA,
                                        diameter_y=4 / 3 * SIGMA))  # fmt: skip
    aside = np.arange(-12, 13) * SIGMA / 3
    weight = np.exp(-(aside**2) / 2 / (8 / 9 * SIGMA**2))
    weight /= weight.sum()
    lost = np.zeros((len(exact), 3))
    for x, y in product(range(25), repeat=2):
        one = state.copy()
        one[:, 6:] += aside[[x, y]]
        psi, zeta, power = facets.readings(thin, one)[:, :3].T
        share = 0.05 * weight[x] * weight[y] * (one[:, 6] - one[:, 0])
        lost += np.nan_to_num((share * power)[:, None] * np.column_stack([psi, zeta, psi**0]))
    rest = exact[:, 2] - lost[:, 2]
    exact[:, :2] = (exact[:, :2] * exact[:, 2:3] - lost[:, :2]) / rest[:, None]
    exact[:, 2] = rest
    return exact


def scatter(sensor, state, exact, share=1e-3):
    """0.1 % of the light of facet B falls on detector A, beside its middle."""
    return add_light(exact, share * np.outer(exact[:, 5], [1, 0, 0]), [1.0, -2.0])


def give_way(sensor, state, exact):
    """Facet A turns by some 2 urad for each mrad of pitch."""
    exact[:, :2] += np.outer(state[:, 4], [0.8, 0.6])
    return exact


def remember(sensor, state, exact):
    return exact - 0.003 * np.diff(exact, axis=0, prepend=exact[:1])


def bend_amplifiers(sensor, state, exact):
    """Electrodes' currents whose gain grows by a hundredth for each 0.1 mW of light."""
    for k in range(3):
        power, sums = exact[:, 3 * k + 2].copy(), []
        for n in (0, 1):
            ratio = exact[:, 3 * k + n] / 6.5
            low, high = (power * (1 + sign * ratio) / 2 for sign in (-1, 1))
            low, high = low * (1 + 0.1 * low), high * (1 + 0.1 * high)
            exact[:, 3 * k + n] = 6.5 * (high - low) / (high + low)
            sums.append(high + low)
        exact[:, 3 * k + 2] = sum(sums) / 2
    return exact


@pytest.mark.parametrize(
    ("alter", "words"),
    [
        (chip, "the mirror's tip is chipped on facet A"),
        (remember, "retain a fraction of the previous reading (up to 0.3"),
        (tarnish, "a facet reflects unevenly, as one that is tarnished (by up to 5"),
        (scatter, "light of one facet falls on another detector"),
        (give_way, "a facet yields as the mirror turns (A, by up to"),
        (set_zero_again, "offsets of the detectors are set again and again, as by an automatic "
         "zero (every 40 rows)"),
        (oblique_window, "there are fringes of the window of detector B (0.9 mm apart)"),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in (
            (reflex, "there is a second reflex next to the beam"),
            (bend_amplifiers, "the amplifiers bend"),
            (leak, "currents of one detector leak into the channels of another (up to 0.5"),
            (fringe, "there are fringes across the beam"),
            (window, "there are fringes of the window of detector B (0.7"),
        )),
    ],
)  # fmt: skip
def test_what_spoils_readings_is_named(alter, words):
    judged = judge(sample_rig(COUNT, alter=alter)[1])
    assert words in words_of(judged)


def stated(judged, name):
    """The standard uncertainty of a calibrated parameter."""
    known = judged.sensor.calibration
    place = known.names.index(name)
    return known.covariance[place][place] ** 0.5


def test_what_is_likely_and_not_told_is_part_of_the_uncertainty():
    """Axes 0.5 mrad out of square look like a beam that is tilted by as much."""
    judged = judge(sample_rig(COUNT, mirror=err_along(0, lambda pose: -5e-4 * pose[:, 2]))[1])
    assert not [part.causes for part in judged.findings if part.causes]
    assert stated(judged, "beam.tilt_y") == pytest.approx(5e-4, rel=0.3)


def err_along(axis, of_pose):
    """Displace the mirror along an axis by a function of its poses."""
    return lambda pose, rng: np.outer(of_pose(pose), np.eye(6)[axis])


@pytest.mark.parametrize(
    ("axis", "of_pose", "words"),
    [
        (0, lambda pose: 4e-3 * (pose[:, 0] / 0.25) ** 2, "the reference's guides are bowed"),
        (1, lambda pose: 2.0 * pose[:, 5], "an Abbe offset of the reference"),
        pytest.param(2, lambda pose: 100 * pose[:, 3] ** 2, "a cosine error of the reference",
                     marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_an_error_of_the_reference_is_not_told_as_light(axis, of_pose, words):
    """Errors in x and y the powers follow as they follow a beam that is not Gaussian."""
    judged = judge(sample_rig(COUNT, mirror=err_along(axis, of_pose))[1])
    assert f"The likeliest cause: {words}" in words_of(judged)
    assert "cross-section" not in words_of(judged)


def test_an_error_of_the_reference_that_the_sensor_would_follow_is_undone_whole():
    """Axes 3 mrad out of square look like a tilted beam and turned facets, but for a few per cent;
    the poses would be off by 3 um for each mm of z."""
    rig, data, _ = sample_rig(COUNT, mirror=err_along(0, lambda pose: -3e-3 * pose[:, 2]))
    judged = judge(data)
    assert "The likeliest cause: the reference's axes are not square" in words_of(judged)
    assert abs(error_slope(rig, judged, axis=0, along=2)) < 1e-3


def test_two_causes_at_once_are_both_named():
    abbe = err_along(1, lambda pose: 2.0 * pose[:, 5])
    judged = judge(sample_rig(COUNT, mirror=abbe, alter=slip)[1])
    assert not judged.is_trusted
    assert {"abbe", "detector_c.jumped"} <= {key for part in judged.findings for key in part.causes}


def test_the_group_is_named_where_its_members_look_alike():
    """A beam and a mirror that vibrate do the same to powers and nearly the same to places."""
    wave = np.outer(np.sin(2 * np.pi * 0.3117 * np.arange(COUNT)), [8e-4, 4e-4])
    judged = judge(sample_rig(COUNT, beam=lambda count, rng: wave)[1])
    (finding,) = [part for part in judged.findings if part.causes]
    assert "beam.oscillated" in finding.causes
    assert "at a period of 3.2" in finding.words


def hum(frequency):
    """Adds 8 um, 5 um and less to the places on the detectors, all in step."""

    def shake(sensor, state, exact):
        rows = np.arange(len(exact))
        exact[:, PLACES] += np.outer(np.sin(2 * np.pi * frequency * rows), HUM)
        return exact

    return shake


@pytest.mark.parametrize("quarters", [pytest.param(600, marks=pytest.mark.slow), 602])
def test_a_hum_is_found_and_stated_whole_between_the_frequencies_of_a_grid(quarters):
    judged = judge(sample_rig(COUNT, alter=hum(quarters / 4 / (2 * COUNT)))[1])
    (finding,) = [part for part in judged.findings if "oscillated" in part.words]
    found = re.search(r"the places on all detectors oscillated by up to (\S+) um", finding.words)
    assert float(found[1]) == pytest.approx(8, rel=0.07)
    known = judged.sensor.calibration
    places = [known.names.index(f"misfit_{k}.{kind}") for k in "abc" for kind in ("psi", "zeta")]
    stated = np.array(known.covariance)[np.ix_(places, places)]
    off = stated - np.outer(HUM, HUM) / 2  # the mean square of a sine is a half
    assert np.abs(off).max() < 0.2 * 8e-3**2 / 2


# ---- something that was loose


def slip(sensor, state, exact):
    exact[BEHIND, 6:8] += [0.008, -0.004]
    return exact


def change_gain(sensor, state, exact):
    exact[BEHIND, 2] *= 1.005
    return exact


def shine(sensor, state, exact):
    """A lamp of 3 uW, at the middle of each detector."""
    return add_light(exact, 3e-3 * np.outer(BEHIND, np.ones(3)), np.zeros(2))


def displace_beam(count, rng):
    return np.outer(BEHIND, [3e-3, -2e-3])


def displace_mirror(pose, rng):
    return np.outer(BEHIND, [3e-3, 0, -4e-3, 0, 2e-5, 0])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        # row 150 is held back
        ({"alter": slip}, "detector C jumped between rows 149 and 151, by 7."),
        ({"alter": change_gain}, "the gain of detector A jumped between rows 149 and 151, by 0.5"),
        ({"alter": shine}, "light of a lamp on the detectors jumped between rows 149 and 151"),
        pytest.param({"beam": displace_beam}, "the beam jumped between rows 149 and 151, by 2.9",
                     marks=pytest.mark.slow),
        pytest.param({"mirror": displace_mirror},
                     "the mirror on the reference (or its zero) jumped between rows 149 and 151, "
                     "by ",
                     marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_a_jump_is_named_with_its_time_and_size(wrong, words):
    judged = judge(sample_rig(COUNT, **wrong)[1])
    assert not judged.is_trusted
    assert words in words_of(judged)


def shade(sensor, state, exact):
    exact[exact[:, 3] > np.quantile(exact[:, 3], 0.97), 5] *= 0.9
    return exact


def stand_in_the_light(sensor, state, exact):
    exact[100:112, 5] *= 0.9
    return exact


@pytest.mark.parametrize(
    ("alter", "words"),
    [(shade, "They are all where psi of detector B is over"),
     (stand_in_the_light, "They follow each other")],
)  # fmt: skip
def test_what_excluded_samples_have_in_common_is_said(alter, words):
    judged = judge(sample_rig(COUNT, alter=alter)[1])
    assert judged.is_trusted
    assert words in words_of(judged)


def test_excluded_samples_that_lack_a_detector_lie_on_no_side_of_it():
    data = sample_rig(COUNT)[1]
    raw = data.raw.copy()
    raw[[20, 80, 140, 200], 5] *= 0.9
    raw[[20, 80, 140, 200], :3] = np.nan
    words = words_of(judge(data._replace(raw=raw)))
    assert "They are all where" not in words
    assert "In most of them power_b_mw errs" in words


def test_a_mirror_that_drifted_on_the_reference_may_be_as_it_was_at_the_start():
    def drift(pose, rng):
        return np.linspace(0, 1, len(pose))[:, None] * [0, 0, 0, 2e-5, 0, 0]

    _, data, state = sample_rig(COUNT, mirror=drift)
    judged = judge(data)
    solved = facets.solve(judged.sensor, correct(judged.sensor, data.raw), beam="known")
    off = np.nanmean((solved.state - state)[:, 3])  # the states have the drift in them
    assert abs(off + 1e-5) < 1.2e-5
    assert 1.5e-5 < np.nanmedian(solved.uncertainty[:, 3]) < 4e-5


def test_a_slow_drift_is_no_jump():
    def drift(sensor, state, exact):
        exact[:, 3] += np.linspace(0, 0.01, COUNT)
        return exact

    rig, data, _ = sample_rig(COUNT, alter=drift)
    judged = judge(data)
    (finding,) = [part for part in judged.findings if part.causes]
    assert finding.causes[0] == "detector_b.drifted"
    assert {key.partition(".")[0] for key in finding.causes} <= {"detector_b", "facet_b"}
    # the detector's drift was undone, and it could be the facet's
    steady, size = judge(sample_rig(COUNT)[1]), stated(judged, "psd_b.height")
    assert size > 1.01 * stated(steady, "psd_b.height")
    assert abs(judged.sensor.psds[1].height - rig.sensor.psds[1].height) < 2 * size


def test_a_drift_with_time_is_told_and_part_of_the_uncertainty():
    """A beam that goes 4 um along x: from where it ends it is 2.3 um away, r.m.s."""

    def walk(count, rng):
        return np.outer(np.linspace(-1, 1, count), [2e-3, 0.0])

    data = sample_rig(COUNT, beam=walk)[1]
    data = data._replace(clock=np.linspace(-1, 1, COUNT)[:, None] * np.eye(3)[0])
    judged = judge(data, settings(time_drift="auto"))
    assert re.search(r"drifted over the run \(bx by (3\.9|4|4\.1) um", words_of(judged))
    assert stated(judged, "light.centre_x") == pytest.approx(2.3e-3, rel=0.1)


def test_what_explains_more_than_the_beams_profile_is_told_instead_of_it():
    """Nine numbers of the profile take up much of it, and less than the light of one facet does."""
    asked = settings(profile="auto", asymmetry="auto")
    words = words_of(judge(sample_rig(COUNT, alter=partial(scatter, share=0.02))[1], asked))
    assert "light of one facet falls on another detector" in words
    assert "profile" not in words


def test_noise_is_no_drift_of_the_laser():
    """The fit follows a laser that drifts; what is left in the powers is their noise."""

    def drift(sensor, state, exact):
        exact[:, 2::3] *= 1 + 0.01 * np.sin(np.linspace(0, 5, COUNT))[:, None]
        return exact

    judged = judge(sample_rig(COUNT, 6, alter=drift, noise=4.0)[1])
    assert not [part.causes for part in judged.findings if part.causes]


# ---- what the samples bound, and do not show


def test_how_far_the_lights_middle_may_be_off_is_part_of_the_uncertainty():
    """All poses together, by as much as a second beam may move the light; nothing else. Samples of
    a Gaussian beam bound what was thought possible, 0.2 % of the power."""
    data = sample_rig(COUNT)[1]
    ideal, real = judge(data), judge(data, settings(diffraction="on"))
    assert "may be off together" not in words_of(ideal)  # ideal light is Gaussian
    centre = stated(real, "light.centre_x")
    assert 0 < centre < 0.8 * 1.5 * 2e-3 * SIGMA
    assert f"x and y of all poses may be off together by {1e3 * centre:.2g} um" in words_of(real)
    at_rest = facets.readings(real.sensor, np.zeros((1, 8)))
    before, after = (
        facets.solve(sensor, at_rest, beam="known", power="unknown").uncertainty ** 2
        for sensor in (real.search.fit.sensor, real.sensor)
    )
    assert np.sqrt((after - before)[:, :2]) == pytest.approx(centre, rel=0.01)
    assert np.sqrt(after[:, 2:6] / before[:, 2:6]).max() < 1.01


def test_bends_of_detectors_are_uncertain_where_no_spot_was():
    data = sample_rig(COUNT, box=[*WIDE[:2], *0.2 * WIDE[2:]])[1]
    bent, straight = (judge(data, settings(bend=mode)).sensor for mode in ("auto", "off"))
    near, far = np.zeros(8), np.array([0, 0, *WIDE[2:], 0, 0])
    states = np.array([near, 0.9 * far])
    over = np.divide(*(
        facets.solve(sensor, facets.readings(sensor, states), beam="known").uncertainty[:, 2:6]
        for sensor in (bent, straight)
    ))  # fmt: skip
    assert (over[0] < 1.1).all()
    assert (over[1] > 2).any()


def test_a_beam_that_is_not_symmetric_has_an_uncertain_middle():
    """1 + 0.02 He_3(x) deviates by 0.02 times the root of 3!, and the middle by 1.5 times this."""
    light, asked = replace(NOMINAL.light, asymmetry=(0.02, 0, 0, 0)), settings(asymmetry="auto")
    judged = judge(sample_rig(120, light=light)[1], asked)
    assert judged.is_trusted
    assert accepted_effects(judged) == {"asymmetry"}
    assert "not Gaussian: its irradiance deviates by 4.9 %" in words_of(judged)
    assert "xxx 0.02, " in words_of(judged)
    assert "It is not symmetric" in words_of(judged)
    size = 1.5 * 0.02 * np.sqrt(6) * SIGMA
    assert stated(judged, "light.centre_x") == pytest.approx(size, rel=0.02)
