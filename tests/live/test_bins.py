"""Samples condensed to bins for pages, beside the plainest way to count them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from streams import CALIBRATED

from facets import MeasuredObject
from facets.core import READING_COLUMNS, STATE_COLUMNS, AuxiliaryChannel
from facets.live import row_content, sample_dtype
from facets.live.web.hub import Hub

CONTENT = row_content(
    replace(
        CALIBRATED,
        object=MeasuredObject(point=(10.0, -20.0, 50.0)),
        acquire=replace(CALIBRATED.acquire, channels=(AuxiliaryChannel("force", "N"),)),
    )
)
POSE = STATE_COLUMNS[:6]
EXTRAS = (
    *(f"object_{name}" for name in POSE), "force_n", *(f"u_object_{name}" for name in POSE)
)  # fmt: skip


@pytest.fixture
def hub():
    return Hub({**CONTENT, "statuses": {}})


def draw_rows(count, bursts=1):
    """Rows with random numbers; some without a pose, some readings and channels unknown.

    bursts: a burst of samples, 50 ms long, comes every 10 s.
    """
    rng = np.random.default_rng(7)
    rows = np.zeros(count, sample_dtype(CONTENT))
    for name in rows.dtype.names[6:]:
        rows[name] = rng.normal(size=count)
    times = 10 * rng.integers(0, bursts, count) + rng.uniform(0, 0.05, count)
    rows["host_s"] = 50.0 + np.sort(times)
    rows["host_s"][0] = 50.0
    rows["seq"] = np.arange(count)
    rows["status"] = np.where(rng.random(count) < 0.2, 3, 0)
    rows["tx_mm"][(rows["status"] != 0) & (rng.random(count) < 0.5)] = np.nan
    rows["force_n"][rng.random(count) < 0.5] = np.nan
    rows["power_b_mw"][rng.random(count) < 0.3] = np.nan
    return rows


def count_plainly(rows):
    """The columns of a bin, by their names."""
    good = rows[rows["status"] == 0]
    values = {"samples": len(rows), "poses": len(good),
              "residual": good["residual"].max(initial=-np.inf)}  # fmt: skip
    for name in READING_COLUMNS:
        values[name] = np.nanmean(rows[name])
    for name in (*STATE_COLUMNS, *EXTRAS):
        known = good[name] if name in STATE_COLUMNS else rows[name][np.isfinite(rows[name])]
        values[f"least_{name}"] = known.min(initial=np.inf)
        values[f"most_{name}"] = known.max(initial=-np.inf)
        values[f"mean_{name}"] = np.mean(known)
    for name in STATE_COLUMNS:
        values[f"u_{name}"] = good[f"u_{name}"].max(initial=-np.inf)
    return values


def assert_same(hub, level, rows):
    columns = json.loads(hub.hello())["columns"]
    numbers = np.floor((rows["host_s"] - 50.0) / level.width).astype(int)
    assert level.present_numbers() == np.unique(numbers).tolist()
    for number, row in zip(*level.values(np.unique(numbers)), strict=True):
        expected = count_plainly(rows[numbers == number])
        values = np.array([expected[name] for name in columns])
        values[~np.isfinite(values)] = np.nan  # nothing is known
        np.testing.assert_allclose(row, values, rtol=1e-6, atol=1e-6)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_bins_are_those_of_a_plain_count_whatever_the_order(hub):
    """A loop that is behind brings samples in an order of its own. The newest two minutes are held
    in bins of 10 ms, and the whole run in bins that become wider."""
    rows = draw_rows(1_500, bursts=30)
    hub.take(rows[:1])
    for first in 1 + 37 * np.random.default_rng(7).permutation(41):
        hub.take(rows[first : first + 37])
    near, whole = hub.levels
    assert whole.width == pytest.approx(0.016)
    assert whole.age == 4
    assert_same(hub, whole, rows)
    newest = rows[rows["host_s"] >= 50.0 + 0.01 * (near.numbers.max() - near.count + 1)]
    assert 0 < len(newest) < 1_000
    assert_same(hub, near, newest)
    hub.take(rows[:50])  # older than two minutes
    early = rows[:5].copy()
    early["host_s"] -= 100.0  # before the run
    hub.take(early)
    assert_same(hub, near, newest)


def test_what_changed_is_told_once(hub):
    rows, near = draw_rows(200), hub.levels[0]
    hub.take(rows)
    assert sorted(near.take_changes()) == near.present_numbers()
    assert not near.take_changes()
    hub.take(rows[:1])
    assert len(near.take_changes()) == 1


def test_a_page_gets_the_newest_sample_with_object_channels_and_parts_of_uncertainties(hub):
    rows = draw_rows(20)
    hub.take(rows)
    hello = json.loads(hub.hello())
    assert hello["object"]["point_mm"] == [10.0, -20.0, 50.0]
    assert hello["extras"] == list(EXTRAS)
    values = [np.nan if value is None else value for value in hub.newest["channels"]]
    np.testing.assert_array_equal(values, [rows[name][-1] for name in EXTRAS])
    for part, values in hub.newest["parts"].items():
        assert values == [rows[f"u_{part}_{name}"][-1] for name in STATE_COLUMNS]
    assert hub.newest["parts"].keys() == {"noise", "calibration"}
