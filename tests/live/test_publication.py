"""Samples for other programs: all of them arrive, and none of the record waits for them."""

from __future__ import annotations

import json
import signal
import socket
import threading
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest
from facets.experiments import kills
from programs import GUARD, await_true

import facets
from facets import InputError
from facets.core import AuxiliaryChannel
from facets.live import (
    CALIBRATED_SAMPLE,
    SAMPLE,
    Pipeline,
    Publication,
    Publications,
    Subscription,
    description,
    join_columns,
    pose_columns,
    rows_of,
)

CONFIG = facets.load("bench")


def solved(count, spoil=False):
    """Poses of a stream, one block after the other; every tenth without light, if so wanted."""
    pipeline, data = Pipeline(CONFIG), kills.stream(count)
    parts = []
    for n in range(0, len(data), 6400):
        for batch in pipeline.take(data[n : n + 6400], 1_000.0 + n * 1e-6):
            if spoil:
                batch.readings[::10] = np.nan
            parts.append(pipeline.solve(batch))
    return parts


class Udps:
    """A socket that keeps what comes to it."""

    def __init__(self):
        self.line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self.line.bind(("127.0.0.1", 0))
        self.line.settimeout(0.2)
        self.port = self.line.getsockname()[1]
        self.came, self.ending = [], threading.Event()
        self.thread = threading.Thread(target=self.listen)
        self.thread.start()

    def listen(self):
        while not self.ending.is_set():
            try:
                self.came.append(self.line.recv(65_536))
            except TimeoutError:
                continue

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.ending.set()
        self.thread.join()
        self.line.close()


def plotted(message):
    """What PlotJuggler's JSON parser makes of a message, by its rules: name -> (time, value).

    An array at the top is a batch. A member `timestamp` that is a number is the sample's time.
    Objects are followed, their keys joined by a slash; what is no number is passed over. What is no
    JSON, as NaN is not, stops its server.
    """

    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    def flatten(prefix, value):
        if isinstance(value, dict):
            for key, inner in value.items():
                yield from flatten(f"{prefix}/{key}", inner)
        elif isinstance(value, (int, float)):
            yield prefix, value

    whole = json.loads(message, parse_constant=refuse)
    found = []
    for one in whole if isinstance(whole, list) else [whole]:
        found += [(name, one["timestamp"], value) for name, value in flatten("", one)]
    return found


def test_rows_have_the_columns_of_the_recording():
    parts = solved(300, spoil=True)
    rows = np.concatenate([rows_of(part, 5.0) for part in parts])
    columns = join_columns([pose_columns(part) for part in parts])
    assert SAMPLE.itemsize == 242
    for name, column in columns.items():
        np.testing.assert_array_equal(rows[name], column)
    np.testing.assert_array_equal(rows["utc_s"], columns["host_s"] + 5.0)


def published(parts, config, *options):
    """The datagrams that come to sockets of these options, and how many samples were sent there."""
    with ExitStack() as closing:
        sockets = [closing.enter_context(Udps()) for _ in options]
        addresses = [
            f"udp://127.0.0.1:{one.port}{option}"
            for one, option in zip(sockets, options, strict=True)
        ]
        with Publications(addresses, config, True, utc_offset=5.0) as publications:
            for part in parts:
                publications.add_poses(part)
    return [(one.came, to.sent) for one, to in zip(sockets, publications.all, strict=True)]


def test_plotjuggler_takes_the_json_which_says_what_the_rows_say():
    parts = solved(100, spoil=True)
    rows = np.concatenate([rows_of(part, 5.0) for part in parts])
    known = np.isfinite(rows["yaw_mrad"])
    assert 0 < known.sum() < len(rows)
    batches, singles = published(parts, CONFIG, "", "?single")
    assert len(batches[0]) < len(rows) == len(singles[0])
    for (datagrams, count), most in ((batches, 8192), (singles, 2048)):
        assert count == len(rows)
        assert max(map(len, datagrams)) <= most
        found = [entry for data in datagrams for entry in plotted(data)]
        yaw = [(at, value) for name, at, value in found if name == "/pose/yaw_mrad"]
        np.testing.assert_allclose([at for at, _ in yaw], rows["utc_s"][known], rtol=0, atol=1e-6)
        np.testing.assert_allclose([v for _, v in yaw], rows["yaw_mrad"][known], rtol=1e-8)
        assert sum(name == "/seq" for name, _, _ in found) == len(rows)
    for data, row in zip(singles[0], rows, strict=True):
        words = json.loads(data)
        for group, name in (("reading", "psi_a_mm"), ("u", "u_tx_mm"), ("pose", "by_mm")):
            value = words[group].get(name, np.nan)  # what is not known is left out
            assert value == pytest.approx(row[name], rel=1e-8, nan_ok=True)


def test_a_calibrated_sensor_publishes_the_parts_of_its_uncertainty():
    """By ZeroMQ and in JSON."""
    known = facets.Calibration(("psd_a.height",), ((1e-6,),))
    config = replace(CONFIG, sensor=replace(CONFIG.sensor, calibration=known))
    pipeline = Pipeline(config)
    (part,) = (pipeline.solve(batch) for batch in pipeline.take(kills.stream(200), 1_000.0))
    columns, rows = pose_columns(part), rows_of(part, 5.0)
    assert rows.dtype == CALIBRATED_SAMPLE
    for name, column in columns.items():
        np.testing.assert_array_equal(rows[name], column)
    ((datagrams, _),) = published([part], config, "?single")
    words = json.loads(datagrams[0])
    for name in ("noise", "calibration"):
        key = f"u_{name}_tz_mm"
        assert words[f"u_{name}"][key] == pytest.approx(rows[key][0], rel=1e-8)
    with (
        Publications(["zmq://127.0.0.1:0"], config, True, utc_offset=5.0) as publications,
        Subscription(publications.places()[0]) as samples,
    ):
        publications.add_poses(part)
        came = next(iter(samples))
    np.testing.assert_array_equal(came, rows[: len(came)])
    assert samples.about["units"]["u_noise_yaw_mrad"] == "mrad"


def test_two_local_subscribers_get_every_sample_at_full_rate():
    parts = solved(3_000)
    came = [[], []]
    with Publications(["zmq://127.0.0.1:0"], CONFIG, True, utc_offset=0.0) as publications:
        (one,) = publications.all
        both = [Subscription(*publications.places()) for _ in came]
        await_true(lambda: one.receivers == 2, "both subscribers")
        for subscription in both:
            assert subscription.about["units"]["tx_mm"] == "mm"
            assert subscription.about["config_sha256"] == CONFIG.sha256
            assert subscription.about["statuses"]["0"] == "converged"
        readers = [
            threading.Thread(target=rows.extend, args=(subscription,))
            for rows, subscription in zip(came, both, strict=True)
        ]
        for reader in readers:
            reader.start()
        for _ in range(10):
            for part in parts:
                publications.add_poses(part)
    for reader, subscription in zip(readers, both, strict=True):
        reader.join()
        assert subscription.lost == 0
        subscription.close()
    expected = np.concatenate([rows_of(part, 0.0) for part in parts]).tobytes() * 10
    assert [np.concatenate(rows).tobytes() == expected for rows in came] == [True, True]
    assert (one.given, one.sent, one.dropped_count) == (30_000, 30_000, 0)


def numbered(first, count):
    rows = np.zeros(count, SAMPLE)
    rows["seq"] = first + np.arange(count)
    return rows


def test_a_slow_subscriber_loses_samples_alone_and_tells_how_many(monkeypatch):
    from facets.live.streams import zeromq

    monkeypatch.setattr(zeromq, "HIGH_WATER_MARK", 5)
    sender = zeromq.ZmqSender("zmq://127.0.0.1:0", description({}), 0.0)
    address, ended = f"zmq://127.0.0.1:{sender.port}", threading.Event()
    assert sender.send(numbered(0, 5)) == 0  # nobody was there

    def answer():
        while not ended.wait(0.01):
            assert sender.receivers >= 0

    thread = threading.Thread(target=answer)
    thread.start()
    try:
        with Subscription(address) as slow, Subscription(address) as quick:
            await_true(lambda: sender.receivers == 2, "both subscribers")
            slow_rows, quick_rows, first = iter(slow), iter(quick), 5
            for _ in range(200):  # 48 MB: more than the system keeps between the two
                assert sender.send(numbered(first, 1_000)) == 1_000
                assert next(quick_rows)["seq"][0] == first
                first += 1_000
            while not slow.lost:
                sender.send(numbered(first, 1_000))
                assert next(quick_rows)["seq"][0] == first
                first += 1_000
                next(slow_rows)
            assert quick.lost == 0
            await_true(lambda: sender.receivers and sender.missed_count == slow.lost, "the loss")
    finally:
        ended.set()
        thread.join()
        sender.close()


def test_nobody_publishes_there():
    with socket.create_server(("127.0.0.1", 0)) as other:
        for address in (f"zmq://127.0.0.1:{other.getsockname()[1]}", "zmq://127.0.0.1:9"):
            with pytest.raises(InputError, match="no program publishes samples there"):
                Subscription(address, timeout=0.1)


@pytest.mark.slow
def test_a_receiver_that_takes_nothing_costs_itself_samples_and_nobody_else(monkeypatch):
    monkeypatch.setattr("facets.live.streams.publication.MAX_WAITING_BYTES", 2_000_000)
    monkeypatch.setattr("facets.live.streams.publication.END_TIMEOUT_S", 0.2)
    parts = solved(2_000)
    with Udps() as other:
        publications = Publications(["zmq://127.0.0.1:0", f"udp://127.0.0.1:{other.port}"], CONFIG)
        stuck, free = publications.all
        stuck.process.send_signal(signal.SIGSTOP)
        while not stuck.dropped_count:  # each call returns, whatever the process does
            for part in parts:
                publications.add_poses(part)
            given = free.given
            await_true(lambda given=given: free.sent + free.dropped_count == given, "all to go")
        publications.close()
    assert stuck.sent + stuck.dropped_count == stuck.given
    assert sum(len(json.loads(data)) for data in other.came) <= free.sent
    assert (free.sent, free.dropped_count) == (free.given, 0)
    assert stuck.sent < free.sent


def test_nobody_there_is_counted():
    one = Publication(f"udp://127.0.0.1:{free_port(socket.SOCK_DGRAM)}", {})
    for part in solved(2_000):
        one.send(rows_of(part, 0.0).tobytes())
    one.close()
    assert one.given == 2_000
    assert one.sent + one.dropped_count == 2_000
    assert one.dropped_count > 500  # of a socket that was refused, the next send says so


def test_a_process_that_dies_is_told_and_nothing_waits_for_it():
    """Neither the run nor those that subscribed."""
    data = rows_of(solved(100)[0], 0.0).tobytes()
    with Publications(["zmq://127.0.0.1:0"], CONFIG) as publications:
        (one,) = publications.all
        with Subscription(*publications.places()) as subscription:
            one.process.kill()
            assert list(subscription) == []
        one.process.wait()
        one.send(data)
        await_true(lambda: one.trouble, "the news")
        one.send(data)
    assert one.dropped_count == one.given
    assert "its process has ended" in one.trouble


@pytest.mark.parametrize(
    "address", ["udp://", "udp://here", "zmq://h:x", "http://h:1", "x", "udp://h:1?bytes=x", "lsl"]
)
def test_an_address_that_is_none_is_refused(address):
    with pytest.raises(InputError, match="give zmq://HOST:PORT, udp"):
        Publications([address], CONFIG)


def test_a_port_that_is_taken_is_refused():
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(InputError, match="in use"):
            Publication(f"zmq://127.0.0.1:{port}", {})


@pytest.mark.slow
def test_an_inlet_of_the_lab_streaming_layer_gets_every_sample(tmp_path, monkeypatch):
    try:
        import pylsl
    except (ImportError, RuntimeError) as error:  # RuntimeError: without its library
        pytest.skip(f"no pylsl: {error}")
    setup = tmp_path / "lsl.cfg"
    setup.write_text("[multicast]\nResolveScope = machine\n[lab]\nKnownPeers = {127.0.0.1}\n")
    monkeypatch.setenv("LSLAPICFG", str(setup))
    parts = [replace(part, channels={"force_n": 0.5 * part.seq}) for part in solved(1_000)]
    channels = (AuxiliaryChannel("force", "N"),)
    config = replace(CONFIG, acquire=replace(CONFIG.acquire, channels=channels))
    with Publications(["lsl:here"], config, True, utc_offset=0.0) as publications:
        found = pylsl.resolve_byprop("source_id", f"facets-{CONFIG.sha256[:16]}", timeout=120)
        if not found:
            pytest.skip("streams are not found on this machine: its network has no multicast")
        inlet = pylsl.StreamInlet(found[0], max_buflen=60)
        inlet.open_stream()
        info = inlet.info(timeout=GUARD)
        channel, labels = info.desc().child("channels").child("channel"), []
        while not channel.empty():
            labels.append((channel.child_value("label"), channel.child_value("unit")))
            channel = channel.next_sibling()
        assert labels[0] == ("seq", "")
        assert ("tx_mm", "mm") in labels
        assert ("yaw_mrad", "mrad") in labels
        assert ("force_n", "N") in labels
        assert info.name() == "here"
        for part in parts:
            publications.add_poses(part)
        came, times = [], []
        while len(came) < 1_000:
            rows, at = inlet.pull_chunk(timeout=5.0)
            came += rows
            times += at
        inlet.close_stream()
    (one,) = publications.all
    assert (one.sent, one.dropped_count) == (1_000, 0)
    rows = np.concatenate([rows_of(part, 0.0) for part in parts])
    names = [name for name, _ in labels]
    np.testing.assert_array_equal(
        np.array(came)[:, names.index("yaw_mrad")], rows["yaw_mrad"].astype(float)
    )
    for name in ("seq", "force_n"):
        np.testing.assert_array_equal(np.array(came)[:, names.index(name)], rows[name])
    np.testing.assert_allclose(np.diff(times), np.diff(rows["host_s"]), atol=1e-6)


def free_port(kind=socket.SOCK_STREAM):
    with socket.socket(socket.AF_INET, kind) as line:
        line.bind(("127.0.0.1", 0))
        return line.getsockname()[1]


def test_an_acquisition_and_a_replay_publish(tmp_path, run_in_process):
    """Both to the end, with all that came."""
    (tmp_path / "board.bin").write_bytes(kills.stream(500))
    acquire = ("acquire", "bench", "--port", "file:board.bin", "--plain", "--folder")
    with Udps() as one:
        status, out, err = run_in_process(
            *acquire, "rec", "--publish", f"udp://127.0.0.1:{one.port}?single"
        )
    assert status == 0, err
    assert f"udp://127.0.0.1:{one.port}?single: 500 samples published, 0 dropped" in out
    rows = sorted((json.loads(data) for data in one.came), key=lambda row: row["seq"])
    assert [row["seq"] for row in rows] == list(range(500))
    address, again = f"zmq://127.0.0.1:{free_port()}", []

    def subscribe():
        with Subscription(address, timeout=GUARD) as subscription:
            again.extend(np.concatenate(list(subscription)))

    thread = threading.Thread(target=subscribe)
    thread.start()
    status, _, err = run_in_process("replay", "rec", "--publish", address)
    assert status == 0
    assert f"publishing at {address}" in err
    thread.join()
    tx, utc = ([row[name] for row in again] for name in ("tx_mm", "utc_s"))
    np.testing.assert_allclose(tx, [row["pose"]["tx_mm"] for row in rows], atol=1e-8)
    np.testing.assert_allclose(utc, [row["timestamp"] for row in rows], atol=1e-3)
    status, _, err = run_in_process(*acquire, "other", "--publish", "x")
    assert status == 2
    assert "--publish x: is not an address" in err
    assert not (tmp_path / "other").exists()
