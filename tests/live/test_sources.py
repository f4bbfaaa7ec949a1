"""What every source of bytes must do: ours, and one that another package brings."""

from __future__ import annotations

import socket
from importlib.metadata import EntryPoint

import pytest
from facets.experiments.studies import kills

from facets.live import SIZE, DatagramPort, PortError, PortInUse, check_source, open_port
from facets.live.sources import ports as module

DATA = kills.stream(200)


def test_a_file_is_a_port(tmp_path):
    (tmp_path / "bytes.bin").write_bytes(DATA)
    check_source(lambda: open_port(f"file:{tmp_path}/bytes.bin", 0), lambda _: None, DATA)


def test_datagrams_are_a_port():
    port = DatagramPort("udp://127.0.0.1:0")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.connect(port.line.getsockname())

        def send(data):
            for n in range(0, len(data), 20 * SIZE):
                line.send(data[n : n + 20 * SIZE])

        check_source(lambda: port, send, DATA)


def test_a_socket_is_a_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = open_port(f"socket://127.0.0.1:{server.getsockname()[1]}", 0)
        line, _ = server.accept()
        with line:
            check_source(lambda: port, line.sendall, DATA)


class Other(module.ClosedAtExit):
    """A source as another package would write it."""

    ended = False
    waits = True

    def __init__(self, name, baud):
        if name == "test:gone":
            raise PortError(f"{name}: is not plugged in")
        if name == "test:broken":
            raise RuntimeError("driver 7")
        self.data = DATA

    def read(self):
        part, self.data = self.data[:1000], self.data[1000:]
        self.ended = not part
        return part

    def close(self):
        pass


@pytest.fixture
def others(monkeypatch):
    """Entry points as two installed packages would have them."""
    sources = {"test": Other, "none": lambda name, baud: object()}

    def find(group, name):
        return [EntryPoint(name, f"{name}:open", group)] if name in sources else []

    monkeypatch.setattr(EntryPoint, "load", lambda self: sources[self.name])
    monkeypatch.setattr(module, "entry_points", find)


def test_another_packages_source_is_a_port(others):
    check_source(lambda: open_port("test:1", 0), lambda _: None, DATA)
    for name, words in (
        ("test:gone", "is not plugged in"),
        ("test:broken", "RuntimeError: driver 7"),
        ("none:1", "gives no port: it has no read, close, ended, waits"),
    ):
        with pytest.raises(PortError, match=words):
            open_port(name, 0)


def test_a_virtual_bench_is_no_port_of_a_run_on_the_hosts_clock():
    with pytest.raises(PortInUse, match=r"are opened by `facets acquire` and facets.live.Run"):
        open_port("virtual:wobble", 0)


@pytest.mark.parametrize("name", ["udp://:x", "udp://", "udp://256.1.1.1:5"])
def test_a_place_that_nobody_can_listen_at_is_told(name):
    with pytest.raises(PortError, match="udp://"):
        open_port(name, 0)
