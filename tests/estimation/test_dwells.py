"""Averages over dwells of a reference: which rows are a dwell, and how well its mean is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import facets
from facets import InputError, standard_deviations
from facets.calibration import Data, add_converter_steps, gather_samples
from facets.core import READING_COLUMNS, Steps
from facets.estimation import dwell_means, find_axis_dwells, find_dwells
from facets.simulation import reading_table, reference_table

SIGMA = np.array([1e-3, 2e-3])


def test_stands_are_found_and_the_way_between_is_not():
    """The third has too few rows."""
    rng, counts = np.random.default_rng(1), (40, 200, 25, 500)
    places, rows = rng.uniform(-1, 1, (5, 2)), []
    for n, count in enumerate(counts):
        rows += [np.tile(places[n], (count, 1)), np.linspace(places[n], places[n + 1], 302)[1:-1]]
    pose = np.concatenate(rows[:-1])
    pose += 0.3 * SIGMA * rng.standard_normal(pose.shape)
    parts = find_dwells(pose, SIGMA)
    for part, n in zip(parts, (0, 1, 3), strict=True):
        assert 0.85 * counts[n] <= part.stop - part.start <= counts[n]
        assert (np.abs(pose[part] - places[n]) < 3 * SIGMA).all()


def test_rows_without_a_pose_end_a_stand():
    pose = np.zeros((200, 2))
    pose[100] = np.nan
    starts = [part.start for part in find_dwells(pose, SIGMA)]
    assert [round(start, -2) for start in starts] == [0, 100]
    assert find_dwells(np.full((50, 2), np.nan), SIGMA) == []


def mean_at_stands(noise, count):
    """The means of noise (n, 9), and powers of 100, at so many places of the same length."""
    places = np.random.default_rng(1).uniform(-1, 1, (count, 2))
    readings = noise + np.tile([0, 0, 100.0], 3)
    columns = dict(zip(READING_COLUMNS, readings.T, strict=True))
    return dwell_means(columns, np.repeat(places, len(noise) // count, axis=0), SIGMA)


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_the_noise_of_a_mean_is_what_means_scatter_by(memory):
    """White noise, and noise that lasts for some rows: the scatter of the means of 200 stands."""
    noise = np.random.default_rng(3).standard_normal((80_000, 9))
    for n in range(1, len(noise)):
        noise[n] += memory * noise[n - 1]
    found = mean_at_stands(noise, 200)
    assert len(found.rows) == 200
    means = np.column_stack([found.columns[name] for name in READING_COLUMNS])
    means[:, 2::3] -= 100.0
    ratio = np.sqrt((means**2).mean(axis=0)) / found.noise.mean(axis=0)
    assert np.sqrt((ratio**2).mean()) == pytest.approx(1, abs=0.08)
    assert found.left_out == 80_000 - found.rows.sum()


def test_rows_that_jump_and_stands_that_are_spoilt_change_little():
    rng = np.random.default_rng(4)
    noise = rng.standard_normal((4000, 9))
    clean = mean_at_stands(noise, 40)
    noise[rng.choice(4000, 40, replace=False), 0] += 1e4
    for row in (300, 1700, 3000):  # a reading that creeps while the mirror stands still
        noise[row : row + 100, 1] += np.linspace(0, 500, 100)
    found = mean_at_stands(noise, 40)
    name = READING_COLUMNS[0]
    np.testing.assert_allclose(found.columns[name], clean.columns[name], atol=0.1)
    assert (found.noise / clean.noise)[:, 1].mean() < 1.3


@pytest.mark.parametrize("bandwidth", [200.0, 5000.0])
def test_a_converter_s_steps_stay_in_a_mean(bandwidth):
    """The r.m.s. error of means of 400 readings over 150 states is as stated; by white noise alone
    it would be a third at most."""
    bench, rows = facets.load("bench").sensor, 400
    electronics = replace(bench.electronics, adc_bits=13, bandwidth=bandwidth)
    sensor, rng = replace(bench, electronics=electronics), np.random.default_rng(5)
    states = rng.uniform(-1, 1, (150, 8)) * [0.02, 0.02, 1.0, 3e-3, 3e-3, 3e-3, 0, 0]
    exact = facets.readings(sensor, states)
    means = np.mean([facets.add_noise(sensor, exact, rng) for _ in range(rows)], axis=0)
    white = standard_deviations(sensor, exact) / np.sqrt(rows)
    data = Data(means, states[:, :6], np.ones(6), np.zeros((150, 2)), noise=white,
                rows=np.full(150, float(rows)))  # fmt: skip
    over = (means - exact) / add_converter_steps(sensor, data).noise
    assert 0.85 < np.sqrt((over**2).mean()) < 1.15


def test_a_table_of_stands_becomes_a_sample_each():
    """Simulated readings beside an exact reference, which stands still a hundred rows a step."""
    stop = np.array([0.1, 0.1, 0.5, 5e-3, -5e-3, 5e-3, 0, 0])
    motion = Steps(tuple(-stop), tuple(stop), 12, 100, 1000.0)
    config = replace(facets.load("paper"), motions={"steps": motion})
    segments, choice = facets.simulate(config, seed=5), replace(config.calibrate, dwells=True)
    columns = reading_table(segments) | reference_table(segments, [0] * 6, 5)
    del columns["motion"]
    data = gather_samples(Path("t.csv"), columns, choice)
    states = segments[0].truth[::100]
    np.testing.assert_allclose(data.pose, states[:, :6], atol=1e-9)
    over = (data.raw - facets.readings(config.sensor, states)) / data.noise
    assert np.sqrt((over**2).mean()) == pytest.approx(1, abs=0.3)
    few = {name: values[:800] for name, values in columns.items()}
    with pytest.raises(InputError, match=r"at rest 8 times.*Leave out --dwells"):
        gather_samples(Path("t.csv"), few, choice)


def test_an_axis_stands_still_where_its_noisy_coordinate_does():
    """Steps of two standard deviations of a row, with missing rows, are found; noise alone is one
    stand."""
    rng = np.random.default_rng(3)
    place = np.repeat([0.0, 2.0, 4.0, 2.0], 500) + rng.standard_normal(2000)
    place[rng.integers(0, 2000, 40)] = np.nan
    parts = find_axis_dwells(place, 300)
    ends = [(part.start // 500, (part.stop - 1) // 500) for part in parts]
    assert ends == [(0, 0), (1, 1), (2, 2), (3, 3)]
    assert min(part.stop - part.start for part in parts) > 380
    assert len(find_axis_dwells(rng.standard_normal(2000), 300)) == 1
    assert find_axis_dwells(np.full(100, np.nan), 30) == []
