"""The drawing of the folders is that of the code; `make layers` holds the code to its contract."""

from pathlib import Path

from facets.experiments.studies import draw_packages

ROOT = Path(__file__).parents[2]
REDRAW = "run: python -m facets.experiments.studies.draw_packages docs/packages.svg"


def test_the_committed_drawing_shows_the_arrows_of_the_code():
    drawn = draw_packages.arrows_of((ROOT / "docs" / "packages.svg").read_text())
    assert drawn == draw_packages.arrows(), REDRAW
