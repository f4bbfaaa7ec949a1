"""`facets render`: the sensor as a picture, a scene for a browser, or a film."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from facets import files, pictures
from facets.core.errors import InputError

from .console import load_config
from .options import (
    At,
    ConfigName,
    Force,
    Look,
    Style,
    Track,
    motion_option,
    output_folder,
    output_option,
)
from .options.places import state_of
from .parts.drawings import draw, draw_flat, film_states, write_film

if TYPE_CHECKING:
    from facets.config import Config


class View(StrEnum):
    both = "both"
    rig = "rig"
    mirror = "mirror"
    detector = "detector"
    cutaway = "cutaway"
    range = "range"
    trail = "trail"


Output = Annotated[
    Path | None,
    output_option(
        "png picture; html page with controls; gltf scene; mp4 or gif film with --motion or "
        "--recording; svg or pdf drawing with --spots or --plan",
        "results/CONFIG-VIEW.png",
    ),
]
Views = Annotated[
    View,
    typer.Option(
        help="What to show: the whole rig (rig), the mirror's point magnified (mirror), the "
        "detectors' faces (detector), all three (both), the rig cut open (cutaway), the range of "
        "the mirror's position (range), or a motion's path (trail)."
    ),
]
Spots = Annotated[
    bool,
    typer.Option("--spots", help="Draw the light on the detectors' faces, as Fig. 2 of the paper."),
]
Plan = Annotated[
    bool, typer.Option("--plan", help="Draw the sensor from above, as Fig. 3 of the paper.")
]
Motion = Annotated[
    str | None, motion_option("a film of it is made, or its path drawn with --view trail")
]
Recording = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Recording to make a film of, or to draw the path of with --view trail.",
    ),
]
Frames = Annotated[int, typer.Option(min=2, help="Number of frames in a film.")]
FrameRate = Annotated[float, typer.Option(min=1, max=60, help="Frames per second of a film.")]
Larger = Annotated[
    float | None,
    typer.Option(
        "--exaggerate",
        min=1,
        help="Factor by which a film enlarges the motion.  [default: as large as possible with all "
        "spots on their detectors]",
    ),
]
Width = Annotated[
    int | None,
    typer.Option(
        min=200,
        max=8000,
        help="Width of the picture in pixels.  [default: 1200, or 720 for a film]",
    ),
]
Height = Annotated[
    int | None,
    typer.Option(
        min=200,
        max=8000,
        help="Height of the picture in pixels.  [default: 900, or 480 for a film]",
    ),
]


def render(
    config: ConfigName,
    output: Output = None,
    force: Force = False,
    at: At = None,
    view: Views = View.both,
    spots: Spots = False,
    plan: Plan = False,
    motion: Motion = None,
    recording: Recording = None,
    track: Track = False,
    frames: Frames = 120,
    frame_rate: FrameRate = 30,
    exaggerate: Larger = None,
    width: Width = None,
    height: Height = None,
    style: Style = Look.screen,
) -> None:
    """Draw the sensor as a picture, a page, a 3D scene or a film.

        facets render paper --at yaw_mrad=5
        facets render paper -o rig.html

    The rays and spots are computed by the model. --at gives the pose of the mirror, and with bx_mm
    and by_mm the position of the beam. --track applies to --view range. Works without a display.
    """
    settings = load_config(config)
    is_flat, is_film = spots or plan, bool(motion or recording) and view is not View.trail
    refuse_together(view, motion, recording, [spots, plan])
    path = output_folder(output, settings.name, name_of(spots, plan, is_film, view))
    check_ending(path, is_flat, is_film)
    files.tables.refuse_to_overwrite([path], force)
    state = state_of(at)
    theme = pictures.materials.theme_of(style.value)
    form = pictures.render.PictureForm(
        view.value, size_of(width, height, is_film), theme, settings.name
    )
    if is_flat:
        draw_flat(settings, state, spots, path)
    elif is_film:
        states = film_states(settings, motion, recording, frames)
        write_film(settings, states, form, path, frame_rate, exaggerate)
    else:
        draw(settings, state, form, path, extras(settings, view, motion, recording, track))
    print(f"{path}")


def refuse_together(
    view: View, motion: str | None, recording: Path | None, drawings: list[bool]
) -> None:
    """Raise `InputError` for options that exclude each other."""
    moves = motion is not None or recording is not None
    if sum([*drawings, motion is not None, recording is not None]) > 1:
        raise InputError("give one of --spots, --plan, --motion, --recording")
    if view is View.trail and not moves:
        raise InputError("--view trail draws the path of a motion: give --motion or --recording")
    if moves and view in (View.cutaway, View.range):
        raise InputError(f"--view {view.value} shows the rig at rest; a film needs another view")


def size_of(width: int | None, height: int | None, is_film: bool) -> tuple[int, int]:
    """The width and height in pixels, by default smaller for a film."""
    usual = (720, 480) if is_film else (1200, 900)
    return width or usual[0], height or usual[1]


def name_of(spots: bool, plan: bool, film: bool, view: View) -> str:
    if film:
        return "film.mp4"
    if spots or plan:
        return "spots.png" if spots else "plan.png"
    return "rig.png" if view is View.both else f"{view.value}.png"


def check_ending(path: Path, flat: bool, film: bool) -> None:
    allowed = (
        pictures.style.ENDINGS
        if flat
        else pictures.render.MOVIES
        if film
        else (*pictures.render.PICTURES, *pictures.render.SCENES)
    )
    if path.suffix.lower() not in allowed:
        kind = "2D" if flat else "a film" if film else "3D"
        raise InputError(f"{path}: its name must end in {', '.join(allowed)} for {kind}")


def extras(
    settings: Config, view: View, motion: str | None, recording: Path | None, track: bool
) -> dict[str, Any]:
    """Arguments that a view needs in addition to sensor and state."""
    if view is View.range:
        return {"rules": replace(settings.range, tracking=True) if track else settings.range}
    if view is View.trail:
        return {"motion": film_states(settings, motion, recording, 600)}
    return {}
