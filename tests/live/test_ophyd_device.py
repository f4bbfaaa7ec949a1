"""The sensor in bluesky plans: a RunEngine's documents hold what the detectors saw."""

from __future__ import annotations

import itertools
import queue
import time
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from facets.experiments.studies import kills
from streams import BENCH, CALIBRATED

from facets import InputError, live
from facets.core import AuxiliaryChannel
from facets.live import (
    SAMPLE,
    SIZE,
    FixedFrames,
    Pipeline,
    Publications,
    pack,
    poses,
    rows_of,
)

pytestmark = pytest.mark.installed

FORCE = AuxiliaryChannel("force", "kN", scale=0.5)
CONFIG = replace(BENCH, acquire=replace(BENCH.acquire, channels=(FORCE,)))


class Documents:
    """What a RunEngine emits, by kind."""

    def __init__(self):
        self.all = defaultdict(list)

    def __call__(self, name, document):
        self.all[name].append(document)

    def flown(self, name):
        """The values of a column in all event pages."""
        pages = [page["data"][f"sensor-{name}"] for page in self.all["event_page"]]
        return list(itertools.chain(*pages))

    def read(self, name):
        return [event["data"][f"sensor-{name}"] for event in self.all["event"]]


@pytest.fixture(scope="module")
def engine():
    pytest.importorskip("bluesky")
    pytest.importorskip("ophyd_async")
    from bluesky.run_engine import RunEngine

    return RunEngine({})


@pytest.fixture
def documents(engine):
    documents = Documents()
    token = engine.subscribe(documents)
    yield documents
    engine.unsubscribe(token)


def nothing():
    yield from ()


def flight(sensor, interval=None, during=nothing):
    import bluesky.plan_stubs as bps
    from bluesky.preprocessors import run_decorator, stage_decorator

    @stage_decorator([sensor])
    @run_decorator()
    def plan():
        yield from bps.declare_stream(sensor, name="flight", collect=True)
        if interval is not None:
            yield from bps.prepare(sensor, interval, wait=True)
        yield from bps.kickoff(sensor, wait=True)
        yield from during()
        yield from bps.complete(sensor, wait=True)
        yield from bps.collect(sensor, name="flight", return_payload=False)

    return plan()


def count(sensor, number):
    """A plan that reads the sensor so many times."""
    from bluesky import plans

    return plans.count([sensor], num=number)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """The address of a recorded stream with a channel."""
    path = tmp_path_factory.mktemp("board") / "bytes.bin"
    samples = FixedFrames().feed(kills.stream(2_500))
    force = np.arange(2_500, dtype=np.float32)[:, None]
    path.write_bytes(pack(replace(samples, channels=force)))
    return f"file:{path}"


@pytest.fixture
def sensor(engine, file):
    return live.PoseSensor(CONFIG, file, name="sensor")


@pytest.fixture(scope="module")
def expected(file):
    return np.concatenate([rows_of(part, 0.0) for part in poses(CONFIG, file)])


def test_a_plan_reads_a_pose_with_its_uncertainties_and_channels(
    engine, documents, sensor, expected
):
    engine(count(sensor, 3))
    assert documents.read("seq") == [0, 1, 2]
    assert documents.read("status") == ["converged"] * 3
    for name in ("yaw_mrad", "u_yaw_mrad", "power_a_mw", "residual"):
        np.testing.assert_array_equal(documents.read(name), expected[name][:3])
    assert documents.read("force_kn") == [0.0, 0.5, 1.0]
    (descriptor,) = documents.all["descriptor"]
    keys = descriptor["data_keys"]
    assert keys["sensor-yaw_mrad"]["units"] == "mrad"
    assert keys["sensor-force_kn"]["units"] == "kN"
    assert descriptor["configuration"]["sensor"]["data"]["sensor-config_sha256"] == CONFIG.sha256
    assert descriptor["hints"]["sensor"]["fields"][0] == "sensor-tx_mm"


def test_a_flight_holds_all_samples_of_a_recording(
    engine, documents, sensor, expected, monkeypatch
):
    monkeypatch.setattr("facets.live.streams.row_stream.AHEAD", 1_000)  # of 2,500
    engine(flight(sensor))
    assert len(documents.all["event_page"]) > 1
    for name in expected.dtype.names:
        if name not in ("status", "host_s", "utc_s"):  # the file is read at another time
            np.testing.assert_array_equal(documents.flown(name), expected[name], err_msg=name)
    assert documents.all["stop"][0]["num_events"] == {"flight": 2_500}


class Board:
    """A stream whose samples are taken when the test says so."""

    def __init__(self, monkeypatch):
        self.queue, self.seq = queue.SimpleQueue(), 0
        monkeypatch.setattr(
            "facets.live.streams.row_stream.RowStream.rows", lambda stream: self.rows(stream)
        )

    def rows(self, stream):
        while not stream.ending.is_set():
            try:
                yield self.queue.get(timeout=0.01)
            except queue.Empty:
                continue

    def send(self, *times):
        rows = np.zeros(len(times), SAMPLE)
        rows["host_s"] = rows["utc_s"] = times
        rows["seq"] = self.seq + np.arange(len(times))
        self.seq += len(times)
        self.queue.put(rows)


def test_a_flight_holds_the_samples_of_its_interval_and_no_others(engine, documents, monkeypatch):
    board = Board(monkeypatch)
    board.send(time.monotonic() - 1.0)
    inside = []

    def during():
        yield from ()
        now = time.monotonic()
        board.send(now - 100.0, now - 99.0)  # late ones, taken before the flight
        inside.extend([now, now + 1e-6])
        for moment in inside:
            board.send(moment)
        board.send(now + 3600.0)  # taken after it

    engine(flight(live.PoseSensor(BENCH, "board", name="sensor"), during=during))
    assert documents.flown("host_s") == inside


def test_a_trigger_waits_for_a_sample_that_is_taken_after_it(engine, documents, monkeypatch):
    import bluesky.plan_stubs as bps
    from bluesky.preprocessors import run_decorator, stage_decorator

    board = Board(monkeypatch)
    board.send(time.monotonic() - 1.0)
    later = time.monotonic() + 3600.0
    sensor = live.PoseSensor(BENCH, "board", name="sensor")

    def plan():
        yield from bps.trigger(sensor, group="trigger")
        yield from bps.sleep(0)  # the trigger has begun
        board.send(time.monotonic() - 10.0)
        board.send(later, later + 1.0)
        yield from bps.wait("trigger")
        yield from bps.create()
        yield from bps.read(sensor)
        yield from bps.save()

    engine(run_decorator()(stage_decorator([sensor])(plan))())
    assert documents.read("host_s") == [later]


def failure(engine, plan):
    """Why a plan failed, in words."""
    from bluesky.utils import FailedStatus

    with pytest.raises(FailedStatus) as failed:
        engine(plan)
    return str(failed.value.__cause__)


def test_samples_that_nobody_collected_fail_the_flight(engine, sensor, monkeypatch):
    monkeypatch.setattr("facets.live.streams.row_stream.MAX_HELD_ROWS", 1_000)
    assert "since nobody collected them" in failure(engine, flight(sensor))


def test_a_source_that_is_not_there_ends_the_plan(engine, tmp_path):
    sensor = live.PoseSensor(CONFIG, f"file:{tmp_path}/none.bin", name="sensor")
    assert "none.bin" in failure(engine, count(sensor, 1))
    with pytest.raises(InputError, match=r"acquire\.port"):
        live.PoseSensor(CONFIG)


def wait_and_add(publications, poses):
    while not publications.outlet.receivers:
        publications.outlet.hear(5)
    publications.add_poses(poses)


def test_a_flight_takes_the_samples_of_a_publication(engine, documents):
    """Of a calibrated sensor, whose samples have more columns."""
    publisher = replace(CALIBRATED, acquire=replace(BENCH.acquire, timing="arrival"))
    pipeline, data = Pipeline(publisher), kills.stream(500)
    with Publications(["zmq://127.0.0.1:0"], publisher, patient=True) as publications:
        sensor = live.PoseSensor(BENCH, publications.places()[0], name="sensor")

        def during():
            yield from ()
            beginning.result()
            publications.add_poses(pipeline.feed(data[SIZE:], time.monotonic() + 100.0))

        # staging waits for a first sample, which waits for it, and the flight for those after it
        first = pipeline.feed(data[:SIZE], time.monotonic())
        with ThreadPoolExecutor() as pool:
            beginning = pool.submit(wait_and_add, publications, first)
            engine(flight(sensor, live.Interval(samples=400), during))
    assert documents.flown("seq") == list(range(1, 401))
    assert set(documents.flown("status")) == {"converged"}
    assert not [name for name in documents.all["event_page"][0]["data"] if "u_noise" in name]
