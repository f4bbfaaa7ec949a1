"""Drawings of `facets render`: pictures, pages and scenes of a state, films of a motion."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from facets import files, live, pictures, simulation
from facets.core.errors import InputError
from facets.core.names import STATE_COLUMNS, STATE_UNITS

from ..console import show_progress

if TYPE_CHECKING:
    from facets.config import Config
    from facets.pictures.stills.render import PictureForm


def film_states(settings: Config, motion: str | None, recording: Path | None, frames: int) -> Any:
    """States (n, 8) of a motion or a recording, one for each frame."""
    import numpy as np

    if recording is not None:
        if live.recording.replay.recorded_config(recording).sensor != settings.sensor:
            remedy = "render the film with the configuration with which it was recorded"
            files.provenance.require_origin(
                recording, live.recording.reader.meta_of(recording), settings, remedy
            )
        poses = live.recording.pose_table.recorded_poses(recording)
        if not poses or not (poses["status"] == 0).any():
            raise InputError(
                f"{recording}: holds no poses; `facets replay --recover` solves its bytes"
            )
        good = poses["status"] == 0
        states = np.column_stack([poses[name][good] for name in STATE_COLUMNS]) * STATE_UNITS
    else:
        _, states = simulation.motion.states(
            simulation.motion.find_motion(settings, motion or ""),
            np.random.default_rng(settings.seed),
        )
    return states[np.linspace(0, len(states) - 1, frames).round().astype(int)]


def write_film(
    settings: Config,
    states: Any,
    form: PictureForm,
    path: Path,
    rate: float,
    exaggerate: float | None,
) -> None:
    """Write a film; print by how much its motion is enlarged."""
    factor = exaggerate or pictures.render.motion_factor(settings.sensor, states)
    turning = pictures.render.turning_factor(factor * states) if exaggerate is None else 1.0
    film = pictures.render.Film(states, rate, factor, turning)
    with (
        pictures.render.Picture(settings.sensor, states[0], form) as picture,
        show_progress("rendering") as on_progress,
    ):
        pictures.render.write_film(picture, film, path, on_progress)
    if note := pictures.render.factor_in_words(factor, turning):
        print(
            f"{note[0].upper()}{note[1:]}, so that it can be seen; the film says so.",
            file=sys.stderr,
        )


def draw(settings: Config, state: Any, form: PictureForm, path: Path, more: dict[str, Any]) -> None:
    """Draw a picture, a page or a scene, by the file's suffix."""
    if path.suffix.lower() == ".html":
        pictures.page.rig_page.write_rig_page(
            settings.sensor, settings.name, state, path, form.view, settings
        )
    elif path.suffix.lower() == ".gltf":
        pictures.render.save_scene(settings.sensor, state, path)
    else:
        with pictures.render.Picture(settings.sensor, state, form, **more) as picture:
            picture.save(path)


def draw_flat(settings: Config, state: Any, spots: bool, path: Path) -> None:
    make = pictures.spots.spots_picture if spots else pictures.spots.plan_picture
    pictures.style.save(make(settings.sensor, state), path)
