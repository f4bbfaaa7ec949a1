"""Averages where a reference stands still: what is a stand, and how well its mean is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import facets
from facets import InputError, standard_deviations
from facets.calibration import Data, gather_samples
from facets.calibration.samples import add_converter_steps
from facets.core import READING_COLUMNS, STATE_UNITS
from facets.estimation import dwell_means, stands, stands_of_axis

SIGMA = np.array([1e-3, 2e-3])


def steps(rng, counts, way):
    """A reference that stands for some rows, goes to another place in `way` rows, and so on."""
    places, parts = rng.uniform(-1, 1, (len(counts), 2)), []
    for n, count in enumerate(counts):
        parts.append(np.tile(places[n], (count, 1)))
        if n + 1 < len(counts):
            share = np.linspace(0, 1, way + 2)[1:-1, None]
            parts.append(places[n] + share * (places[n + 1] - places[n]))
    return np.concatenate(parts), places


def test_stands_are_found_and_the_way_between_is_not():
    rng = np.random.default_rng(1)
    counts = [40, 200, 31, 500]
    pose, places = steps(rng, counts, way=300)
    pose += 0.3 * SIGMA * rng.standard_normal(pose.shape)
    found = stands(pose, SIGMA)
    assert len(found) == 3  # 31 rows are too few
    for part, n in zip(found, (0, 1, 3), strict=True):
        assert 0.85 * counts[n] <= part.stop - part.start <= counts[n]
        assert (np.abs(pose[part] - places[n]) < 3 * SIGMA).all()


def test_rows_without_a_pose_and_a_new_seat_end_a_stand():
    pose = np.zeros((300, 2))
    pose[100] = np.nan
    seat = np.where(np.arange(300) < 200, 0.0, 120.0)
    assert [(part.start // 100, part.stop // 100) for part in stands(pose, SIGMA, seat)] == [
        (0, 0), (1, 1), (2, 2),
    ]  # fmt: skip
    assert stands(np.full((50, 2), np.nan), SIGMA) == []


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_the_noise_of_a_mean_is_what_means_scatter_by(memory):
    """White noise, and noise that lasts for some rows: the scatter of the means of 200 stands."""
    rng = np.random.default_rng(3)
    count, rows = 200, 400
    pose = np.repeat(rng.uniform(-1, 1, (count, 2)), rows, axis=0)
    noise = rng.standard_normal((count * rows, 9))
    for n in range(1, len(noise)):
        noise[n] += memory * noise[n - 1]
    noise[:, 2::3] += 100.0  # powers
    columns = dict(zip(READING_COLUMNS, noise.T, strict=True))
    found = dwell_means(columns, pose, SIGMA)
    assert len(found.rows) == count
    means = np.column_stack([found.columns[name] for name in READING_COLUMNS])
    means[:, 2::3] -= 100.0
    ratio = np.sqrt((means**2).mean(axis=0)) / found.noise.mean(axis=0)
    assert np.sqrt((ratio**2).mean()) == pytest.approx(1, abs=0.08)
    assert found.left_out == count * rows - found.rows.sum()


def test_rows_that_jump_and_stands_that_are_spoilt_change_little():
    rng = np.random.default_rng(4)
    count, rows = 40, 100
    pose = np.repeat(rng.uniform(-1, 1, (count, 2)), rows, axis=0)
    noise = rng.standard_normal((count * rows, 9))
    noise[:, 2::3] += 100.0
    clean = dwell_means(dict(zip(READING_COLUMNS, noise.T, strict=True)), pose, SIGMA)
    hit = noise.copy()
    hit[rng.choice(len(hit), 40, replace=False), 0] += 1e4
    for stand in (3, 17, 30):  # a reading that creeps while the mirror stands still
        hit[stand * rows : (stand + 1) * rows, 1] += np.linspace(0, 500, rows)
    found = dwell_means(dict(zip(READING_COLUMNS, hit.T, strict=True)), pose, SIGMA)
    name = READING_COLUMNS[0]
    np.testing.assert_allclose(found.columns[name], clean.columns[name], atol=0.1)
    assert (found.noise / clean.noise)[:, 1].mean() < 1.3


@pytest.mark.parametrize("bandwidth", [200.0, 5000.0])
def test_a_converter_s_steps_stay_in_a_mean(bandwidth):
    """The r.m.s. error of means of 400 readings over 150 states, beside what is stated."""
    bench = facets.load("bench").sensor
    electronics = replace(bench.electronics, adc_bits=13, bandwidth=bandwidth)
    sensor = replace(bench, electronics=electronics)
    rng, rows = np.random.default_rng(5), 400
    states = np.zeros((150, 8))
    states[:, :6] = rng.uniform(-1, 1, (150, 6)) * [0.02, 0.02, 1.0, 3e-3, 3e-3, 3e-3]
    exact = facets.readings(sensor, states)
    means = np.mean([facets.add_noise(sensor, exact, rng) for _ in range(rows)], axis=0)
    white = standard_deviations(sensor, exact) / np.sqrt(rows)
    data = Data(means, states[:, :6], np.ones(6), np.zeros((150, 2)), noise=white,
                rows=np.full(150, float(rows)))  # fmt: skip
    over = (means - exact) / add_converter_steps(sensor, data).noise
    assert np.sqrt((over**2).mean()) == pytest.approx(1, abs=0.15)
    assert np.sqrt((((means - exact) / white) ** 2).mean()) > 3


def columns_of(rng, count, rows):
    config = facets.load("paper")
    reach = np.array([0.1, 0.1, 0.5, 5e-3, 5e-3, 5e-3])
    places = rng.uniform(-1, 1, (count, 6)) * reach
    states = np.zeros((count * rows, 8))
    states[:, :6] = np.repeat(places, rows, axis=0)
    raw = facets.add_noise(config.sensor, facets.readings(config.sensor, states), rng)
    columns = dict(zip(READING_COLUMNS, raw.T, strict=True))
    names = ("tx_mm", "ty_mm", "tz_mm", "roll_mrad", "pitch_mrad", "yaw_mrad")
    for n, name in enumerate(names):
        columns[f"ref_{name}"] = states[:, n] / STATE_UNITS[n]
    columns["time_s"] = 1e-3 * np.arange(count * rows)
    return config, places, columns


def test_a_table_of_stands_becomes_a_sample_each():
    rng = np.random.default_rng(5)
    config, places, columns = columns_of(rng, 12, 100)
    settings = replace(config.calibrate, dwells=True)
    data = gather_samples(Path("t.csv"), columns, settings)
    np.testing.assert_allclose(data.pose, places, atol=1e-9)
    assert data.velocity is None
    states = np.concatenate([places, np.zeros((12, 2))], axis=1)
    over = (data.raw - facets.readings(config.sensor, states)) / data.noise
    assert np.sqrt((over**2).mean()) == pytest.approx(1, abs=0.3)
    single = standard_deviations(config.sensor, data.raw)
    np.testing.assert_allclose(data.noise / single, 1 / np.sqrt(90), rtol=0.4)


def test_a_reference_that_does_not_stand_still_is_told():
    rng = np.random.default_rng(6)
    config, _, columns = columns_of(rng, 8, 100)
    with pytest.raises(InputError, match=r"stands still 8 times.*Leave out --dwells"):
        gather_samples(Path("t.csv"), columns, replace(config.calibrate, dwells=True))


def test_an_axis_stands_still_where_its_noisy_coordinate_does():
    """Steps of two standard deviations of a row, with missing rows, are found; noise alone is one
    stand."""
    rng = np.random.default_rng(3)
    places = np.repeat([0.0, 2.0, 4.0, 2.0], 500)
    place = places + rng.standard_normal(len(places))
    place[rng.integers(0, len(place), 40)] = np.nan
    found = stands_of_axis(place, 300)
    assert len(found) == 4
    for k, part in enumerate(found):
        assert 500 * k <= part.start < part.stop <= 500 * (k + 1)
        assert part.stop - part.start > 380
    assert len(stands_of_axis(rng.standard_normal(2000), 300)) == 1
    assert stands_of_axis(np.full(100, np.nan), 30) == []
