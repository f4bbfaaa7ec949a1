"""The page of a design space and the report on a layout, as a browser shows them."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from commands import command

import facets
from facets import design, pictures
from facets.design import Space, part_of, states_of

from .conftest import LOOSE

CONFIG = facets.load("layout")
gallery = design.exploration.gallery


@pytest.fixture(scope="module")
def browser():
    from browser import CHROMIUM, Browser

    if CHROMIUM is None:
        pytest.skip("needs Chromium")
    with Browser("about:blank", webgl=True) as window:
        yield window


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A page, what it shows, and the configurations that it gives to copy."""
    pytest.importorskip("plotly")
    folder = tmp_path_factory.mktemp("page")
    space = Space(CONFIG.sensor, CONFIG.range, CONFIG.layout, 40, 1, part=40)
    table = part_of(space, 0)
    ranges = np.isfinite(table["range_roll_mrad"])
    best = gallery.best_of(table, list(space.objectives), ranges & (np.arange(40) % 4 == 0))
    shown, sensors = gallery.gallery(space, best, table)
    texts = gallery.texts_of(CONFIG, sensors, folder)
    designs = pictures.exploration_page.ShownDesigns(shown, sensors, texts)
    text = pictures.exploration_page.page(
        "layout </script>", space.names, list(space.objectives), designs, ""
    )
    (folder / "page.html").write_text(text, "utf-8")
    return folder / "page.html", shown, texts


def test_a_page_gives_each_design_to_copy_in_the_numbers_of_its_table(written, tmp_path):
    """The table's head is the drawing's, in numbers that can be made; no network is asked."""
    page, shown, texts = written
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=", page.read_text("utf-8"))
    assert len(texts) == len(shown["kind"])
    assert shown["kind"].tolist().count("own") == 1
    for n in range(1, len(texts)):
        radius = shown["radius_mm"][n]
        assert shown["head_mm"][n] == pytest.approx(2 * radius, rel=1e-12)
        assert f"radius_mm: {radius:g}" in texts[n]
    (tmp_path / "last.yaml").write_text(texts[-1])
    sensor = facets.load(tmp_path / "last.yaml").sensor
    assert sensor.psds[0].radius == pytest.approx(shown["radius_mm"][-1], abs=0.051)
    assert 1e3 * sensor.psds[1].pitch == pytest.approx(shown["pitch_mrad"][-1], abs=0.51)
    assert sensor.beam.diameter_x == pytest.approx(shown["diameter_mm"][-1], abs=0.0051)
    assert sensor.psds[0].height != 0


#: What a user does: choose a design in the list, keep a part of an axis, choose a point.
ACTS = """(async () => {
  const rows = document.querySelectorAll("#list tbody tr");
  const seen = {drawn: document.body.dataset.drawn, rows: rows.length};
  rows[2].click();
  seen.row = document.getElementById("which").textContent;
  const plotted = data.columns.filter(c => c.plotted);
  const radius = plotted.findIndex(c => c.label.startsWith("radius"));
  const values = plotted[radius].values;
  const middle = [...values].sort((a, b) => a - b)[Math.floor(values.length / 2)];
  seen.below = values.filter(v => v <= middle).length;
  await Plotly.restyle("axes", {[`dimensions[${radius}].constraintrange`]: [[0, middle]]});
  document.getElementById("matrix").emit("plotly_click", {points: [{pointNumber: 5}]});
  seen.point = document.getElementById("which").textContent;
  seen.yaml = document.getElementById("yaml").textContent;
  seen.svg = document.querySelectorAll("#drawing svg line").length;
  return seen;
})()"""


def test_a_drawing_has_the_head_and_its_dimensions():
    drawing = pictures.head_drawing.drawing
    svg = drawing(facets.load("paper").sensor)
    assert "head \u2300 500 mm" in svg
    assert "facet at 45\u00b0" in svg
    assert svg.count("<line") > 8
    skewed = drawing(facets.load("skewed").sensor)
    assert all(f"{letter}: R" in skewed for letter in "ABC")


@pytest.fixture(scope="module")
def optimised(tmp_path_factory):
    """The folder of a layout with margins for 90 % of its heads, and what was printed."""
    folder = tmp_path_factory.mktemp("optimised")
    (folder / "loose.yaml").write_text(LOOSE + "  production: {yield_percent: 90}\n")
    result = command(
        "optimize", "loose.yaml", "-o", "best.yaml", "--report", "best.html",
        "--heads", "5", cwd=folder,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    return folder, result.stdout


@pytest.mark.slow
def test_a_report_tells_the_whole_story(optimised):
    folder, _ = optimised
    text = (folder / "best.html").read_text("utf-8")
    for part in ("Requirements", "What changes", "diameter of the head, mm", "<svg",
                 "after over before", "What limits the layout", "best.gltf", "proved",
                 "uncertainty of shift in x, µm", "PSD B, +z edge", "±0.05",
                 "pitch at its upper bound", "Which tolerance costs most"):  # fmt: skip
        assert part in text, part
    assert not re.search(r"\b(u|range)_\w+_(um|mm|u?rad|mrad)\b|\+- ", text)
    assert json.loads((folder / "best.gltf").read_text())["asset"]["version"].startswith("2")


@pytest.mark.slow
def test_optimize_writes_a_better_layout_and_tells_how_it_was_found(optimised):
    folder, printed = optimised
    for part in (
        "tolerances give them, for 90 % of the heads (predicted",
        "what holds it back",
        "proved: no two states within the ranges of the axes and with at least 10.8 % of the light"
        " on each detector (32.4 µW of a laser of 0.3 mW or less)",
    ):
        assert part in printed
    lines = [line for line in (folder / "best.yaml").read_text().splitlines() if line[:1] != "#"]
    assert "extends: loose.yaml" in lines
    assert any("+- 0.05" in line for line in lines)
    volume = np.array(states_of(CONFIG.layout, 1.0), dtype=float)
    old, new = (
        facets.uncertainties(sensor, volume, facets.Knowledge()).max(axis=0)
        for sensor in (CONFIG.sensor, facets.load(folder / "best.yaml").sensor)
    )
    assert (new < old).all()
    assert "u_roll_urad" in (folder / "best.csv").read_text()


#: The labels of both plots: those that are cut, lie on another, or are missing.
LABELS = """(() => {
  const names = data.columns.filter(c => c.plotted).map(c => c.lines.join(""));
  const boxes = [...document.querySelectorAll("#axes .axis-title, #axes .axis-extent-text, " +
    "#matrix .xtitle, #matrix .x2title, #matrix g[class*=title] text")]
    .filter(l => l.textContent.trim()).map(l => {
      const b = l.getBoundingClientRect(), p = l.closest(".plot"), o = p.getBoundingClientRect();
      return {text: l.textContent, left: b.left + p.scrollLeft - o.left, top: b.top,
        right: b.right + p.scrollLeft - o.left, bottom: b.bottom, room: p.scrollWidth};
    });
  const meet = (a, b) => a.right > b.left + 1 && b.right > a.left + 1 &&
    a.bottom > b.top + 1 && b.bottom > a.top + 1;
  return [
    boxes.filter(b => !(0 <= b.left && b.left <= b.right && b.right <= b.room)),
    boxes.filter((a, n) => boxes.slice(n + 1).some(b => meet(a, b))),
    names.slice(1, -1).filter(name => boxes.filter(b => b.text === name).length < 2),
  ];
})()"""


@pytest.mark.slow
def test_a_browser_draws_the_page_and_brushing_and_clicks_work(written, browser):
    """And no label of the plots is cut or lies on another."""
    page, shown, texts = written
    for width in (1440, 360):
        browser.resize(width, 1400)
        browser.send("Page.navigate", url=f"file://{page}?{width}")
        browser.await_true(f"location.search === '?{width}' && document.body.dataset.drawn")
        assert browser.ask("document.documentElement.scrollWidth") <= width
        assert browser.ask(LABELS) == [[], [], []]
    seen = browser.ask(ACTS)
    assert int(seen["drawn"]) == len(texts)
    assert seen["rows"] == int((shown["kind"] != "other").sum())
    assert seen["row"] == shown["title"][2]
    assert seen["below"] < len(texts)
    browser.await_true(f"document.body.dataset.kept === '{seen['below']}'")
    assert seen["point"] == shown["title"][5]
    assert seen["yaml"] == texts[5]
    assert seen["svg"] > 5
