"""Faults of the data: none may end as a calibration that is confident and wrong, each is named."""

from __future__ import annotations

import numpy as np
import pytest
from facets.experiments import rigs
from scipy.spatial.transform import Rotation

import facets
from facets.calibration import Data, choice, velocities
from facets.calibration.verdict import verdict
from facets.detectors import tetra_lateral_ratios

CONFIG = facets.load("paper")
NOMINAL, SETTINGS = CONFIG.sensor, CONFIG.calibrate
COUNT = 100


def measured(seed=1, count=COUNT):
    rng = np.random.default_rng(seed)
    rig = rigs.draw_rig(NOMINAL, rng)
    return rig, rigs.sample_motion(rig, count, rng)[0]


@pytest.fixture(scope="module")
def samples():
    return measured()[1]


def judged(data, sensor=NOMINAL):
    return verdict(sensor, data, choice(sensor, SETTINGS), SETTINGS)


def said(found):
    return " ".join(one.words for one in found.findings)


def with_raw(data, change):
    raw = data.raw.copy()
    change(raw)
    return data._replace(raw=raw)


def with_pose(data, change):
    pose = data.pose.copy()
    change(pose)
    return data._replace(pose=pose)


def test_without_a_fault_it_is_trusted(samples):
    found = judged(samples)
    assert found.is_trusted
    assert "Probably" not in said(found)
    assert "residuals" not in said(found)  # neither their size nor what they follow


def times(columns, factor):
    def change(rows):
        rows[:, columns] *= factor

    return change


def exchanged(rows):
    rows[:] = rows[:, [3, 4, 5, 0, 1, 2, 6, 7, 8]]


def columns(*order):
    def change(rows):
        rows[:] = rows[:, order]

    return change


def two_at_once(rows):
    rows[:, 3] *= -1
    rows[:] = rows[:, [0, 1, 8, 3, 4, 5, 6, 7, 2]]


def not_straightened(raw):
    """Currents of tetra-lateral detectors, converted as a duo-lateral's."""
    for k in range(3):
        place = raw[:, 3 * k : 3 * k + 2]
        place[:] = 6.5 * tetra_lateral_ratios(place / 6.5, 1.0)


def other_kind(raw):
    """Currents of pincushion detectors, converted as a duo-lateral's: both places are the same."""
    raw[:, 1::3] = raw[:, ::3]
    raw[:, 2::3] /= 2


def other_order(pose):
    turn = Rotation.from_euler("ZYX", pose[:, [5, 4, 3]])
    pose[:, 3:] = turn.as_euler("XYZ")


@pytest.mark.parametrize(
    ("of", "change", "words"),
    [
        (with_raw, times([3], -1), "sign of psi of detector B is swapped"),
        (with_raw, exchanged, "detectors A and B are exchanged"),
        (with_raw, columns(0, 1, 5, 3, 4, 2, 6, 7, 8), "powers of detectors A and B are exch"),
        (with_raw, columns(0, 1, 2, 6, 4, 5, 3, 7, 8), "psi of detectors B and C are exch"),
        (with_raw, two_at_once, "two faults at once"),
        (with_raw, not_straightened, "sensor.electronics.kind to tetra-lateral"),
        (with_raw, other_kind, "sensor.electronics.kind to pincushion"),
        (with_pose, other_order, "angles are taken in another order"),
        (with_pose, times([3, 4, 5], 1e3), "in urad"),
        (with_pose, times([3, 4, 5], 1 / (np.pi / 180 * 1000)), "in degrees"),
        (with_pose, times([0, 1, 2], 1e3), "lengths are in um"),
        (with_raw, times([2, 5, 8], 1e3), "powers are in uW"),
        (with_pose, times([5], -1), "sign of the reference's yaw"),
    ],
    ids=[
        "sign",
        "exchange",
        "powers",
        "psi",
        "two",
        "tetra",
        "pincushion",
        "order",
        "urad",
        "degrees",
        "um",
        "uW",
        "yaw",
    ],
)
@pytest.mark.slow
def test_a_fault_of_columns_is_named(samples, of, change, words):
    found = judged(of(samples, change))
    assert not found.is_trusted
    assert words in said(found)


def test_a_stuck_detector_is_named(samples):
    def stick(raw):
        raw[:, 4] = raw[0, 4]

    found = judged(with_raw(samples, stick))
    assert not found.is_trusted
    assert "zeta of detector B is stuck" in said(found)


def test_a_stuck_detector_is_named_also_where_a_row_jumps(samples):
    def stick(raw):
        raw[:, 6] = raw[0, 6] + 1e-5 * np.cos(np.arange(COUNT))
        raw[17, 6] += 4.0

    assert "psi of detector C is stuck" in said(judged(with_raw(samples, stick)))


def test_repeated_poses_are_counted_once(samples):
    same = samples.part(np.arange(COUNT) % 6)
    found = judged(same)
    assert not found.is_trusted
    assert "6 different poses only" in said(found)


def test_spikes_are_excluded_and_told(samples):
    rng = np.random.default_rng(5)

    def hit(raw):
        raw[rng.random(COUNT) < 0.05, 0] += 0.5

    found = judged(with_raw(samples, hit))
    assert found.is_trusted
    assert "hold an outlier that no noise makes and were excluded (rows 8, 9, 32" in said(found)


def slow(seed=2, late=0.0, count=150):
    """A motion in time, sampled at 1 kHz, the reference late by some seconds."""
    rng = np.random.default_rng(seed)
    rig = rigs.draw_rig(NOMINAL, rng)
    time = np.arange(count) / 1000
    phase, cycles = rng.uniform(0, 6, 6), np.array([1.3, 2.1, 1.7, 2.9, 3.3, 2.3])
    empty = rigs.sample_motion(rig, count, rng)[0]

    def pose(at):
        return 0.9 * rigs.BOX * np.sin(2 * np.pi * 4 * cycles * at[:, None] + phase)

    data = rigs.read(rig, empty._replace(pose=pose(time)), rng)
    said_pose = pose(time - late) + rigs.REFERENCE * rng.standard_normal((count, 6))
    clock = np.column_stack([np.linspace(-1, 1, count), *np.zeros((3, count))])
    return data._replace(pose=said_pose, velocity=velocities(time, said_pose), clock=clock)


@pytest.mark.slow
def test_a_late_reference_is_found():
    found = judged(slow(late=3e-4))
    taken = {row.key for row in found.search.rows if row.accepted}
    assert "delay" in taken
    names = found.found.choice.names
    late = found.found.values[names.index("reference.delay")]
    assert late == pytest.approx(3e-4, abs=2e-5)


@pytest.mark.slow
def test_a_late_reference_without_a_clock_is_not_trusted():
    found = judged(slow(late=1e-3)._replace(velocity=None, clock=None))
    assert not found.is_trusted


@pytest.mark.slow
def test_a_beam_that_moves_is_told(samples):
    rig, _ = measured()
    rng = np.random.default_rng(8)
    moved = np.cumsum(rng.normal(size=(COUNT, 2)), axis=0)
    moved = 3e-3 * (moved - moved.mean(axis=0)) / moved.std(axis=0)
    pose = rng.uniform(-1, 1, (COUNT, 6)) * rigs.BOX
    data = rigs.read(rig, samples._replace(pose=pose, beam=moved), rng)
    found = judged(data._replace(beam=np.zeros((COUNT, 2))))
    assert "The beam moved by" in said(found) or not found.is_trusted


def test_a_power_that_drifts_is_told(samples):
    def drift(raw):
        raw[:, 2::3] *= np.linspace(0.97, 1.03, COUNT)[:, None]

    found = judged(with_raw(samples, drift))
    assert found.is_trusted
    assert "The laser's power changed by" in said(found)


@pytest.mark.slow
def test_too_few_axes_are_named():
    rng = np.random.default_rng(3)
    rig = rigs.draw_rig(NOMINAL, rng)
    pose = rng.uniform(-1, 1, (COUNT, 6)) * rigs.BOX
    pose[:, 3:] = 0
    empty = Data(np.zeros((COUNT, 9)), pose, rigs.REFERENCE, np.zeros((COUNT, 2)))
    found = judged(rigs.read(rig, empty, rng))
    assert "hardly moves in roll, pitch, yaw" in said(found)


@pytest.mark.slow
def test_another_rig_s_configuration_is_not_trusted(samples):
    from dataclasses import replace

    psds = [replace(psd, radius=245.0) for psd in NOMINAL.psds]
    found = judged(samples, replace(NOMINAL, psds=(psds[0], psds[1], psds[2])))
    assert not found.is_trusted
    assert "the configuration is not that of this rig" in said(found)
