"""The rig's page in a browser, as a person's hands use it: pointer, fingers and keys."""

import time

import numpy as np
import pytest
from browser import Browser
from programs import await_true

import facets
from facets.optics import rotation

pytestmark = pytest.mark.slow
SHIFT = 8  # the modifier's bit in the browser's protocol


@pytest.fixture(scope="module")
def spatial(address):
    """The page with WebGL, drawn coarsely; its messages are looked at after the last test."""
    with Browser("about:blank", webgl=True) as browser:
        browser.resize(1440, 900, scale=0.25)
        browser.send("Page.navigate", url=address)
        browser.await_true("page.scene && page.scene.drawn")
        yield browser
        assert not browser.errors


def state_of(browser):
    return np.array(browser.ask("page.state()"))


def ends_of(browser):
    """The ends of the sliders, mm and rad."""
    return browser.ask("PAGE.components.map(({end, factor}) => end * factor)")


def begin(browser, view="mirror", at=(0.0,) * 8):
    """Look at a state; return the middle of the view and half its height, pixels."""
    browser.ask(f"page.moveTo({np.array(at).tolist()})")
    browser.ask(f"page.card.close(); page.scene.look('{view}', false)")
    x, y, _, height = browser.box_of("#rig canvas")
    return np.array([x, y]), height / 2


def drag(browser, start, way, **more):
    browser.drag(tuple(start), tuple(np.add(start, way)), **more)


def sides(browser):
    """The picture's directions to the right and up, from where the camera is and looks."""
    camera, target = np.array(
        browser.ask(
            "[page.scene.camera.position, page.scene.controls.target].map((v) => v.toArray())"
        )
    )
    right = np.cross(target - camera, [0, 0, 1])
    upward = np.cross(right, target - camera)
    return right / np.linalg.norm(right), upward / np.linalg.norm(upward)


def test_a_drag_moves_the_mirror_in_the_plane_of_the_picture(spatial):
    middle, half = begin(spatial)
    right, up = sides(spatial)
    drag(spatial, middle, (60, -30))
    wanted = (60 * right + 30 * up) / half * ends_of(spatial)[0]
    assert state_of(spatial) == pytest.approx([*wanted, 0, 0, 0, 0, 0], abs=1e-5)


def test_a_drag_with_shift_turns_the_mirror_as_the_pointer_goes(spatial):
    """Exactly, also one that is turned already."""
    from scipy.spatial.transform import Rotation

    first = np.array([0, 0, 0, 4e-3, -3e-3, 5e-3, 0, 0])
    middle, half = begin(spatial, at=first)
    right, up = sides(spatial)
    drag(spatial, middle, (80, 40), modifiers=SHIFT)
    turn = Rotation.from_rotvec((80 * up + 40 * right) / half * ends_of(spatial)[3]).as_matrix()
    state = state_of(spatial)
    assert np.abs(np.array(rotation(*state[3:6])) - turn @ rotation(*first[3:6])).max() < 2e-6
    assert not state[:3].any()


@pytest.mark.parametrize(("view", "mode", "place"), [("rig", "move", -300), ("mirror", "view", 0)])
def test_a_drag_beside_the_mirror_or_in_the_mode_view_turns_the_camera(spatial, view, mode, place):
    middle, _ = begin(spatial, view)
    spatial.ask(f"document.querySelector('[data-mode={mode}]').click()")
    before = sides(spatial)
    drag(spatial, np.add(middle, (place, 0)), (50, 0))
    assert not state_of(spatial).any()
    assert np.abs(np.subtract(sides(spatial), before)).max() > 0.01
    spatial.ask("document.querySelector('[data-mode=move]').click()")


def test_a_finger_drags_the_mirror(spatial):
    (x, y), _ = begin(spatial)
    for kind, way in (("Start", 0), ("Move", 20), ("Move", 40)):
        points = [{"x": x + way, "y": y}]
        spatial.send("Input.dispatchTouchEvent", type=f"touch{kind}", touchPoints=points)
    spatial.send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    assert np.linalg.norm(state_of(spatial)[:3]) > 0.01 * ends_of(spatial)[0]


def test_a_click_on_a_part_shows_its_name_and_numbers(spatial):
    """Also where the button is held for long, as on a computer that draws slowly."""
    middle, _ = begin(spatial, "A", [0, 0, 0, 0, 0, 3e-3, 0, 0])
    card = "document.getElementById('card')"
    spatial.press("mousePressed", *middle, button="left", clickCount=1)
    time.sleep(0.6)
    spatial.press("mouseReleased", *middle, button="left", clickCount=1)
    text = spatial.ask(f"{card}.innerText")
    psi = facets.readings(facets.Sensor(), state_of(spatial))[0]
    for words in ("Detector A", "250 mm", f"{psi:.4f}".rstrip("0") + " mm"):
        assert words in text
    spatial.ask("document.querySelector('[data-part=mirror]').click()")
    assert "0 mrad, 0 mrad, 3 mrad" in spatial.ask(f"{card}.innerText")
    spatial.key("Escape")
    assert spatial.ask(f"{card}.hidden")


def test_a_picture_is_saved(spatial, tmp_path):
    spatial.send("Page.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    begin(spatial, "rig")
    spatial.key("p")
    wide, colours = spatial.ask(
        "(() => { const c = page.picture(), pen = c.getContext('2d');"
        " const d = pen.getImageData(0, 0, c.width, 700).data;"
        " return [c.width, new Set(new Uint32Array(d.buffer)).size]; })()"
    )
    assert (wide, colours > 1000) == (1600, True)  # the rig is in it
    path = tmp_path / "paper.png"
    await_true(path.exists, "the file of the picture")
    assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


#: How much of the picture has each detector's hue.
HUES = """(() => {
  const {scene} = page, gl = scene.renderer.getContext();
  scene.draw();
  const wide = gl.drawingBufferWidth, high = gl.drawingBufferHeight;
  const data = new Uint8Array(4 * wide * high), count = [0, 0, 0];
  gl.readPixels(0, 0, wide, high, gl.RGBA, gl.UNSIGNED_BYTE, data);
  for (let n = 0; n < data.length; n += 4) {
    const [r, g, b] = data.subarray(n, n + 3);
    if (b > r + 70 && b > g + 20) count[0]++;
    if (r > b + 70 && r > g + 30) count[1]++;
    if (g > r + 60 && g > b + 10) count[2]++;
  }
  return count.map((pixels) => pixels / wide / high);
})()"""


def test_the_rig_in_space_shows_the_three_lights(spatial):
    begin(spatial)
    lit = spatial.ask(HUES)
    begin(spatial, at=[40, 0, 0, 0, 0, 0, 0, 0])
    dark = spatial.ask(HUES)
    assert np.subtract(lit, dark).min() > 0.003, (lit, dark)


#: How far the detectors' corners are from the middle of the view, in halves of its width and of
#: its height; the ends of the middle that buttons and hints leave free, in halves of the height.
CORNERS = """(() => {
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
#: The graphics driver draws nothing, which is quick; the camera goes where it would.
BLIND = """for (const name of ["drawArrays", "drawElements"]) {
  WebGL2RenderingContext.prototype[name] = () => {};
}"""
#: A small rig whose detectors stand low.
LOW = """
  Model.change({...Model.nominal,
    psds: Model.nominal.psds.map((psd) => ({...psd, radius: 60, height: -3}))});
  Object.assign(RIG, Model.bodies());
  page.rebuild();
"""


def test_the_view_of_the_rig_shows_every_detector(address):
    with Browser("about:blank", webgl=True) as browser:
        browser.send("Page.addScriptToEvaluateOnNewDocument", source=BLIND)
        browser.send("Page.navigate", url=address)
        browser.await_true("page.scene && page.scene.drawn")
        for change in ("", LOW):
            browser.ask(change)
            for width, height in ((360, 740), (360, 1500), (1440, 900)):
                browser.resize(width, height, scale=0.25)
                browser.ask("new Promise((done) => setTimeout(done, 300))")
                seen = browser.ask(CORNERS)
                (x, y), (low, high) = np.array(seen["corners"]).T, seen["free"]
                assert np.abs(x).max() < 1, width
                assert low < y.min() < y.max() < high, width
        assert not browser.errors


def test_keys_do_all_that_hands_do(flat):
    flat.ask("page.moveTo(new Array(8).fill(0)); document.getElementById('rig').focus()")
    for key in ("ArrowRight", "ArrowUp", "PageDown"):
        flat.key(key)
    flat.key("ArrowUp", modifiers=SHIFT)
    flat.key("t")
    flat.key("ArrowLeft")
    x, y, z, roll = np.array(ends_of(flat)[:4]) / 50
    assert state_of(flat) == pytest.approx([x, 1.1 * y, -z, -roll, 0, 0, 0, 0], rel=1e-5)
    moved = state_of(flat).tolist()
    flat.ask("document.getElementById('text').focus()")
    flat.key("r")  # a letter that is typed
    assert state_of(flat).tolist() == moved
    flat.ask("document.activeElement.blur()")
    flat.key("r")
    assert state_of(flat).tolist() == flat.ask("PAGE.state")
    flat.key("?")
    assert flat.ask("document.getElementById('help').open")
    flat.ask("document.getElementById('help').close()")


def test_without_webgl_the_mirror_is_dragged_under_the_beam(flat):
    """To scale: by as many mm as the picture says."""
    flat.ask("page.moveTo(new Array(8).fill(0)); document.getElementById('point').scrollIntoView()")
    drag(flat, flat.box_of("#point")[:2], (20, 10))
    x, y = np.array([20, -10]) / flat.ask("page.point.scale")
    assert state_of(flat) == pytest.approx([x, y, 0, 0, 0, 0, 0, 0], rel=1e-4)


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
