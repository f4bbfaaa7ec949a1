"""Pictures: time to a first one, and to each frame of a film; and what is left out of a view."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from ..pictures import scene
from ..pictures.render import BODIES, Picture
from . import rivals

Row = dict[str, Any]


def drawing(quick: bool, seed: int) -> list[Row]:
    """Each view at 1200 x 900, after imports."""
    del seed  # nothing is drawn at random
    views = ("both", "rig", "mirror")
    Picture(rivals.SENSOR, np.zeros(8), "mirror", (200, 200)).close()  # imports, graphics
    return [row(view, 2 if quick else 30) for view in views]


def row(view: Any, frames: int) -> Row:
    state = np.zeros(8)
    start = time.perf_counter()
    picture = Picture(rivals.SENSOR, state, view)
    picture.plotter.screenshot(None, return_img=True)
    first = time.perf_counter() - start
    start = time.perf_counter()
    for n in range(frames):
        state[5] = 1e-3 * n
        picture.move(state)
        picture.plotter.render()
        picture.plotter.screenshot(None, return_img=True)
    each = (time.perf_counter() - start) / frames
    picture.close()
    whole = sum(len(body.points) for body in scene.rig(rivals.SENSOR, state))
    parts = BODIES if view == "both" else {view: BODIES[view]}
    points = sum(len(b.points) for make in parts.values() for b in make(rivals.SENSOR, state))
    return {
        "view": view,
        "first_ms": 1e3 * first,
        "frame_ms": 1e3 * each,
        "frames_per_s": 1 / each,
        "points": points,
        "of_all": points / whole,
    }
