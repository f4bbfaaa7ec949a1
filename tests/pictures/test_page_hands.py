"""The rig's page in a browser, as a person's hands use it: pointer, fingers and keys."""

from __future__ import annotations

import time

import numpy as np
import pytest
from browser import CHROMIUM, Browser

import facets
from facets.core import STATE_COLUMNS
from facets.optics import rotation
from facets.pictures.page.rig_page import components, rig_page

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium"),
]
PAPER = facets.Sensor()
ENDS = np.array([one["end"] * one["factor"] for one in components(PAPER)])
SHIFT = 8  # the modifier's bit in the browser's protocol


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "rig.html"
    path.write_text(rig_page(PAPER, "paper", np.zeros(8)), "utf-8")
    return f"file://{path}"


@pytest.fixture(scope="module")
def spatial(address):
    """The page with WebGL; its messages are looked at after the last test."""
    with Browser(address, webgl=True) as browser:
        browser.await_true("page.scene && page.scene.drawn")
        yield browser
        assert not browser.errors


@pytest.fixture(scope="module")
def flat(address):
    with Browser(address) as browser:
        browser.await_true("page.state()")
        yield browser
        assert not browser.errors


def state(browser):
    return np.array(browser.ask("page.state()"))


def begin(browser, view="mirror", at=(0.0,) * 8):
    browser.ask(f"page.moveTo({np.array(at).tolist()})")
    browser.ask(f"page.card.close(); page.scene.look('{view}', false)")
    left, top, wide, high = browser.ask(
        "(() => { const r = document.querySelector('#rig canvas').getBoundingClientRect();"
        " return [r.left, r.top, r.width, r.height]; })()"
    )
    return np.array([left + wide / 2, top + high / 2]), high / 2


def sides(browser):
    """The picture's directions to the right and up, from where the camera is and looks."""
    camera, target = map(
        np.array,
        browser.ask(
            "[page.scene.camera.position, page.scene.controls.target].map((v) => v.toArray())"
        ),
    )
    ahead = (target - camera) / np.linalg.norm(target - camera)
    right = np.cross(ahead, [0, 0, 1])
    right /= np.linalg.norm(right)
    return right, np.cross(right, ahead)


def test_a_drag_moves_the_mirror_in_the_plane_of_the_picture(spatial):
    middle, half = begin(spatial)
    right, up = sides(spatial)
    spatial.drag(tuple(middle), tuple(np.add(middle, (60, -30))))
    wanted = (60 * right + 30 * up) / half * ENDS[0]
    assert state(spatial)[:3] == pytest.approx(wanted, abs=1e-5)
    assert not state(spatial)[3:].any()


def test_a_drag_with_shift_turns_the_mirror_as_the_pointer_goes(spatial):
    """Exactly, also one that is turned already, by Rodrigues' formula."""
    first = np.array([0, 0, 0, 4e-3, -3e-3, 5e-3, 0, 0])
    middle, half = begin(spatial, at=first)
    right, up = sides(spatial)
    spatial.drag(tuple(middle), tuple(np.add(middle, (80, 40))), modifiers=SHIFT)
    vector = (80 * up + 40 * right) / half * ENDS[3]
    angle = np.linalg.norm(vector)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    found = state(spatial)
    assert np.abs(np.array(rotation(*found[3:6])) - turn @ rotation(*first[3:6])).max() < 2e-6
    assert not found[:3].any()


def test_a_drag_beside_the_mirror_or_in_the_mode_view_turns_the_camera(spatial):
    for view, place in (("rig", [-300, 40]), ("mirror", [0, 0])):
        middle, _ = begin(spatial, view)
        spatial.ask(
            f"document.querySelector('[data-mode={'move' if place[0] else 'view'}]').click()"
        )
        before = sides(spatial)
        spatial.drag(tuple(middle + place), tuple(middle + place + [50, 0]))
        assert not state(spatial).any()
        assert np.abs(np.subtract(sides(spatial), before)).max() > 0.01
    spatial.ask("document.querySelector('[data-mode=move]').click()")


def test_a_finger_drags_the_mirror(spatial):
    (x, y), _ = begin(spatial)
    for kind, points in (("Start", [x]), ("Move", [x + 20]), ("Move", [x + 40]), ("End", [])):
        spatial.send(
            "Input.dispatchTouchEvent",
            type=f"touch{kind}",
            touchPoints=[{"x": at, "y": y} for at in points],
        )
    assert np.linalg.norm(state(spatial)[:3]) > 0.01 * ENDS[0]


def test_a_click_on_a_part_shows_its_name_and_numbers(spatial):
    """Also where the button is held for long, as on a computer that draws slowly."""
    middle, _ = begin(spatial, "A", [0, 0, 0, 0, 0, 3e-3, 0, 0])
    spatial.press("mousePressed", *middle, button="left", clickCount=1)
    time.sleep(0.6)
    spatial.press("mouseReleased", *middle, button="left", clickCount=1)
    text = spatial.ask("document.getElementById('card').innerText")
    psi = facets.readings(PAPER, state(spatial))[0]
    assert "Detector A" in text
    assert "250 mm" in text
    assert f"{psi:.4f}".rstrip("0") + " mm" in text
    spatial.ask("document.querySelector('[data-part=mirror]').click()")
    assert "0 mrad, 0 mrad, 3 mrad" in spatial.ask("document.getElementById('card').innerText")
    spatial.key("Escape")
    assert spatial.ask("document.getElementById('card').hidden")


def test_who_prefers_less_motion_sees_none(spatial):
    features = [{"name": "prefers-reduced-motion", "value": "reduce"}]
    spatial.send("Emulation.setEmulatedMedia", features=features)
    begin(spatial, "rig")
    spatial.ask("document.querySelector('[data-look=A]').click()")
    there = "page.scene.controls.target.toArray()"
    assert spatial.ask(there) == pytest.approx([250, 0, 0], abs=1e-6)
    spatial.send("Emulation.setEmulatedMedia", features=[])


def test_a_picture_is_saved(spatial, tmp_path):
    spatial.send("Page.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    begin(spatial, "rig")
    spatial.key("p")
    wide, colours = spatial.ask(
        "(() => { const c = page.picture(), pen = c.getContext('2d');"
        " const d = pen.getImageData(0, 0, c.width, 700).data;"
        " return [c.width, new Set(new Uint32Array(d.buffer)).size]; })()"
    )
    assert wide == 1600
    assert colours > 1000  # the rig is in it
    path = tmp_path / "paper.png"
    for _ in range(200):
        if path.exists():
            break
        spatial.ask("new Promise((done) => setTimeout(done, 50))")
    assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_keys_do_all_that_hands_do(flat):
    flat.ask("page.moveTo(new Array(8).fill(0)); document.getElementById('rig').focus()")
    steps = ENDS / 50
    for key in ("ArrowRight", "ArrowUp", "PageDown"):
        flat.key(key)
    flat.key("ArrowUp", modifiers=SHIFT)
    flat.key("t")
    flat.key("ArrowLeft")
    wanted = [steps[0], 1.1 * steps[1], -steps[2], -steps[3], 0, 0, 0, 0]
    assert state(flat) == pytest.approx(wanted, rel=1e-5)
    flat.key("m")
    flat.key("l")
    theme = flat.ask("document.documentElement.dataset.theme")
    flat.ask("document.getElementById('text').focus()")
    flat.key("l")  # a letter that is typed
    assert flat.ask("document.documentElement.dataset.theme") == theme
    flat.ask("document.activeElement.blur()")
    flat.key("r")
    assert not state(flat).any()
    flat.key("?")
    assert flat.ask("document.getElementById('help').open")
    assert "arrow" in flat.ask("document.getElementById('help').innerText").lower()
    flat.ask("document.getElementById('letters').click(); document.getElementById('help').close()")
    flat.key("l")
    assert flat.ask("document.documentElement.dataset.theme") == theme
    flat.ask("document.getElementById('letters').click()")


def test_without_webgl_the_mirror_is_dragged_under_the_beam(flat):
    """To scale: by as many mm as the picture says."""
    flat.ask("page.moveTo(new Array(8).fill(0)); document.getElementById('point').scrollIntoView()")
    x, y = flat.ask(
        "(() => { const r = document.getElementById('point').getBoundingClientRect();"
        " return [r.left + r.width / 2, r.top + r.height / 2]; })()"
    )
    scale = flat.ask("page.point.scale")
    flat.drag((x, y), (x + 20, y + 10))
    assert state(flat)[:2] == pytest.approx([20 / scale, -10 / scale], rel=1e-4)
    shown = flat.ask("document.getElementById('text').value")
    assert [part.split("=")[0] for part in shown.split(",")] == list(STATE_COLUMNS[:2])


def test_numbers_are_written_as_a_person_writes_them(flat):
    written = flat.ask(
        "[Digits.fixed(-6.2e-17, 4, 1e-9), Digits.fixed(-0.25, 2), Digits.fixed(6.2e-17, 4),"
        " Digits.short(12.5), Digits.short(-1e-12), Digits.short(100), Digits.signed(-1e-9, 3),"
        " Digits.signed(-1.5, 1), Digits.three(-0.00012345), Digits.grouped(-1234567),"
        " Digits.fine(2.5e-3, 'mm')]"
    )
    assert written == [
        "0.0000", "\u22120.25", "6.2 \u00d7 10⁻¹⁷", "12.5", "0", "100", "0.000", "\u22121.5",
        "\u22121.23 \u00d7 10⁻⁴", "\u22121\u202f234\u202f567", "2.50 µm",
    ]  # fmt: skip
