"""The rig's page at the widths of a telephone, a tablet and a screen; its accessibility, its size.

Pictures of whole pages depend on fonts and on how a processor draws, so boxes are compared instead:
nothing is cut, nothing lies over anything, and the parts are arranged as meant. What the model
draws by itself is compared with a coarse reference.
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from browser import CHROMIUM, Browser

import facets
from facets.pictures.page.rig_page import rig_page

needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
PAPER = facets.Sensor()
STATE = np.array([0.08, 0.05, 0.5, 0.003, 0.004, 0.006, 0.0, 0.0])
#: A table with a long name that has no pose, own readings that have none, a state whose numbers are
#: all long, and a part's card.
FILL = r"""(async () => {
  const table = "tx_mm,ty_mm,tz_mm,roll_mrad,pitch_mrad,yaw_mrad\n-0.1234567,0,0,1,1,1\n,,,,,";
  await page.take([new File([table], "a-recording-with-quite-a-long-name-of-its-own.csv")]);
  const put = (id, value) => {
    const one = document.getElementById(id);
    one.value = value;
    one.dispatchEvent(new Event("input"));
  };
  put("at", 1);
  put("own-text", "0 0 0 0 0 0 0 0 0");
  page.moveTo([-0.12345678, -0.09876543, -1.1234567, -0.0123, 0.0123456, -0.0098765, -0.01, 0.01]);
  page.card.open("A");
})()"""
#: Texts that are cut, and parts past the page's edge.
CUT = """(() => {
  const {clientWidth: wide, scrollWidth} = document.documentElement;
  const found = scrollWidth > wide ? [`the page: ${scrollWidth}`] : [];
  for (const one of document.querySelectorAll("body *")) {
    const box = one.getBoundingClientRect(), style = getComputedStyle(one);
    if (!box.width || one.closest(".label")) continue;
    const name = `${one.tagName} ${one.id} ${one.textContent.trim().slice(0, 40)}`;
    if (box.right > wide + 1 || box.left < -1) found.push(`past the edge: ${name}`);
    const holds = one.tagName === "INPUT" || style.overflowX !== "visible" || !one.children.length;
    const isCut = style.display !== "inline" && one.scrollWidth > one.clientWidth + 1;
    if (holds && isCut) found.push(`cut: ${name}`);
  }
  return found;
})()"""
#: Pairs of texts and controls that lie over each other, outside of the rig's view.
OVER = """(() => {
  const own = "button, input, select, textarea, td, th, dt, dd, canvas, h1, h2, label, p, li";
  const boxes = [...document.querySelectorAll(own)].filter((one) =>
    one.getBoundingClientRect().width && !one.closest("#view, #card")
    && (one.children.length === 0 || one.matches("button, td, th")));
  const name = (one) => `${one.tagName} ${one.id} ${one.textContent.slice(0, 20)}`;
  const found = [];
  boxes.forEach((one, n) => boxes.slice(n + 1).forEach((other) => {
    if (one.contains(other) || other.contains(one)) return;
    const [a, b] = [one.getBoundingClientRect(), other.getBoundingClientRect()];
    const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (wide > 1.5 && high > 1.5) found.push(`${name(one)} / ${name(other)}`);
  }));
  return found;
})()"""
#: How far the detectors' corners are from the middle of the view, in halves of its width and of
#: its height; the ends of the middle that buttons and hints leave free, in halves of the height.
SEEN = """(() => {
  page.scene.draw();
  const box = (id) => document.querySelector(id).getBoundingClientRect();
  const view = box("#view"), y = (at) => 1 - 2 * (at - view.top) / view.height;
  const over = ["#hint", "#modes"].map((id) => box(id).top).filter((top) => y(top) < 0);
  return {
    free: [y(Math.min(...over)), y(box(".looks").bottom)],
    corners: RIG.detectors.flatMap(({centre, axes, half}) => [0, 1, 2, 3].map((corner) => {
      const [a, b] = [corner & 1 ? 1 : -1, corner & 2 ? 1 : -1];
      const at = centre.map((x, n) => x + a * half[0] * axes[1][n] + b * half[1] * axes[2][n]);
      const {x, y} = new THREE.Vector3(...at).project(page.scene.camera);
      return [x, y];
    })),
  };
})()"""
BOX = """["view", "faces", "state", "readings", "panels"].map((id) => {
  const box = document.getElementById(id).getBoundingClientRect();
  return [box.left, box.top];
})"""
#: The mean brightness of 8 x 8 parts of the flat pictures, by rows.
FLAT = """["point", "face-a", "face-b", "face-c"].map((id) => {
  const small = Object.assign(document.createElement("canvas"), {width: 8, height: 8});
  const pen = small.getContext("2d");
  pen.fillStyle = "#fff";
  pen.fillRect(0, 0, 8, 8);
  pen.imageSmoothingQuality = "high";
  pen.drawImage(document.getElementById(id), 0, 0, 8, 8);
  const {data} = pen.getImageData(0, 0, 8, 8);
  return Array.from({length: 64}, (_, n) => (data[4 * n] + data[4 * n + 1] + data[4 * n + 2]) / 3);
})"""
#: As these pictures were when they were looked at; a failing test prints those that it found.
REFERENCE = [
    [
        "fff8ebe7e7ecf6fff8e9d6cecdd4e7f8eddbbda3a0b5daeddec49b73719fcce4",
        "e5ca9b6f6e9dcce3edd9b99c9bb0d9ecf8e9d6cbcbd7e3f6fff7eae6e6ecebe1",
    ],
    [
        "f4f2f3f0eff2f2f4f2edd3edf1f3f3f2edd4c9e2f1f4f3f2f0e3dfe8eff2f1ef",
        "f1f0f0ece7f1f1f1f2f3f4f0eff3f3f2f2f3f3f1f2f3f3f2f0e9e9eff1f2f2f4",
    ],
    [
        "f4f2f2f1eff2f2f4f2f3f3f1f1f3f3f2f2f3f4f0dff3f3f2f1f2f1ecedf1f1ef",
        "f1edeeedeff2f1f1f0c6aae8f1f4f3f2efe5dbe5f1f3f3f2f4eae7eeefe9e9f0",
    ],
    [
        "f4f2f3f0eff2f2f4f2e6c0eaf1f3f3f2ecc0addaf1f4f3f2f0ded8e7ebe8f1ef",
        "f1f0f0efefe4f1f1f2f3f4f2f2f4f3f2f2f3f3f1f2f3f3f2f0e9e9eff1f2f2f4",
    ],
]


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "rig.html"
    path.write_text(rig_page(PAPER, "paper", STATE), "utf-8")
    return f"file://{path}"


@contextmanager
def opened(address):
    """The page once its scripts have run; nothing may stand on its console in the end."""
    with Browser(address) as browser:
        browser.await_true("document.readyState === 'complete' && page.point.scale > 0")
        yield browser
        assert not browser.errors


@needs_browser
@pytest.mark.slow
@pytest.mark.parametrize("fill", ["", FILL])
def test_nothing_is_cut_or_covered_at_any_width(address, fill):
    with opened(address) as browser:
        browser.ask(fill)
        for width, height in ((360, 740), (768, 1024), (1024, 768), (1200, 800), (1440, 900)):
            browser.resize(width, height)
            browser.ask("new Promise((done) => setTimeout(done, 300))")
            assert browser.ask(CUT) == [], width
            assert browser.ask(OVER) == [], width
            view, faces, state, readings, panels = browser.ask(BOX)
            assert view[1] < faces[1] < panels[1]
            if width > 1080:  # numbers beside the view
                assert state[0] > view[0]
                assert readings[0] == state[0]
            else:  # below it; beside each other where there is room
                assert min(state[1], readings[1]) > faces[1]
                assert (state[1] == readings[1]) == (width > 680)


@needs_browser
@pytest.mark.slow
@pytest.mark.parametrize("low", [False, True])
def test_the_view_of_the_rig_shows_every_detector(low, tmp_path):
    """Of a small rig whose detectors stand low, too, and in a tall view."""
    psds = tuple(replace(psd, radius=60.0, height=-3.0) for psd in PAPER.psds)
    sensor = replace(PAPER, psds=psds) if low else PAPER
    path = tmp_path / "rig.html"
    path.write_text(rig_page(sensor, "rig", STATE), "utf-8")
    with Browser(f"file://{path}", webgl=True) as browser:
        browser.await_true("page.scene && page.scene.drawn")
        for width, height in ((360, 740), (360, 1500), (768, 1024), (1440, 900)):
            browser.resize(width, height)
            browser.ask("new Promise((done) => setTimeout(done, 300))")
            found = browser.ask(SEEN)
            x, y = np.array(found["corners"]).T
            assert np.abs(x).max() < 1, width
            assert found["free"][0] < y.min(), width
            assert y.max() < found["free"][1], width
        assert not browser.errors


@needs_browser
@pytest.mark.slow
def test_fingers_have_room_on_a_telephone(address):
    with opened(address) as browser:
        browser.send("Emulation.setTouchEmulationEnabled", maxTouchPoints=1, enabled=True)
        browser.send(
            "Emulation.setDeviceMetricsOverride",
            width=360, height=740, deviceScaleFactor=2, mobile=True,
        )  # fmt: skip
        browser.await_true("matchMedia('(pointer: coarse)').matches")
        heights = browser.ask(
            "[...document.querySelectorAll('button, select, input:not([type=checkbox])')].map("
            "(one) => one.getBoundingClientRect()).filter((box) => box.width).map("
            "(box) => box.height)"
        )
        assert min(heights) >= 40
        assert browser.ask(CUT) == []


@needs_browser
@pytest.mark.slow
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing_against_wcag(address, theme):
    with opened(f"{address}?theme={theme}") as browser:
        browser.ask(FILL)
        for help_open in ("close", "showModal"):
            browser.ask(f"document.getElementById('help').{help_open}()")
            assert browser.find_barriers() == []


@needs_browser
@pytest.mark.slow
def test_the_flat_pictures_are_as_they_were(address):
    """In parts of a dozen pixels, so that fonts and edges do not count."""
    reference = np.array([list(bytes.fromhex("".join(one))) for one in REFERENCE])
    with opened(f"{address}?theme=light") as browser:
        browser.resize(1440, 900)
        found = np.array(browser.ask(FLAT))
    told = [np.round(one).astype(np.uint8).tobytes().hex() for one in found]
    assert np.abs(found - reference).max() < 20, told
    assert np.abs(found - reference).mean() < 3, told


def test_the_page_is_smaller_than_two_megabytes():
    assert len(rig_page(PAPER, "paper", STATE).encode()) < 2_000_000
