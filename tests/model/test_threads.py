"""Threads share the work and change nothing else."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from facets.model import once, share


@pytest.mark.parametrize(("rows", "threads"), [(0, 1), (5, 4), (10_001, 3), (4000, 0)])
def test_every_row_is_done_once(rows, threads):
    done = np.zeros(rows, int)

    def run(part):
        done[part] += 1

    share(run, rows, threads)
    assert (done == 1).all()


def test_what_two_threads_ask_for_is_made_once_and_other_things_meanwhile():
    made, both = [], threading.Barrier(2, timeout=60)

    @once
    def make(name):
        made.append(name)
        if name != "later":
            both.wait()  # only two that are made at the same time get past it
        return [name]

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(make, ["one", "other"]))
        later = list(pool.map(make, ["later"] * 4))
    assert sorted(made) == ["later", "one", "other"]
    assert all(each is later[0] for each in later)
