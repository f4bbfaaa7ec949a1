"""Samples in shared memory: all arrive, and a slow reader knows what it has lost."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import uuid

import numpy as np
import pytest
from facets.experiments.kills import stream

import facets
from facets.core.errors import InputError
from facets.live.run.pipeline import Pipeline
from facets.live.streams import shared_ring as module
from facets.live.streams.publication import Publications
from facets.live.streams.sample_rows import SAMPLE, description, rows_of
from facets.live.streams.shared_ring import HEAD, SharedSender, SharedSubscription, attach

CONFIG = facets.load("bench")
ABOUT = description({"config": "bench"})


@pytest.fixture
def name():
    return f"facets-test-{uuid.uuid4().hex[:12]}"


def rows(first, count):
    found = np.zeros(count, SAMPLE)
    found["seq"] = first + np.arange(count)
    found["residual"] = found["seq"]
    return found


def test_all_rows_arrive_in_their_order(name, monkeypatch):
    monkeypatch.setattr(module, "CAPACITY", 1_000)
    sender = SharedSender(name, ABOUT, 0.0)
    assert sender.receivers == 0
    assert sender.send(rows(0, 5)) == 0  # nobody was there
    with SharedSubscription(f"shm:{name}") as samples:
        assert samples.about == ABOUT
        assert sender.receivers == 1
        came = []
        for first in range(5, 20_005, 400):
            assert sender.send(rows(first, 400)) == 400
            came.append(samples.read())
        came = np.concatenate(came)
        assert came["seq"].tolist() == list(range(5, 20_005))
        np.testing.assert_array_equal(came["residual"], came["seq"])
        assert samples.lost == 0
        assert len(samples.read()) == 0
        sender.close()
        assert list(samples) == []
    with pytest.raises(FileNotFoundError):
        attach(name)


def test_a_slow_reader_loses_the_oldest_and_knows_how_many(name, monkeypatch):
    monkeypatch.setattr(module, "CAPACITY", 1_000)
    sender = SharedSender(name, ABOUT, 0.0)
    with SharedSubscription(f"shm:{name}") as samples:
        sent = sum(sender.send(rows(first, 100)) for first in range(0, 2_500, 100))
        came = samples.read()
        assert came["seq"].tolist() == list(range(1_500, 2_500))
        assert samples.lost == 1_500 == 2_500 - sent
        sender.send(rows(2_500, 10))
        assert samples.read()["seq"].tolist() == list(range(2_500, 2_510))
        assert samples.lost == 1_500
        sender.close()


def test_what_is_overwritten_while_it_is_copied_is_given_up(name, monkeypatch):
    monkeypatch.setattr(module, "CAPACITY", 100)
    sender = SharedSender(name, ABOUT, 0.0)
    with SharedSubscription(f"shm:{name}") as samples:
        sender.send(rows(0, 100))
        sender.ring.head["begun"] = 130  # the writer is in the middle of 30 more
        assert samples.read()["seq"].tolist() == list(range(30, 100))
        assert samples.lost == 30
        sender.close()


def test_a_writer_at_full_speed_spoils_no_row(name, monkeypatch):
    """Rows whose columns say the same number, while the ring goes round beside the reader."""
    monkeypatch.setattr(module, "CAPACITY", 512)
    sender = SharedSender(name, ABOUT, 0.0)
    with SharedSubscription(f"shm:{name}") as samples:

        def write():
            for first in range(0, 100_000, 50):
                sender.send(rows(first, 50))
            sender.close()

        thread = threading.Thread(target=write)
        thread.start()
        count, last = 0, -1
        for part in samples:
            np.testing.assert_array_equal(part["residual"], part["seq"])
            assert part["seq"][0] > last
            assert (np.diff(part["seq"]) == 1).all()
            count, last = count + len(part), int(part["seq"][-1])
        thread.join()
        assert last == 99_999
        assert count + samples.lost == 100_000


def test_a_second_reader_and_a_second_writer_are_refused(name):
    sender = SharedSender(name, ABOUT, 0.0)
    with SharedSubscription(f"shm:{name}"), pytest.raises(InputError, match="reads there already"):
        SharedSubscription(f"shm:{name}")
    with pytest.raises(InputError, match=f"process {os.getpid()} has memory of that name"):
        SharedSender(name, ABOUT, 0.0)
    with SharedSubscription(f"shm:{name}"):  # the first one has gone
        sender.close()
    with pytest.raises(InputError, match="nobody publishes there"):
        SharedSubscription(f"shm:{name}", timeout=0.0)


def test_what_a_killed_writer_left_is_taken_away(name):
    code = (
        "import os, sys\n"
        "from facets.live.streams.shared_ring import SharedSender\n"
        "from facets.live.streams.sample_rows import description\n"
        "from multiprocessing import resource_tracker\n"
        "resource_tracker.register = lambda *_: None\n"  # killed as a whole, with its tracker
        f"SharedSender({name!r}, description({{}}), 0.0)\n"
        "os._exit(9)\n"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 9
    with pytest.raises(InputError, match="nobody publishes there"):
        SharedSubscription(f"shm:{name}", timeout=0.0)
    sender = SharedSender(name, ABOUT, 0.0)
    sender.close()


@pytest.mark.parametrize("bad", ["", "a/b", "a b"])
def test_a_name_that_is_none_is_told(bad):
    with pytest.raises(InputError, match="is no name"):
        SharedSubscription(f"shm:{bad}")
    with pytest.raises(InputError, match="is no name"):
        Publications([f"shm:{bad}"], CONFIG)


def test_the_layout_is_the_documented_one():
    assert HEAD.itemsize == 64
    assert [HEAD.fields[name][1] for name in ("begun", "written", "reader", "read")] == [
        32, 40, 48, 56,
    ]  # fmt: skip


def test_a_publication_in_shared_memory_gives_all_samples(name):
    pipeline = Pipeline(CONFIG)
    parts = [pipeline.solve(b) for b in pipeline.take(stream(3_000), 1_000.0)]
    came = []
    with (
        Publications([f"shm:{name}"], CONFIG, patient=True) as publications,
        SharedSubscription(f"shm:{name}") as samples,
    ):
        for part in parts:
            publications.add_poses(part)
        for some in samples:
            came.append(some)
            if sum(map(len, came)) == 3_000:
                break
    raw = np.concatenate([rows_of(part, publications.offset) for part in parts])
    found = np.concatenate(came)
    assert found.tobytes() == raw.tobytes()
    (counts,) = publications.counts()
    assert counts["sent"] == 3_000
    assert counts["dropped"] == 0
