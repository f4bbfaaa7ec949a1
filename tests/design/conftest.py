"""What tests of several files look at: one optimisation by the command, with all that it writes."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pytest
from commands import command

#: Heads of which about half meet the requirements as the layout is, and an aim of one search.
LOOSE = """
extends: layout
calibrate:
  before: {psd_place_mm: 0.05, psd_turn_mrad: 2, facet_mrad: 0.5, beam_tilt_mrad: 0.5,
           beam_diameter_percent: 2, power_percent: 2, scale_percent: 0.5}
optimize:
  starts: 1
  limit: {tz_um: 2.4, roll_urad: 8, pitch_urad: 8, yaw_urad: 10}
"""


class Optimised(NamedTuple):
    """The folder of best.yaml, best.html and t.tex, and what was printed."""

    folder: Path
    printed: str


@pytest.fixture(scope="session")
def optimised(tmp_path_factory):
    """A layout with margins, so that 90 % of its heads meet the requirements."""
    folder = tmp_path_factory.mktemp("optimised")
    (folder / "loose.yaml").write_text(LOOSE + "  production: {yield_percent: 90}\n")
    result = command(
        "optimize", "loose.yaml", "-o", "best.yaml", "--report", "best.html", "--sheets", "t.tex",
        "--heads", "10", cwd=folder,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    return Optimised(folder, result.stdout)
