"""Whoever follows the README and the guides sees every command succeed and print what they show."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import pytest
from pages import DOCS, GUIDES, ROOT, agree, shape, steps
from reader import Reader

import facets

#: Commands of the guides that another test runs; the guides show nothing of what they print.
ELSEWHERE = (
    "facets range-map paper --axes tx,ty --folder results/paper-range",  # of the README
    "facets resolution paper --folder results/paper-resolution",  # of its page
    "facets render paper -o results/paper.png",  # of the README, with another sensor
    "facets jacobian head.yaml --certify",  # tests/cli/test_jacobian.py, with another sensor
    "facets jacobian fig4-copy.yaml --states 20000",
    "facets resolution fig4-copy.yaml",
    "facets jacobian paper --certify --folder results/proof",  # tests/proof
    "python -m facets.experiments.check_certificate results/proof/certificate.json",
    "facets resolution probe.yaml --coverage 0.95 --trials 20000 --folder trust",
    "facets reproduce all --quick --folder results/paper-report",  # tests/experiments
)
#: What is typed in place of what would take long.
SHORTER = {
    "-o results/rig.png": "-o results/rig.png --width 320 --height 240",
    "--designs 1000": "--designs 20",
    "rate=250": "rate=100",
    "--samples 3300": "--samples 1320",
    "--samples 120000": "--samples 8000",
    "--resolution-hz 0.15": "--resolution-hz 1.5",
    "--seconds 8": "--seconds 4",
}
#: Pages of commands whose examples need no second terminal, in an order in which each finds
#: the files of earlier ones: those of the README's commands, and others.
OF_THE_README = ("simulate", "solve", "range-map")
LONG = ("resolution", "optimize", "render", "tolerances", "jacobian", "calibrate", "rezero", "axis",
        "explore", "reproduce")  # fmt: skip


def shorten(step):
    for long, short in SHORTER.items():
        step = replace(step, block=step.block.replace(long, short))
    return step


@pytest.fixture(scope="module")
def reader(tmp_path_factory):
    """Who has followed the README, but for its Python, which `test_documentation.py` runs."""
    reader = Reader(tmp_path_factory.mktemp("reader"))
    for step in steps(ROOT / "README.md"):
        if step.language != "python":
            reader.follow(shorten(step))
    return reader


def show(reader, page, most=None):
    """Run the first examples of a command's page; each line that they show has to be printed."""
    examples = steps(DOCS / f"commands/{page}.md")
    for step in [step for step in examples if step.language in ("yaml", "console")][:most]:
        if step.language == "yaml":
            reader.follow(step)
            continue
        reader.printed = []
        lines = step.block.splitlines()
        for line in lines:
            if line.startswith("$ "):
                reader.type(line[2:])
        reader.compare(line for line in lines if not line.startswith("$ "))


def test_the_readme_and_the_pages_of_its_commands_show_what_is_printed(reader):
    for page in OF_THE_README:
        show(reader, page)


@pytest.mark.slow
def test_the_page_of_resolution_shows_what_is_printed(reader):
    """But for a million trials, which are a study."""
    show(reader, "resolution", most=1)


@pytest.mark.study
def test_the_pages_of_long_commands_show_what_is_printed(reader):
    results = reader.folder / "results"
    for path in (*results.glob("better.*"), results / "rig.png"):  # which the pages write anew
        path.unlink()
    for page in LONG:
        show(reader, page)


@pytest.mark.slow
def test_the_guides_can_be_followed_in_one_folder(tmp_path):
    """By several readers at once, because most of them wait for recordings."""
    with ThreadPoolExecutor(len(GUIDES)) as readers:
        for _ in readers.map(partial(follow, folder=tmp_path), GUIDES):
            pass
    check_calibration(tmp_path)
    assert "breaks a limit" not in (tmp_path / "head.yaml").read_text()


def follow(page, folder):
    reader = Reader(folder)
    reader.outputs = {line: [] for line in ELSEWHERE}
    for step in steps(page):
        reader.follow(shorten(step))


def check_calibration(folder):
    """The calibrated sensor describes the rig as it was built, which the drawn one does not."""
    built, drawn, calibrated = (
        facets.load(folder / f"{name}.yaml").sensor for name in ("built", "quiet", "calibrated")
    )
    readings = facets.readings(built, [0.05, -0.05, 1.0, 0.003, -0.003, 0.01, 0, 0])
    before, after = (
        facets.solve(sensor, readings, beam="known").residual for sensor in (drawn, calibrated)
    )
    assert after < 0.01 * before
    assert before > 100


def test_a_line_is_compared_but_for_its_numbers():
    assert shape(" tx  -0.274  1.2e-3  5 %") == shape(" tx     3  +4 12 %")
    assert shape(" tx  0.1  um") != shape(" tx  0.1  mm")
    assert shape(" tx  0.1  0.2") != shape(" tx  0.1")
    assert agree(" tx 1,020 5 ...", " tx 1,000 6 7", 0.02)
    assert not agree(" tx 1,020 8", " tx 1,000 5", 0.02)
