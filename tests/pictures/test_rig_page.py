"""The page of a rig: its numbers are the model's, and what it cannot know it says so."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from browser import CHROMIUM, Browser
from sensors import SENSORS, states

import facets
from facets import InputError
from facets.core import STATE_COLUMNS, STATE_UNITS
from facets.pictures import Stand, rig_page, scene

PAPER = facets.Sensor()
REST = np.zeros(8)
#: What the page shows of readings: as a number, and in words.
SHOWN = """[...document.querySelectorAll("td[data-reading]")].map(
  (cell) => [cell.dataset.value, cell.textContent])"""
WHY = """[...document.querySelectorAll("#why li")].map((item) => item.textContent)"""


def put(page, name, value):
    """Move a slider, or type into a field."""
    page.ask(
        f"(() => {{ const field = document.getElementById('{name}');"
        f" field.value = {json.dumps(value)}; field.dispatchEvent(new Event('input')); }})()"
    )


def text_of(page, name):
    return page.ask(f"document.getElementById('{name}').textContent")


def state_of(page):
    """The state that the page has as text, in the units of the code."""
    pairs = page.ask("document.getElementById('text').value").split(",")
    shown = dict(pair.split("=") for pair in pairs if pair)
    return np.array([float(shown.get(column, 0)) for column in STATE_COLUMNS]) * STATE_UNITS


def readings_of(page):
    """The readings that the page shows, and their words."""
    values, words = zip(*page.ask(SHOWN), strict=True)
    return np.array(values, float), words


def test_sliders_move_the_readings_as_python_has_them(flat):
    wanted = states(8, seed=21, offset=0.3, angle=0.012) / STATE_UNITS
    wanted[:, [0, 1, 2, 6, 7]] = wanted[:, [0, 1, 2, 6, 7]].clip(-0.3, 0.3)
    shown = []
    for asked in wanted:
        for column, value in zip(STATE_COLUMNS, asked, strict=True):
            put(flat, column, value)
        state, (readings, _) = state_of(flat), readings_of(flat)
        assert np.allclose(state / STATE_UNITS, asked, rtol=0, atol=1e-4)
        assert np.abs(readings - facets.readings(PAPER, state)).max() < 1e-9
        shown.append(readings)
    assert np.ptp(shown, axis=0).min() > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("roll_mrad=1200", "turned away|never meets"),
        ("tx_mm=40", "No light gets from facet"),
        ("tz_mm=9", "^Spots A, B and C lie beside their detectors, which read nothing"),
    ],
)
def test_lost_values_are_said_to_be_lost_and_why(flat, text, words):
    put(flat, "text", text)
    readings, cells = readings_of(flat)
    lost = np.isnan(facets.readings(PAPER, state_of(flat)))
    assert np.isnan(readings).tolist() == lost.tolist() == [cell == "lost" for cell in cells]
    assert lost.any() == (text != "tz_mm=9")
    assert any(re.search(words, why) for why in flat.ask(WHY))


@pytest.mark.slow
def test_readings_are_shown_as_a_person_writes_them(flat):
    """At rest a spot's place is rounding, which is zero; a power so small is told as a power of
    ten."""
    flat.ask(f"page.moveTo({REST.tolist()})")
    places = [cell for n, cell in enumerate(readings_of(flat)[1]) if n % 3 < 2]
    assert all(re.fullmatch("\u2212?\\d+\\.\\d{4}", cell) for cell in places), places
    put(flat, "text", "tx_mm=-1.5")
    far = [cell for cell in readings_of(flat)[1] if cell != "lost"]
    assert not any("e" in cell for cell in far), far
    assert any("\u00d7 10\u207b" in cell for cell in far), far


@pytest.mark.slow
def test_a_state_is_copied_and_pasted_as_text(flat):
    for pasted, text in (
        ('{"tx_mm": 0.05, "yaw_mrad": -7.25}', "tx_mm=0.05,yaw_mrad=-7.25"),
        ("link.html#pitch_mrad=2&by_mm=0.01", "pitch_mrad=2,by_mm=0.01"),
    ):
        put(flat, "text", pasted)
        flat.ask("document.getElementById('text').dispatchEvent(new Event('blur'))")
        assert flat.ask("document.getElementById('text').value") == text
    before = flat.ask("page.state()")
    put(flat, "text", "tilt_mrad=3")
    assert re.search("tilt_mrad.*tx_mm", text_of(flat, "said"))
    put(flat, "text", "tx_mm=wide")
    assert "tx_mm is not a number that is finite" in text_of(flat, "said")
    assert flat.ask("page.state()") == before
    flat.ask("document.getElementById('reset').click()")
    assert flat.ask("document.getElementById('text').value") == "ty_mm=0.03"
    put(flat, "roll_mrad-number", "12.5")
    assert flat.ask("document.getElementById('roll_mrad').value") == "12.5"
    flat.await_true("location.hash === '#ty_mm=0.03&roll_mrad=12.5'")


@pytest.mark.slow
def test_the_mirror_moves_by_itself_until_it_is_stopped(flat):
    flat.ask("document.querySelector('[data-try=tz]').click()")
    lifted, _ = readings_of(flat)
    assert np.ptp(lifted[1::3]) < 1e-9 < lifted[1]
    flat.ask("document.getElementById('play').click()")
    flat.await_true("document.getElementById('text').value.split('=').length === 7")
    flat.ask("document.getElementById('play').click()")
    stopped = flat.ask("page.state()")
    flat.ask("new Promise((done) => setTimeout(done, 300))")
    assert flat.ask("page.state()") == stopped


@pytest.mark.slow
def test_without_webgl_the_page_says_so_and_draws_flat(flat):
    assert not flat.ask("document.getElementById('flat').hidden")
    assert flat.ask("document.title") == "paper: a three-facet-mirror sensor"
    flat.ask(f"page.moveTo({REST.tolist()})")
    inked = flat.ask("""["point", "face-a", "face-b", "face-c"].map((id) => {
      const {width, height} = document.getElementById(id);
      const pen = document.getElementById(id).getContext("2d");
      const alpha = pen.getImageData(0, 0, width, height).data.filter((_, n) => n % 4 === 3);
      return alpha.filter((value) => value > 0).length / width / height;
    })""")
    assert min(inked) > 0.3


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_what_is_drawn_lies_where_the_model_has_it(tmp_path):
    """The spots of the apex and of the beam, and the facets that the beam meets."""
    sensor = SENSORS["skewed1"]
    given = np.concatenate([states(5, 1), states(5, 2, offset=1.5, angle=0.2)])
    (tmp_path / "rig.html").write_text(rig_page(sensor, "skewed", REST), "utf-8")
    with Browser(f"file://{tmp_path}/rig.html") as page:
        page.await_true("page.state()")
        for state in given:
            drawn = page.ask(f"Model.drawing({state.tolist()}).facets")
            stand = Stand.from_state(sensor, state)
            for k, facet in enumerate(drawn):
                spot = scene.spot(stand, k)
                assert facet["meets"]
                assert facet["apexSpot"] == pytest.approx(spot.apex, abs=1e-9)
                assert facet["beamSpot"] == pytest.approx(spot.beam, abs=1e-9)


def test_the_command_writes_the_page(run_in_process, tmp_path):
    words = ("render", "paper", "--at", "ty_mm=0.03", "--view", "mirror", "-o", "rig.html")
    status, _, errors = run_in_process(*words)
    assert status == 0, errors
    config, state = facets.load("paper"), np.array([0, 0.03, 0, 0, 0, 0, 0, 0])
    text = rig_page(config.sensor, "paper", state, "mirror", config)
    assert (tmp_path / "rig.html").read_text("utf-8") == text


def test_the_page_asks_nothing_of_a_network():
    text = rig_page(PAPER, "a </script> name", REST, "mirror")
    assert "default-src 'none'" in text
    assert not re.search(r"<(script|img|link|iframe)[^>]+(src|href)=(?!\"data:)", text)
    assert text.count("</script>") == 4
    assert "a &lt;/script&gt; name" in text
    assert '"view": "mirror"' in text


def said_on(sensor):
    """The sentences on what the page's readings, noise and file leave out."""
    text = rig_page(sensor, "rig", REST)
    words = json.loads(re.search(r"const PAGE = (\{.*\});", text)[1].replace("<\\/", "</"))
    return words["sentences"], words["estimate"], words["omitted"]


def test_what_the_page_leaves_out_is_said_in_sentences():
    assert said_on(PAPER) == (["The readings are without noise."], [], [])
    light = facets.BenchLight(index=(1.4, 7.5), delays=(0.0, 1e-5, 2e-5))
    openings = facets.Apertures(beam=1.0, detectors=True)
    readings = " ".join(said_on(replace(PAPER, light=light, apertures=openings))[0])
    for part in ("light of this bench", "apertures cut", "read at different times"):
        assert part in readings
    known = facets.Calibration(("psd_a.height",), ((1e-6,),))
    _, estimate, omitted = said_on(replace(PAPER, calibration=known))
    assert "without the calibration's part" in estimate[0]
    assert "left out" in omitted[0]
    assert "steps of the converter" in said_on(facets.load("bench").sensor)[1][0]


def test_a_state_that_is_no_number_is_refused():
    with pytest.raises(InputError, match="not finite"):
        rig_page(PAPER, "paper", np.array([np.nan, *[0.0] * 7]))
