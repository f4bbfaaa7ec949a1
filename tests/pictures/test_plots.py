"""Plots: no text on another, none too small in print, fonts embedded, nothing hidden or empty."""

from __future__ import annotations

from itertools import combinations
from xml.etree import ElementTree

import figures
import numpy as np
import pytest
from figures import ALL, texts_of

from facets.core import THEMES, chosen_style, use_style
from facets.pictures import style

#: A column of a journal, inches, and the least size of text that journals take in it, points.
COLUMN, LEAST = 88 / 25.4, 5.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_nothing_written_is_too_small_or_lies_on_another(name):
    with use_style("paper"):
        drawing = ALL[name]()
        texts = texts_of(drawing)
    assert texts
    shrunk = COLUMN / drawing.get_size_inches()[0]
    for text, box in texts:
        assert min(shrunk, 1.0) * text.get_fontsize() >= LEAST, text.get_text()
        assert (box.min >= -1).all(), text.get_text()
        assert (box.max <= drawing.bbox.max + 1).all(), text.get_text()
    upright = [(text.get_text(), box) for text, box in texts if text.get_rotation() % 90 == 0]
    for (words, first), (others, second) in combinations(upright, 2):
        over = np.minimum(first.max, second.max) - np.maximum(first.min, second.min)
        assert over.min() < 1, (words, others)


def test_text_stays_text_in_vector_files(tmp_path):
    for ending in ("pdf", "svg"):
        drawing = style.figure(3, 2)
        drawing.subplots().set_title("0.681 → 0.466 µm")
        style.save(drawing, tmp_path / f"drawing.{ending}")
    data = (tmp_path / "drawing.pdf").read_bytes()
    assert b"/Type3" not in data
    assert b"/FontFile2" in data  # a TrueType font, embedded
    root = ElementTree.parse(tmp_path / "drawing.svg")
    written = ["".join(node.itertext()) for node in root.iter("{http://www.w3.org/2000/svg}text")]
    assert "0.681 → 0.466 µm" in written


def pixels_of(hue):
    return np.array([int(hue[n : n + 2], 16) for n in (1, 3, 5)])


@pytest.mark.installed
@pytest.mark.parametrize("name", THEMES)
def test_a_style_has_its_ground_and_its_dots(tmp_path, name):
    from matplotlib.image import imread

    with use_style(name):
        drawing = figures.plan()
        style.save(drawing, tmp_path / "plan.png")
    assert chosen_style() == "screen"
    pixels = np.round(255 * imread(tmp_path / "plan.png")[..., :3])
    assert (pixels[0, 0] == pixels_of(THEMES[name].ground)).all()
    assert pixels.shape[1] == round(style.DOTS[name] * drawing.get_size_inches()[0])
    for hue in THEMES[name].detectors.values():  # the three detectors, each in its own
        assert (np.abs(pixels - pixels_of(hue)).max(axis=-1) < 5).sum() > 50, hue


def hue_in(drawing, axes, hue):
    """How many dots of a panel have nearly a hue."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(drawing)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[::-1, :, :3].astype(int)  # from below
    (left, low), (right, high) = axes.get_window_extent().get_points().astype(int)
    return int((np.abs(pixels[low:high, left:right] - pixels_of(hue)).max(axis=-1) < 40).sum())


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 5])
def test_few_samples_are_seen(count):
    drawing = figures.motion(figures.segment(count=count))
    for panel in drawing.axes[:2]:  # the place, and its error
        assert hue_in(drawing, panel, THEMES[chosen_style()].axes["tx"]) > 5


def test_a_motion_of_which_nothing_is_solved_says_so():
    drawing = figures.motion(figures.segment(count=50, solved=False))
    words = [text.get_text() for text, _ in texts_of(drawing)]
    assert words.count("no sample could be solved") == 6
    assert "not solved" in words
    assert hue_in(drawing, drawing.axes[0], THEMES[chosen_style()].alarm) > 20


def test_a_band_holds_every_sample_and_keeps_gaps():
    time = np.arange(1000.0)
    values = np.sin(time / 40)
    values[437] = 9.0
    values[600:700] = np.nan
    band = style.band(time, values, 50)
    assert len(band.time) == 50
    assert band.high[21] == 9.0
    assert np.flatnonzero(np.isnan(band.middle)).tolist() == [30, 31, 32, 33, 34]
    few = style.band(time[:7], values[:7], 50)
    np.testing.assert_array_equal([few.low, few.high], [values[:7]] * 2)


def test_the_hue_of_a_front_is_its_third_objective():
    drawing = figures.front()
    panel = drawing.axes[0]
    assert panel.get_xlabel() == "diameter of the head, mm"
    assert panel.get_ylabel() == "uncertainty of roll, µrad"
    assert "range of roll, mrad" in [axes.get_ylabel() for axes in drawing.axes]
    table = figures.designs()
    known = np.isfinite(table["range_roll_mrad"])
    # those without a range are no part of it
    values = np.concatenate([part.get_array() for part in panel.collections])
    np.testing.assert_allclose(np.sort(values), np.sort(table["range_roll_mrad"][known]))


def test_a_command_draws_in_the_style_asked_for(run_in_process, tmp_path):
    words = ("simulate", "paper", "--motion", "multi-axis", "--plot", "svg", "-d", "out")
    status, _, errors = run_in_process(*words, "--style", "dark")
    assert status == 0, errors
    text = (tmp_path / "out" / "motion.svg").read_text()
    assert f"fill: {THEMES['dark'].ground.lower()}" in text
    status, _, errors = run_in_process(*words, "--style", "pink")
    assert status == 2
    assert "pink" in errors
