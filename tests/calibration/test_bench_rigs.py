"""A rig with the light of a bench, read by rays that share no optics with the model."""

from __future__ import annotations

import numpy as np
import pytest
from facets.experiments.studies import disturbed_rigs, new_zero, rigs, simulated_bench as bench
from rig_samples import CONFIG, NOMINAL, accepted_effects, judge, words_of

import facets
from facets.calibration import ChangePriors, fold_mount
from facets.detectors import correct


@pytest.fixture(scope="module")
def calibrated():
    """A rig with every effect at once and 3 % LG10 in its beam, which made x and y ten times wrong
    while the model's beam was Gaussian; and what is said of 300 samples."""
    rng = np.random.default_rng(1)
    (wrong,) = (case for case in disturbed_rigs.CASES if case.words == "3 % LG10")
    real = rigs.draw_bench_rig(NOMINAL, rng)
    table = bench.measure(bench.draw_scene(real, rng, 300), [wrong], 1)
    real = real._replace(bench=wrong.parts["bench"](real.bench, None, None))
    return real, judge(bench.samples_of(table, CONFIG.calibrate), CONFIG.calibrate), rng


@pytest.mark.slow
def test_a_rig_with_every_effect_at_once_is_calibrated(calibrated):
    real, judged, rng = calibrated
    assert judged.is_trusted
    effects = {"curvature", "diffraction", "strips", "background", "profile"}
    assert effects <= accepted_effects(judged)
    assert "profile is not Gaussian" in words_of(judged)
    assert max(judged.sensor.light.profile) == pytest.approx(0.015, abs=0.003)
    use = bench.draw_use(real, rng, 300)
    raw = bench.readings_of(bench.measure(use, [], 2))
    state = bench.states_at(fold_mount(real.rig.values), use.pose)
    ideal = facets.add_noise(judged.sensor, facets.readings(judged.sensor, state), rng)
    solved, perfect = (
        facets.solve(judged.sensor, readings, beam="known", power="unknown")
        for readings in (correct(judged.sensor, raw), ideal)
    )
    error, least = ((each.state - state)[:, :6] for each in (solved, perfect))
    assert (rigs.rms(error) < 1.5 * rigs.rms(least)).all()
    assert ((np.abs(error) < 1.96 * solved.uncertainty[:, :6]).mean(axis=0) > 0.85).all()


@pytest.mark.slow
def test_intervals_of_a_new_zero_hold(calibrated):
    """A few draws of `python -m facets.experiments.studies.new_zero`."""
    real, judged, rng = calibrated
    rig = new_zero.CalibratedRig(real, judged.sensor, rng)
    known = new_zero.known_change(rig)
    assert known.is_explained
    assert np.abs(known.beam - [1e-3, 0]).max() < 1.5e-4
    draws = [new_zero.draw_changes(rig, ChangePriors(), 5) for _ in range(12)]
    changes, before, after = (
        np.abs(np.concatenate([getattr(draw, name) for draw in draws])) < 1.96
        for name in ("off", "before", "after")
    )
    assert changes.mean() > 0.88
    assert after.mean() > 0.9
    assert before[:, :2].mean() < 0.2
