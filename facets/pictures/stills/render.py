"""The sensor in three dimensions: a picture, a film's frame, or a scene for other programs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain
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
from .exposure import Exposure, expose, floor_under
from .materials import THEMES, Material, ThemeName
from .rig import LASER_HEIGHT, RigModel
from .scene import Stand
from .sheet import DrawingSheet
from .solids import RigPart, Solid, bands
from .studio import Shot, Studio
from .views import factor_in_words as factor_in_words, round_down, state_in_words

OnProgress = Callable[[float, float], None]
ViewName = Literal["both", "rig", "mirror", "detector", "cutaway", "range", "trail"]
#: File name endings: pictures, scenes that can be turned, films.
PICTURES, SCENES, MOVIES = (".png",), (".gltf", ".html"), (".mp4", ".gif")

#: Films: container and codec with their options, and the format of pixels.
GIF: tuple[Any, ...] = ("gif", {"loop": "0"}, "gif", {}, "pal8")
H264 = ("mp4", {"movflags": "+faststart"}, "libx264", {"crf": "10"}, "yuv420p")
#: How far the camera of a film swings to either side, rad, and by which share of its distance it
#: approaches in the middle.
SWING_RAD, NEARER_SHARE = 0.20, 0.04
#: Distance of a drawn spot in front of its detector, mm, without which the two would intersect.
SPOT_OFFSET_MM = 0.02

#: Largest distance of a spot's centroid from its detector's axes, over half the detector's size,
#: and least share of the light on a detector, in a magnified motion.
INSIDE, LEAST = 0.80, 0.06
#: The largest rotation of a head in a picture, rad.
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
    """How a picture is drawn.

    size: pixels.  title: begins the caption.  sharpness: samples a side of each pixel.
    """

    view: ViewName = "both"
    size: tuple[int, int] = (1200, 900)
    theme: ThemeName = "dark"
    title: str = ""
    sharpness: int = 2


class Picture(ClosedAtExit):
    """A view of the sensor at a state that can be changed.

    more: further inputs of a view: `rules` of a range, `motion` (n, 8) of a trail.
    """

    def __init__(
        self, sensor: Sensor, state: Floats, form: PictureForm | None = None, **more: Any
    ) -> None:
        self.form = form or PictureForm()
        self.theme, rig = THEMES[self.form.theme], RigModel(sensor)
        self.laser = LASER_HEIGHT * rig.unit
        self.view = VIEWS[self.form.view](rig, self.theme, self.form.size, **more)
        self.studio = Studio(self.view.parts, self.theme, self.view.aside)
        self.floor = floor_under(self.studio, self.view.points(), (rig.floor - 14) * rig.unit)
        self.move(state)

    def move(self, state: Floats, factor: float = 1.0, turning: float = 1.0) -> None:
        """Move to another state (8,), mm and rad, drawn `factor` times as large.

        turning: further magnification of the head's rotation about its apex in the large picture.
        """
        self.state, self.factor, self.turning = np.asarray(state, float), factor, turning
        self.view.move(factor * self.state)

    def take(
        self, camera: Camera, assemblies: Collection[str], state: Floats, turning: float
    ) -> Shot:
        """Render parts at a state, the head's angles `turning` times as large."""
        self.studio.move(state, turning)
        return self.studio.take(camera, assemblies, self.form.sharpness)

    def expose(self, camera: Camera, look: Exposure, turning: float = 1.0) -> Floats:
        """Render parts and light, (h, w, 3), 0 to 1."""
        shot = self.take(camera, look.assemblies, self.view.state, turning)
        picture = expose(self.view.stand, shot, self.theme, self.floor, look, self.laser)
        for ghost in look.ghosts:
            shown = self.take(camera, ghost.assemblies, ghost.state, 1.0)
            share = np.where(shown.depth < shot.depth, ghost.front, ghost.behind)[..., None]
            picture = picture * (1 - share * shown.cover[..., None]) + share * shown.colour
        return picture

    def image(self, camera: Camera | None = None) -> Any:
        """Return the picture (h, w, 3), 0 to 255, by default as the view's camera sees it."""
        with style_context(text__hinting="none"):  # letters are as wide as they are measured
            return self.annotate(camera or self.view.camera)

    def annotate(self, camera: Camera) -> Any:
        """Render the picture that a camera sees with its caption, insets and labels."""
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


# --- scenes that can be turned: bodies of light beside the parts ---------------------------------


def light_bodies(stand: Stand, length: float) -> list[RigPart]:
    """Make the beam from a length (mm) above the apex, the sub-beams and the spots as surfaces."""
    theme = THEMES["light"]
    back = -np.array(stand.geometry.direction)
    bodies, feet = [], []
    for k, hue in enumerate(theme.hues):
        start, end = scene.rims(stand, k)
        if not len(start):
            continue
        feet.append(scene.array(stand.facet_points(k, scene.cut(stand, k)[-1])))
        material = Material(hue, clear=0.5, even=True)
        bodies.append(RigPart(f"sub-beam {DETECTORS[k]}", "light", material, bands([start, end])))
        spot = end - SPOT_OFFSET_MM * np.array(stand.geometry.axes[k][0])
        face = Solid(spot, [list(range(len(spot)))])
        bodies.append(RigPart(f"spot {DETECTORS[k]}", "light", Material(hue, even=True), face))
    if feet:
        foot = np.concatenate(feet)
        top = foot + ((length + stand.at.apex[2] - foot[:, 2]) / back[2])[:, None] * back
        material = Material(theme.beam, clear=0.5, even=True)
        bodies.append(RigPart("beam", "light", material, bands([foot, top])))
    return bodies


def save_scene(sensor: Sensor, state: Floats, path: Path) -> None:
    """Write a glTF file: the rig's parts with their materials, and the light as bodies."""
    rig, stand = RigModel(sensor), Stand.from_state(sensor, state)
    studio = Studio([*rig.parts(), *light_bodies(stand, 120)], THEMES["light"])
    studio.move(state)
    studio.plotter.camera_position = [(430, -540, 330), (0, 0, 0), (0, 0, 1)]
    studio.plotter.reset_camera()
    with Whole(path) as temporary, TemporaryDirectory() as folder:
        plain = Path(folder) / "scene.gltf"  # VTK opens no name that is not UTF-8
        studio.plotter.export_gltf(str(plain))
        copyfile(plain, temporary)
    studio.close()


# --- films ---------------------------------------------------------------------------------------


def ease_camera(camera: Camera, share: float) -> Camera:
    """Return the camera at a share of a film: it swings to both sides, and is nearer in the middle.

    At the end it has its first place and speed, so that a film can be repeated.
    """
    angle = SWING_RAD * np.sin(2 * np.pi * share)
    nearer = NEARER_SHARE * (1 - np.cos(2 * np.pi * share)) / 2
    direction = np.array(rotation(0.0, 0.0, angle), float) @ np.asarray(camera.direction, float)
    return replace(camera, direction=direction, height=(1 - nearer) * camera.height)


@dataclass(frozen=True)
class Film:
    """A motion, state by state (n, 8), with its frames a second and its magnification `factor`.

    turning: further magnification of the head's rotation in the large picture; light has `factor`.
    """

    states: Floats
    rate: float
    factor: float
    turning: float = 1.0


def film_frames(
    av: Any, picture: Picture, film: Film, size: Sequence[int], on_progress: OnProgress
) -> Iterator[Any]:
    """Draw the frames of a film, the last row and column black where a size is one more."""
    still, count = picture.view.camera, len(film.states)
    for n, state in enumerate(film.states):
        picture.move(state, film.factor, film.turning)
        image = picture.image(ease_camera(still, n / count))
        more = np.subtract((*size[::-1], 3), image.shape)
        frame = av.VideoFrame.from_ndarray(np.pad(image, [(0, pixels) for pixels in more]))
        frame.pts = n
        yield frame
        on_progress(n + 1, count)


def few_colours(
    av: Any, frames: Iterable[Any], size: Sequence[int], rate: Fraction
) -> Iterator[Any]:
    """Yield frames in the few colours of a GIF: those of what moves, once all frames are drawn."""
    graph = av.filter.Graph()
    source = graph.add_buffer(None, *size, "rgb24", None, 1 / rate)
    colours = graph.add("palettegen", "max_colors=112:stats_mode=diff")
    split, last = graph.add("split"), graph.add("paletteuse", "dither=none")
    graph.link_nodes(source, split, colours).link_nodes(last, graph.add("buffersink"))
    split.link_to(last, 1, 0)
    colours.link_to(last, 0, 1)
    graph.configure()
    for frame in chain(frames, [None]):
        graph.push(frame)
    with suppress(EOFError):
        while True:
            yield graph.pull()


def write_film(
    picture: Picture, film: Film, path: Path, on_progress: OnProgress = lambda *_: None
) -> None:
    """Write a film; a failure leaves no file.

    on_progress: takes the frames done and their number.
    """
    av = require_extra("av", "a film")
    is_gif, rate = path.suffix.lower() == ".gif", Fraction(film.rate).limit_denominator()
    form, options, codec, quality, pixels = GIF if is_gif else H264
    size = [side if is_gif else side + side % 2 for side in picture.form.size]
    frames = film_frames(av, picture, film, size, on_progress)
    with Whole(path) as temporary, av.open(str(temporary), "w", form, options) as file:
        stream = file.add_stream(codec, rate, quality)
        stream.width, stream.height, stream.pix_fmt = *size, pixels
        stored = few_colours(av, frames, size, rate) if is_gif else frames
        for frame in chain(stored, [None]):
            file.mux(stream.encode(frame))


def motion_factor(sensor: Sensor, states: Floats) -> float:
    """The largest round factor, 1 or more, by which states (n, 8) may be multiplied with all three
    spots on their detectors and light on each; the larger motion is then possible."""
    some = states[:: max(1, len(states) // 100)]
    factor = 1.0
    for more in (2, 5, 10, 20, 50, 100, 200, 500, 1000):
        if not stays_on_detectors(sensor, more * some):
            break
        factor = float(more)
    return factor


def stays_on_detectors(sensor: Sensor, states: Floats) -> bool:
    """Return whether all spots are well on their detectors in all states."""
    reading = readings(sensor, states)
    power = reading[:, 2::3]
    if not (power > LEAST * sensor.beam.power).all():
        return False
    places = np.stack([reading[:, 0::3], reading[:, 1::3]], axis=-1)
    return bool((np.abs(places) < INSIDE * half_sizes(sensor)).all())


def turning_factor(states: Floats) -> float:
    """The round factor by which the head's own rotation may be magnified further, up to about a
    tenth of a turn to either side, about its apex, which does not move."""
    largest = float(np.abs(states[:, 3:6]).max())
    return max(1.0, round_down(MAX_TURN_RAD / largest)) if largest > 0 else 1.0
