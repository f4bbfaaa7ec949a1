"""Samples condensed to bins for pages, beside the plainest way to count them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from streams import BENCH

from facets import MeasuredObject
from facets.core import READING_COLUMNS, STATE_COLUMNS, AuxiliaryChannel
from facets.live import row_content, sample_dtype
from facets.live.web.hub import Hub

CONFIG = replace(
    BENCH,
    object=MeasuredObject(point=(10.0, -20.0, 50.0)),
    acquire=replace(BENCH.acquire, channels=(AuxiliaryChannel("force", "N"),)),
)
CONTENT = row_content(CONFIG)
POSE = STATE_COLUMNS[:6]
EXTRAS = (
    *(f"object_{name}" for name in POSE), "force_n", *(f"u_object_{name}" for name in POSE)
)  # fmt: skip


def hub():
    return Hub({**CONTENT, "statuses": {}})


def draw_rows(count, bursts, seed):
    """Rows with random numbers; some without a pose, some readings and channels unknown.

    bursts: a burst of samples, 50 ms long, comes every 10 s.
    """
    rng = np.random.default_rng(seed)
    dtype = sample_dtype(CONTENT)
    rows = np.zeros(count, dtype)
    for name in dtype.names[6:]:
        rows[name] = rng.normal(size=count)
    rows["host_s"] = 50.0 + np.sort(
        10 * rng.integers(0, bursts, count) + rng.uniform(0, 0.05, count)
    )
    rows["host_s"][0] = 50.0
    rows["seq"] = np.arange(count)
    rows["status"] = np.where(rng.random(count) < 0.2, 3, 0)
    rows["tx_mm"][(rows["status"] != 0) & (rng.random(count) < 0.5)] = np.nan
    rows["force_n"][rng.random(count) < 0.5] = np.nan
    rows["power_b_mw"][rng.random(count) < 0.3] = np.nan
    return rows


def count_plainly(rows, width):
    """number -> column -> value, one bin after the other."""
    numbers = np.floor((rows["host_s"] - 50.0) / width).astype(int)
    bins = {}
    for number in np.unique(numbers):
        mine = rows[numbers == number]
        good = mine[mine["status"] == 0]
        values = {
            "samples": len(mine),
            "poses": len(good),
            "residual": good["residual"].max(initial=-np.inf),
        }
        for name in READING_COLUMNS:
            values[name] = mine[name][np.isfinite(mine[name])].sum() / np.isfinite(mine[name]).sum()
        for name in (*STATE_COLUMNS, *EXTRAS):
            known = good[name] if name in STATE_COLUMNS else mine[name][np.isfinite(mine[name])]
            values[f"least_{name}"] = known.min(initial=np.inf)
            values[f"most_{name}"] = known.max(initial=-np.inf)
            values[f"mean_{name}"] = known.sum() / len(known)
        for name in STATE_COLUMNS:
            values[f"u_{name}"] = good[f"u_{name}"].max(initial=-np.inf)
        bins[number] = values
    return bins


def assert_same(page_hub, bins, expected):
    columns = json.loads(page_hub.hello())["columns"]
    assert bins.present_numbers() == sorted(expected)
    numbers, table = bins.values(np.array(sorted(expected)))
    for number, row in zip(numbers.tolist(), table, strict=True):
        values = np.array([expected[number][name] for name in columns])
        values[~np.isfinite(values)] = np.nan  # nothing is known
        np.testing.assert_allclose(row, values, rtol=1e-6, atol=1e-6)


@pytest.mark.filterwarnings("ignore:invalid value encountered")
def test_bins_are_those_of_a_plain_count_whatever_the_order():
    """A loop that is behind brings samples in an order of its own. The newest two minutes are held
    in bins of 10 ms, and the whole run in bins that become wider."""
    rows, page_hub = draw_rows(1_500, bursts=30, seed=7), hub()
    page_hub.take(rows[:1])
    for first in 1 + 37 * np.random.default_rng(7).permutation(41):
        page_hub.take(rows[first : first + 37])
    near, whole = page_hub.levels
    assert whole.width == pytest.approx(0.016)
    assert whole.age == 4
    assert_same(page_hub, whole, count_plainly(rows, whole.width))
    newest = rows[rows["host_s"] >= 50.0 + 0.01 * (near.numbers.max() - near.count + 1)]
    assert 0 < len(newest) < 1_000
    assert_same(page_hub, near, count_plainly(newest, 0.01))
    before = near.values(np.array(near.present_numbers()))[1]
    page_hub.take(rows[:50])  # older than two minutes
    early = rows[:5].copy()
    early["host_s"] -= 100.0  # before the run
    page_hub.take(early)
    np.testing.assert_array_equal(near.values(np.array(near.present_numbers()))[1], before)


def test_what_changed_is_told_once():
    rows, page_hub = draw_rows(200, bursts=1, seed=5), hub()
    near = page_hub.levels[0]
    page_hub.take(rows)
    assert sorted(near.take_changes()) == near.present_numbers()
    assert not near.take_changes()
    page_hub.take(rows[:1])
    assert len(near.take_changes()) == 1


def test_a_page_gets_the_newest_sample_with_object_and_channels():
    rows, page_hub = draw_rows(20, bursts=1, seed=3), hub()
    page_hub.take(rows)
    hello = json.loads(page_hub.hello())
    assert hello["object"]["point_mm"] == [10.0, -20.0, 50.0]
    assert hello["extras"] == list(EXTRAS)
    values = [np.nan if value is None else value for value in page_hub.newest["channels"]]
    np.testing.assert_array_equal(values, [rows[name][-1] for name in EXTRAS])
