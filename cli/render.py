"""`facets render`: the sensor as a picture, a scene for a browser, or a film."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .console import load_config
from .options import ConfigName
from .places import state_of

if TYPE_CHECKING:
    from facets.config import Config


class View(StrEnum):
    both = "both"
    rig = "rig"
    mirror = "mirror"


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
    str | None, typer.Option(help="The state: tx_mm=0.1,yaw_mrad=5; the rest is zero.")
]
Spots = Annotated[bool, typer.Option("--spots", help="The detectors' faces, as Fig. 2.")]


def render(
    config: ConfigName,
    output: Output = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an older file.")] = False,
    at: State = None,
    view: Annotated[View, typer.Option(help="The rig, the mirror large, or both.")] = View.both,
    spots: Spots = False,
    plan: Annotated[bool, typer.Option("--plan", help="From above, as Fig. 3.")] = False,
    motion: Annotated[str | None, typer.Option(help="A film of this motion.")] = None,
    recording: Annotated[Path | None, typer.Option(help="A film of a recording's poses.")] = None,
    frames: Annotated[int, typer.Option(min=2, help="Of a film.")] = 60,
    rate: Annotated[float, typer.Option(min=1, max=60, help="Of a film, frames per second.")] = 15,
    width: Annotated[int, typer.Option(min=200, max=8000, help="Pixels.")] = 1200,
    height: Annotated[int, typer.Option(min=200, max=8000, help="Pixels.")] = 900,
    show: Annotated[bool, typer.Option("--show", help="In a window, to be turned.")] = False,
) -> None:
    """Render the sensor at a state: rig, mirror, beams, and the light on the detectors.

    All bodies are made of the model's own rays. Without a display it renders off-screen.
    """
    from facets.core.errors import InputError
    from facets.files import tables

    settings = load_config(config)
    flat, film = spots or plan, motion is not None or recording is not None
    if (spots and plan) or (flat and film) or (motion and recording):
        raise InputError("give one of --spots, --plan, --motion, --recording")
    path = output or Path("results") / f"{settings.name}-{name_of(spots, plan, film)}"
    check_ending(path, flat, film)
    tables.refuse_to_overwrite([] if show else [path], force)
    state = state_of(at)
    if flat:
        draw_flat(settings, state, spots, path)
    elif film:
        states = film_states(settings, motion, recording, frames)
        shoot(settings, states, view.value, (width, height), path, rate)
        if note := motion_note(states, settings.sensor, view):
            typer.echo(note, err=True)
    else:
        draw(settings, state, view.value, (width, height), None if show else path)
    if not show:
        typer.echo(f"{path}")


def name_of(spots: bool, plan: bool, film: bool) -> str:
    if film:
        return "film.mp4"
    return "spots.png" if spots else "plan.png" if plan else "rig.png"


def check_ending(path: Path, flat: bool, film: bool) -> None:
    from facets.core.errors import InputError
    from facets.pictures.render import MOVIES, PICTURES, SCENES
    from facets.pictures.style import ENDINGS

    allowed = ENDINGS if flat else MOVIES if film else (*PICTURES, *SCENES)
    if path.suffix.lower() not in allowed:
        kind = "2D" if flat else "a film" if film else "3D"
        raise InputError(f"{path}: its name must end in {', '.join(allowed)} for {kind}")


def draw(settings: Config, state: Any, view: Any, size: tuple[int, int], path: Path | None) -> None:
    if path is not None and path.suffix.lower() == ".html":
        from facets.pictures.page.rig_page import write_rig_page

        write_rig_page(settings.sensor, settings.name, state, path)
        return
    from facets.pictures.render import Picture

    picture = Picture(settings.sensor, state, view, size, interactive=path is None)
    if path is None:
        picture.plotter.show()
        return
    picture.save(path)
    picture.close()


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
        from facets.live.recording import recorded_poses

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


#: A motion of less than this share of what a film shows is not seen in it: a few pixels.
SEEN = 0.02


def motion_note(states: Any, sensor: Any, view: View) -> str:
    """What to say of a motion that is too small to be seen in its film, else nothing."""
    import numpy as np

    from facets.pictures.scene import rim_of

    span = float(np.ptp(states[:, :3], axis=0).max())
    turn = float(np.ptp(states[:, 3:6], axis=0).max())
    shown = 2 * max(psd.radius for psd in sensor.psds)
    if view is not View.rig:
        shown = 2 * rim_of(sensor)
    if max(span / shown, turn) >= SEEN:
        return ""
    return (
        f"The mirror moves by {1e3 * span:.3g} µm and turns by {1e3 * turn:.3g} mrad in this film, "
        f"whose picture is {shown:.3g} mm wide: too little to be seen. The pose is written in each "
        "frame, and `facets simulate` draws it over time."
    )


def shoot(
    settings: Config, states: Any, view: Any, size: tuple[int, int], path: Path, rate: float
) -> None:
    from rich.console import Console
    from rich.progress import Progress

    from facets.pictures.render import Picture

    picture = Picture(settings.sensor, states[0], view, size)
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("rendering", total=len(states))
        picture.film(path, states, rate, lambda: progress.advance(task))
    picture.close()
