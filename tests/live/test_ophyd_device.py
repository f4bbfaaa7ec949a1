"""The sensor in bluesky plans: a RunEngine's documents hold what the detectors saw."""

from __future__ import annotations

import itertools
import queue
import time
from dataclasses import replace

import numpy as np
import pytest
from facets.experiments import kills
from programs import Program

import facets
from facets import InputError
from facets.core import AuxiliaryChannel
from facets.live import (
    LABELS,
    SAMPLE,
    SIZE,
    FixedFrames,
    Pipeline,
    Publications,
    pack,
    poses,
    rows_of,
)
from facets.live.streams import row_stream

bluesky = pytest.importorskip("bluesky")
pytest.importorskip("ophyd_async")

import bluesky.plan_stubs as bps  # noqa: E402
import bluesky.plans as bp  # noqa: E402
from bluesky.preprocessors import run_decorator, stage_decorator  # noqa: E402
from bluesky.run_engine import RunEngine  # noqa: E402
from bluesky.utils import FailedStatus  # noqa: E402

from facets.live import PoseSensor  # noqa: E402
from facets.live.streams.ophyd_device import COLUMNS, Interval  # noqa: E402

pytestmark = pytest.mark.installed

CONFIG = facets.load("bench")


class Documents:
    """What a RunEngine emits, by kind."""

    def __init__(self):
        self.all = {}

    def __call__(self, name, document):
        self.all.setdefault(name, []).append(document)

    def flown(self, name):
        """The values of a column in all event pages."""
        pages = self.all.get("event_page", [])
        return [value for page in pages for value in page["data"][f"sensor-{name}"]]

    def read(self, name):
        return [event["data"][f"sensor-{name}"] for event in self.all.get("event", [])]


@pytest.fixture(scope="module")
def engine():
    return RunEngine({})


@pytest.fixture
def documents(engine):
    found = Documents()
    token = engine.subscribe(found)
    yield found
    engine.unsubscribe(token)


def flight(sensor, interval=None, during=bps.null):
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


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A recorded stream of 12,500 samples: more than are read ahead."""
    path = tmp_path_factory.mktemp("board") / "bytes.bin"
    path.write_bytes(kills.stream(12_500))
    return path


@pytest.fixture(scope="module")
def expected(file):
    return np.concatenate([rows_of(part, 0.0) for part in poses(CONFIG, f"file:{file}")])


def test_a_plan_reads_a_pose_with_its_uncertainties(engine, documents, file, expected):
    engine(bp.count([PoseSensor(CONFIG, f"file:{file}", name="sensor")], num=3))
    assert documents.read("seq") == [0, 1, 2]
    assert documents.read("status") == ["converged"] * 3
    for name in ("yaw_mrad", "u_yaw_mrad", "power_a_mw", "residual"):
        np.testing.assert_array_equal(documents.read(name), expected[name][:3])
    (descriptor,) = documents.all["descriptor"]
    key = descriptor["data_keys"]["sensor-yaw_mrad"]
    assert (key["units"], key["dtype"], key["shape"]) == ("mrad", "number", [])
    told = descriptor["configuration"]["sensor"]["data"]
    assert told["sensor-config_sha256"] == CONFIG.sha256
    assert descriptor["hints"]["sensor"]["fields"][0] == "sensor-tx_mm"


def test_a_plan_reads_auxiliary_channels_with_their_units(engine, documents, tmp_path):
    samples = FixedFrames().feed(kills.stream(50))
    force = np.arange(50, dtype=np.float32)[:, None]
    (tmp_path / "bytes.bin").write_bytes(pack(replace(samples, channels=force)))
    channel = AuxiliaryChannel("force", "kN", scale=0.5)
    config = replace(CONFIG, acquire=replace(CONFIG.acquire, channels=(channel,)))
    address = f"file:{tmp_path / 'bytes.bin'}"
    engine(bp.count([PoseSensor(config, address, name="sensor")], num=3))
    assert documents.read("force_kn") == [0.0, 0.5, 1.0]
    (descriptor,) = documents.all["descriptor"]
    assert descriptor["data_keys"]["sensor-force_kn"]["units"] == "kN"


@pytest.mark.slow
def test_a_flight_holds_all_samples_of_a_recording(engine, documents, file, expected):
    engine(flight(PoseSensor(CONFIG, f"file:{file}", name="sensor")))
    assert len(documents.all["event_page"]) > 1
    assert documents.flown("seq") == list(range(12_500))
    for name in COLUMNS:
        if name not in ("status", "host_s"):  # the file is read at another time
            np.testing.assert_array_equal(documents.flown(name), expected[name], err_msg=name)
    assert documents.all["stop"][0]["num_events"] == {"flight": 12_500}


def test_a_flight_holds_as_many_samples_as_it_is_asked_for(engine, documents, file):
    sensor = PoseSensor(CONFIG, f"file:{file}", name="sensor")
    engine(flight(sensor, Interval(samples=700)))
    assert documents.flown("seq") == list(range(700))


class Board:
    """A stream whose samples are taken when the test says so."""

    def __init__(self, monkeypatch):
        self.queue, self.seq = queue.SimpleQueue(), 0
        monkeypatch.setattr(row_stream.RowStream, "rows", lambda stream: self.rows(stream))

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


def test_samples_are_counted_while_more_come(monkeypatch):
    rows = np.ones(1, SAMPLE)
    monkeypatch.setattr(row_stream.RowStream, "rows", lambda _: itertools.repeat(rows, 20_000))
    stream = row_stream.RowStream(CONFIG, "board")
    stream.keep()
    counts = [0]
    while not stream.ended:
        counts.append(stream.count_since(1.0))
    assert counts == sorted(counts)
    assert stream.count_since(1.0) == stream.held.count
    assert stream.count_since(2.0) == 0
    stream.close()


def test_a_flight_holds_the_samples_of_its_interval_and_no_others(engine, documents, monkeypatch):
    board = Board(monkeypatch)
    board.send(time.monotonic() - 1.0)
    inside = []

    def during():
        now = time.monotonic()
        board.send(now - 100.0, now - 99.0)  # late ones, taken before the flight
        board.send(now)
        inside.append(now)
        board.send(now + 1e-6)
        inside.append(now + 1e-6)
        board.send(now + 3600.0)  # taken after it
        yield from bps.null()

    engine(flight(PoseSensor(CONFIG, "board", name="sensor"), during=during))
    assert documents.flown("host_s") == inside


def test_a_trigger_waits_for_a_sample_that_is_taken_after_it(engine, documents, monkeypatch):
    board = Board(monkeypatch)
    board.send(time.monotonic() - 1.0)
    later = time.monotonic() + 3600.0
    sensor = PoseSensor(CONFIG, "board", name="sensor")

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


def test_samples_that_nobody_collected_fail_the_flight(engine, file, monkeypatch):
    monkeypatch.setattr(row_stream, "MAX_HELD_ROWS", 5_000)
    with pytest.raises(FailedStatus) as failed:
        engine(flight(PoseSensor(CONFIG, f"file:{file}", name="sensor")))
    assert "since nobody collected them" in str(failed.value.__cause__)


def test_a_source_that_is_not_there_ends_the_plan(engine, tmp_path):
    sensor = PoseSensor(CONFIG, f"file:{tmp_path}/none.bin", name="sensor")
    with pytest.raises(FailedStatus) as failed:
        engine(bp.count([sensor]))
    assert "none.bin" in str(failed.value.__cause__)
    with pytest.raises(InputError, match=r"acquire\.port"):
        PoseSensor(CONFIG)


def test_a_flight_takes_the_samples_of_a_publication(engine, documents):
    by_arrival = replace(CONFIG, acquire=replace(CONFIG.acquire, timing="arrival"))
    pipeline, data = Pipeline(by_arrival), kills.stream(500)
    with Publications(["zmq://127.0.0.1:0"], CONFIG, patient=True) as publications:
        sensor = PoseSensor(CONFIG, publications.places()[0], name="sensor")

        def during():
            for batch in pipeline.take(data[SIZE:], time.monotonic() + 100.0):
                publications.add_poses(pipeline.solve(batch))
            yield from bps.null()

        # staging waits for a first sample, and the flight for those after it
        publications.add_poses(pipeline.feed(data[:SIZE], time.monotonic()))
        engine(flight(sensor, Interval(samples=400), during))
    assert documents.flown("seq") == list(range(1, 401))
    assert set(documents.flown("status")) == {LABELS[0]}


@pytest.mark.slow
def test_a_plan_flies_on_the_virtual_bench(engine, documents, tmp_path):
    with Program("emulate", "bench", "--motion", "wobble", "--rate", "1000",
                 cwd=tmp_path) as bench:  # fmt: skip
        bench.await_output("running")
        sensor = PoseSensor(CONFIG, str(tmp_path / "bench" / "board"), name="sensor")
        engine(flight(sensor, Interval(samples=300)))
    assert len(documents.flown("seq")) == 300
    assert set(documents.flown("status")) == {"converged"}
    assert np.max(np.abs(documents.flown("tz_mm"))) < 2.0
