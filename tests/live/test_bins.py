"""Samples condensed to bins, beside the plainest way to count them."""

from __future__ import annotations

import numpy as np
import pytest

from facets.core import READING_COLUMNS, STATE_COLUMNS
from facets.live import row_dtype
from facets.live.web.bins import COLUMNS, AllBins, Bins, bin_columns

CHANNELS = ("force_n", "temperature_c")


def some_rows(count, seed, status=True):
    """Rows with random numbers; some without a pose, some readings and channels unknown."""
    rng = np.random.default_rng(seed)
    dtype = row_dtype(False, CHANNELS)
    rows = np.zeros(count, dtype)
    for name in dtype.names[6:]:
        rows[name] = rng.normal(size=count)
    rows["host_s"] = 50.0 + np.sort(rng.uniform(0, 3, count))
    rows["seq"] = np.arange(count)
    if status:
        rows["status"] = np.where(rng.random(count) < 0.2, 3, 0)
        for name in STATE_COLUMNS:
            rows[name][rows["status"] != 0] = np.nan
            rows[f"u_{name}"][rows["status"] != 0] = np.nan
        rows["force_n"][rng.random(count) < 0.5] = np.nan
        rows["power_b_mw"][rng.random(count) < 0.3] = np.nan
    return rows


def plain(rows, times, width):
    """number -> column -> value, one sample after the other."""
    found = {}
    for number in np.unique(np.floor(times / width).astype(int)):
        mine = rows[np.floor(times / width).astype(int) == number]
        good = mine[mine["status"] == 0]
        one = {"samples": len(mine), "poses": len(good)}
        one["residual"] = good["residual"].max() if len(good) else np.nan
        for name in READING_COLUMNS:
            known = mine[name][np.isfinite(mine[name])]
            one[name] = known.mean() if len(known) else np.nan
        for name in STATE_COLUMNS:
            values, sigmas = good[name], good[f"u_{name}"]
            one[f"least_{name}"] = values.min() if len(good) else np.nan
            one[f"most_{name}"] = values.max() if len(good) else np.nan
            one[f"mean_{name}"] = values.mean() if len(good) else np.nan
            one[f"u_{name}"] = sigmas.max() if len(good) else np.nan
        for name in CHANNELS:
            known = mine[name][np.isfinite(mine[name])]
            one[f"least_{name}"] = known.min() if len(known) else np.nan
            one[f"most_{name}"] = known.max() if len(known) else np.nan
            one[f"mean_{name}"] = known.mean() if len(known) else np.nan
        found[number] = one
    return found


def assert_same(bins, expected):
    assert bins.present_numbers() == sorted(expected)
    numbers, table = bins.values(np.array(bins.present_numbers()))
    for number, row in zip(numbers.tolist(), table, strict=True):
        for name, value in zip(bin_columns(CHANNELS), row, strict=True):
            np.testing.assert_allclose(value, expected[number][name], rtol=1e-6, atol=1e-6)


def add_in_parts(bins, rows, times, seed):
    """In an order of its own, as a loop that is behind brings them."""
    rng = np.random.default_rng(seed)
    parts = np.array_split(np.arange(len(rows)), 40)
    for k in rng.permutation(len(parts)):
        bins.add(times[parts[k]], rows[parts[k]])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.slow
def test_bins_are_those_of_a_plain_count_whatever_the_order(seed):
    rows = some_rows(3_000, seed)
    times = rows["host_s"] - 50.0
    bins = Bins(0.01, 1_000, CHANNELS)
    add_in_parts(bins, rows, times, seed)
    assert_same(bins, plain(rows, times, 0.01))


def test_a_run_that_grows_is_told_in_wider_bins():
    rows = some_rows(3_000, 7)
    times = rows["host_s"] - 50.0
    bins = AllBins(0.001, 256, CHANNELS)
    add_in_parts(bins, rows, times, 7)
    assert bins.width == pytest.approx(0.016)
    assert bins.age == 4
    assert_same(bins, plain(rows, times, bins.width))


def test_only_the_newest_bins_are_held_and_late_samples_of_older_ones_are_passed_over():
    rows = some_rows(2_000, 3)
    times = rows["host_s"] - 50.0
    bins = Bins(0.01, 100)
    bins.add(times, rows)
    last = int(np.floor(times / 0.01).max())
    assert min(bins.present_numbers()) > last - 100
    before = bins.values(np.array(bins.present_numbers()))[1]
    bins.add(times[:50], rows[:50])
    np.testing.assert_array_equal(bins.values(np.array(bins.present_numbers()))[1], before)
    bins.add(times[:5] - 100.0, rows[:5])  # before the origin
    np.testing.assert_array_equal(bins.values(np.array(bins.present_numbers()))[1], before)


def test_what_changed_is_told_once():
    rows = some_rows(200, 5)
    bins = Bins(0.01, 1_000)
    bins.add(rows["host_s"] - 50.0, rows)
    assert sorted(bins.take_changes()) == bins.present_numbers()
    assert not bins.take_changes()
    bins.add(rows["host_s"][:1] - 50.0, rows[:1])
    assert len(bins.take_changes()) == 1


def test_nothing_is_drawn_of_a_sample_without_a_pose_even_if_it_has_numbers():
    rows = some_rows(10, 5, status=False)
    rows["status"] = 1
    bins = Bins(10.0, 4)
    bins.add(rows["host_s"] - 50.0, rows)
    _, table = bins.values(np.array([0]))
    values = dict(zip(COLUMNS, table[0], strict=True))
    assert values["samples"] == 10
    assert values["poses"] == 0
    assert all(np.isnan(values[f"{part}tx_mm"]) for part in ("least_", "most_", "mean_", "u_"))
