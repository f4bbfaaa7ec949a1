"""Samples for other programs: all of them arrive, and none of the record waits for them."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager, suppress
from dataclasses import replace

import numpy as np
import pytest
from facets.experiments.studies import kills
from programs import GUARD, await_true
from streams import BENCH, CALIBRATED, subscribe

from facets import InputError
from facets.core import AuxiliaryChannel
from facets.files import join_columns
from facets.live import (
    SAMPLE,
    Pipeline,
    Publications,
    Subscription,
    recorded_columns,
    rows_of,
)

#: Maximum number of messages that are heard at once, as the outlet has it.
MAX_HEARD = 100
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
    """Samples that have nothing but their numbers."""
    rows = np.zeros(count, SAMPLE)
    rows["seq"] = first + np.arange(count)
    return rows


def await_count(publications, true, what):
    """Wait until something is so of what became of the samples, address by address."""
    await_true(lambda: true(*publications.counts()), what)


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


def test_json_says_what_the_rows_say():
    """Each sample has a `timestamp`, as PlotJuggler takes it. What is not known is left out."""
    parts = solved(60)
    rows = np.concatenate([rows_of(part, 5.0) for part in parts])
    with datagram_socket() as (line, port):
        address = f"udp://127.0.0.1:{port}"
        with Publications([address], CONFIG, True, utc_offset=5.0) as publications:
            for part in parts:
                publications.add_poses(part)
        datagrams = receive_all(line)
    samples = [json.loads(data, parse_constant=pytest.fail) for data in datagrams]  # no NaN
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
        both = subscribe(publications, 2)
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
    (counts,) = publications.counts()
    assert (counts["sent"], counts["dropped"]) == (30_000, 0)
    about = subscription.about
    assert about["config_sha256"] == CONFIG.sha256
    assert about["statuses"]["0"] == "converged"
    assert about["channels"][0]["delay_us"] == pytest.approx(250.0)
    units = {"tx_mm": "mm", "u_noise_yaw_mrad": "mrad", "force_n": "N"}
    assert units.items() <= about["units"].items()


def test_a_slow_subscriber_loses_samples_alone_and_tells_how_many():
    """Beyond 1,000 messages at each end, and what the system keeps between the two."""
    with Publications(["zmq://127.0.0.1:0"], BENCH) as publications:
        outlet, sent = publications.outlet, 0
        outlet.send(numbered(100))
        (counts,) = publications.counts()
        assert counts["dropped"] == 100  # nobody was there
        outlet.take(b"lost 99999999999999")  # more than was published
        slow, quick = subscribe(publications, 2)
        with slow, quick:
            slow_rows, quick_rows = iter(slow), iter(quick)
            while not slow.lost:
                for _ in range(100):
                    outlet.send(numbered(100, sent))
                    sent += 100
                for _ in range(100):
                    assert len(next(quick_rows)) == 100
                    if sent > 300_000:
                        next(slow_rows)
            assert quick.lost == 0
            lost = 200 + slow.lost
            await_count(publications, lambda counts: counts["dropped"] == lost, "the loss")


#: A subscriber that reads nothing, and says words without end, if it is given any.
STRANGE = """
import sys, zmq
endpoint, words = sys.argv[1:]
socket = zmq.Context().socket(zmq.XSUB)
socket.connect(endpoint)
socket.send(b"\\1samples")
while words:
    socket.send(words.encode())
sys.stdin.read()
"""


@pytest.mark.parametrize("words", ["", "lost 1", "from nobody {}", "x" * 10_000])
def test_a_subscriber_that_reads_nothing_or_talks_without_end_costs_nobody_else_samples(words):
    """Nor is more heard of it at once than the loop has time for."""
    with Publications(["zmq://127.0.0.1:0"], BENCH) as publications:
        outlet = publications.outlet
        endpoint = outlet.places[0].replace("zmq", "tcp")
        command = [sys.executable, "-c", STRANGE, endpoint, words]
        with subprocess.Popen(command, stdin=subprocess.PIPE) as strange:
            await_true(lambda: outlet.hear() or outlet.receivers, "the strange subscriber")
            if not words:
                strange.send_signal(signal.SIGSTOP)
            (quick,) = subscribe(publications)
            with quick:
                rows, before = iter(quick), outlet.missed
                for first in range(0, 150_000, 100):
                    outlet.send(numbered(100, first))
                    assert len(next(rows)) == 100
                assert quick.lost == 0
                assert outlet.missed - before <= 1_500 * MAX_HEARD
            strange.kill()
    (counts,) = publications.counts()
    assert counts["sent"] == 150_000


def test_an_address_where_nobody_publishes_and_one_in_use_are_told():
    with socket.create_server(("127.0.0.1", 0)) as other:
        taken = f"zmq://127.0.0.1:{other.getsockname()[1]}"
        for address in (taken, "zmq://127.0.0.1:9"):
            with pytest.raises(InputError, match=f"{address}: no program publishes samples there"):
                Subscription(address, timeout=0.1)
        with pytest.raises(InputError, match=f"--publish {taken}: Address already in use"):
            Publications(["udp://127.0.0.1:9", taken], BENCH)


def test_a_process_that_takes_nothing_costs_itself_samples_and_nobody_else(monkeypatch):
    """What it has missed is known when it goes on, and at the end of the run."""
    monkeypatch.setattr("facets.live.streams.outlet.END_TIMEOUT_S", 0.5)
    with datagram_socket() as (_, port):
        address = f"udp://127.0.0.1:{port}"
        publications = Publications([address] * 3, BENCH)
        stuck, late, _ = publications.outlet.relays
        for one in (stuck, late):
            one.process.send_signal(signal.SIGSTOP)
        for first in range(0, 2_500, 500):
            for number in range(first, first + 500):  # each call returns, whatever they do
                publications.outlet.send(numbered(1, number))
            sent = publications.outlet.count
            await_count(publications, lambda *counts, n=sent: counts[2]["sent"] == n, "all to go")
        late.process.send_signal(signal.SIGCONT)
        send_one = lambda: publications.outlet.send(numbered(1))  # noqa: E731
        # the number of the next sample that finds a place tells how many did not
        await_true(lambda: send_one() or publications.counts()[1]["dropped"], "what was missed")
        publications.close()
    counts = publications.counts()
    assert all(all_known(one, publications.outlet.count) for one in counts)
    assert counts[0]["sent"] < counts[1]["sent"] < counts[2]["sent"]
    assert counts[2]["dropped"] == 0
    assert publications.messages() == [
        f"{address}: publishing has ended: its receiver accepts no more data"
    ]


def all_known(counts, count):
    return counts["sent"] + counts["dropped"] == count


def test_samples_that_nobody_takes_are_counted():
    with datagram_socket() as (_, port):
        address = f"udp://127.0.0.1:{port}"
    with Publications([address], BENCH) as publications:
        publications.outlet.send(numbered(2_000))
    (counts,) = publications.counts()
    assert all_known(counts, 2_000)
    assert counts["dropped"] > 500  # of a socket that was refused, the next send says so


def test_a_process_that_dies_is_told_and_the_run_does_not_wait_for_it():
    with datagram_socket() as (_, port):
        address = f"udp://127.0.0.1:{port}"
        publications = Publications([address, "zmq://127.0.0.1:0"], BENCH)
        publications.outlet.relays[0].process.kill()
        await_true(publications.messages, "the news")
        with subscribe(publications)[0] as subscription:
            publications.outlet.send(numbered(100))
            publications.close()
            assert sum(map(len, subscription)) == 100
    assert publications.messages() == [f"{address}: publishing has ended: its process has ended"]
    assert [one["dropped"] for one in publications.counts()] == [0, 100]


def test_no_process_and_no_file_survive_a_run_that_is_killed(tmp_path):
    """Nor does a subscriber wait for the run."""
    pytest.importorskip("aiohttp")
    with datagram_socket() as (_, port):
        command = [sys.executable, "-c", RUN, f"udp://127.0.0.1:{port}"]
        places = os.environ | {"TMPDIR": str(tmp_path)}
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=places) as run:
            place, *processes = run.stdout.readline().split()
            with Subscription(place) as subscription:
                run.kill()
                assert list(subscription) == []
    assert len(processes) == 2
    await_true(lambda: not any(map(is_running, processes)), "the ends of the run's processes")
    assert list(tmp_path.glob("facets-*")) == []


RUN = """
import sys
import facets
from facets.live import Publications, WebPage

config = facets.load("bench")
publications = Publications(["zmq://127.0.0.1:0", *sys.argv[1:]], config)
WebPage(publications.outlet, config, "0", dict, {"kind": "acquire"}, drawn={})
print(publications.places()[0], *(one.process.pid for one in publications.outlet.relays))
sys.stdout.flush()
while True:
    publications.outlet.hear(100)
"""


def is_running(number):
    """Whether there is a process of this number that has not ended."""
    with suppress(ProcessLookupError):
        os.kill(int(number), 0)
        return True
    return False


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


def test_an_acquisition_publishes_to_its_end(tmp_path, run_in_process):
    (tmp_path / "board.bin").write_bytes(kills.stream(60))
    acquire = ("acquire", "bench", "--port", "file:board.bin", "--plain", "--folder")
    with datagram_socket() as (line, port):
        address = f"udp://127.0.0.1:{port}"
        status, out, err = run_in_process(*acquire, "rec", "--publish", address)
        samples = sorted(map(json.loads, receive_all(line)), key=lambda sample: sample["seq"])
    assert status == 0, err
    assert f"{address}: 60 samples published, 0 dropped" in out
    assert [sample["seq"] for sample in samples] == list(range(60))
    status, _, err = run_in_process(*acquire, "other", "--publish", "x")
    assert status == 2
    assert "--publish x: is not an address" in err
    assert not (tmp_path / "other").exists()
