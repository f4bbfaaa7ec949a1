"""The page's own process: who is let in, what they are told, and that nobody keeps it waiting."""

from __future__ import annotations

import asyncio
import json
import socket
import struct
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from facets.experiments import kills
from programs import GUARD, await_true

import facets
from facets import InputError
from facets.live import SAMPLE, Live, Pipeline, ReplayPage, WebPage, stage, status_of
from facets.tracking import Encoder

pytestmark = pytest.mark.installed

aiohttp = pytest.importorskip("aiohttp")
CONFIG = facets.load("bench")
#: Before bins: their level, whether those told before are void, their width (s), and their number.
HEAD = struct.Struct("<IIdII")


def rows_of(count, rate=1_000.0, first=0):
    """Samples with poses that tell their number."""
    rows = np.zeros(count, SAMPLE)
    for name in SAMPLE.names[6:]:
        rows[name] = 0.001
    rows["seq"] = first + np.arange(count)
    rows["host_s"] = 1_000.0 + rows["seq"] / rate
    rows["utc_s"] = 1.7e9 + rows["seq"] / rate
    rows["tx_mm"] = rows["seq"] * 1e-3
    return rows


def give(page, rows):
    """Samples, handed over at once, as the loop has it done when it comes round."""
    page.send(rows.tobytes())
    page.flush()


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


def answer(page, path, **headers):
    """Status, text and headers of a request; a header Host as it is given."""

    async def ask():
        async with (
            aiohttp.ClientSession() as session,
            session.get(f"{page.address}{path}", headers=headers, allow_redirects=False) as got,
        ):
            return got.status, await got.text(), got.headers

    return asyncio.run(asyncio.wait_for(ask(), GUARD))


def begun(web="0"):
    live = Live(Pipeline(CONFIG))
    page = WebPage(CONFIG, web, lambda: status_of(live), {"kind": "acquire"}, drawn={})
    page.live = live
    return page


@pytest.fixture(autouse=True)
def unhurried(monkeypatch):
    """No test fails since a machine is slow."""
    monkeypatch.setattr("facets.live.web.page.END_TIMEOUT_S", GUARD)


@pytest.fixture
def page():
    page = begun()
    yield page
    page.close()


@pytest.fixture(scope="module")
def still():
    """A page that nobody sends any samples to."""
    page = begun()
    yield page
    page.close()


@pytest.mark.parametrize("text", ["", "x", ":80", "::1:80", "1.2.3.4", "80:", "65536", "-1", "٣"])
def test_what_is_no_address_is_refused(text):
    with pytest.raises(InputError, match="is not an address"):
        begun(text)


def test_the_guard_lets_in_who_has_the_address_and_nobody_else(still):
    port, token = still.port, still.url.rstrip("/").rpartition("/")[2]

    def complaint(host, token=token, **headers):
        status, text, _ = answer(still, f"/{token}/", Host=host, **headers)
        assert (status == 200) == text.startswith("<!doctype html>")
        return "" if status == 200 else text

    for name in ("127.0.0.1", "localhost", "LOCALHOST", "[::1]"):
        host = f"{name}:{port}"
        assert complaint(host) == complaint(host, Origin=f"http://{host}") == ""
        assert "token" in complaint(host, f"{token[:-1]}_")
        assert "another page" in complaint(host, Origin="http://elsewhere.example")
        assert "another page" in complaint(host, Origin="null")
    for host in (f"elsewhere.example:{port}", f"127.0.0.1:{port + 1}", "127.0.0.1", "[", "::x"):
        assert "name" in complaint(host)


def test_only_the_whole_address_is_answered(still):
    token = still.url.rstrip("/").rpartition("/")[2]
    status, text, headers = answer(still, f"/{token}/")
    assert status == 200
    assert "<title>facets" in text
    assert headers["Cache-Control"] == "no-store"
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert answer(still, f"/{token}")[0] == 302
    assert answer(still, f"/{token}/nothing.js")[0] == 404
    assert answer(still, f"/{token}/../../../../etc/passwd")[0] in (403, 404)
    assert answer(still, f"/{token}/%2e%2e/%2e%2e/page.py")[0] in (403, 404)
    for path in ("/", "/x/", "/x/page.js", "/x/stream", f"/{token[:-1]}/", f"/{token}x/stream"):
        assert answer(still, path)[0] == 403, path
    assert answer(still, f"/{token}/stream", Origin="http://elsewhere.example")[0] == 403


def test_nothing_but_the_address_that_was_asked_for_is_bound(still):
    assert still.address.startswith("http://127.0.0.1:")
    assert still.local
    others = [
        entry[4][0]
        for entry in socket.getaddrinfo(socket.gethostname(), still.port, socket.AF_INET)
    ]
    for other in {address for address in others if not address.startswith("127.")}:
        with socket.socket() as line:
            assert line.connect_ex((other, still.port)) != 0


def test_another_address_is_bound_only_when_asked_for_and_with_a_warning():
    wide = begun("0.0.0.0:0")
    try:
        assert not wide.local
        assert any(text.startswith("warning:") for text in wide.greeting())
        path = wide.url.removeprefix(wide.address)
        for name, status in (("192.0.2.7", 200), (socket.gethostname(), 200), ("a.example", 403)):
            assert answer(wide, path, Host=f"{name}:{wide.port}")[0] == status
    finally:
        wide.close()


def test_a_page_is_told_every_sample_in_bins_and_the_newest_in_full(page):
    rows = rows_of(3_000)
    rows["status"][5] = 3
    rows["tx_mm"][5] = np.nan
    for part in np.array_split(rows, 30):
        give(page, part)
    page.show()
    told = watched(page, lambda told: told.has_sample(2_999))
    newest = told.news["sample"]
    assert newest["state"][0] == rows["tx_mm"][-1]
    assert newest["utc"] == rows["utc_s"][-1]
    assert newest["pose"]
    for level, width in zip(told.bins, (0.01, 0.001), strict=True):
        table = np.array([level[number] for number in sorted(level)])
        assert table[:, 0].sum() == 3_000
        assert table[:, 1].sum() == 2_999
        means = table[:, told.hello["columns"].index("mean_tx_mm")]
        np.testing.assert_allclose(
            np.nansum(means * table[:, 1]), np.nansum(rows["tx_mm"]), rtol=1e-6
        )
        assert max(level) == int(np.floor((rows["host_s"][-1] - rows["host_s"][0]) / width))
    assert told.news["status"]["stage"]["why"]
    give(page, rows_of(500, first=3_000))  # a page that comes later is told all that was
    later = watched(page, lambda told: told.has_sample(3_499))
    assert sum(bin[0] for bin in later.bins[0].values()) == 3_500


@pytest.mark.slow
def test_a_page_that_takes_nothing_costs_nobody_else_anything(page):
    """It holds 4 MB that it was sent, in bins, and does not read them."""
    for first in range(0, 12_000, 1_000):
        give(page, rows_of(1_000, rate=100.0, first=first))
    hung = socket.socket()
    hung.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_096)
    hung.connect(("127.0.0.1", page.port))
    path = page.url.removeprefix(page.address)
    hung.sendall(
        (
            f"GET {path}stream HTTP/1.1\r\nHost: 127.0.0.1:{page.port}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
        ).encode()
    )
    assert hung.recv(12) == b"HTTP/1.1 101"
    await_true(lambda: page.receivers == 1, "the hung page is there")
    for first in range(12_000, 15_000, 100):
        give(page, rows_of(100, rate=100.0, first=first))
    told = watched(page, lambda told: told.has_sample(14_999))
    assert sum(bin[0] for bin in told.bins[1].values()) == 15_000
    page.close()
    assert page.dropped_count == 0
    assert not page.trouble
    hung.close()


def test_the_end_is_said_to_every_page(page):
    give(page, rows_of(100))

    async def both():
        ended = [asyncio.create_task(follow(page, lambda told: told.end)) for _ in range(2)]
        await asyncio.to_thread(await_true, lambda: page.receivers == 2, "two pages")
        await asyncio.to_thread(page.close)
        return await asyncio.wait_for(asyncio.gather(*ended), GUARD)

    for told in asyncio.run(both()):
        assert told.end["good"]
        assert told.end["reason"] == "The run has ended."
        assert told.news["sample"]["seq"] == 99
        assert told.events[-1]["text"] == "The run has ended."
    assert page.sent == 100


@pytest.mark.slow
def test_a_process_that_dies_is_told_and_costs_the_run_nothing(page):
    page.process.kill()
    page.process.wait()
    for first in range(0, 10_000, 1_000):
        give(page, rows_of(1_000, first=first))
        page.show()
    await_true(lambda: page.trouble, "its end is noticed")
    page.close()
    assert page.dropped_count == 10_000


def test_a_port_in_use_is_said_before_anything_is_recorded(still, tmp_path, run_in_process):
    words = ("acquire", "bench", "--port", "nothing", "--folder", "rec", "--web")
    status, _, err = run_in_process(*words, still.port)
    assert status == 2
    assert f"--web 127.0.0.1:{still.port}: Address already in use" in err
    assert "Traceback" not in err
    assert not (tmp_path / "rec").exists()
    status, _, err = run_in_process(*words, "here")
    assert status == 2
    assert "--web here: is not an address" in err


def test_a_page_is_told_messages_as_events_unsolved_samples_and_a_run_that_breaks_off(page):
    """A message is an event when it begins and when it ends, whatever its numbers."""
    behind = "the loop is {} s behind"
    for texts in (
        [],
        [behind.format(0.3)],
        [behind.format(1.7), "light is lost"],
        ["light is lost"],
    ):
        page.tell({"messages": texts, "events": {"samples lost": 0}})
    page.tell({"messages": ["light is lost"], "events": {"samples lost": 7}})
    told = watched(page, lambda told: len(told.events) == 4)
    assert [(event["what"], event["text"][:9]) for event in told.events] == [
        ("begins", "the loop "), ("begins", "light is "), ("ends", "the loop "), ("", "samples l"),
    ]  # fmt: skip
    rows = rows_of(10)  # samples without times or poses break nothing
    rows["host_s"] = rows["utc_s"] = rows["tx_mm"] = np.nan
    rows["status"] = 66
    give(page, rows)
    newest = watched(page, lambda told: told.has_sample(9)).news["sample"]
    assert newest["state"][0] is newest["t"] is newest["utc"] is None
    assert newest["status"] == "saturated"

    async def break_off():
        task = asyncio.create_task(follow(page, lambda told: told.end))
        await asyncio.to_thread(await_true, lambda: page.receivers == 1, "a page")
        page.status = None  # nothing is said of an end, as where the program is killed
        await asyncio.to_thread(page.close)
        return await asyncio.wait_for(task, GUARD)

    assert not asyncio.run(break_off()).end["good"]


def test_what_is_not_known_has_a_reason(still):
    words = status_of(still.live)
    items = [*words["counts"], *words["clock"]]
    unknown = [one for one in items if one["value"] is None]
    assert {one["name"] for one in unknown} == {"latency p99", "board's clock", "u(time)"}
    assert all(one["why"] for one in unknown)
    assert words["stage"] == {"there": False, "why": "no stage is moved (--track moves one)"}
    json.dumps(words, allow_nan=False)


def test_the_stage_is_told_with_its_target_and_what_is_left():
    live = Live(Pipeline(CONFIG))
    encoder = Encoder(1.0, np.array([1.0, -2.0]), np.zeros(2))
    envelope = SimpleNamespace(encoder=encoder, sent=(1.0, np.array([1.25, -2.0])), latched="")
    live.tracker = SimpleNamespace(envelope=envelope, state="following", moves=7)
    words = stage(live.tracker, live)
    assert words["place"] == [1.0, -2.0]
    assert words["target"] == [1.25, -2.0]
    assert words["error"] == [-0.25, 0.0]
    assert (words["state"], words["moves"], words["chi"]) == ("following", 7, None)
    assert not words["stopped"]
    envelope.sent = None
    live.tracker.state = "no fresh sample"
    words = stage(live.tracker, live)
    assert words["target"] is words["error"] is None
    assert words["state"] == "no fresh sample"
    assert words["why"]


def test_the_pages_button_resumes_and_nothing_else_that_a_page_says_does(still):
    pressed = []
    still.resume = lambda: pressed.append(len(pressed))

    async def say(*texts, total):
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"{still.url}stream") as line,
        ):
            for text in texts:
                await line.send_str(text)
            while len(pressed) < total:
                await asyncio.sleep(0.01)

    others = ("go", '{"resume": true}', "Resume")
    asyncio.run(asyncio.wait_for(say(*others, "resume", total=1), GUARD))
    asyncio.run(asyncio.wait_for(say("resume", total=2), GUARD))
    assert pressed == [0, 1]
    assert still.trouble == ""


def test_what_happened_in_a_recorded_run_is_told_at_its_time(tmp_path):
    lines = [
        '{"monotonic": 5.0, "utc": 1.0, "event": "behind", "seconds": 0.3}',
        '{"monotonic": 6.0, "event": "move", "x": 1}',
        "[]", "no JSON", '{"event": "without a time"}',
        '{"monotonic": 7.5, "event": "caught up"}', '{"monotonic": 8.0, "eve',
    ]  # fmt: skip
    (tmp_path / "events.jsonl").write_text("\n".join(lines))
    known = facets.Calibration(("psd_a.height",), ((1e-6,),))
    pipeline = Pipeline(replace(CONFIG, sensor=replace(CONFIG.sensor, calibration=known)))
    poses = pipeline.feed(kills.stream(3), 5.0)
    with ReplayPage(pipeline, tmp_path, "0", {}) as replay:
        list(replay.following([poses]))
        told = watched(replay.page, lambda told: told.events)
    begin = poses.host[0]
    assert [event["text"] for event in told.events] == ["behind: seconds 0.3", "caught up"]
    assert [event["t"] for event in told.events] == pytest.approx([5.0 - begin, 7.5 - begin])
    parts = told.news["sample"]["parts"]  # of the uncertainty of a calibrated sensor
    assert parts["noise"][2] == poses.solution.noise_uncertainty[-1, 2]
    assert parts["calibration"][2] == poses.solution.calibration_uncertainty[-1, 2]
