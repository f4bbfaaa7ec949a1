"""Orders of poses that are short to travel, against the shortest by trial of all."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from facets.calibration import short_order, travel


def length(points, start, order):
    return travel(np.vstack([start[None], points[list(order)]]))


def test_an_order_is_nearly_the_shortest_of_all():
    for seed in range(4):
        points, start = np.random.default_rng(seed).uniform(-1, 1, (6, 6)), np.zeros(6)
        best = min(length(points, start, order) for order in permutations(range(6)))
        order = short_order(points, start)
        assert sorted(order.tolist()) == list(range(6))
        assert best - 1e-12 <= length(points, start, order) <= 1.1 * best


def test_poses_on_a_line_are_visited_along_it():
    points = np.array([3.0, -1.0, 2.0, 4.0, 1.0, 0.5])[:, None] * np.ones((1, 6))
    order = short_order(points, np.full(6, -2.0))
    assert points[order, 0].tolist() == [-1.0, 0.5, 1.0, 2.0, 3.0, 4.0]


def test_many_poses_become_much_shorter():
    points, start = np.random.default_rng(2).uniform(-1, 1, (60, 6)), np.zeros(6)
    order = short_order(points, start)
    assert length(points, start, order) < 0.75 * length(points, start, range(60))


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_equal_poses_and_few_are_an_order_too(count):
    order = short_order(np.ones((count, 6)), np.zeros(6))
    assert sorted(order.tolist()) == list(range(count))
