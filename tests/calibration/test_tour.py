"""Orders of poses that are short to travel, against the shortest by trial of all."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from facets.calibration.tour import short_order, travel


def length(points, start, order):
    return travel(np.vstack([start[None], points[list(order)]]))


@pytest.mark.parametrize("seed", range(8))
def test_an_order_is_nearly_the_shortest_of_all(seed):
    rng = np.random.default_rng(seed)
    points, start = rng.uniform(-1, 1, (7, 6)), np.zeros(6)
    best = min(length(points, start, order) for order in permutations(range(7)))
    order = short_order(points, start)
    assert sorted(order.tolist()) == list(range(7))
    assert best - 1e-12 <= length(points, start, order) <= 1.1 * best


def test_poses_on_a_line_are_visited_along_it():
    points = np.array([3.0, -1.0, 2.0, 4.0, 1.0, 0.5])[:, None] * np.ones((1, 6))
    order = short_order(points, np.full(6, -2.0))
    assert points[order, 0].tolist() == [-1.0, 0.5, 1.0, 2.0, 3.0, 4.0]


def test_many_poses_become_much_shorter():
    rng = np.random.default_rng(2)
    points, start = rng.uniform(-1, 1, (60, 6)), np.zeros(6)
    assert length(points, start, short_order(points, start)) < 0.75 * length(
        points, start, range(60)
    )


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_poses_are_an_order_too(count):
    order = short_order(np.ones((count, 6)), np.zeros(6))
    assert sorted(order.tolist()) == list(range(count))


def test_the_same_pose_again_and_again_is_an_end():
    order = short_order(np.zeros((5, 6)), np.zeros(6))
    assert sorted(order.tolist()) == list(range(5))
