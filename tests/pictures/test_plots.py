"""Plots: no text on another, none too small in print, fonts embedded, nothing hidden or empty."""

from __future__ import annotations

import re
from itertools import combinations
from xml.etree import ElementTree

import figures
import numpy as np
import pytest
from commands import command
from figures import ALL, texts_of

from facets import InputError
from facets.core import THEMES, choose_style, chosen_style, use_style
from facets.pictures import style
from facets.pictures.motion import motion_picture

#: A column of a journal, inches, and the least size of text that journals take in it, points.
COLUMN, LEAST = 88 / 25.4, 5.0


@pytest.fixture(scope="module", params=list(ALL))
def picture(request):
    with use_style("paper"):
        yield ALL[request.param](), request.param


@pytest.mark.slow
def test_nothing_written_is_too_small_or_lies_on_another(picture):
    drawing, name = picture
    found = texts_of(drawing)
    assert found
    shrunk = COLUMN / drawing.get_size_inches()[0]
    for text, box in found:
        assert min(shrunk, 1.0) * text.get_fontsize() >= LEAST, text.get_text()
        assert box.x0 >= -1, (name, text.get_text())
        assert box.y0 >= -1, (name, text.get_text())
        assert box.x1 <= drawing.bbox.x1 + 1, (name, text.get_text())
        assert box.y1 <= drawing.bbox.y1 + 1, (name, text.get_text())
    upright = [(text, box) for text, box in found if text.get_rotation() % 90 == 0]
    for (one, first), (other, second) in combinations(upright, 2):
        across = min(first.x1, second.x1) - max(first.x0, second.x0)
        down = min(first.y1, second.y1) - max(first.y0, second.y0)
        assert min(across, down) < 1, (name, one.get_text(), other.get_text())


def test_two_texts_on_one_another_are_found():
    drawing = style.figure(4, 3)
    panel = drawing.subplots()
    panel.text(0.5, 0.5, "0.681")
    panel.text(0.52, 0.5, "0.466")
    boxes = {text.get_text(): box for text, box in texts_of(drawing)}
    assert boxes["0.681"].x1 > boxes["0.466"].x0


@pytest.mark.parametrize("kind", ["pdf", "svg"])
@pytest.mark.slow
def test_text_stays_text_in_vector_files(tmp_path, kind):
    path = tmp_path / f"layout.{kind}"
    style.save(figures.layout(), path)
    data = path.read_bytes()
    if kind == "pdf":
        assert b"/Type3" not in data
        assert b"/FontFile2" in data  # a TrueType font, embedded
        return
    root = ElementTree.fromstring(data)
    written = {"".join(node.itertext()) for node in root.iter("{http://www.w3.org/2000/svg}text")}
    assert "0.681 → 0.466 µm" in written
    assert "after over before" in written


@pytest.mark.installed
@pytest.mark.parametrize("name", THEMES)
def test_a_style_has_its_ground_and_its_dots(tmp_path, name):
    from matplotlib.image import imread

    with use_style(name):
        path = tmp_path / "plan.png"
        drawing = figures.plan()
        style.save(drawing, path)
        pixels = imread(path)
        ground = tuple(int(THEMES[name].ground[n : n + 2], 16) for n in (1, 3, 5))
        assert tuple(np.round(255 * pixels[0, 0, :3]).astype(int)) == ground
        assert pixels.shape[1] == round(style.DOTS[name] * drawing.get_size_inches()[0])
        for hue in THEMES[name].detectors.values():  # the three detectors, each in its own
            there = np.array([int(hue[n : n + 2], 16) / 255 for n in (1, 3, 5)])
            assert (np.abs(pixels[..., :3] - there).max(axis=-1) < 0.02).sum() > 50, hue


@pytest.mark.parametrize("high", np.geomspace(2, 1e4, 20))
def test_numbers_of_a_logarithmic_axis_have_room(high):
    ticks = np.log(style.log_ticks(1.7, 1.7 * high))
    assert len(ticks) >= 2
    assert np.diff(ticks).min() > 0.085 * np.log(high)


def test_a_style_is_chosen_and_ends():
    before = chosen_style()
    with use_style("dark") as hues:
        assert chosen_style() == "dark"
        assert style.rules()["figure.facecolor"] == hues.ground
    assert chosen_style() == before
    with pytest.raises(ValueError, match="paper, screen, dark"):
        choose_style("pink")


def test_truth_and_estimate_are_both_seen():
    """The truth is broader than the estimate and lies below it."""
    drawing = motion_picture([figures.segment()])
    truth, estimate = drawing.axes[0].lines[:2]
    assert truth.get_linewidth() > 3 * estimate.get_linewidth()
    assert truth.get_zorder() <= estimate.get_zorder()


def hue_in(drawing, axes, hue):
    """How many dots of a panel have nearly a hue."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(drawing)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[..., :3].astype(int)
    box = axes.get_window_extent()
    part = pixels[len(pixels) - int(box.y1) : len(pixels) - int(box.y0), int(box.x0) : int(box.x1)]
    there = np.array([int(hue[n : n + 2], 16) for n in (1, 3, 5)])
    return int((np.abs(part - there).max(axis=-1) < 40).sum())


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.slow
def test_few_samples_are_seen(count):
    drawing = motion_picture([figures.segment(count=count)])
    hues = THEMES[chosen_style()]
    place, error = drawing.axes[:2]
    assert hue_in(drawing, place, hues.axes["tx"]) > 5
    assert hue_in(drawing, error, hues.axes["tx"]) > 5


def test_a_motion_of_which_nothing_is_solved_says_so():
    drawing = motion_picture([figures.segment(count=50, solved=False)])
    said = [text.get_text() for text, _ in texts_of(drawing)]
    assert said.count("no sample could be solved") == 6
    assert "not solved" in said
    assert hue_in(drawing, drawing.axes[0], THEMES[chosen_style()].alarm) > 20


def test_a_band_holds_every_sample_and_keeps_gaps():
    time = np.arange(1000.0)
    values = np.sin(time / 40)
    values[437] = 9.0
    values[600:700] = np.nan
    found = style.band(time, values, 50)
    assert len(found.time) == 50
    assert np.nanmax(found.high) == 9.0
    assert np.isnan(found.middle[31:34]).all()
    assert np.isfinite(found.middle[:29]).all()
    few = style.band(time[:7], values[:7], 50)
    np.testing.assert_array_equal(few.low, values[:7])
    np.testing.assert_array_equal(few.high, values[:7])


def test_the_hue_of_a_front_is_its_third_objective():
    drawing = figures.front()
    panel = drawing.axes[0]
    labels = {axes.get_ylabel() for axes in drawing.axes} | {panel.get_xlabel()}
    assert {
        "diameter of the head, mm",
        "uncertainty of roll, µrad",
        "range of roll, mrad",
    } <= labels
    table = figures.designs()
    known = np.isfinite(table["range_roll_mrad"])
    drawn = np.concatenate([part.get_offsets() for part in panel.collections])
    assert len(drawn) == known.sum()  # those without a range are no part of it
    values = np.concatenate([part.get_array() for part in panel.collections])
    np.testing.assert_allclose(np.sort(values), np.sort(table["range_roll_mrad"][known]))


@pytest.mark.slow
def test_noise_is_drawn_by_detector_and_axis():
    from facets.pictures.noise import deviations, group_channels, spectra

    channels = figures.noise_channels()
    assert list(group_channels(channels)) == [
        "place psi",
        "place zeta",
        "power",
        "shifts",
        "angles",
    ]
    hues = THEMES[chosen_style()]
    text = spectra("Spectra", group_channels(channels[:9])) + deviations(group_channels(channels))
    for hue in (*hues.detectors.values(), *(hues.axes[name] for name in ("tx", "yaw"))):
        assert hue.lower() in text, hue
    words = set(re.findall(r">([^<>]+)</text>", text))
    assert {"detector A", "shift in x", "frequency, Hz", "averaging time, s"} <= words


def test_a_name_that_is_no_picture_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"ends in \.png"):
        style.save(style.figure(3, 2), tmp_path / "plot.jpg")


def test_every_command_that_draws_takes_a_style():
    from importlib import import_module
    from inspect import signature

    from facets.cli import COMMANDS

    drawing = set()
    for name, module in COMMANDS.items():
        work = getattr(import_module(f"facets.cli.{module}"), name.replace("-", "_"), None)
        if work and "plot" in signature(work).parameters:
            drawing.add(name)
            assert "look" in signature(work).parameters, name
    assert {"simulate", "resolution", "calibrate"} <= drawing


def test_a_command_draws_in_the_style_asked_for(tmp_path):
    words = ("resolution", "paper", "--plot", "svg", "-d", "out")
    result = command(*words, "--style", "dark", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    text = (tmp_path / "out" / "budget.svg").read_text()
    assert f"fill: {THEMES['dark'].ground.lower()}" in text
    wrong = command(*words, "--style", "pink", cwd=tmp_path)
    assert wrong.returncode == 2
    assert "pink" in wrong.stderr
