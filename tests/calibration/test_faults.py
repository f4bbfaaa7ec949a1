"""Faults of the data: none may end as a calibration that is confident and wrong, each is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from facets.experiments.studies import rigs
from facets.experiments.studies.faults import change_currents
from rig_samples import (
    CONFIG,
    NOMINAL,
    accepted_effects,
    judge,
    sample_in_time,
    sample_rig,
    settings,
    words_of,
)
from scipy.spatial.transform import Rotation

from facets.calibration import PLACE

COUNT = 100


@pytest.fixture(scope="module")
def samples():
    return sample_rig(COUNT, 1, box=rigs.BOX)[1]


def test_without_a_fault_it_is_trusted(samples):
    judged = judge(samples, CONFIG.calibrate)
    assert judged.is_trusted
    assert "Probably" not in words_of(judged)
    assert "residuals" not in words_of(judged)  # neither their size nor what they follow
    assert "scatter" not in words_of(judged)


def exchange_powers_and_swap_a_sign(raw, pose):
    raw[:, 3] *= -1
    raw[:, [2, 8]] = raw[:, [8, 2]]


def take_angles_in_another_order(raw, pose):
    turn = Rotation.from_euler("ZYX", pose[:, [5, 4, 3]])
    pose[:, 3:] = turn.as_euler("XYZ")


def give_angles_in_urad(raw, pose):
    pose[:, 3:] *= 1e3


def convert_pincushion_currents_as_another_kind(raw, pose):
    raw[:, 1::3] = raw[:, ::3]
    raw[:, 2::3] /= 2


def stick_but_for_a_jump(raw, pose):
    raw[:, 6] = raw[0, 6] + 1e-5 * np.cos(np.arange(COUNT))
    raw[17, 6] += 4.0


def saturate(raw, pose):
    """Amplifiers that follow no current of an electrode beyond that of 0.09 mW."""
    raw[:] = change_currents(raw, lambda current: np.minimum(current, 0.09))


def swap_a_sign_in_some_rows(raw, pose):
    raw[60:85, 4] *= -1


def slip_by_a_row(raw, pose):
    pose[21:46] = pose[20:45].copy()


def repeat_six_rows(raw, pose):
    for rows in (raw, pose):
        rows[:] = rows[np.arange(COUNT) % 6]


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        pytest.param(exchange_powers_and_swap_a_sign, "two faults at once", marks=pytest.mark.slow),
        pytest.param(
            take_angles_in_another_order,
            "angles are taken in another order (about the fixed axes z, then y, then x; "
            "here x, then y, then z): with that undone",
            marks=pytest.mark.slow,
        ),
        pytest.param(give_angles_in_urad, "angles are in urad", marks=pytest.mark.slow),
        pytest.param(saturate, "amplifiers saturate", marks=pytest.mark.slow),
        (
            swap_a_sign_in_some_rows,
            "rows 61 to 84 do not belong to the others (in them, the sign "
            "of zeta of detector B is swapped)",
        ),
        pytest.param(
            slip_by_a_row,
            "(in them, the reference's rows are one row below where they belong)",
            marks=pytest.mark.slow,
        ),
        (convert_pincushion_currents_as_another_kind, "sensor.electronics.kind to pincushion"),
        (stick_but_for_a_jump, "psi of detector C is stuck"),
        (repeat_six_rows, "only 6 different poses"),
    ],
)
def test_a_fault_of_the_table_is_named_and_not_trusted(samples, spoil, words):
    """What undoes each of the faults that are tried: `test_hypotheses.py`."""
    spoilt = samples._replace(raw=samples.raw.copy(), pose=samples.pose.copy())
    spoil(spoilt.raw, spoilt.pose)
    judged = judge(spoilt, CONFIG.calibrate)
    assert not judged.is_trusted
    assert words in words_of(judged)


def test_angles_in_another_order_are_named_where_they_are_small(samples):
    """They then lie within what real light leaves."""
    pose = samples.pose.copy()
    pose[:, 3:] = Rotation.from_euler("xyz", pose[:, 3:]).as_euler("zxy")[:, [1, 2, 0]]
    judged = judge(samples._replace(pose=pose))
    assert "(about the fixed axes z, then x, then y; here x, then y, then z)" in words_of(judged)


@pytest.mark.slow
def test_readings_that_were_averaged_are_named():
    data = sample_in_time(count=400)
    raw = data.raw.copy()
    raw[1:-1] = (raw[:-2] + raw[1:-1] + raw[2:]) / 3
    words = words_of(judge(data._replace(raw=raw)))
    assert (
        "the readings were averaged or filtered, and the reference was not (as over 3 rows)"
        in words
    )


def test_places_with_few_digits_count_as_noise(samples):
    raw = samples.raw.copy()
    places = np.arange(9) % 3 < 2
    raw[:, places] = np.round(raw[:, places] / 0.02) * 0.02
    judged = judge(samples._replace(raw=raw))
    assert "The places are written in steps of 20 um" in words_of(judged)
    pose = samples.pose.copy()
    pose[:, :3] = np.round(pose[:, :3] / 2e-4) * 2e-4
    grid = judge(samples._replace(pose=pose))  # wanted poses
    assert "written in steps" not in words_of(grid)
    assert "scatter" not in words_of(judged)


@pytest.mark.parametrize("has_time", [False, True])
def test_rows_that_were_sorted_are_told(samples, has_time):
    count = len(samples.raw)
    clock = np.linspace(-1, 1, count)[:, None] * np.eye(3)[0] if has_time else None
    rows = np.argsort(samples.pose[:, 2])
    whole = samples._replace(clock=clock)
    words = "The rows are not in the order of time, as after sorting"
    assert words in words_of(judge(whole.part(rows)))
    assert words not in words_of(judge(whole))


@pytest.mark.parametrize("missing", [1, 6])
def test_rows_without_a_time_are_neither_sorted_nor_of_another_clock(samples, missing):
    time = np.linspace(-1, 1, len(samples.raw))
    time[20 : 20 + 7 * missing : 7] = 0  # as the table without them is read
    words = words_of(judge(samples._replace(clock=time[:, None] * np.eye(3)[0])))
    assert "in the order of time" not in words
    assert "time_s jumps" not in words


def round_to_steps(pose):
    """Poses (n, 6) whose x is written in steps of 2 um."""
    rounded = pose.copy()
    rounded[:, 0] = np.round(pose[:, 0] / 2e-3) * 2e-3
    return rounded


def test_a_reference_that_is_rounded_is_told(samples):
    """Not one whose poses lie on a grid and are so."""
    words = "(tx in steps of 2 um), which is more than its uncertainty"
    assert words in words_of(judge(samples._replace(pose=round_to_steps(samples.pose))))
    wanted = list[np.ndarray]()

    def go_to_the_grid(pose, rng):
        wanted.append(round_to_steps(pose))
        return wanted[0] - pose

    data = sample_rig(240, mirror=go_to_the_grid)[1]
    data.pose[:, 0] = wanted[0][:, 0]
    assert words not in words_of(judge(data))


@pytest.mark.parametrize(("late", "count", "close"), [(3e-4, 150, 0.07), (8e-4, 400, 3e-3)])
def test_a_late_reference_is_found(late, count, close):
    """A delay of most of a row is followed along the path, which bends; what is left is of third
    order."""
    judged = judge(sample_in_time(late, count=count), settings(delay="auto"))
    assert accepted_effects(judged) == {"delay"}
    assert judged.fit.all_values[PLACE["reference.delay"]] == pytest.approx(late, rel=close)
    assert "The reference is late by 0." in words_of(judged)
    assert "rows are one row" not in words_of(judged)


def test_channels_read_in_turn_are_found():
    delays, asked = (0.0, 4e-5, 1e-4), settings(channel_skew="auto")
    data = sample_in_time(delays=delays)
    judged = judge(data, asked)
    assert judged.is_trusted
    assert accepted_effects(judged) == {"channel_skew"}
    assert judged.sensor.light.delays == pytest.approx(delays, abs=1e-5)
    (row,) = judge(data.part(slice(0, 30))._replace(velocity=None), asked).search.rows
    assert (row.key, row.accepted, row.why) == ("channel_skew", False, "no time_s of a motion")


def test_axes_of_the_reference_that_are_read_in_turn_are_named():
    judged = judge(sample_in_time(2e-5 * np.arange(6)[:, None], count=140), settings(delay="auto"))
    words = words_of(judged)
    assert "the reference's axes are read at different times" in words
    assert "late as by creep (up to 0." in words


@pytest.mark.slow
def test_a_late_reference_without_a_clock_is_not_trusted():
    assert not judge(sample_in_time(1e-3)._replace(velocity=None)).is_trusted


def test_a_power_that_drifts_is_told(samples):
    raw = samples.raw.copy()
    raw[:, 2::3] *= np.linspace(0.97, 1.03, COUNT)[:, None]
    judged = judge(samples._replace(raw=raw))
    assert judged.is_trusted
    assert "The laser's power changed by" in words_of(judged)


def test_too_few_axes_are_named():
    _, data, _ = sample_rig(COUNT, 3, box=rigs.BOX * [1, 1, 1, 0, 0, 0])
    assert "hardly moves in roll, pitch, yaw" in words_of(judge(data))


@pytest.mark.slow
def test_another_rig_s_configuration_is_not_trusted(samples):
    psds = (replace(NOMINAL.psds[0], radius=247.0), *NOMINAL.psds[1:])
    judged = judge(samples, sensor=replace(NOMINAL, psds=psds))
    assert not judged.is_trusted
    assert "the configuration is not that of this rig" in words_of(judged)
