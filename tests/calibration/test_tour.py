"""Orders of poses that are short to travel, against the shortest by trial of all."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from facets.calibration import short_order, travel

START = np.zeros(6)


def length(points, order):
    return travel(np.vstack([START, points[list(order)]]))


def test_an_order_is_nearly_the_shortest_of_all():
    for seed in range(4):
        points = np.random.default_rng(seed).uniform(-1, 1, (6, 6))
        best = min(length(points, order) for order in permutations(range(6)))
        order = short_order(points, START)
        assert sorted(order.tolist()) == list(range(6))
        assert best - 1e-12 <= length(points, order) <= 1.1 * best


def test_equal_poses_and_few_are_an_order_too():
    for count in (0, 5):
        order = short_order(np.ones((count, 6)), START)
        assert sorted(order.tolist()) == list(range(count))
