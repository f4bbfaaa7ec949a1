"""Plots: no text on another, none too small in print, fonts embedded, nothing hidden or empty."""

from itertools import combinations
from types import SimpleNamespace
from unittest.mock import patch
from xml.etree import ElementTree

import numpy as np
import pytest

import facets
from facets.characterization import Boundary
from facets.core import THEMES, chosen_style, use_style
from facets.pictures import lay_out, motion_picture, plan_picture, ranges_picture, style

#: A column of a journal, inches, and the least size of text that journals take in it, points.
COLUMN, LEAST = 88 / 25.4, 5.0
CONFIG = "extends: layout\noptimize: {starts: 1, variables: {radius_mm: [100, 260]}}\n"


def texts_of(picture):
    """Draw a figure and return each text with its bounding box in pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.text import Text

    canvas = FigureCanvasAgg(picture)
    lay_out(picture, 100)
    with patch.object(Text, "draw", autospec=True, side_effect=Text.draw) as draw:
        canvas.draw()
        drawn = [call.args[0] for call in draw.call_args_list]
        return [
            (text, Text.get_window_extent(text, canvas.renderer))
            for text in drawn
            if text.get_visible() and text.get_text().strip()
        ]


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        "simulate paper --motion multi-axis -d out --plot svg",
        "range-map paper --axes tx,ty -d out",
        "resolution paper -d out",
        "jacobian paper --states 1000 --no-search-worst -d out",
        "optimize my.yaml --certify 0 -o out.yaml",
        "explore layout --designs 32 -d out",
        "render paper --spots -o out.svg",
        "render paper --plan -o out.pdf",
    ],
)
def test_nothing_written_is_too_small_or_lies_on_another(words, run_in_process, tmp_path):
    from matplotlib.figure import Figure

    (tmp_path / "my.yaml").write_text(CONFIG)
    with patch.object(Figure, "savefig", autospec=True, side_effect=Figure.savefig) as save:
        assert run_in_process(*words.split())[0] == 0
    drawing = save.call_args.args[0]
    texts = texts_of(drawing)
    shrunk = COLUMN / drawing.get_size_inches()[0]
    for text, box in texts:
        assert min(shrunk, 1.0) * text.get_fontsize() >= LEAST, text
        assert (box.min >= -1).all(), text
        assert (box.max <= drawing.bbox.max + 1).all(), text
    upright = [(text, box) for text, box in texts if text.get_rotation() % 90 == 0]
    for (text, first), (other, second) in combinations(upright, 2):
        over = np.minimum(first.max, second.max) - np.maximum(first.min, second.min)
        assert over.min() < 1, (text, other)


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
def test_a_style_has_its_ground_and_its_hues(tmp_path, name):
    from matplotlib.image import imread

    with use_style(name):
        style.save(plan_picture(facets.Sensor(), np.zeros(8)), tmp_path / "plan.png")
    assert chosen_style() == "screen"
    pixels = np.round(255 * imread(tmp_path / "plan.png")[..., :3])
    assert (pixels[0, 0] == pixels_of(THEMES[name].ground)).all()
    for hue in THEMES[name].detectors.values():
        assert (np.abs(pixels - pixels_of(hue)).max(axis=-1) < 5).sum() > 50, hue


def test_maps_inside_ranges_have_one_scale_and_a_constant_is_written():
    places = np.linspace(-1, 1, 5)
    shape = np.stack([places, places**2], axis=1)
    edge = Boundary(("tx", "yaw"), np.zeros(6), shape, np.zeros(5, int))
    same, more, most = ((places, places, ends[0] + np.linspace(0, ends[1], 25).reshape(5, 5))
                        for ends in ((2.37299, 8e-5), (1, 2), (2, 4)))  # fmt: skip
    drawing = ranges_picture([edge] * 3, [same, more, most], "tx")
    images = [panel.collections[-1] for panel in drawing.axes[1:3]]
    assert [image.get_clim() for image in images] == [(1, 6), (1, 6)]
    words = [text.get_text() for text, _ in texts_of(drawing)]
    assert words.count("u(tx)\nis 2.37 µm\n\neverywhere\n") == words.count("u(tx), µm") == 1
    assert len(ranges_picture([edge], [same], "tx").axes) == 1  # without a scale of one colour


def test_a_motion_of_which_nothing_is_solved_says_so():
    nothing = np.full((50, 8), np.nan)
    solution = SimpleNamespace(state=nothing, uncertainty=nothing, converged=np.zeros(50, bool))
    segment = SimpleNamespace(
        name="", time=np.arange(50), truth=np.zeros((50, 8)), solution=solution,
        error=nothing[:, :6],
    )  # fmt: skip
    words = [text.get_text() for text, _ in texts_of(motion_picture([segment]))]
    assert words.count("no sample could be solved") == 6


def test_a_band_holds_every_sample_and_keeps_gaps():
    time = np.arange(1000.0)
    values = np.sin(time / 40)
    values[437] = 9.0
    values[600:700] = np.nan
    band = style.band(time, values, 50)
    assert band.high[21] == 9.0
    assert np.flatnonzero(np.isnan(band.middle)).tolist() == [30, 31, 32, 33, 34]


def test_a_command_draws_in_the_style_asked_for(run_in_process, tmp_path):
    words = ("render", "paper", "--plan", "-o", "plan.svg", "--style")
    assert run_in_process(*words, "dark")[0] == 0
    ground = THEMES["dark"].ground.lower()
    assert f"fill: {ground}" in (tmp_path / "plan.svg").read_text()
    status, _, errors = run_in_process(*words, "pink", "--force")
    assert status == 2
    assert "pink" in errors
