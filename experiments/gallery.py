"""Pictures of the documentation: `python -m facets.experiments.gallery docs/gallery`."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import facets
from facets.pictures import style
from facets.pictures.render import Picture
from facets.pictures.spots import plan_picture, spots_picture
from facets.simulation.motion import states

TILTED = np.array([0.08, 0.05, 0, 8e-3, 6e-3, 10e-3, 0, 0])


def main(folder: Path) -> None:
    config = facets.load("bench")
    sensor = config.sensor
    for view, name in (("both", "rig"), ("mirror", "mirror")):
        picture = Picture(sensor, TILTED, view)  # type: ignore[arg-type]
        picture.save(folder / f"{name}.png")
        picture.close()
    style.save(spots_picture(sensor, TILTED), folder / "spots.png")
    style.save(plan_picture(sensor, np.zeros(8)), folder / "plan.png")
    _, motion = states(config.motions["wobble"], np.random.default_rng(1))
    picture = Picture(sensor, motion[0], "both", (720, 540))
    picture.film(folder / "wobble.gif", motion[::50], 10, lambda: None)
    picture.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
