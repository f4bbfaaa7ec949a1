"""The page's own process: who is let in, what they are told, and that nobody keeps it waiting."""

from __future__ import annotations

import asyncio
import json
import socket
import struct
from types import SimpleNamespace

import numpy as np
import pytest
import zmq
from facets.experiments.studies import kills
from programs import GUARD, await_true
from streams import BENCH, page_rows

from facets import InputError
from facets.live import Live, Pipeline, Publications, ReplayPage, WebPage, stage, status_of
from facets.tracking import Encoder

pytestmark = pytest.mark.installed

aiohttp = pytest.importorskip("aiohttp")
#: Before bins: their level, whether those told before are void, their width (s), and their number.
HEAD = struct.Struct("<IIdII")


class Told:
    """What a page was told: hello, bins by level and number, the newest news, the end."""

    def __init__(self):
        self.hello = self.news = self.end = None
        self.bins = [{}, {}]
        self.events = []

    def take(self, message):
        if message.type == aiohttp.WSMsgType.TEXT:
            words = json.loads(message.data, parse_constant=pytest.fail)  # NaN is no JSON
            setattr(self, words["type"], words)
            self.events += words.get("events", [])
        elif message.type == aiohttp.WSMsgType.BINARY:
            level, void, _, count, _ = HEAD.unpack_from(message.data)
            if void:
                self.bins[level].clear()
            numbers = np.frombuffer(message.data, "<i4", count, HEAD.size)
            table = np.frombuffer(message.data, "<f4", -1, HEAD.size + 4 * count)
            table = table.reshape(count, len(self.hello["columns"]))
            self.bins[level].update(zip(numbers.tolist(), table, strict=True))

    def has_sample(self, number):
        return self.news and (self.news["sample"] or {}).get("seq") == number


async def follow(page, until):
    """Reads as a page does, until something is so of what was told or the server ends it."""
    told = Told()
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f"{page.url}stream", max_msg_size=0) as line,
    ):
        async for message in line:
            told.take(message)
            if until(told):
                break
    return told


def watched(page, until):
    return asyncio.run(asyncio.wait_for(follow(page, until), GUARD))


def await_pages(page, count):
    """Wait until so many pages are there."""
    await_true(lambda: page.outlet.hear() or page.counts()["receivers"] == count, "the pages")


def watch_the_end(page, count):
    """What pages that are open are told until the run has ended."""

    async def watch():
        tasks = [asyncio.create_task(follow(page, lambda told: told.end)) for _ in range(count)]
        await asyncio.to_thread(await_pages, page, count)
        await asyncio.to_thread(page.outlet.close)
        return await asyncio.wait_for(asyncio.gather(*tasks), GUARD)

    return asyncio.run(watch())


def answer(page, path, **headers):
    """Status, text and headers of a request; a header Host as it is given."""

    async def ask():
        async with (
            aiohttp.ClientSession() as session,
            session.get(f"{page.address}{path}", headers=headers, allow_redirects=False) as got,
        ):
            return got.status, await got.text(), got.headers

    return asyncio.run(asyncio.wait_for(ask(), GUARD))


def begin(web="0"):
    live, outlet = Live(Pipeline(BENCH)), Publications([], BENCH).outlet
    try:
        return WebPage(
            outlet, BENCH, web, lambda: status_of(live), {"kind": "acquire"}, drawn={}
        )  # fmt: skip
    except InputError:
        outlet.close()
        raise


@pytest.fixture(autouse=True)
def unhurried(monkeypatch):
    """No test fails since a machine is slow."""
    monkeypatch.setattr("facets.live.streams.outlet.END_TIMEOUT_S", GUARD)


@pytest.fixture
def page():
    page = begin()
    yield page
    page.outlet.close()


@pytest.fixture(scope="module")
def still():
    """A page that nobody sends any samples to."""
    page = begin()
    yield page
    page.outlet.close()


@pytest.mark.parametrize("text", ["", "x", "::1:80", "80:", "65536", "٣"])
def test_what_is_no_address_is_refused(text):
    with pytest.raises(InputError, match="is not an address"):
        begin(text)


def test_the_guard_lets_in_who_has_the_address_and_nobody_else(still):
    port, token = still.port, still.url.rstrip("/").rpartition("/")[2]

    def complaint(host, token=token, **headers):
        status, text, _ = answer(still, f"/{token}/", Host=host, **headers)
        assert (status == 200) == text.startswith("<!doctype html>")
        return "" if status == 200 else text

    for name in ("127.0.0.1", "LOCALHOST", "[::1]"):
        host = f"{name}:{port}"
        assert complaint(host) == complaint(host, Origin=f"http://{host}") == ""
        assert "token" in complaint(host, token.swapcase())
        for origin in ("http://elsewhere.example", "null"):
            assert "another page" in complaint(host, Origin=origin)
    for host in (f"elsewhere.example:{port}", f"127.0.0.1:{port + 1}", "127.0.0.1", "[", "::x"):
        assert "name" in complaint(host)


def test_only_the_whole_address_is_answered(still):
    token = still.url.rstrip("/").rpartition("/")[2]
    _, text, headers = answer(still, f"/{token}/")
    assert "<title>facets" in text
    assert headers["Cache-Control"] == "no-store"
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    for path, status in {
        f"/{token}": 302,
        f"/{token}/nothing.js": 404,
        f"/{token}/%2e%2e/%2e%2e/page.py": 403,
        "/": 403,
        "/x/page.js": 403,
        "/x/stream": 403,
        f"/{token}x/stream": 403,
    }.items():
        assert answer(still, path)[0] == status, path
    assert answer(still, f"/{token}/stream", Origin="http://elsewhere.example")[0] == 403


def is_bound(page, host):
    with socket.socket() as line:
        return line.connect_ex((host, page.port)) == 0


def test_another_address_is_bound_only_when_asked_for_and_with_a_warning(still):
    assert still.address == f"http://127.0.0.1:{still.port}"
    assert still.is_local
    assert not is_bound(still, "127.0.0.2")
    wide = begin("0.0.0.0:0")
    try:
        assert is_bound(wide, "127.0.0.2")
        assert not wide.is_local
        assert any(text.startswith("warning:") for text in wide.greeting())
        path = wide.url.removeprefix(wide.address)
        for name, status in (("192.0.2.7", 200), (socket.gethostname(), 200), ("a.example", 403)):
            assert answer(wide, path, Host=f"{name}:{wide.port}")[0] == status
    finally:
        wide.outlet.close()


def test_pages_are_told_every_sample_in_bins_the_newest_in_full_and_the_end(page):
    rows = page_rows(3_000)
    rows["status"][5] = 3
    rows["tx_mm"][5] = np.nan
    for part in np.array_split(rows, 30):
        page.outlet.send(part)
    page.outlet.refresh()
    told = watched(page, lambda told: told.has_sample(2_999) and told.news["status"])
    newest = told.news["sample"]
    assert newest["state"][0] == rows["tx_mm"][-1]
    assert newest["utc"] == rows["utc_s"][-1]
    assert newest["pose"]
    for level, last in zip(told.bins, (299, 2_999), strict=True):
        samples, poses = np.array(list(level.values()))[:, :2].sum(axis=0)
        assert (samples, poses, max(level)) == (3_000, 2_999, last)
    status = told.news["status"]
    unknown = [item for item in status["counts"] + status["clock"] if item["value"] is None]
    assert {item["name"] for item in unknown} == {"latency p99", "board's clock", "u(time)"}
    assert all(item["why"] for item in unknown)
    assert not status["stage"]["there"]
    page.outlet.send(page_rows(500, first=3_000))
    for told in watch_the_end(page, 2):  # they came later, and are told all that was
        assert sum(row[0] for row in told.bins[0].values()) == 3_500
        assert told.news["sample"]["seq"] == 3_499
        assert told.end["good"]
        assert told.end["reason"] == told.events[-1]["text"] == "The run has ended."
    assert page.counts()["sent"] == 3_500


@pytest.mark.slow
def test_a_page_that_takes_nothing_costs_nobody_else_anything(page):
    """It holds 4 MB that it was sent, in bins, and does not read them."""
    for first in range(0, 12_000, 1_000):
        page.outlet.send(page_rows(1_000, first, rate_hz=100.0))
    path = page.url.removeprefix(page.address)
    with socket.socket() as hung:
        hung.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_096)
        hung.connect(("127.0.0.1", page.port))
        hung.sendall(
            f"GET {path}stream HTTP/1.1\r\nHost: 127.0.0.1:{page.port}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n".encode()
        )
        assert hung.recv(12) == b"HTTP/1.1 101"
        await_pages(page, 1)
        for first in range(12_000, 15_000, 100):
            page.outlet.send(page_rows(100, first, rate_hz=100.0))
        told = watched(page, lambda told: told.has_sample(14_999))
        assert sum(row[0] for row in told.bins[1].values()) == 15_000
        page.outlet.close()
    assert page.counts()["dropped"] == 0
    assert not page.trouble


def test_a_port_in_use_is_said_before_anything_is_recorded(still, tmp_path, run_in_process):
    words = ("acquire", "bench", "--port", "nothing", "--folder", "rec", "--web", still.port)
    status, _, err = run_in_process(*words)
    assert status == 2
    assert f"--web 127.0.0.1:{still.port}: Address already in use" in err
    assert not (tmp_path / "rec").exists()


def test_a_page_is_told_messages_as_events_unsolved_samples_and_a_run_that_breaks_off(page):
    """A message is an event when it begins and when it ends, whatever its numbers."""
    behind, light = "the loop is {} s behind", "light is lost"
    for texts in ([], [behind.format(0.3)], [behind.format(1.7), light], [light]):
        page.outlet.send_status({"messages": texts})
    page.outlet.send_status({"messages": [light], "events": {"samples lost": 7}})
    rows = page_rows(10)  # samples without times or poses break nothing
    rows["host_s"] = rows["utc_s"] = rows["tx_mm"] = np.nan
    rows["status"] = 66
    page.outlet.send(rows)
    told = watched(page, lambda told: told.has_sample(9) and len(told.events) == 4)
    assert [(event["what"], event["text"][:9]) for event in told.events] == [
        ("begins", "the loop "), ("begins", "light is "), ("ends", "the loop "), ("", "samples l"),
    ]  # fmt: skip
    newest = told.news["sample"]
    assert newest["state"][0] is newest["t"] is newest["utc"] is None
    assert newest["status"] == "saturated"
    page.outlet.context.destroy(0)  # nothing is said of an end, as where the program is killed
    told = watched(page, lambda told: told.end)
    assert not told.end["good"]
    page.process.wait(GUARD)


def test_the_stage_is_told_with_its_target_and_what_is_left():
    encoder = Encoder(1.0, np.array([1.0, -2.0]), np.zeros(2))
    envelope = SimpleNamespace(encoder=encoder, sent=(1.0, np.array([1.25, -2.0])), latched="")
    tracker = SimpleNamespace(envelope=envelope, state="following", moves=7)
    words = stage(tracker, None)
    assert (words["place"], words["target"]) == ([1.0, -2.0], [1.25, -2.0])
    assert words["error"] == [-0.25, 0.0]
    assert words["state"] == "following"
    envelope.sent = None
    words = stage(tracker, None)
    assert words["target"] is words["error"] is None
    assert words["why"]


def test_the_pages_button_resumes_and_nothing_else_that_a_page_says_does(still):
    pressed = []
    still.resume = lambda: pressed.append(True)

    async def say(*texts):
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"{still.url}stream") as line,
        ):
            for text in texts:
                await line.send_str(text)
            await asyncio.to_thread(
                await_true, lambda: still.outlet.hear() or pressed, "the button's word"
            )

    asyncio.run(asyncio.wait_for(say("go", '{"resume": true}', "Resume", "resume"), GUARD))
    assert pressed == [True]
    assert still.trouble == ""


def test_nothing_that_a_subscriber_says_resumes_the_stage_and_nothing_secret_is_published():
    pressed, heard = [], []
    context = zmq.Context()
    with (
        Publications(["zmq://127.0.0.1:0"], BENCH) as publications,
        context.socket(zmq.XSUB) as spy,
    ):
        outlet = publications.outlet
        more = {"kind": "acquire"}
        page = WebPage(outlet, BENCH, "0", lambda: {"messages": []}, more, drawn={"x.js": "drawn"})
        page.resume = lambda: pressed.append(True)
        spy.connect(outlet.places[0].replace("zmq", "tcp"))
        spy.send(b"\1")  # every topic
        outlet.send(page_rows(10))  # nobody can have lost more than was published
        words = b'{"resume": true}'
        for token in (b"", b"0" * 32, b"*", page.url.encode()):
            spy.send(b"from " + token + b" " + words)
        for said in (b"resume", words, b"status" + words, b"from", b"lost 7"):
            spy.send(said)
        await_true(lambda: outlet.hear() or outlet.missed == 7, "the last word")
        outlet.send(page_rows(10))
        outlet.refresh()
        await_pages(page, 0)
        page.outlet.close()
        while spy.poll(1_000):
            heard += spy.recv_multipart()
    context.term()
    assert pressed == []
    assert {b"samples", b"status", b"end"} <= set(heard)
    for secret in (page.token, page.url.split("/")[-2].encode(), b"drawn"):
        assert secret not in b"".join(heard)


def test_what_happened_in_a_recorded_run_is_told_at_its_time(tmp_path):
    (tmp_path / "events.jsonl").write_text(
        """\
{"monotonic": 5.0, "utc": 1.0, "event": "behind", "seconds": 0.3}
{"monotonic": 6.0, "event": "move", "x": 1}
[]
no JSON
{"event": "without a time"}
{"monotonic": 7.5, "event": "caught up"}
{"monotonic": 8.0, "eve"""
    )
    pipeline = Pipeline(BENCH)
    poses = pipeline.feed(kills.stream(3), 5.0)
    with ReplayPage(pipeline, tmp_path, "0", {}) as replay:
        assert list(replay.following([poses])) == [poses]
        told = watched(replay.page, lambda told: told.events)
    assert [event["text"] for event in told.events] == ["behind: seconds 0.3", "caught up"]
    times = [event["t"] + poses.host[0] for event in told.events]
    assert times == pytest.approx([5.0, 7.5])
