"""Pictures of the documentation.

`python -m facets.experiments.studies.gallery docs/gallery [NAME ...]`
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import facets
from facets.core.motions import Sine
from facets.core.units import Floats
from facets.pictures import style
from facets.pictures.plots.spots import plan_picture, spots_picture
from facets.pictures.stills.render import (
    Film,
    Picture,
    PictureForm,
    motion_factor,
    turning_factor,
    write_film,
)
from facets.simulation.motion import states

CONFIG = facets.load("paper")
TILTED = np.array([0.08, 0.05, 0, 8e-3, 6e-3, 10e-3, 0, 0])
SIZE = (1200, 750)


def wander() -> Floats:
    """A motion in all six axes, (n, 8)."""
    amplitude = (0.06, 0.06, 0.06, 4e-3, 4e-3, 9e-3, 0, 0)
    cycles, phase = (2, 3, 1, 3, 2, 1, 0, 0), (0, 0.5, 0, 1, 0, 0.4, 0, 0)
    motion = Sine((0.0,) * 8, amplitude, cycles, phase, 600, 100.0)
    return states(motion, np.random.default_rng(1))[1]


def three_d(view: Any, theme: Any, state: Any = TILTED, size: Any = SIZE, **more: Any) -> Any:
    """Make a function that writes a three-dimensional picture to a file."""

    def write(path: Path) -> None:
        form = PictureForm(view, size, theme, "paper")
        with Picture(CONFIG.sensor, np.array(state), form, **more) as picture:
            picture.save(path)

    return write


def spots(path: Path) -> None:
    style.save(spots_picture(CONFIG.sensor, TILTED), path)


def plan(path: Path) -> None:
    style.save(plan_picture(CONFIG.sensor, np.zeros(8)), path)


def wobble(path: Path) -> None:
    """Write a film for a web page: small, and in few colours."""
    motion = 0.2 * wander()[::15]
    factor = motion_factor(CONFIG.sensor, motion)
    form = PictureForm("both", (600, 400), "dark", "paper")
    with Picture(CONFIG.sensor, motion[0], form) as picture:
        turning = turning_factor(factor * motion)
        write_film(picture, Film(motion, 12.5, factor, turning), path)


REST = np.zeros(8)
FOLLOWED = replace(CONFIG.range, tracking=True)
PICTURES: dict[str, Callable[[Path], None]] = {
    "rig.png": three_d("both", "dark", size=(1440, 900)),
    "rig-light.png": three_d("both", "light"),
    "mirror.png": three_d("mirror", "dark"),
    "detector.png": three_d("detector", "dark"),
    "cutaway.png": three_d("cutaway", "light", REST),
    "range.png": three_d("range", "dark", REST, rules=CONFIG.range),
    "range-track.png": three_d("range", "light", REST, rules=FOLLOWED),
    "trail.png": three_d("trail", "dark", REST, motion=wander()),
    "wobble.gif": wobble,
    "spots.png": spots,
    "plan.png": plan,
}


def main(folder: Path, *names: str) -> None:
    """Make all pictures, or those with these names."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, write in PICTURES.items():
        if not names or name in names:
            write(folder / name)
            print(folder / name)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
