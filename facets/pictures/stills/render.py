"""The sensor in three dimensions: a picture, a film's frame, or a scene for other programs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from ...core.closing import ClosedAtExit
from ...core.extras import require_extra
from ...core.names import DETECTORS
from ...core.sensor import Sensor
from ...core.units import Floats
from ...files.whole import Whole
from ...model.arrays import half_sizes, readings
from ...optics.vectors import rotation
from ..style import style_context
from . import scene, views
from .camera import Camera
from .exposure import Exposure, add_floor, expose
from .materials import THEMES, Material, ThemeName
from .rig import LASER_HEIGHT, RigModel
from .scene import PosedSensor
from .sheet import DrawingSheet, round_down
from .solids import RigPart, Solid, bands
from .studio import Shot, Studio
from .views import factor_in_words as factor_in_words, state_in_words

OnProgress = Callable[[float, float], None]
ViewName = Literal["both", "rig", "mirror", "detector", "cutaway", "range", "trail"]
#: File name endings: pictures, scenes that can be turned, films.
PICTURES, SCENES, MOVIES = (".png",), (".gltf", ".html"), (".mp4", ".gif")

#: Angle by which the camera of a film swings to either side, rad, and fraction of its distance by
#: which it approaches in the middle.
SWING_RAD, APPROACH = 0.20, 0.04
#: Distance of a drawn spot in front of its detector, mm, without which the two would intersect.
SPOT_OFFSET_MM = 0.02

#: Limits of a magnified motion: distance of a spot's centroid from its detector's axes, over half
#: the detector's size; and fraction of the light on each detector.
MAX_OFFSET, MIN_POWER = 0.80, 0.06
#: Largest rotation of a head in a picture, rad.
MAX_TURN_RAD = 0.3

VIEWS: dict[str, Callable[..., views.SceneView]] = {
    "both": views.CombinedView,
    "rig": views.RigView,
    "mirror": views.MirrorView,
    "detector": views.DetectorView,
    "cutaway": views.CutawayView,
    "range": views.RangeView,
    "trail": views.TrailView,
}


@dataclass(frozen=True)
class PictureForm:
    """View, size and style of a picture.

    size: width and height, pixels.  title: beginning of the caption.
    """

    view: ViewName = "both"
    size: tuple[int, int] = (1200, 900)
    theme: ThemeName = "dark"
    title: str = ""


class Picture(ClosedAtExit):
    """A view of the sensor at a state that can be changed.

    inputs: further inputs of a view: `rules` of a range, `motion` (n, 8) of a trail.
    """

    def __init__(
        self, sensor: Sensor, state: Floats, form: PictureForm | None = None, **inputs: Any
    ) -> None:
        self.form = form or PictureForm()
        self.theme, rig = THEMES[self.form.theme], RigModel(sensor)
        self.laser = LASER_HEIGHT * rig.unit
        self.view = VIEWS[self.form.view](rig, self.theme, self.form.size, **inputs)
        self.studio = Studio(self.view.parts, self.theme, self.view.extra)
        if self.view.look.floor:
            add_floor(self.studio, self.view.points(), (rig.floor - 14) * rig.unit, self.theme)
        self.move(state)

    def move(self, state: Floats, factor: float = 1.0, turning: float = 1.0) -> None:
        """Move to another state (8,), mm and rad, and draw it `factor` times as large.

        turning: additional magnification of the head's rotation about its apex, in the main
        picture only.
        """
        self.state, self.factor, self.turning = np.asarray(state, float), factor, turning
        self.view.move(factor * self.state)

    def take(
        self, camera: Camera, assemblies: Collection[str], state: Floats, turning: float
    ) -> Shot:
        """Render parts at a state; the head's angles are multiplied by `turning`."""
        self.studio.move(state, turning)
        return self.studio.take(camera, assemblies)

    def expose(self, camera: Camera, look: Exposure, turning: float = 1.0) -> Floats:
        """Compute the picture of parts and light, (h, w, 3), 0 to 1."""
        shot = self.take(camera, look.assemblies, self.view.state, turning)
        picture = expose(self.view.posed, shot, self.theme, look, self.laser)
        for ghost in look.ghosts:
            parts = self.take(camera, ghost.assemblies, ghost.state, 1.0)
            opacity = np.where(parts.depth < shot.depth, ghost.front, ghost.behind)[..., None]
            picture = picture * (1 - opacity * parts.cover[..., None]) + opacity * parts.colour
        return picture

    def image(self, camera: Camera | None = None) -> Any:
        """Return the picture (h, w, 3), 0 to 255; by default, as the view's camera sees it."""
        with style_context(text__hinting="none"):  # letters have the width that is measured
            return self.annotate(camera or self.view.camera)

    def annotate(self, camera: Camera) -> Any:
        """Draw the picture that a camera sees, with its caption, insets and labels."""
        view = self.view
        sheet = DrawingSheet(self.expose(camera, view.look, self.turning), self.theme)
        note = factor_in_words(self.factor, self.turning) or view.note
        words = " \u00b7 ".join(part for part in (self.form.title, view.what, note) if part)
        sheet.caption([words, state_in_words(self.state)] if view.has_state else [words])
        if view.scale is not None:
            sheet.scale_bar(camera.pixel, view.width, view.scale)
        if view.legend:
            sheet.legend(view.legend_title, view.legend)
        for inset in view.insets():
            sheet.paste(inset, self.expose(inset.camera, inset.look), camera)
        for label in view.labels():
            sheet.draw(label, camera)
        return sheet.pixels()

    def save(self, path: Path) -> None:
        """Write a PNG; a failure leaves no partial file."""
        from PIL import Image

        with Whole(path) as temporary:
            Image.fromarray(self.image()).save(temporary, format="png", optimize=True)

    def close(self) -> None:
        self.studio.close()


# --- scenes for other programs: parts, and light as bodies ---------------------------------------


def light_bodies(posed: PosedSensor, length: float) -> list[RigPart]:
    """Make surfaces of the beam, from a length (mm) above the apex, the sub-beams and the spots."""
    theme = THEMES["light"]
    back = -np.array(posed.geometry.direction)
    bodies, feet = [], []
    for k, hue in enumerate(theme.hues):
        start, end = scene.rims(posed, k)
        if not len(start):
            continue
        feet.append(scene.array(posed.facet_points(k, scene.cut(posed, k)[-1])))
        material = Material(hue, clear=0.5, even=True)
        bodies.append(RigPart(f"sub-beam {DETECTORS[k]}", "light", material, bands([start, end])))
        spot = end - SPOT_OFFSET_MM * np.array(posed.geometry.axes[k][0])
        face = Solid(spot, [list(range(len(spot)))])
        bodies.append(RigPart(f"spot {DETECTORS[k]}", "light", Material(hue, even=True), face))
    if feet:
        foot = np.concatenate(feet)
        top = foot + ((length + posed.at.apex[2] - foot[:, 2]) / back[2])[:, None] * back
        material = Material(theme.beam, clear=0.5, even=True)
        bodies.append(RigPart("beam", "light", material, bands([foot, top])))
    return bodies


def save_scene(sensor: Sensor, state: Floats, path: Path) -> None:
    """Write a glTF file: the rig's parts with their materials, and the light as bodies."""
    rig, posed = RigModel(sensor), PosedSensor.from_state(sensor, state)
    studio = Studio([*rig.parts(), *light_bodies(posed, 120)], THEMES["light"])
    studio.move(state)
    studio.plotter.camera_position = [(430, -540, 330), (0, 0, 0), (0, 0, 1)]
    studio.plotter.reset_camera()
    with Whole(path) as temporary, TemporaryDirectory() as folder:
        plain = Path(folder) / "scene.gltf"  # VTK opens no name that is not UTF-8
        studio.plotter.export_gltf(str(plain))
        copyfile(plain, temporary)
    studio.close()


# --- films ---------------------------------------------------------------------------------------


def swing_camera(camera: Camera, phase: float) -> Camera:
    """Move the camera for a phase of a film, 0 to 1: to both sides, and nearer in the middle.

    At the end the camera has its first place and speed, so that a film can be repeated.
    """
    angle = SWING_RAD * np.sin(2 * np.pi * phase)
    approach = APPROACH * (1 - np.cos(2 * np.pi * phase)) / 2
    direction = np.array(rotation(0.0, 0.0, angle), float) @ np.asarray(camera.direction, float)
    return replace(camera, direction=direction, height=(1 - approach) * camera.height)


@dataclass(frozen=True)
class Film:
    """A motion: states (n, 8), frames per second, and the magnification of the motion.

    turning: additional magnification of the head's rotation in the main picture.
    """

    states: Floats
    rate: float
    factor: float
    turning: float = 1.0


def film_frames(picture: Picture, film: Film, on_progress: OnProgress) -> Iterator[Any]:
    """Draw the frames of a film, (h, w, 3), 0 to 255."""
    still, count = picture.view.camera, len(film.states)
    for n, state in enumerate(film.states):
        picture.move(state, film.factor, film.turning)
        yield picture.image(swing_camera(still, n / count))
        on_progress(n + 1, count)


def write_gif(frames: Iterator[Any], rate: float, path: Path) -> None:
    """Write frames as a GIF that repeats, with the colours of the first frame."""
    from PIL import Image

    images = map(Image.fromarray, frames)
    first = next(images).quantize(255, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    others = (image.quantize(palette=first, dither=Image.Dither.NONE) for image in images)
    first.save(path, "gif", save_all=True, append_images=others, duration=1000 / rate, loop=0)


def write_mp4(frames: Iterator[Any], rate: float, path: Path) -> None:
    """Write frames as H.264; an odd width or height gets one more row or column, black."""
    av = require_extra("av", "a film")
    with av.open(str(path), "w", "mp4", {"movflags": "+faststart"}) as file:
        stream = file.add_stream("libx264", Fraction(rate).limit_denominator(), {"crf": "10"})
        for n, image in enumerate(frames):
            height, width, _ = image.shape
            even = np.pad(image, [(0, height % 2), (0, width % 2), (0, 0)])
            frame = av.VideoFrame.from_ndarray(even)
            frame.pts = n
            if n == 0:
                stream.width, stream.height, stream.pix_fmt = frame.width, frame.height, "yuv420p"
            file.mux(stream.encode(frame))
        file.mux(stream.encode())


def write_film(
    picture: Picture, film: Film, path: Path, on_progress: OnProgress = lambda *_: None
) -> None:
    """Write a film; a failure leaves no file.

    on_progress: callback (frames drawn, number of frames).
    """
    write = write_gif if path.suffix.lower() == ".gif" else write_mp4
    with Whole(path) as temporary:
        write(film_frames(picture, film, on_progress), film.rate, temporary)


def motion_factor(sensor: Sensor, states: Floats) -> float:
    """Find the largest round factor, 1 or more, by which states (n, 8) can be multiplied while all
    spots stay on their detectors."""
    sample = states[:: max(1, len(states) // 100)]
    factor = 1.0
    for larger in (2, 5, 10, 20, 50, 100, 200, 500, 1000):
        if not stays_on_detectors(sensor, larger * sample):
            break
        factor = float(larger)
    return factor


def stays_on_detectors(sensor: Sensor, states: Floats) -> bool:
    """Return whether, in all states, the spots are well inside their detectors."""
    reading = readings(sensor, states)
    power = reading[:, 2::3]
    if not (power > MIN_POWER * sensor.beam.power).all():
        return False
    places = np.stack([reading[:, 0::3], reading[:, 1::3]], axis=-1)
    return bool((np.abs(places) < MAX_OFFSET * half_sizes(sensor)).all())


def turning_factor(states: Floats) -> float:
    """Find the round factor, 1 or more, that magnifies the head's rotation to `MAX_TURN_RAD`."""
    largest = float(np.abs(states[:, 3:6]).max())
    return max(1.0, round_down(MAX_TURN_RAD / largest)) if largest > 0 else 1.0
