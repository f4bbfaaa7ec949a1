"""What limits a response is said, with its cause, and only then."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import facets
from facets.characterization import (
    build_signals,
    estimate_response,
    find_limits,
    find_peaks,
    find_stretches,
    noise_deviation,
    silent_axes,
)
from facets.core import MIRROR, STATE_COLUMNS, STATE_UNITS, MeasuredObject, Mode, Vibration
from facets.detectors import SATURATED, standard_deviations
from facets.estimation import solve_readings
from facets.simulation import shake

COUNT, RATE = 40_000, 1000.0
NOISE = np.array([6e-5, 6e-5, 4e-5, 1e-7, 1e-7, 2e-7])
SHAPES = np.array([[0, 0, 0.02, 0, 0, 0], [0.003, 0.001, 0, 2e-5, 4e-5, 1e-5]])
BODY = Vibration(
    {
        "bounce": Mode(60.0, 0.06, tuple(SHAPES[0])),
        "rock": Mode(130.0, 0.05, tuple(SHAPES[1])),
    },
    low=2.0,
    high=400.0,
    samples=COUNT,
    rate=RATE,
)


def look(change=None, resolution=0.5, usable=None, saturated=0, misfits=(0,), body=BODY):
    """The response that `change` has spoilt, its peaks, and its limits for each number of
    misfits."""
    rng = np.random.default_rng(2)
    force, moved = shake(body, rng)
    moved = moved + NOISE * rng.standard_normal((COUNT, 6))
    if change is not None:
        change(force, moved)
    every = np.ones(COUNT, bool) if usable is None else usable
    stretches = find_stretches(np.arange(COUNT) / RATE, every, "it")
    found = estimate_response(force, moved, stretches, resolution, NOISE, 5000.0)
    signals = SimpleNamespace(
        stimulus=force, motion=moved, usable=every, stretches=stretches, saturated=saturated
    )
    peaks = find_peaks(found)
    limits = []
    for signals.misfits in misfits:
        limits.append(find_limits(found, signals, peaks, 5000.0))
    return found, peaks, *limits


def test_a_good_record_has_no_limits_but_the_band_and_the_bandwidth():
    found, peaks, limits = look()
    assert [round(one.frequency) for one in peaks] == pytest.approx([60, 130], abs=2)
    assert [one.axis for one in peaks] == ["tz", "pitch"]
    assert peaks[0].width == pytest.approx(2 * 0.06 * 60, rel=0.15)
    assert peaks[0].size == pytest.approx(0.02 / 0.12, rel=0.1)
    assert [text.split(" ")[1] for text in limits] == ["input", "electronics'"]
    assert "from 401.5" in limits[0]
    assert "-0.32 % and the phase by -4.6 degrees" in limits[1]
    assert not silent_axes(found).any()


def add_drift(force, motion):
    motion[:, 0] += np.linspace(0, 0.1, COUNT)


def add_step(force, motion):
    motion[COUNT // 3 :, 0] += 0.1


def clip(force, motion):
    np.clip(force, -1, 1, out=force)


def clip_above(force, motion):
    force[force > 0.8 * force.std()] = 0.8 * force.std()


def compress(force, motion):
    force[:] = np.tanh(force / force.std())


def add_force(force, motion):
    motion[:, 2] += 2 * shake(BODY, np.random.default_rng(9))[1][:, 2]


def silence(force, motion):
    motion[:, 5] = NOISE[5] * np.random.default_rng(3).standard_normal(COUNT)


@pytest.mark.parametrize(
    ("change", "words", "most"),
    [
        (add_drift, "zero moved from the beginning to the end, tx by +90 µm, little by little", 4),
        (add_step, "zero moved from the beginning to the end, tx by +100 µm, all at once", 4),
        (clip, "clipped by its amplifier or converter", 9),
        (clip_above, "clipped by its amplifier or converter", 9),
        (compress, "goes with the cube of the input", 9),
        (add_force, "The coherence of tz is below 0.75 in 100 % of the excited lines; the cause is"
                    " unknown (another force", 4),
        (silence, "No response beyond chance: yaw. What is drawn is an upper limit; the motion "
                  "there is the sensor's noise.", 4),
    ],
)  # fmt: skip
@pytest.mark.slow
def test_what_spoils_a_record_is_said(change, words, most):
    *_, limits = look(change)
    assert any(words in text for text in limits), limits
    assert len(limits) <= most


@pytest.mark.slow
def test_a_sweep_that_is_slower_than_a_segment_is_said():
    *_, limits = look(body=replace(BODY, drive="sweep"))
    assert any("only 1 of the 39 segments have input" in text for text in limits), limits


@pytest.mark.slow
def test_few_averages_and_narrow_peaks_are_said():
    sharp = replace(BODY, modes={"bounce": Mode(60.0, 0.004, tuple(SHAPES.sum(axis=0)))})
    _, (peak,), limits = look(body=sharp)
    assert peak.width < 2
    assert any("The lines are too far apart for the peaks at 60 Hz (" in text for text in limits)
    *_, limits = look(resolution=0.1)
    assert limits[0].startswith("There are only 6.")


def test_rows_that_are_left_out_are_said():
    usable = np.ones(COUNT, bool)
    usable[5000::10_000] = False
    *_, few, many = look(usable=usable, saturated=4, misfits=(8, 400))
    assert any("gaps cut them: 0 samples were lost or not taken, and 4 rows have no pose or no "
               "input" in text for text in many)  # fmt: skip
    assert any("Detectors were saturated in 4 of 40000 rows" in text for text in many)
    assert any(text.startswith("In 400 of 40000 rows the residual") for text in many)
    assert not any("residual" in text for text in few)  # twice as many as by chance


@pytest.mark.slow
def test_a_body_that_does_not_answer_is_silent():
    def still(force, motion):
        motion[:] = NOISE * np.random.default_rng(3).standard_normal((COUNT, 6))

    found, peaks, _ = look(still)
    assert silent_axes(found).all()
    assert peaks == []


def test_the_noise_at_a_point_is_that_of_solved_poses():
    """And the motion there is that of a rigid body."""
    config, count = facets.load("bench"), 4000
    pose = np.array([0.02, -0.01, 0.3, 1e-3, -2e-3, 3e-3, 0.0, 0.0])
    swing = np.sin(np.arange(count) / 7)
    states = np.tile(pose, (count, 1))
    states[:, 4] += 1e-4 * swing
    exact = facets.readings(config.sensor, states)
    noise = np.random.default_rng(1).standard_normal((count, 9))
    readings = exact + standard_deviations(config.sensor, exact[0]) * noise
    solution = solve_readings(config.sensor, config.solve, readings, np.zeros((count, 2)))
    columns = dict(zip(STATE_COLUMNS[:6], (solution.state / STATE_UNITS).T[:6], strict=True))
    columns["tz_mm"][7] = np.nan
    rows = np.arange(count)
    columns |= {"time_s": rows / 1000, "force_n": swing, "misfit": rows < 5}
    columns["flags"] = np.where(rows < 3, SATURATED, 0)
    body = MeasuredObject(point=(0.0, 0.0, 40.0))
    signals = build_signals(columns, "force_n", body, config, "it")
    expected = 40 * 1e-4 * swing
    apart = signals.motion[:, 0] - (expected - expected.mean())
    assert np.nanstd(apart) == pytest.approx(signals.deviation[0], rel=0.1)
    assert abs(np.nanmean(apart)) < signals.deviation[0]
    assert np.nanstd(signals.motion[:, 5]) == pytest.approx(signals.deviation[5], rel=0.1)
    apex = noise_deviation(config, pose, MIRROR)
    assert signals.deviation[0] < 0.98 * apex[0]  # errors of tx and pitch are correlated
    assert (signals.saturated, signals.misfits, int((~signals.usable).sum())) == (3, 5, 1)
