"""Threads share the work and change nothing else."""

import threading

import numpy as np
import pytest
from llvmlite import ir
from sensors import SENSORS, states

import facets
from facets import InputError
from facets.model import cores, object_code, once, part_of, run_side_by_side, share


@pytest.mark.parametrize(("rows", "threads"), [(0, 1), (5, 4), (2000, 2), (10_001, 3), (4000, 0)])
def test_every_row_is_done_once(rows, threads):
    done = np.zeros(rows, int)

    def run(part):
        done[part] += 1

    share(run, rows, threads)
    assert (done == 1).all()


def test_results_do_not_depend_on_threads():
    sensor, some_states = SENSORS["skewed4"], states(5000, seed=2)
    one, three = (facets.readings(sensor, some_states, threads=k) for k in (1, 3))
    assert (one == three).all()
    one, three = (facets.jacobian(sensor, some_states, threads=k) for k in (1, 3))
    assert (one == three).all()
    beam = facets.Prior(some_states[:, 6:], 0.01)
    a, b = (facets.solve(sensor, facets.readings(sensor, some_states), beam=beam, threads=k)
            for k in (1, 3))  # fmt: skip
    np.testing.assert_array_equal(a.state, b.state)
    np.testing.assert_array_equal(a.covariance, b.covariance)


def test_what_all_share_is_not_split():
    shared = np.zeros((1, 3))
    assert part_of(shared, slice(0, 2), 10) is shared


def test_bad_numbers_of_threads_are_named():
    assert cores() >= 1
    with pytest.raises(InputError, match="threads is -1"):
        share(print, 10, -1)


def test_what_two_threads_ask_for_is_made_once_and_other_things_meanwhile():
    made, both = [], threading.Barrier(2, timeout=60)

    @once
    def make(name):
        made.append(name)
        if name != "later":
            both.wait()  # only two that are made at the same time get past it
        return [name]

    run_side_by_side([lambda: make("one"), lambda: make("other")])
    found = []
    run_side_by_side([lambda: found.append(make("later"))] * 4)
    assert sorted(made) == ["later", "one", "other"]
    assert all(each is found[0] for each in found)


def test_an_object_that_two_threads_need_is_made_by_one_of_them(tmp_path, monkeypatch):
    """And read whole by the other; another one is made meanwhile."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    made, both = [], threading.Barrier(2, timeout=60)

    def write(builder, arguments):
        pointer = builder.inttoptr(arguments[0], ir.PointerType(arguments[0].type))
        builder.store(arguments[1], pointer)

    def recipe(name):
        def written():
            made.append(name)
            both.wait()
            return write

        return written

    found = {}

    def get(key, name):
        found[key] = object_code.function(name, 2, recipe(name))

    names = ["one", "other", "one", "other"]
    threads = [threading.Thread(target=get, args=pair) for pair in enumerate(names)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(made) == ["one", "other"]
    place = np.zeros(1, np.int64)
    for n in range(4):
        found[n](place.ctypes.data, n + 1)
        assert place[0] == n + 1


def test_what_goes_wrong_side_by_side_is_raised():
    with pytest.raises(ZeroDivisionError):
        run_side_by_side([lambda: 1 / 0, int])
