"""Residuals beyond chance: as many as chance has where all is right, and told where it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from measured import measure

import facets
from facets import Measurement, Samples, add_noise
from facets.estimation import (
    FALSE_ALARM_RATE,
    LIMITS,
    MIN_REDUNDANCY,
    Tally,
)

CONFIG = facets.load("paper")
OPTIONS = replace(CONFIG.solve, beam="known", power="unknown")


def read(count=2000, seed=1):
    rng = np.random.default_rng(seed)
    state = np.zeros((count, 8))
    state[:, :6] = rng.uniform(-1, 1, (count, 6)) * [0.1, 0.1, 1, 4e-3, 4e-3, 5e-3]
    return add_noise(CONFIG.sensor, facets.readings(CONFIG.sensor, state), rng)


@pytest.mark.parametrize(
    ("beam", "power", "count"),
    [("known", "known", 3), ("known", "unknown", 2), ("free", "known", 1), ("free", "unknown", 0)],
)
def test_redundancy_is_what_is_read_beside_what_is_sought(beam, power, count):
    raw = read(2)
    raw[1, 4] = np.nan
    solution = facets.solve(CONFIG.sensor, raw, beam=beam, power=power)
    assert solution.checks.tolist() == [count, max(count - 3, 0)]
    assert solution.limit.tolist() == LIMITS[solution.checks].tolist()
    assert facets.solve(CONFIG.sensor, raw[0], beam=beam, power=power).checks == count


#: Standard deviations (9,) of a reading at rest.
NOISE = facets.standard_deviations(CONFIG.sensor, facets.readings(CONFIG.sensor, [0.0] * 8))


def flags(sensor, raw, options=OPTIONS):
    measurement = Measurement(replace(CONFIG, sensor=sensor, solve=options))
    solution = measurement.poses(Samples(raw)).solution
    return solution.misfit, measurement.tally.misfit


@pytest.mark.parametrize("count", [0, 1, 2])
def test_corrupted_readings_are_reported_from_the_first_on(count):
    raw = read(100)
    raw[:count, 3] += 0.1
    marks, found = flags(CONFIG.sensor, raw)
    assert marks.tolist() == [True] * count + [False] * (100 - count)
    assert (
        ("single readings are corrupted" in found.sentence) == bool(found.sentence) == (count > 0)
    )
    assert ("(see sample 1)" in found.sentence) == (count == 1)


def test_an_error_of_all_readings_is_not_taken_for_single_spoilt_ones():
    """Few poses of them are flagged, but the others have larger residuals than noise makes, too."""
    noise = np.random.default_rng(1)
    raw = read(300) + NOISE * noise.normal(size=(300, 9))
    raw[:, 1] += 6 * NOISE[1]
    marks, found = flags(CONFIG.sensor, raw)
    assert 5 < marks.sum() < 150
    assert "the model misses something" in found.sentence


def test_errors_that_a_calibration_left_widen_the_limit():
    """By three standard deviations of psi on B beside the noise's one: the root of 1 + 9."""
    covariance = ((9 * NOISE[3] ** 2, 0.0), (0.0, 1.0))
    known = facets.Calibration(("misfit_b.psi", "psd_a.radius"), covariance)
    sensor = replace(CONFIG.sensor, calibration=known)
    solution = facets.solve(sensor, read(1)[0], beam="known")
    assert solution.limit == pytest.approx(np.sqrt(10) * LIMITS[3])


def redundancy(sensor, sigmas):
    """That of a reading at rest: the trace of what the residuals keep of an error, from a Jacobian
    by differences.  sigmas: (3,) of the priors of bx, by and the power."""
    steps, unit = np.diag([1e-4] * 3 + [1e-6] * 3 + [1e-4] * 2), np.zeros(8)
    slopes = [
        (facets.readings(sensor, unit + step) - facets.readings(sensor, unit - step))
        / 2
        / step.max()
        for step in steps
    ]
    exact = facets.readings(sensor, unit)
    slopes.append(np.where(np.arange(9) % 3 == 2, exact, 0.0) / sensor.beam.power)
    noise = facets.standard_deviations(sensor, exact)
    priors = np.zeros((3, 9))
    priors[:, 6:] = np.diag(1 / np.array(sigmas))
    rows = np.vstack([np.array(slopes).T / noise[:, None], priors])
    rows /= np.linalg.norm(rows, axis=0)
    return 9 - np.trace((rows @ np.linalg.pinv(rows))[:9, :9])


@pytest.mark.parametrize(("name", "place"), [("paper", 5e-3), ("bench", 5e-4), ("bench", 5e-3)])
def test_priors_that_are_too_wide_to_check_a_pose_leave_none(name, place):
    """A reading whose error stays hidden up to hundreds of its standard deviations checks nothing;
    a prior counts by how much it determines, not as a known value."""
    sensor = facets.load(name).sensor
    reading = facets.readings(sensor, np.zeros(8))
    unknown = {"beam": facets.Prior((0.0, 0.0), place)}
    for width in np.geomspace(1e-7, 1e-1, 13):
        prior = facets.Prior(sensor.beam.power, width * sensor.beam.power)
        solution = facets.solve(sensor, reading, power=prior, **unknown)
        left = redundancy(sensor, [place, place, prior.sigma])
        assert solution.ok == (left > MIN_REDUNDANCY), (width, left)
        assert solution.ok or solution.status == facets.Status.UNCHECKED
        assert facets.solve(sensor, reading, power=prior, **unknown, accept_unchecked=True).ok


@pytest.mark.parametrize(
    ("beam", "power", "least"),
    [("prior", "known", "0.58 to 1"), ("known", "known", "1"), ("free", "known", "1")],
)
def test_the_expected_residual_is_that_of_what_priors_leave_to_check(beam, power, least):
    """Of three degrees of freedom a beam that is known within 250 times the noise has two."""
    config = facets.load("bench")
    solve = replace(config.solve, beam=beam, power=power, beam_sigma=5e-3)
    measurement = Measurement(replace(config, solve=solve))
    solution = measurement.poses(Samples(read_bench(count=20_000))).solution
    said = measurement.tally.sentences(measurement.config)[0]
    measured = float(said.split("are ")[1].split(" times")[0])
    assert f"(RMS; {least} is expected" in said
    assert measured == pytest.approx(float(least.split()[0]), abs=0.03)
    assert solution.ok.mean() > 0.999


def test_poses_that_only_wide_priors_check_are_counted_as_unchecked():
    config = facets.load("bench")
    wide = replace(config.solve, beam="prior", power="prior", power_sigma=1.0, beam_sigma=0.05)
    rest = np.repeat(facets.readings(BENCH, np.zeros((1, 8))), 20, axis=0)
    for accepts, words in ((False, "Samples without a redundant reading: 20."),
                           (True, "Poses without a redundant reading: 20.")):  # fmt: skip
        measurement = Measurement(replace(config, solve=replace(wide, accept_unchecked=accepts)))
        measurement.poses(Samples(rest))
        said = " ".join(measurement.tally.sentences(measurement.config))
        assert words in said
        assert ("A wrong power then shifts the pose by any amount" in said) == accepts
        assert "times the noise" not in said
    assert (
        Tally(unseen=np.array([np.inf, np.inf]))
        .unseen_sentence("known")
        .endswith("by any amount; a wrong position of a spot by any amount.")
    )


BENCH = facets.load("bench").sensor
KNOWN = replace(CONFIG.solve, beam="known", power="known")


def read_bench(beam=(0.0, 0.0), moves=True, power=1.0, count=400):
    """Readings of the bench's sensor, whose beam stands elsewhere, or is of another power."""
    rng = np.random.default_rng(3)
    state = np.zeros((count, 8))
    state[:, :6] = [*beam, 0.5, 1e-3, -1e-3, 2e-3]
    if moves:
        state[:, :6] += rng.uniform(-1, 1, (count, 6)) * [0.05, 0.05, 1, 4e-3, 4e-3, 5e-3]
    state[:, 6:] = beam
    sensor = replace(BENCH, beam=replace(BENCH.beam, power=power * BENCH.beam.power))
    return add_noise(sensor, facets.readings(sensor, state), rng)


@pytest.mark.parametrize("options", [KNOWN, OPTIONS])
@pytest.mark.parametrize("moves", [True, False])
def test_a_beam_that_stands_elsewhere_is_the_likeliest_cause(options, moves):
    sentence = flags(BENCH, read_bench((4.0, -1.5), moves), options)[1].sentence
    assert "fit a beam at (4, -1.5) mm instead of (0, 0) mm" in sentence
    assert ("because the mirror did not move" in sentence) == (not moves)


def test_a_beam_elsewhere_than_its_stage_says_and_another_power_are_told():
    found = flags(BENCH, read_bench((0.3, 0.1)), KNOWN)[1]
    found.carried = True
    assert "(0.3, 0.1) mm from where the stage says" in found.sentence
    assert "stage.zero_mm" in found.sentence
    gain = read(400)
    gain[:, 2] *= 1.02
    for sensor, raw, power in (
        (BENCH, read_bench(power=0.8), "0.24 mW instead of 0.3"),
        (CONFIG.sensor, gain, "0.302"),
    ):
        sentence = flags(sensor, raw, KNOWN)[1].sentence
        assert f"fit a laser of {power} mW" in sentence
        assert "changed gain of one detector" in sentence


@pytest.mark.parametrize("options", [KNOWN, OPTIONS])
def test_what_nothing_explains_is_unknown(options):
    """Another geometry, order or sign: a free beam for each reading would fit most of them."""
    good = read_bench()
    psds = tuple(replace(psd, radius=psd.radius + 5 * n) for n, psd in enumerate(BENCH.psds))
    order, signs = good[:, [3, 4, 5, 0, 1, 2, 6, 7, 8]], [-1, *[1] * 8]
    for sensor, raw in ((replace(BENCH, psds=psds), good), (BENCH, good * signs), (BENCH, order)):
        assert "The cause is unknown" in flags(sensor, raw, options)[1].sentence
    free = replace(options, beam="free", power="known")
    assert "fit a beam" not in flags(BENCH, 1e3 * good, free)[1].sentence


def test_limits_are_those_of_the_distribution_and_chance_flags_as_many_as_it_should():
    from scipy.stats import chi2

    exact = np.sqrt(chi2.isf(FALSE_ALARM_RATE, np.arange(1, 10)))
    assert LIMITS[1:] == pytest.approx(exact, rel=1e-12)
    solution = measure(CONFIG.sensor, OPTIONS, Samples(read()))
    assert 0.03 < (solution.residual > np.sqrt(chi2.isf(0.05, 2))).mean() < 0.07


def test_spots_near_an_edge_are_counted_where_the_model_has_none():
    """Light is lost there; of three poses one has a spot nearer to an edge than its own size."""
    states = np.zeros((3, 8))
    states[1:, 2] = 6.0, 5.5
    readings = facets.readings(CONFIG.sensor, states)
    for cut, edges in ((False, 1), (True, 0)):
        sensor = replace(CONFIG.sensor, apertures=facets.Apertures(detectors=cut))
        measurement = Measurement(replace(CONFIG, sensor=sensor, solve=OPTIONS))
        measurement.poses(Samples(readings))
        assert measurement.tally.edges == edges
    assert measurement.tally.unseen[1] > measurement.tally.unseen[0] > 5


def test_the_laser_s_own_jitter_is_a_noise_that_checks_poses():
    """It differs from sample to sample, other than a power that is not known."""
    electronics = replace(BENCH.electronics, power_noise=1e-3)
    sensor = replace(BENCH, electronics=electronics)
    solve = replace(facets.load("bench").solve, beam="prior", beam_sigma=5e-3, power="known")
    knowledge = solve.knowledge(sensor)
    reading = facets.readings(sensor, np.zeros(8))
    assert facets.solve(sensor, reading, beam=knowledge.beam, power=knowledge.power).ok
    wide = facets.solve(BENCH, reading, beam=knowledge.beam, power=knowledge.power)
    assert wide.status == facets.Status.UNCHECKED
