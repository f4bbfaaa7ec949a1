"""`facets render`: the sensor as a picture, a scene for a browser, or a film."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from . import completion
from .console import load_config
from .options import ConfigName, Look, Style
from .places import state_of

if TYPE_CHECKING:
    from facets.config import Config


class View(StrEnum):
    both = "both"
    rig = "rig"
    mirror = "mirror"
    detector = "detector"
    cutaway = "cutaway"
    exploded = "exploded"
    range = "range"
    trail = "trail"


Output = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--output",
        help="png; html, a page to play with; gltf, to be turned; mp4 or gif with --motion or "
        "--recording; svg or pdf with --spots or --plan.  [default: results/CONFIG-WHAT.png]",
    ),
]
State = Annotated[
    str | None,
    typer.Option(
        help="The state: tx_mm=0.1,yaw_mrad=5; the rest is zero.",
        autocompletion=completion.assignments(completion.state_names),
    ),
]
Views = Annotated[
    View,
    typer.Option(
        help="both: the rig, and magnified the mirror's point and the detectors' faces; one of "
        "these; cut open; taken apart; the range of the mirror's place; the trail of a motion."
    ),
]
Spots = Annotated[bool, typer.Option("--spots", help="The detectors' faces, as Fig. 2.")]
Track = Annotated[bool, typer.Option("--track", help="The beam follows the mirror, in a range.")]
Larger = Annotated[
    float | None,
    typer.Option(
        "--exaggerate",
        min=1,
        help="How many times larger a film's motion is drawn.  [default: as far as all spots stay "
        "on their detectors]",
    ),
]


class Shape(NamedTuple):
    """How a picture is drawn: its view, its size in pixels, and its style."""

    view: Any
    size: tuple[int, int]
    style: str


def render(
    config: ConfigName,
    output: Output = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an older file.")] = False,
    at: State = None,
    view: Views = View.both,
    spots: Spots = False,
    plan: Annotated[bool, typer.Option("--plan", help="From above, as Fig. 3.")] = False,
    motion: Annotated[
        str | None,
        typer.Option(
            help="A film of this motion, or its trail with --view trail.",
            autocompletion=completion.motions,
        ),
    ] = None,
    recording: Annotated[
        Path | None, typer.Option(help="A film, or the trail, of a recording's poses.")
    ] = None,
    track: Track = False,
    frames: Annotated[int, typer.Option(min=2, help="Of a film.")] = 120,
    rate: Annotated[float, typer.Option(min=1, max=60, help="Of a film, frames per second.")] = 30,
    exaggerate: Larger = None,
    width: Annotated[
        int | None,
        typer.Option(min=200, max=8000, help="Pixels.  [default: 1200; of a film 720]"),
    ] = None,
    height: Annotated[
        int | None,
        typer.Option(min=200, max=8000, help="Pixels.  [default: 900; of a film 480]"),
    ] = None,
    style: Style = Look.screen,
    show: Annotated[bool, typer.Option("--show", help="In a window, to be turned.")] = False,
) -> None:
    """Render the sensor at a state: the rig, the point of the mirror, and the light in it.

    All light is made of the model's own rays. Without a display it renders off-screen.
    """
    from facets.core.errors import InputError
    from facets.files import tables

    settings = load_config(config)
    moves = motion is not None or recording is not None
    flat, film = spots or plan, moves and view is not View.trail
    if (spots and plan) or (flat and moves) or (motion and recording):
        raise InputError("give one of --spots, --plan, --motion, --recording")
    if view is View.trail and not moves:
        raise InputError("a trail is that of a motion: give --motion or --recording")
    if film and view in (View.cutaway, View.exploded, View.range):
        raise InputError(f"--view {view.value} shows the rig at rest; a film needs another view")
    path = output or Path("results") / f"{settings.name}-{name_of(spots, plan, film, view)}"
    check_ending(path, flat, film)
    tables.refuse_to_overwrite([] if show else [path], force)
    state = state_of(at)
    usual = (720, 480) if film else (1200, 900)
    shape = Shape(view.value, (width or usual[0], height or usual[1]), style.value)
    if flat:
        draw_flat(settings, state, spots, path)
    elif film:
        states = film_states(settings, motion, recording, frames)
        shoot(settings, states, shape, path, rate, exaggerate)
    elif show:
        from facets.pictures import render as pictures

        pictures.show(settings.sensor, state)
    else:
        more = extras(settings, view, motion, recording, track)
        draw(settings, state, shape, path, more)
    if not show:
        typer.echo(f"{path}")


def name_of(spots: bool, plan: bool, film: bool, view: View) -> str:
    if film:
        return "film.mp4"
    if spots or plan:
        return "spots.png" if spots else "plan.png"
    return "rig.png" if view is View.both else f"{view.value}.png"


def check_ending(path: Path, flat: bool, film: bool) -> None:
    from facets.core.errors import InputError
    from facets.pictures.render import MOVIES, PICTURES, SCENES
    from facets.pictures.style import ENDINGS

    allowed = ENDINGS if flat else MOVIES if film else (*PICTURES, *SCENES)
    if path.suffix.lower() not in allowed:
        kind = "2D" if flat else "a film" if film else "3D"
        raise InputError(f"{path}: its name must end in {', '.join(allowed)} for {kind}")


def extras(
    settings: Config, view: View, motion: str | None, recording: Path | None, track: bool
) -> dict[str, Any]:
    """What a view needs beside sensor and state."""
    from dataclasses import replace

    if view is View.range:
        return {"rules": replace(settings.range, tracking=True) if track else settings.range}
    if view is View.trail:
        return {"motion": film_states(settings, motion, recording, 600)}
    return {}


def draw(settings: Config, state: Any, shape: Shape, path: Path, more: dict[str, Any]) -> None:
    """A picture, a page or a scene, by the file's ending."""
    from facets.pictures.materials import theme_of
    from facets.pictures.render import Picture, save_scene

    if path.suffix.lower() == ".html":
        from facets.pictures.page.rig_page import write_rig_page

        write_rig_page(settings.sensor, settings.name, state, path, shape.view)
    elif path.suffix.lower() == ".gltf":
        save_scene(settings.sensor, state, path)
    else:
        theme = theme_of(shape.style)
        with Picture(
            settings.sensor, state, shape.view, shape.size, theme, settings.name, **more
        ) as picture:
            picture.save(path)


def draw_flat(settings: Config, state: Any, spots: bool, path: Path) -> None:
    from facets.pictures import style
    from facets.pictures.spots import plan_picture, spots_picture

    make = spots_picture if spots else plan_picture
    style.save(make(settings.sensor, state), path)


def film_states(settings: Config, motion: str | None, recording: Path | None, frames: int) -> Any:
    """States (n, 8) of a motion or a recording, as many as there are frames."""
    import numpy as np

    from facets.core.errors import InputError

    if recording is not None:
        from facets.core.names import STATE_COLUMNS, STATE_UNITS
        from facets.files.provenance import require_origin
        from facets.live.recording import meta_of, recorded_poses
        from facets.live.replay import recorded_config

        if recorded_config(recording).sensor != settings.sensor:
            remedy = "render it with the configuration that it was recorded with"
            require_origin(recording, meta_of(recording), settings, remedy)
        poses = recorded_poses(recording)
        if not poses or not (poses["status"] == 0).any():
            raise InputError(f"{recording}: holds no poses; see `facets recover`")
        good = poses["status"] == 0
        states = np.column_stack([poses[name][good] for name in STATE_COLUMNS]) * STATE_UNITS
    else:
        from facets.simulation.motion import named
        from facets.simulation.motion import states as states_of

        _, states = states_of(named(settings, motion or ""), np.random.default_rng(settings.seed))
    return states[np.linspace(0, len(states) - 1, frames).round().astype(int)]


def shoot(
    settings: Config, states: Any, shape: Shape, path: Path, rate: float, exaggerate: float | None
) -> None:
    """A film; says by how much its motion is drawn larger."""
    from rich.console import Console
    from rich.progress import Progress

    from facets.pictures import film
    from facets.pictures.magnification import motion_factor, times, turning_factor
    from facets.pictures.materials import theme_of
    from facets.pictures.render import Picture

    factor = exaggerate or motion_factor(settings.sensor, states)
    turning = turning_factor(factor * states) if exaggerate is None else 1.0
    console = Console(stderr=True)
    theme = theme_of(shape.style)
    with (
        Picture(
            settings.sensor, states[0], shape.view, shape.size, theme, settings.name
        ) as picture,
        Progress(console=console, transient=True, disable=not console.is_terminal) as progress,
    ):
        task = progress.add_task("rendering", total=len(states))
        film.write(picture, states, path, rate, factor, lambda: progress.advance(task), turning)
    if note := times(factor, turning):
        typer.echo(
            f"{note[0].upper()}{note[1:]}, so that it can be seen; the film says so.", err=True
        )
