"""The page of a rig: its numbers are the model's, and what it cannot know it says so."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from commands import command
from sensors import ASYMMETRY, PROFILE, SENSORS, states

import facets
from facets import BenchLight, InputError
from facets.core import STATE_COLUMNS, STATE_UNITS
from facets.pictures import scene
from facets.pictures.page.javascript import javascript
from facets.pictures.page.model import model
from facets.pictures.page.rig_page import rig_page, sentences

PAPER = facets.Sensor()
CUT = replace(
    SENSORS["skewed0"],
    apertures=facets.Apertures(beam=1.0, detectors=True, rim=5.0, tip=0.01, gap=0.005),
)
LIT = BenchLight(
    curvature_xx=3e-4, curvature_yy=2e-4, wavelength=6.33e-4, rolloff=(5e-5,) * 6,
    rolloff_width=0.05, strips=(0.01, 0.008, 0.006), tip=1e-3, index=(1.4, 7.5), polarization=0.4,
    background=((1e-4, 1.0, 2.0), (0.0, 0.0, 0.0), (2e-4, -1.0, 0.5)),
)  # fmt: skip
PROFILED = BenchLight(curvature_xx=3e-4, profile=PROFILE, asymmetry=ASYMMETRY)
COATED = BenchLight(index=(1.4, 7.5), background=((1e-4, 1.0, 2.0),) * 3)
#: One sensor for each of the optics' ways to its readings.
KINDS = {
    "plain": PAPER,
    "skewed": SENSORS["skewed1"],
    "cut": CUT,
    "lit": replace(PAPER, light=LIT),
    "not Gaussian": replace(PAPER, light=PROFILED),
    "cut and lit": replace(CUT, light=COATED),
}
#: A graphics driver's remark, when a test reads a picture back.
DRIVER = "GL Driver Message"
needs_browser = pytest.mark.skipif(not shutil.which("chromium"), reason="needs Chromium")


def in_browser(path, profile, *flags):
    """What the last script of a page has put into the body's `data-told`."""
    done = subprocess.run(
        ["chromium", "--headless", "--no-sandbox", "--disable-quic", "--no-first-run",
         "--disable-background-networking", "--disable-component-update", "--disable-sync",
         f"--user-data-dir={profile}", "--window-size=1300,900", "--virtual-time-budget=6000",
         "--enable-logging=stderr", *flags, "--dump-dom", f"file://{path}"],
        check=True, capture_output=True, timeout=570, text=True,
    )  # fmt: skip
    found = re.search(r'data-told="([^"]*)"', done.stdout)
    assert found, done.stdout[-2000:] + done.stderr[-2000:]
    written = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert not [line for line in written if DRIVER not in line], written
    return json.loads(unescape(found.group(1)))


def numbers(values):
    """Numbers as JSON gives them, with NaN as text."""
    return np.array([float(value) for value in values])


def many_states(count, seed):
    """Half of them where a rig works, half far off, in the tails of the beam."""
    half = count // 2
    far = states(count - half, seed + 1, offset=1.5, angle=0.2)
    return np.concatenate([states(half, seed), far])


def placed(sensor, state):
    """Where the apex's ray and the beam's own land on the three detectors, by another text."""
    stand = scene.Stand.from_state(sensor, state)
    spots = [scene.spot(stand, k) for k in range(3)]
    return np.array([[spot.apex, spot.beam] for spot in spots])


@needs_browser
@pytest.mark.slow
def test_each_way_to_the_readings_gives_what_python_gives(tmp_path):
    """Also where values are lost, and with what is drawn in its place."""
    given = {name: many_states(24, seed) for seed, name in enumerate(KINDS)}
    texts = [
        "{" + model(sensor) + f"""
        told[{json.dumps(name)}] = {json.dumps(given[name].tolist())}.map((state) => {{
          const drawn = Model.drawing(state);
          return {{
            readings: Model.readings(state).map(String),
            spots: drawn.facets.map((facet) => [facet.apexSpot, facet.beamSpot]),
            meets: drawn.facets.map((facet) => facet.meets),
          }};
        }});
        }}"""
        for name, sensor in KINDS.items()
    ]  # fmt: skip
    body = "document.body.dataset.told = JSON.stringify(told);"
    script = "const told = {};\n" + "\n".join(texts) + body
    page = tmp_path / "models.html"
    page.write_text(f"<!doctype html><body><script>{script}</script>", "utf-8")
    told = in_browser(page, tmp_path / "profile", "--disable-3d-apis")
    for name, sensor in KINDS.items():
        wanted = facets.readings(sensor, given[name])
        found = np.array([numbers(one["readings"]) for one in told[name]])
        assert np.array_equal(np.isnan(found), np.isnan(wanted)), name
        assert np.isfinite(wanted).any(), name
        assert np.nanmax(np.abs(found - wanted)) < 1e-9, name
        if not sensor.light.on:
            for state, one in zip(given[name], told[name], strict=True):
                assert all(one["meets"])
                assert np.allclose(one["spots"], placed(sensor, state), rtol=0, atol=1e-9)


@needs_browser
@pytest.mark.slow
def test_readings_are_shown_as_a_person_writes_them(tmp_path):
    """At rest a spot's place is rounding, which is zero; a power so small is told as a power of
    ten."""
    told = """<script>addEventListener("load", () => setTimeout(() => {
      const cells = [...document.querySelectorAll("td[data-reading]")];
      const said = {rest: cells.map((cell) => cell.textContent)};
      const far = document.getElementById("text");
      far.value = "tx_mm=-1.5";
      far.dispatchEvent(new Event("input"));
      said.far = cells.map((cell) => cell.textContent);
      document.body.dataset.told = JSON.stringify(said);
    }, 1000));</script></html>"""
    page = tmp_path / "rig.html"
    page.write_text(rig_page(PAPER, "paper", np.zeros(8)).replace("</html>", told), "utf-8")
    said = in_browser(page, tmp_path / "profile", "--disable-3d-apis")
    places = [text for n, text in enumerate(said["rest"]) if n % 3 < 2]
    assert all(re.fullmatch("\u2212?\\d+\\.\\d{4}", text) for text in places), said
    assert not any("e" in text for text in said["far"] if text != "lost"), said
    assert any("\u00d7 10\u207b" in text for text in said["far"]), said


#: What a user does: moves one slider after the other, types numbers, pastes states.
ACTS = """<script>
addEventListener("load", () => setTimeout(() => {
  const byId = (id) => document.getElementById(id);
  const put = (element, value) => {
    element.value = value;
    element.dispatchEvent(new Event("input"));
  };
  const values = () => [...document.querySelectorAll("td[data-reading]")].map(
    (cell) => ({value: cell.dataset.value, text: cell.textContent}));
  const page = () => ({state: byId("text").value, cells: values(),
    why: [...document.querySelectorAll("#why li")].map((item) => item.textContent)});
  const told = {moved: [], typed: [], flat: !byId("flat").hidden, title: document.title};
  for (const state of STATES) {
    state.forEach((value, n) => put(byId(KEYS[n]), value));
    told.moved.push(page());
  }
  for (const text of TEXTS) {
    put(byId("text"), text);
    byId("text").dispatchEvent(new Event("blur"));
    told.typed.push({...page(), said: byId("said").textContent});
  }
  byId("reset").click();
  told.reset = page();
  put(byId("roll_mrad-number"), "12.5");
  told.number = {...page(), slider: byId("roll_mrad").value};
  const ink = (canvas) => {
    const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    let count = 0;
    for (let n = 3; n < data.length; n += 4) count += data[n] > 0;
    return count / canvas.width / canvas.height;
  };
  told.ink = ["point", "face-a", "face-b", "face-c"].map((id) => ink(byId(id)));
  const themes = [document.documentElement.dataset.theme];
  byId("theme").click();
  themes.push(document.documentElement.dataset.theme);
  told.themes = themes;
  setTimeout(() => {
    told.hash = location.hash;
    document.querySelector("[data-try=tz]").click();
    told.lifted = page();
    byId("play").click();
    setTimeout(() => {
      byId("play").click();
      told.played = page();
      setTimeout(() => {
        told.stopped = page();
        document.body.dataset.told = JSON.stringify(told);
      }, 300);
    }, 1000);
  }, 1000);
}, 1000));
</script></html>"""
TEXTS = [
    "roll_mrad=1200",
    "tx_mm=40",
    "tz_mm=9",
    '{"tx_mm": 0.05, "yaw_mrad": -7.25}',
    "link.html#pitch_mrad=2&by_mm=0.01",
    "tilt_mrad=3",
    "tx_mm=wide",
]


def state_of(text):
    """A state in the units of the code from what the page shows of it."""
    shown = dict(pair.split("=") for pair in text.split(",") if pair)
    columns = [float(shown.get(column, 0)) for column in STATE_COLUMNS]
    return np.array(columns) * STATE_UNITS


def cells(shown):
    return numbers(cell["value"] for cell in shown["cells"])


@pytest.fixture(scope="module")
def acted(tmp_path_factory):
    """The paper's page after sixty states by sliders, and some by text; without WebGL."""
    folder = tmp_path_factory.mktemp("page")
    result = command("render", "paper", "--at", "ty_mm=0.03", "-o", "rig.html", cwd=folder)
    assert result.returncode == 0, result.stderr
    wanted = states(60, seed=21, offset=0.3, angle=0.012) / STATE_UNITS
    wanted[:, :3] = wanted[:, :3].clip(-0.3, 0.3)
    wanted[:, 6:] = wanted[:, 6:].clip(-0.3, 0.3)
    acts = ACTS.replace("STATES", json.dumps(wanted.tolist())).replace("TEXTS", json.dumps(TEXTS))
    acts = acts.replace("KEYS", json.dumps(STATE_COLUMNS))
    text = (folder / "rig.html").read_text("utf-8").replace("</html>", acts)
    (folder / "acted.html").write_text(text, "utf-8")
    told = in_browser(folder / "acted.html", folder / "profile", "--disable-3d-apis")
    return wanted, told


@needs_browser
@pytest.mark.slow
def test_sliders_move_the_readings_as_python_has_them(acted):
    wanted, told = acted
    assert len(told["moved"]) == 60
    for asked, shown in zip(wanted, told["moved"], strict=True):
        state = state_of(shown["state"])
        assert np.allclose(state / STATE_UNITS, asked, rtol=0, atol=1e-4)
        assert np.abs(cells(shown) - facets.readings(PAPER, state)).max() < 1e-9
    assert np.ptp([cells(shown) for shown in told["moved"]], axis=0).min() > 0.01


@needs_browser
@pytest.mark.slow
def test_lost_values_are_said_to_be_lost_and_why(acted):
    turned, dark, beside = acted[1]["typed"][:3]
    for shown in (turned, dark, beside):
        found, wanted = cells(shown), facets.readings(PAPER, state_of(shown["state"]))
        assert np.array_equal(np.isnan(found), np.isnan(wanted))
        for cell, value in zip(shown["cells"], found, strict=True):
            assert (cell["text"] == "lost") == np.isnan(value)
    assert np.isnan(cells(turned)).any()
    assert any("turned away" in why or "never meets" in why for why in turned["why"])
    assert np.isnan(cells(dark)).any()
    assert any("No light gets from facet" in why for why in dark["why"])
    assert np.isfinite(cells(beside)).all()
    (why,) = beside["why"]
    assert why.startswith("Spots A, B and C lie beside their detectors, which read nothing")


@needs_browser
@pytest.mark.slow
def test_a_state_is_copied_and_pasted_as_text(acted):
    told = acted[1]
    json_text, link, unknown, wrong = told["typed"][3:]
    assert json_text["state"] == "tx_mm=0.05,yaw_mrad=-7.25"
    assert link["state"] == "pitch_mrad=2,by_mm=0.01"
    assert "tilt_mrad" in unknown["said"]
    assert "tx_mm" in unknown["said"]
    assert "tx_mm is not a number that is finite" in wrong["said"]
    assert state_of(unknown["state"]).tolist() == state_of(link["state"]).tolist()
    assert told["reset"]["state"] == "ty_mm=0.03"
    assert told["hash"] == "#ty_mm=0.03&roll_mrad=12.5"
    assert float(told["number"]["slider"]) == 12.5


@needs_browser
@pytest.mark.slow
def test_the_mirror_moves_by_itself_until_it_is_stopped(acted):
    told = acted[1]
    lifted = cells(told["lifted"])
    assert np.ptp(lifted[1::3]) < 1e-9 < lifted[1]
    assert told["played"]["state"].count("=") == 6
    assert told["stopped"]["state"] == told["played"]["state"]


@needs_browser
@pytest.mark.slow
def test_without_webgl_the_page_says_so_and_draws_flat(acted):
    told = acted[1]
    assert told["flat"]
    assert min(told["ink"]) > 0.3
    assert sorted(told["themes"]) == ["dark", "light"]
    assert told["title"] == "paper: a three-facet-mirror sensor"


#: How much of the picture has each detector's hue, while light falls on all and on none.
LOOK = """<script>
addEventListener("load", () => setTimeout(() => {
  const {scene} = page;
  if (!scene) { document.body.dataset.told = JSON.stringify({none: true}); return; }
  const gl = scene.renderer.getContext();
  const seen = () => {
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
    return count.map((found) => found / wide / high);
  };
  scene.look("mirror", false);
  const told = {lit: seen()};
  page.accept("tx_mm=40");
  scene.look("mirror", false);
  told.dark = seen();
  document.body.dataset.told = JSON.stringify(told);
}, 1000));
</script></html>"""


@needs_browser
@pytest.mark.slow
def test_the_rig_in_space_shows_the_three_lights(tmp_path):
    page = tmp_path / "rig.html"
    text = rig_page(PAPER, "paper", np.zeros(8))
    text = text.replace('id="rig"', 'id="rig" style="max-width:500px"')
    page.write_text(text.replace("</html>", LOOK), "utf-8")
    told = in_browser(page, tmp_path / "profile", "--enable-unsafe-swiftshader")
    if told.get("none"):
        pytest.skip("this Chromium has no WebGL")
    for lit, dark in zip(told["lit"], told["dark"], strict=True):
        assert lit > dark + 0.003, told


def test_the_page_asks_nothing_of_a_network():
    text = rig_page(PAPER, "a </script> name", np.zeros(8))
    assert "default-src 'none'" in text
    assert not re.search(r"<(script|img|link|iframe)[^>]+(src|href)=(?!\"data:)", text)
    assert text.count("</script>") == 4
    assert "a &lt;/script&gt; name" in text
    assert '"view": "mirror"' in rig_page(PAPER, "paper", np.zeros(8), "mirror")


def test_what_the_page_leaves_out_is_said_in_sentences():
    assert sentences(PAPER) == ["The readings are without noise."]
    light = replace(COATED, delays=(0.0, 1e-5, 2e-5))
    told = " ".join(sentences(replace(CUT, light=light)))
    for part in ("light of this bench", "apertures cut", "read at different times"):
        assert part in told


def test_a_state_that_is_no_number_is_refused():
    with pytest.raises(InputError, match="not finite"):
        rig_page(PAPER, "paper", np.array([np.nan, *[0.0] * 7]))


def of_a_text_that_is_not_understood(x):
    return {name: x + n for n, name in enumerate("abc")}


def test_a_text_that_is_not_understood_is_refused_with_its_place():
    with pytest.raises(TypeError, match=r"test_rig_page\.py, line \d+: .* is not understood"):
        javascript(of_a_text_that_is_not_understood)
