"""Films of a motion under a camera that moves gently, as H.264 or as GIF."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...core.extras import require_extra
from ...core.units import Floats
from ...files.whole import Whole
from .camera import Camera
from .magnification import factor_in_words
from .materials import THEMES, rgb
from .render import Picture

OnProgress = Callable[[float, float], None]

#: How far the camera swings to either side, rad.
SWING_RAD = 0.20
#: The share of its distance by which the camera approaches in the middle.
NEARER_SHARE = 0.04
#: Colours of a GIF.
COLOURS = 64


def ease_camera(camera: Camera, share: float) -> Camera:
    """Return the camera at a share of a film: it swings to both sides, and is nearer in the middle.

    At the end it has its first place and speed, so that a film can be repeated.
    """
    angle = SWING_RAD * np.sin(2 * np.pi * share)
    near = 1 - NEARER_SHARE * (1 - np.cos(2 * np.pi * share)) / 2
    c, s = np.cos(angle), np.sin(angle)
    apart = np.subtract(camera.place, camera.focus)
    turned = near * np.array([c * apart[0] - s * apart[1], s * apart[0] + c * apart[1], apart[2]])
    return replace(camera, place=tuple(np.add(camera.focus, turned)))


@dataclass(frozen=True)
class Film:
    """A motion, state by state (n, 8), with its frames a second and its magnification `factor`.

    turning: further magnification of the head's rotation in the large picture; light has `factor`.
    """

    states: Floats
    rate: float
    factor: float
    turning: float = 1.0


def frames(picture: Picture, film: Film, on_progress: OnProgress) -> Iterator[Any]:
    """Yield the frames (h, w, 3), 0 to 255."""
    view = picture.view
    still = view.camera()
    view.larger, view.turning = film.factor, film.turning
    view.note = factor_in_words(film.factor, film.turning)
    count = len(film.states)
    for n, state in enumerate(film.states):
        view.camera = lambda n=n: ease_camera(still, n / count)  # type: ignore[method-assign, misc]
        picture.move(film.factor * state)
        yield picture.image()
        on_progress(n + 1, count)


def write(
    picture: Picture, film: Film, path: Path, on_progress: OnProgress = lambda done, whole: None
) -> None:
    """Write a film; a failure leaves no file.

    on_progress: takes the frames done and their number.
    """
    with Whole(path) as temporary:
        shown = frames(picture, film, on_progress)
        if path.suffix.lower() == ".gif":
            write_gif(shown, temporary, film.rate)
        else:
            write_h264(shown, temporary, film.rate)


def write_h264(shown: Iterator[Any], path: Path, rate: float) -> None:
    open_writer = require_extra("imageio", "a film").get_writer
    with open_writer(
        path, format="FFMPEG", fps=rate, codec="libx264", quality=8, macro_block_size=2,
        ffmpeg_log_level="error", output_params=["-movflags", "+faststart", "-f", "mp4"],
    ) as writer:  # fmt: skip
        for frame in shown:
            writer.append_data(frame)


def write_gif(shown: Iterator[Any], path: Path, rate: float) -> None:
    """Write all frames in the colours of the first and in the detectors' hues, since a GIF has few
    colours; the film repeats."""
    from PIL import Image

    first = Image.fromarray(next(shown))
    colours = first.quantize(COLOURS, method=Image.Quantize.MEDIANCUT).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([*colours[: 3 * COLOURS], *hue_ramps()])
    dither = Image.Dither.NONE
    pictures = [
        first.quantize(palette=palette, dither=dither),
        *(Image.fromarray(f).quantize(palette=palette, dither=dither) for f in shown),
    ]
    pictures[0].save(
        path, format="gif", save_all=True, append_images=pictures[1:], loop=0,
        duration=round(1000 / rate / 10) * 10, optimize=True,
    )  # fmt: skip


def hue_ramps() -> list[int]:
    """The detectors' hues from dark to bright, which few pixels have and which must be distinct."""
    levels: list[int] = []
    for theme in THEMES.values():
        for hue in (*theme.hues, "#FFFFFF"):
            for share in (0.25, 0.4, 0.55, 0.7, 0.85, 1.0):
                levels += [round(255 * share * part) for part in rgb(hue)]
    return levels
