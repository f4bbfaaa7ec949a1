"""The page of a design space and the report on a layout, as a browser shows them."""

from __future__ import annotations

import json
import re
import shutil
import subprocess

import numpy as np
import pytest
from commands import command

import facets
from facets.design import NO_RIVALS, Space, part_of
from facets.design.gallery import best_of, gallery, texts_of
from facets.pictures.head_drawing import drawing

pytest.importorskip("plotly")
from facets.pictures.exploration_page import page

CONFIG = facets.load("layout")
needs_browser = pytest.mark.skipif(not shutil.which("chromium"), reason="needs Chromium")


def in_browser(path, profile):
    """The document of a page once its scripts have run."""
    done = subprocess.run(
        ["chromium", "--headless", "--no-sandbox", "--enable-unsafe-swiftshader", "--no-first-run",
         "--disable-background-networking", "--disable-component-update", "--disable-sync",
         f"--user-data-dir={profile}", "--window-size=1400,1000", "--virtual-time-budget=30000",
         "--dump-dom", f"file://{path}"],
        check=True, capture_output=True, timeout=300, text=True,
    )  # fmt: skip
    return done.stdout


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    space = Space(CONFIG.sensor, CONFIG.range, CONFIG.layout, "sobol", 40, 1, part=40, every=True)
    table = part_of(space, 0, NO_RIVALS)
    ranges = np.isfinite(table["range_roll_mrad"])
    best = best_of(table, list(space.objectives), ranges & (np.arange(40) % 4 == 0))
    shown, sensors = gallery(space, best, table)
    texts = texts_of(CONFIG, sensors, folder)
    text = page("layout </script>", space.names, list(space.objectives), shown, sensors, texts, "")
    (folder / "page.html").write_text(text, "utf-8")
    return folder, shown, texts


def test_the_page_asks_nothing_of_a_network(written):
    folder, shown, texts = written
    text = (folder / "page.html").read_text("utf-8")
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=", text)
    assert len(texts) == len(shown["kind"])
    assert shown["kind"].tolist().count("own") == 1


def test_what_the_page_gives_to_copy_is_the_design(written, tmp_path):
    _, shown, texts = written
    for n in (1, len(texts) - 1):
        (tmp_path / "one.yaml").write_text(texts[n])
        sensor = facets.load(tmp_path / "one.yaml").sensor
        assert sensor.psds[0].radius == pytest.approx(shown["radius_mm"][n], abs=0.051)
        assert 1e3 * sensor.psds[1].pitch == pytest.approx(shown["pitch_mrad"][n], abs=0.51)
        assert sensor.beam.diameter_x == pytest.approx(shown["diameter_mm"][n], abs=0.0051)
        assert sensor.psds[0].height != 0


#: What a user does: choose a design in the list, keep a part of an axis, choose a point.
ACTS = """<script>
addEventListener("load", () => setTimeout(() => {
  const rows = document.querySelectorAll("#list tbody tr");
  const told = {drawn: document.body.dataset.drawn, rows: rows.length};
  rows[2].click();
  told.row = document.getElementById("which").textContent;
  const radius = data.columns.filter(c => c.plotted).findIndex(c => c.label.startsWith("radius"));
  const values = data.columns.filter(c => c.plotted)[radius].values;
  const middle = [...values].sort((a, b) => a - b)[Math.floor(values.length / 2)];
  Plotly.restyle("axes", {[`dimensions[${radius}].constraintrange`]: [[0, middle]]}).then(() => {
    setTimeout(() => {
      told.kept = document.body.dataset.kept;
      told.below = values.filter(v => v <= middle).length;
      document.getElementById("matrix").emit("plotly_click", {points: [{pointNumber: 5}]});
      told.point = document.getElementById("which").textContent;
      told.yaml = document.getElementById("yaml").textContent;
      told.svg = document.querySelectorAll("#drawing svg line").length;
      document.body.dataset.told = JSON.stringify(told);
    }, 1500);
  });
}, 6000));
</script></html>"""


@needs_browser
@pytest.mark.slow
def test_a_browser_draws_the_page_and_brushing_and_clicks_work(written, tmp_path):
    folder, shown, texts = written
    acted = tmp_path / "acted.html"
    acted.write_text((folder / "page.html").read_text("utf-8").replace("</html>", ACTS), "utf-8")
    document = in_browser(acted, tmp_path / "profile")
    found = re.search(r'data-told="([^"]*)"', document)
    assert found, document[-2000:]
    told = json.loads(found.group(1).replace("&quot;", '"'))
    count = len(texts)
    assert int(told["drawn"]) == count
    assert told["rows"] == int((shown["kind"] != "other").sum())
    assert told["row"] == shown["title"][2]
    assert int(told["kept"]) == told["below"] < count
    assert told["point"] == shown["title"][5]
    assert told["yaml"] == texts[5]
    assert told["svg"] > 5


def test_a_drawing_has_the_head_and_its_dimensions():
    paper = facets.load("paper").sensor
    svg = drawing(paper)
    assert "head \u2300 500 mm" in svg
    assert "facet at 45\u00b0" in svg
    assert svg.count("<line") > 8
    skewed = drawing(facets.load("skewed").sensor)
    assert all(f"{letter}: R" in skewed for letter in "ABC")


def check_that_nothing_is_cut(page):
    """No table is wider than its place on a desk's screen, and no page than a telephone's."""
    from browser import CHROMIUM, Browser

    if CHROMIUM is None:
        return
    wider = "[...document.querySelectorAll('section')].filter(s => s.scrollWidth > s.clientWidth)"
    with Browser(f"file://{page}") as browser:
        browser.await_true(
            "document.readyState === 'complete' && !!document.querySelector('footer')"
        )
        for width in (360, 768, 1300, 1440):
            browser.send("Emulation.setDeviceMetricsOverride", width=width, height=1400,
                         deviceScaleFactor=1, mobile=False)  # fmt: skip
            wide = browser.ask("document.documentElement.scrollWidth")
            assert wide <= width
            assert width < 1000 or browser.ask(f"{wider}.length") == 0, browser.ask(
                f"{wider}.map(s => s.textContent.slice(0, 80))"
            )


@pytest.mark.slow
def test_a_report_tells_the_whole_story(tmp_path):
    (tmp_path / "mine.yaml").write_text(
        "extends: layout\noptimize:\n  starts: 1\n"
        "  variables: {inclination_deg: null, azimuth_b_deg: null, pitch_mrad: null}\n"
    )
    result = command("optimize", "mine.yaml", "--report", "new.html", "--certify", "10",
                     "-o", "new.yaml", cwd=tmp_path)  # fmt: skip
    assert result.returncode == 0, result.stderr
    text = (tmp_path / "new.html").read_text("utf-8")
    for part in ("Requirements", "What changes", "diameter of the head, mm", "<svg",
                 "after over before", "What limits the layout", "new.gltf", "proved"):  # fmt: skip
        assert part in text, part
    assert not re.search(r"\b(u|range)_\w+_(um|mm|u?rad|mrad)\b|\+- ", text)
    check_that_nothing_is_cut(tmp_path / "new.html")
    assert json.loads((tmp_path / "new.gltf").read_text())["asset"]["version"].startswith("2")
    lines = [line for line in (tmp_path / "new.yaml").read_text().splitlines() if line[:1] != "#"]
    assert "extends: mine.yaml" in lines
    assert len([line for line in lines if line]) <= 7
    assert any("+- 0.05" in line for line in lines)
    refused = command("explore", "layout", "--report", "page.txt", cwd=tmp_path)
    assert refused.returncode == 2
    assert ".html" in refused.stderr


#: What a label's box is: none may be cut, and none may lie on another.
BOXES = """(() => {
  const names = data.columns.filter(c => c.plotted).map(c => c.lines.join(""));
  const labels = [...document.querySelectorAll("#axes .axis-title, #axes .axis-extent-text, " +
    "#matrix .xtitle, #matrix .x2title, #matrix g[class*=title] text")];
  const page = document.documentElement.clientWidth;
  return {page, wide: document.documentElement.scrollWidth, names, boxes: labels
    .filter(l => l.textContent.trim()).map(l => {
      const b = l.getBoundingClientRect(), p = l.closest(".plot"), o = p.getBoundingClientRect();
      return {text: l.textContent, left: b.left + p.scrollLeft - o.left, top: b.top,
        right: b.right + p.scrollLeft - o.left, bottom: b.bottom, room: p.scrollWidth};
    })};
})()"""


@needs_browser
@pytest.mark.slow
def test_no_label_of_the_plots_is_cut_or_lies_on_another(written):
    from browser import Browser

    folder, _, _ = written
    with Browser("about:blank", webgl=True) as browser:
        for width in (360, 768, 1300, 1440):
            browser.send("Emulation.setDeviceMetricsOverride", width=width, height=1400,
                         deviceScaleFactor=1, mobile=False)  # fmt: skip
            browser.send("Page.navigate", url=f"file://{folder / 'page.html'}?{width}")
            browser.await_true(f"location.search === '?{width}' && document.body.dataset.drawn")
            check_labels(browser.ask(BOXES))


def check_labels(seen):
    assert seen["wide"] <= seen["page"]
    boxes = seen["boxes"]
    texts = [box["text"] for box in boxes]
    assert all(texts.count(name) > 1 for name in seen["names"][1:-1]), texts  # in both plots
    for n, box in enumerate(boxes):
        assert 0 <= box["left"] <= box["right"] <= box["room"], box
        for other in boxes[:n]:
            apart = (
                box["right"] <= other["left"] + 1
                or other["right"] <= box["left"] + 1
                or box["bottom"] <= other["top"] + 1
                or other["bottom"] <= box["top"] + 1
            )
            assert apart, (seen["page"], box, other)


def test_a_page_shows_each_design_in_one_set_of_numbers(written):
    """The table's head is the drawing's, in numbers that can be made."""
    _, shown, texts = written
    for n in range(1, len(texts)):
        radius = shown["radius_mm"][n]
        assert shown["head_mm"][n] == pytest.approx(2 * radius, rel=1e-12)
        assert f"radius_mm: {radius:g}" in texts[n]


def test_what_is_said_on_pages_is_in_words_with_units():
    from facets.pictures.wording import label, limit_in_words, lines_of, rows_in_words

    assert label("u_tx_um") == "uncertainty of shift in x, µm"
    assert label("azimuth_b_deg") == "azimuth B, deg"
    assert lines_of("diameter of the head, mm") == ["diameter of", "the head", "mm"]
    assert limit_in_words("radius_mm at its least") == "radius at its lower bound"
    assert rows_in_words([["u_roll_urad", "1.5"], ["psd.b.pitch_mrad", "+- 0.5, which"]]) == [
        ["uncertainty of roll, µrad", "1.5"],
        ["PSD B, pitch, mrad", "±0.5, which"],
    ]
