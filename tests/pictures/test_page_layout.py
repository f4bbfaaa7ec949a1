"""The rig's page at the widths of a telephone, a tablet and a screen; its accessibility, its size.

Pictures of whole pages depend on fonts and on how a processor draws, so boxes are compared instead:
nothing is cut, and nothing lies over anything. What the model
draws by itself is compared with a coarse reference.
"""

import numpy as np
import pytest

pytestmark = pytest.mark.slow
STATE = [0.08, 0.05, 0.5, 0.003, 0.004, 0.006, 0.0, 0.0]
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
def page(flat):
    """The page in daylight, at a state that moves every spot."""
    choose_theme(flat, "light")
    flat.ask(f"page.moveTo({STATE})")
    return flat


def choose_theme(page, theme):
    shown = "document.documentElement.dataset.theme"
    page.ask(f"if ({shown} !== '{theme}') document.getElementById('theme').click()")
    assert page.ask(shown) == theme


def test_the_flat_pictures_are_as_they_were(page):
    """In parts of a dozen pixels, so that fonts and edges do not count."""
    reference = np.array([list(bytes.fromhex("".join(rows))) for rows in REFERENCE])
    page.resize(1440, 900)
    assert not page.ask("document.getElementById('flat').hidden")  # there is no WebGL
    pictures = np.array(page.ask(FLAT))
    shown = [np.round(picture).astype(np.uint8).tobytes().hex() for picture in pictures]
    assert np.abs(pictures - reference).max() < 20, shown
    assert np.abs(pictures - reference).mean() < 3, shown


def test_fingers_have_room_on_a_telephone(page):
    page.send("Emulation.setTouchEmulationEnabled", maxTouchPoints=1, enabled=True)
    page.await_true("matchMedia('(pointer: coarse)').matches")
    page.resize(360, 740)
    heights = page.ask(
        "[...document.querySelectorAll('button, select, input:not([type=checkbox])')].map("
        "(one) => one.getBoundingClientRect().height).filter((height) => height)"
    )
    assert min(heights) >= 40
    assert page.ask(CUT) == []
    page.send("Emulation.setTouchEmulationEnabled", enabled=False)


@pytest.mark.parametrize("fill", ["", FILL], ids=["plain", "filled"])
def test_nothing_is_cut_or_covered_at_any_width(page, fill):
    page.ask(fill)
    for width, height in ((360, 740), (768, 1024), (1024, 768), (1200, 800), (1440, 900)):
        page.resize(width, height)
        page.ask("new Promise((done) => setTimeout(done, 300))")
        assert page.ask(CUT) == [], width
        assert page.ask(OVER) == [], width


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing_against_wcag(page, theme):
    choose_theme(page, theme)
    page.ask(FILL)
    for help_open in ("close", "showModal"):
        page.ask(f"document.getElementById('help').{help_open}()")
        assert page.find_barriers() == []
    page.ask("document.getElementById('help').close()")
