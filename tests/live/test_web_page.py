"""The page in a browser, as a person uses it."""

from __future__ import annotations

import signal
from dataclasses import replace

import numpy as np
import pytest
from browser import CHROMIUM, Browser
from commands import command
from facets.experiments.studies import kills
from programs import Program, await_true
from streams import BENCH, page_rows

from facets.live import (
    FixedFrames,
    Live,
    Pipeline,
    Publications,
    WebPage,
    pack,
    recorded_poses,
    status_of,
)
from facets.pictures import page as drawing

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
STATES = ("tx_mm", "ty_mm", "tz_mm", "roll_mrad", "pitch_mrad", "yaw_mrad")
COUNT = 6_000
#: An auxiliary channel, of which each fifth value is missing.
FORCE = np.where(np.arange(COUNT) % 5, np.sin(np.arange(COUNT) / 300), np.nan).astype(np.float32)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The folder of a recording `rec` with channels, made with a page that nobody opened."""
    pytest.importorskip("aiohttp")
    folder = tmp_path_factory.mktemp("recorded")
    samples = FixedFrames().feed(kills.stream(COUNT))
    channels = np.stack([FORCE, np.full(COUNT, 21.5, np.float32)], axis=1)
    (folder / "board.bin").write_bytes(pack(replace(samples, channels=channels)))
    (folder / "own.yaml").write_text(
        "extends: bench\nacquire: {channels: [{name: force, unit: N, scale: 2}, "
        "{name: temperature, unit: degC}]}\n"
    )
    words = ("acquire", "own.yaml", "--port", "file:board.bin", "-d", "rec", "--web")
    result = command(*words, "--plain", cwd=folder)
    assert "the page is at http://127.0.0.1:" in result.stderr
    assert " samples published, " in result.stdout
    return folder


@pytest.fixture
def open_page():
    """Opens the page of a run, which is closed at the end of the test."""
    pytest.importorskip("aiohttp")
    pages = []

    def open_page(status=dict):
        scripts = drawing.scripts.rig_scripts(BENCH.sensor)
        outlet = Publications([], BENCH).outlet
        pages.append(WebPage(outlet, BENCH, "0", status, {"kind": "acquire"}, drawn=scripts))
        return pages[-1]

    yield open_page
    for page in pages:
        page.outlet.close()


def numbers(browser):
    """The numbers beside the strips, by component; None where there is none."""
    values = browser.ask(
        "Object.fromEntries([...document.querySelectorAll('.strip')].map((one) => "
        "[one.dataset.name, one.querySelector('.number').dataset.value]))"
    )
    return {name: float(value) if value else None for name, value in values.items()}


@pytest.mark.slow
def test_a_recording_on_the_page_is_that_of_the_record(recorded):
    poses = recorded_poses(recorded / "rec")
    last = np.argmax(poses["seq"])
    with Program("replay", "rec", "--web", "127.0.0.1:0", cwd=recorded) as replay:
        replay.await_output("the page stays at ")
        url = replay.stderr.partition("the page is at ")[2].split()[0]
        with Browser(url) as browser:
            browser.await_true("facets.run.status.finished && facets.run.sample")
            browser.await_true("document.querySelector('.number').dataset.value")
            shown = numbers(browser)
            for column in STATES:
                assert shown[column.partition("_")[0]] == poses[column][last]  # to the last bit
            assert browser.ask("document.body.dataset.state") == "ended"
            events = "document.getElementById('events').innerText"
            browser.await_true(f"{events}.includes('end: samples {COUNT}')")
            assert_means_are_those_of_the_record(browser, poses)
            for name, words in (("force", f"{2 * FORCE[-1]:.5g} N"), ("temperature", "21.5 degC")):
                strip = f"document.querySelector('[data-name={name}]')"
                assert words in browser.ask(f"{strip}.innerText")
            pause_zoom_and_follow(browser)
            assert all(address.split("/")[2] == url.split("/")[2] for address in browser.addresses)
            assert not browser.errors
            assert replay.end(signal.SIGINT) == 0
            browser.await_true("document.body.dataset.state === 'ended' && facets.run.end")
            assert "has ended" in browser.ask("document.getElementById('doubts').textContent")
            assert numbers(browser)["tx"] == poses["tx_mm"][last]  # it keeps the last data
            assert_nothing_is_cut_on_a_telephone_and_on_a_screen(browser)


def assert_means_are_those_of_the_record(browser, poses):
    view = browser.ask("facets.run.store.view(0, 1e9, 1e9)")
    assert sum(view["samples"]) == len(poses["seq"])
    for mean, most, name in zip(view["mean"], view["most"], STATES, strict=False):
        known = poses[name][poses["status"] == 0]
        total = np.nansum(np.array(mean, float) * view["poses"]) / sum(view["poses"])
        assert total == pytest.approx(known.mean(), abs=1e-6 * abs(known).max())
        assert np.nanmax(np.array(most, float)) == pytest.approx(known.max(), rel=1e-6)


def pause_zoom_and_follow(browser):
    """By the button, the mouse and the bar, as a person does."""
    browser.ask("document.getElementById('pause').click()")
    browser.await_true(
        "facets.look.paused && document.getElementById('pill').textContent.includes('paused')"
    )
    first, last = browser.ask("[facets.look.from, facets.look.to]")
    wide = last - first
    x, y, width = browser.ask(
        "(() => { const r = facets.strips.plots[2].u.over.getBoundingClientRect();"
        " return [r.left, r.top + r.height / 2, r.width]; })()"
    )
    browser.drag((x + 0.4 * width, y), (x + 0.6 * width, y))
    browser.await_true(f"facets.look.to - facets.look.from < {0.5 * wide}")
    begin, end = browser.ask("[facets.look.from, facets.look.to]")
    assert [begin, end] == pytest.approx([first + 0.4 * wide, first + 0.6 * wide], abs=0.03 * wide)
    browser.await_true(f"Math.abs(facets.strips.plots[0].u.scales.x.min - {begin}) < 1e-9")
    middle = (begin + end) / 2
    browser.ask(
        f"(() => {{ const at = document.getElementById('at'); at.value = {middle};"
        " at.dispatchEvent(new Event('input')); })()"
    )
    browser.await_true("document.getElementById('pose-status').textContent.includes('mean of')")
    shown = browser.ask("facets.run.store.at(facets.look.at)")
    assert abs(shown["t"] - middle) <= shown["width"]
    browser.await_true(
        f"document.querySelector('.number').dataset.value === String({shown['state'][0]!r})"
    )
    browser.ask("document.getElementById('pause').click()")
    browser.await_true("!facets.look.paused && facets.look.at === null")


#: What of the page's texts is cut, or reaches past the page's edge.
CUT = """
[...document.querySelectorAll('.head, .number, .u, .face p, .face h3, #when, dt, dd, #at-text')]
  .filter((one) => one.scrollWidth > one.clientWidth + 1
    || one.getBoundingClientRect().right > document.documentElement.clientWidth + 1)
  .map((one) => one.textContent)
"""
#: Whether the strips have the width of their place; and the longest unit that stands beside a pose.
FITTED = "facets.strips.plots.every(({ box, u }) => u.width === box.lastChild.clientWidth)"
UNITS = """
[...document.querySelectorAll('.scale')].slice(0, 6).forEach(
  (one) => { one.textContent = '\\u00b5rad from \\u22123.00012 mrad'; })
"""


def assert_nothing_is_cut_on_a_telephone_and_on_a_screen(browser):
    for width, height in ((360, 740), (768, 1024), (1440, 900)):
        browser.resize(width, height)
        browser.await_true(FITTED)
        browser.ask(UNITS)
        assert browser.ask("document.documentElement.scrollWidth") <= width
        assert browser.ask(CUT) == []


@pytest.mark.slow
def test_the_rig_is_drawn_where_there_is_webgl(open_page):
    page = open_page()
    page.outlet.send(page_rows(100))
    with Browser("about:blank", webgl=True) as browser:
        browser.resize(1440, 900, scale=0.25)
        browser.send("Page.navigate", url=page.url)
        browser.await_true("facets.scene.drawn")
        assert browser.ask("document.querySelectorAll('#scene canvas').length") == 1
        assert not browser.errors


def test_what_is_not_known_is_never_a_number_and_a_page_comes_back_by_itself(open_page):
    live = Live(Pipeline(BENCH))
    page = open_page(lambda: status_of(live))
    page.outlet.refresh()
    with Browser(page.url) as browser:
        browser.await_true("facets.run.status && document.getElementById('counts').children.length")
        text = browser.ask("document.body.innerText")
        assert "unknown: no sample is solved yet" in text
        assert "unknown: no stage is moved" in text
        assert set(numbers(browser).values()) == {None}
        page.outlet.send(page_rows(1_000))
        browser.await_true("facets.run.sample?.seq === 999")
        browser.await_true("document.querySelector('.number').dataset.value === '0.999'")
        spoilt = page_rows(10, 1_000)
        spoilt["status"], spoilt["flags"] = 66, 1
        for name in ("tx_mm", "power_b_mw", "psi_b_mm", "zeta_b_mm"):
            spoilt[name] = np.nan
        page.outlet.send(spoilt)
        browser.await_true("facets.run.sample?.seq === 1009")
        browser.await_true("document.querySelector('.strip .u').textContent === 'saturated'")
        assert set(numbers(browser).values()) == {None}
        trouble = "document.querySelector('.face[data-name=B]').dataset.trouble"
        assert browser.ask(trouble) == "saturated"
        browser.ask("facets.run.line.close()")
        page.outlet.send(page_rows(500, 1_010))
        browser.await_true("facets.run.connections === 2 && facets.run.sample.seq === 1509")
        samples = browser.ask("facets.run.store.view(0, 1e9, 1e9).samples.reduce((a, b) => a + b)")
        assert samples == 1_510
        browser.await_true("facets.scene.root.textContent.includes('no WebGL')")
        page.outlet.close()
        browser.await_true("document.body.dataset.state === 'ended'")
        assert "The run has ended." in browser.ask("document.body.innerText")
        assert not browser.errors
    await_true(lambda: page.process.poll() is not None, "its process ends")
    assert page.counts()["dropped"] == 0


@pytest.mark.slow
def test_a_stopped_stage_has_a_button_that_resumes_it(open_page):
    live, pressed = Live(Pipeline(BENCH)), []
    words = status_of(live) | {"messages": ["the stage is stopped, the recording goes on"]}
    stage = {"there": True, "state": "stopped: no pose", "stopped": "no pose", "moves": 3}
    page = open_page(lambda: words | {"stage": stage})
    page.resume = lambda: pressed.append(True)
    button = "document.getElementById('resume')"
    with Browser(page.url) as browser:
        page.outlet.refresh()
        browser.await_true(f"{button} && !{button}.hidden")
        browser.ask(f"{button}.click()")
        await_true(lambda: page.outlet.hear() or pressed, "the button's word")
        stage |= {"state": "following", "stopped": ""}
        words["messages"] = []
        page.outlet.status_due = 0.0
        page.outlet.refresh()
        browser.await_true(f"{button}.hidden")
        doubts = "document.getElementById('doubts').textContent"
        browser.await_true(f"{doubts} === 'No sample has come yet.'")
        assert not browser.errors
    assert pressed == [True]


@pytest.mark.slow
def test_axe_finds_nothing_against_wcag(open_page):
    page = open_page()
    page.outlet.send(page_rows(1_000))
    for theme in ("light", "dark"):
        with Browser(f"{page.url}?theme={theme}") as browser:
            browser.await_true("document.querySelector('.number').dataset.value")
            assert browser.find_barriers() == []
