"""Time of a first picture, and of each frame of a film."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from ..pictures.stills.render import Picture, PictureForm
from . import rivals

Row = dict[str, Any]


def drawing(quick: bool, seed: int) -> list[Row]:
    """Time views at 1200 x 900 and frames of a film at 720 x 480, after imports; a quick run draws
    a third of each width and height."""
    del seed  # the pictures contain no random number
    with Picture(rivals.SENSOR, np.zeros(8), PictureForm("mirror", (200, 200))) as picture:
        picture.image()  # imports, graphics
    sizes = {"both": (1200, 900), "rig": (1200, 900), "mirror": (1200, 900), "film": (720, 480)}
    shrink, frames = (3, 2) if quick else (1, 20)
    return [
        row(view, (width // shrink, height // shrink), frames)
        for view, (width, height) in sizes.items()
    ]


def row(name: str, size: tuple[int, int], frames: int) -> Row:
    view: Any = "both" if name == "film" else name
    state = np.zeros(8)
    start, work = time.perf_counter(), time.process_time()
    with Picture(rivals.SENSOR, state, PictureForm(view, size)) as picture:
        picture.image()
        first, first_work = time.perf_counter() - start, time.process_time() - work
        start, work = time.perf_counter(), time.process_time()
        for n in range(frames):
            state[5] = 1e-3 * n
            picture.move(state)
            picture.image()
        each = (time.perf_counter() - start) / frames
        each_work = (time.process_time() - work) / frames
    return {
        "view": name,
        "width": size[0],
        "height": size[1],
        "first_ms": 1e3 * first,
        "first_processor_ms": 1e3 * first_work,
        "frame_ms": 1e3 * each,
        "frame_processor_ms": 1e3 * each_work,
        "frames_per_s": 1 / each,
    }
