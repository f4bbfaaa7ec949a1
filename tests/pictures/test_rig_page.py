"""The page of a rig: its numbers are the model's, and what it cannot know it says so."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import facets
from facets import InputError
from facets.core import STATE_COLUMNS, STATE_UNITS
from facets.pictures import rig_page

PAPER = facets.Sensor()
REST = np.zeros(8)
#: What the page shows of readings: as a number, and in words.
SHOWN = """[...document.querySelectorAll("td[data-reading]")].map(
  (cell) => [cell.dataset.value, cell.textContent])"""
WHY = """[...document.querySelectorAll("#why li")].map((item) => item.textContent)"""


def state_of(page):
    return np.array(page.ask("page.state()"))


def readings_of(page):
    """The readings that the page shows, and their words."""
    values, words = zip(*page.ask(SHOWN), strict=True)
    return np.array(values, float), words


@pytest.mark.slow
def test_sliders_move_the_readings_as_python_has_them(flat):
    ends = [0.3, 0.3, 0.3, 8, 8, 8, 0.3, 0.3]
    wanted = np.random.default_rng(21).uniform(-1, 1, (8, 8)) * ends
    shown = []
    for asked in wanted:
        for column, value in zip(STATE_COLUMNS, asked, strict=True):
            flat.put(column, value)
        state, (readings, _) = state_of(flat), readings_of(flat)
        assert state / STATE_UNITS == pytest.approx(asked, abs=1e-4)
        assert readings == pytest.approx(facets.readings(PAPER, state), abs=1e-9)
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
    flat.put("text", text)
    readings, cells = readings_of(flat)
    lost = np.isnan(facets.readings(PAPER, state_of(flat)))
    assert np.isnan(readings).tolist() == lost.tolist() == [cell == "lost" for cell in cells]
    assert lost.any() == (text != "tz_mm=9")
    assert any(re.search(words, why) for why in flat.ask(WHY))


@pytest.mark.slow
def test_a_state_is_copied_and_pasted_as_text(flat):
    for pasted, text in (
        ('{"tx_mm": 0.05, "yaw_mrad": -7.25}', "tx_mm=0.05,yaw_mrad=-7.25"),
        ("link.html#pitch_mrad=2&by_mm=0.01", "pitch_mrad=2,by_mm=0.01"),
    ):
        flat.put("text", pasted)
        flat.ask("document.getElementById('text').dispatchEvent(new Event('blur'))")
        assert flat.ask("document.getElementById('text').value") == text
    before = flat.ask("page.state()")
    flat.put("text", "tilt_mrad=3")
    assert re.search("tilt_mrad.*tx_mm", flat.text_of("said"))
    flat.put("text", "tx_mm=wide")
    assert "tx_mm is not a number that is finite" in flat.text_of("said")
    assert flat.ask("page.state()") == before
    flat.ask("document.getElementById('reset').click()")
    assert flat.ask("document.getElementById('text').value") == "ty_mm=0.03"
    flat.put("roll_mrad-number", "12.5")
    assert flat.ask("document.getElementById('roll_mrad').value") == "12.5"
    flat.await_true("location.hash === '#ty_mm=0.03&roll_mrad=12.5'")


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


def said_on(**parts):
    """The sentences on what the page's readings, noise and file leave out."""
    text = rig_page(replace(PAPER, **parts), "rig", REST)
    words = json.loads(re.search(r"const PAGE = (\{.*\});", text)[1].replace("<\\/", "</"))
    return [" ".join(words[part]) for part in ("sentences", "estimate", "omitted")]


def test_what_the_page_leaves_out_is_said_in_sentences():
    assert said_on() == ["The readings are without noise.", "", ""]
    light = facets.BenchLight(index=(1.4, 7.5), delays=(0.0, 1e-5, 2e-5))
    readings, _, _ = said_on(light=light, apertures=facets.Apertures(beam=1.0, detectors=True))
    for part in ("light of this bench", "apertures cut", "read at different times"):
        assert part in readings
    _, estimate, omitted = said_on(calibration=facets.Calibration(("psd_a.height",), ((1e-6,),)))
    assert "without the calibration's part" in estimate
    assert "left out" in omitted
    _, estimate, _ = said_on(electronics=facets.load("bench").sensor.electronics)
    assert "steps of the converter" in estimate


def test_a_state_that_is_no_number_is_refused():
    with pytest.raises(InputError, match="not finite"):
        rig_page(PAPER, "paper", np.array([np.nan, *[0.0] * 7]))
