"""Samples for other programs: all of them arrive, and none of the record waits for them."""

from __future__ import annotations

import json
import signal
import socket
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import chain

import numpy as np
import pytest
from facets.experiments.studies import kills
from programs import GUARD, await_true
from streams import CALIBRATED

from facets import InputError
from facets.core import AuxiliaryChannel
from facets.live import (
    SAMPLE,
    Pipeline,
    Publication,
    Publications,
    Subscription,
    join_columns,
    recorded_columns,
    rows_of,
)

FORCE = AuxiliaryChannel("force", "N", delay=250e-6)
#: Of a calibrated sensor with an auxiliary channel, whose samples have more columns.
CONFIG = replace(CALIBRATED, acquire=replace(CALIBRATED.acquire, channels=(FORCE,)))


def solved(count):
    """Poses of a stream, one block after the other; every tenth sample has no light."""
    pipeline, data = Pipeline(CALIBRATED), kills.stream(count)
    parts = []
    for n in range(0, len(data), 6400):
        for batch in pipeline.take(data[n : n + 6400], 1_000.0 + n * 1e-6):
            batch.readings[::10] = np.nan
            part = pipeline.solve(batch)
            parts.append(replace(part, channels={"force_n": 0.5 * part.seq}))
    return parts


def numbered(count, first=0):
    """The bytes of samples, which have nothing but their numbers."""
    rows = np.zeros(count, SAMPLE)
    rows["seq"] = first + np.arange(count)
    return rows.tobytes()


@contextmanager
def datagram_socket():
    """A socket for datagrams, and its port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        line.bind(("127.0.0.1", 0))
        line.setblocking(False)
        yield line, line.getsockname()[1]


def receive_all(line):
    """The datagrams that wait at a socket."""
    datagrams = []
    with suppress(BlockingIOError):
        while True:
            datagrams.append(line.recv(65_536))
    return datagrams


@pytest.mark.parametrize(("option", "size"), [("", 8192), ("?bytes=4000", 4000), ("?single", 2500)])
def test_json_says_what_the_rows_say(option, size):
    """In arrays of samples with a `timestamp`, as PlotJuggler takes them, or one by one. What is
    not known is left out."""
    parts = solved(60)
    rows = np.concatenate([rows_of(part, 5.0) for part in parts])
    with datagram_socket() as (line, port):
        address = f"udp://127.0.0.1:{port}{option}"
        with Publications([address], CONFIG, True, utc_offset=5.0) as publications:
            for part in parts:
                publications.add_poses(part)
        datagrams = receive_all(line)
    assert max(map(len, datagrams)) <= size
    texts = [json.loads(data, parse_constant=pytest.fail) for data in datagrams]  # NaN is no JSON
    samples = texts if option == "?single" else list(chain(*texts))
    assert len(texts) > 1
    for sample, row in zip(samples, rows, strict=True):
        assert sample["seq"] == row["seq"]
        assert sample["timestamp"] == pytest.approx(row["utc_s"], rel=0, abs=1e-6)
        for group, name in {
            "reading": "psi_a_mm",
            "pose": "yaw_mrad",
            "u": "u_tx_mm",
            "u_noise": "u_noise_tz_mm",
            "u_calibration": "u_calibration_tz_mm",
            "channels": "force_n",
        }.items():
            value = sample[group].get(name, np.nan)
            assert value == pytest.approx(row[name], rel=1e-8, nan_ok=True)


def test_two_local_subscribers_get_every_sample_with_all_columns_of_the_recording():
    parts = solved(3_000)
    came = [[], []]
    with Publications(["zmq://127.0.0.1:0"], CONFIG, True, utc_offset=5.0) as publications:
        (publication,) = publications.all
        both = [Subscription(*publications.places()) for _ in came]
        await_true(lambda: publication.receivers == 2, "both subscribers")
        readers = [
            threading.Thread(target=rows.extend, args=(subscription,))
            for rows, subscription in zip(came, both, strict=True)
        ]
        for reader in readers:
            reader.start()
        for part in 10 * parts:
            publications.add_poses(part)
    columns = join_columns(list(map(recorded_columns, parts)))
    for reader, subscription, lots in zip(readers, both, came, strict=True):
        reader.join()
        rows = np.concatenate(lots)
        assert (len(rows), rows.dtype) == (30_000, subscription.dtype)
        for name, column in columns.items():
            np.testing.assert_array_equal(rows[name], np.tile(column, 10))
        np.testing.assert_array_equal(rows["utc_s"], rows["host_s"] + 5.0)
        assert subscription.lost == 0
        subscription.close()
    assert (publication.sent, publication.dropped_count) == (30_000, 0)
    about = subscription.about
    assert about["config_sha256"] == CONFIG.sha256
    assert about["statuses"]["0"] == "converged"
    assert about["channels"][0]["delay_us"] == pytest.approx(250.0)
    units = {"tx_mm": "mm", "u_noise_yaw_mrad": "mrad", "force_n": "N"}
    assert units.items() <= about["units"].items()


def test_a_slow_subscriber_loses_samples_alone_and_tells_how_many():
    """Beyond 1,000 messages at each end, and what the system keeps between the two."""
    publication, sent = Publication("zmq://127.0.0.1:0", {}), 0
    publication.send(numbered(100))
    await_true(lambda: publication.dropped_count == 100, "that nobody was there")
    address = f"zmq://127.0.0.1:{publication.port}"
    with Subscription(address) as slow, Subscription(address) as quick:
        await_true(lambda: publication.receivers == 2, "both subscribers")
        slow_rows, quick_rows = iter(slow), iter(quick)
        while not slow.lost:
            for _ in range(100):
                publication.send(numbered(100, sent))
                sent += 100
            for _ in range(100):
                assert len(next(quick_rows)) == 100
                if sent > 300_000:
                    next(slow_rows)
        assert quick.lost == 0
        await_true(lambda: publication.dropped_count == 100 + slow.lost, "the loss")
    publication.close()


def test_an_address_where_nobody_publishes_and_one_in_use_are_told():
    with socket.create_server(("127.0.0.1", 0)) as other:
        taken = f"zmq://127.0.0.1:{other.getsockname()[1]}"
        for address in (taken, "zmq://127.0.0.1:9"):
            with pytest.raises(InputError, match="no program publishes samples there"):
                Subscription(address, timeout=0.1)
        with pytest.raises(InputError, match="in use"):
            Publication(taken, {})


@pytest.mark.slow
def test_a_receiver_that_takes_nothing_costs_itself_samples_and_nobody_else(monkeypatch):
    monkeypatch.setattr("facets.live.streams.publication.MAX_WAITING_BYTES", 2_000_000)
    monkeypatch.setattr("facets.live.streams.publication.END_TIMEOUT_S", 0.2)
    parts = solved(2_000)
    with datagram_socket() as (_, port):
        publications = Publications(["zmq://127.0.0.1:0", f"udp://127.0.0.1:{port}"], CONFIG)
        stuck, free = publications.all
        stuck.process.send_signal(signal.SIGSTOP)
        while not stuck.dropped_count:  # each call returns, whatever the process does
            for part in parts:
                publications.add_poses(part)
            await_true(lambda: free.sent + free.dropped_count == free.given, "all to go")
        publications.close()
    assert stuck.sent + stuck.dropped_count == stuck.given
    assert (free.sent, free.dropped_count) == (free.given, 0)
    assert stuck.sent < free.sent


def test_samples_that_nobody_takes_are_counted():
    with datagram_socket() as (_, port):
        address = f"udp://127.0.0.1:{port}"
    publication = Publication(address, {})
    publication.send(numbered(2_000))
    publication.close()
    assert publication.sent + publication.dropped_count == publication.given == 2_000
    assert publication.dropped_count > 500  # of a socket that was refused, the next send says so


def test_a_process_that_dies_is_told_and_neither_run_nor_subscriber_waits_for_it():
    publication, data = Publication("zmq://127.0.0.1:0", {}), numbered(100)
    with Subscription(f"zmq://127.0.0.1:{publication.port}") as subscription:
        publication.process.kill()
        assert list(subscription) == []
    publication.process.wait()
    publication.send(data)
    await_true(lambda: publication.trouble, "the news")
    publication.send(data)
    publication.close()
    assert publication.dropped_count == 200
    assert "its process has ended" in publication.trouble


@pytest.mark.parametrize(
    "address", ["udp://", "udp://here", "zmq://h:x", "http://h:1", "x", "udp://h:1?bytes=x", "lsl"]
)
def test_an_address_that_is_none_is_refused(address):
    with pytest.raises(InputError, match="give zmq://HOST:PORT, udp"):
        Publications([address], CONFIG)


@pytest.mark.slow
def test_an_inlet_of_the_lab_streaming_layer_gets_every_sample(tmp_path, monkeypatch):
    try:
        import pylsl
    except (ImportError, RuntimeError) as error:  # RuntimeError: without its library
        pytest.skip(f"no pylsl: {error}")
    setup = tmp_path / "lsl.cfg"
    setup.write_text("[multicast]\nResolveScope = machine\n[lab]\nKnownPeers = {127.0.0.1}\n")
    monkeypatch.setenv("LSLAPICFG", str(setup))
    parts, came, times = solved(1_000), [], []
    with Publications(["lsl:here"], CONFIG, True, utc_offset=0.0) as publications:
        streams = pylsl.resolve_byprop("source_id", f"facets-{CONFIG.sha256[:16]}", timeout=120)
        if not streams:
            pytest.skip("streams are not found on this machine: its network has no multicast")
        inlet = pylsl.StreamInlet(streams[0], max_buflen=60)
        inlet.open_stream()
        info = inlet.info(timeout=GUARD)
        names = info.get_channel_labels()
        for part in parts:
            publications.add_poses(part)
        while len(came) < 1_000:
            rows, at = inlet.pull_chunk(timeout=5.0)
            came += rows
            times += at
        inlet.close_stream()
    assert info.name() == "here"
    units = dict(zip(names, info.get_channel_units(), strict=True))
    assert (units["tx_mm"], units["force_n"]) == ("mm", "N")
    rows = np.concatenate([rows_of(part, 0.0) for part in parts])
    for name in ("seq", "yaw_mrad", "force_n"):
        values = np.array(came)[:, names.index(name)]
        np.testing.assert_array_equal(values, rows[name].astype(float))
    np.testing.assert_allclose(np.diff(times), np.diff(rows["host_s"]), atol=1e-6)


def test_an_acquisition_and_a_replay_publish_to_their_end(tmp_path, run_in_process):
    (tmp_path / "board.bin").write_bytes(kills.stream(60))
    acquire = ("acquire", "bench", "--port", "file:board.bin", "--plain", "--folder")
    with datagram_socket() as (line, port):
        address = f"udp://127.0.0.1:{port}?single"
        status, out, err = run_in_process(*acquire, "rec", "--publish", address)
        samples = sorted(map(json.loads, receive_all(line)), key=lambda sample: sample["seq"])
    assert status == 0, err
    assert f"{address}: 60 samples published, 0 dropped" in out
    assert [sample["seq"] for sample in samples] == list(range(60))
    with socket.create_server(("127.0.0.1", 0)) as other:
        address = f"zmq://127.0.0.1:{other.getsockname()[1]}"

    def subscribe():
        with Subscription(address, timeout=GUARD) as subscription:
            return np.concatenate(list(subscription))

    with ThreadPoolExecutor() as pool:
        again = pool.submit(subscribe)
        status, _, err = run_in_process("replay", "rec", "--publish", address)
    assert status == 0
    assert f"publishing at {address}" in err
    for row, sample in zip(again.result(), samples, strict=True):
        assert row["tx_mm"] == pytest.approx(sample["pose"]["tx_mm"], abs=1e-8)
        assert row["utc_s"] == pytest.approx(sample["timestamp"], abs=1e-3)
    status, _, err = run_in_process(*acquire, "other", "--publish", "x")
    assert status == 2
    assert "--publish x: is not an address" in err
    assert not (tmp_path / "other").exists()
