"""Letters, lines and insets over a picture, drawn by matplotlib.

They are data: each has its places in the world, and a sheet draws it as a camera sees it. Labels do
not overlap: each has several candidate places and takes the first free one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...core.units import MICRO, Floats
from .camera import Camera
from .exposure import Exposure
from .materials import Theme
from .studio import as_bytes

#: Left, top, right and bottom in pixels.
Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class Words:
    """Words at the first of several places (n, 3) in the world that is free, `up` above it."""

    places: Floats
    words: str
    size: float
    hue: str = ""
    bold: bool = False
    up: float = 0.0


@dataclass(frozen=True)
class Dimension:
    """A dimension between two points (2, 3), drawn `off` units from them.

    towards: the direction, pixels; by default square to the dimension, upward.
    """

    ends: Any
    words: str
    off: float
    towards: Any = None
    size: float = 15


@dataclass(frozen=True)
class Polyline:
    """A line through points (n, 3), in one hue or in one for each point."""

    points: Floats
    hue: str | Floats
    width: float
    dashes: Any = "solid"


Label = Words | Dimension | Polyline


@dataclass(frozen=True)
class Inset:
    """A magnified part of the picture.

    title, note: below it.  camera, look: that show it.  hue: of its frame.  corner: its upper left
    one, pixels.  target: the place in the world that it magnifies.  round: whether it is a circle;
    else lines mark its middle.
    """

    title: str
    note: str
    camera: Camera
    look: Exposure
    hue: str
    corner: tuple[float, float]
    target: Floats | None = None
    round: bool = False
    labels: Sequence[Label] = field(default=())


def unit_of(size: tuple[int, int]) -> float:
    """Return the unit of letters and lines, pixels; letters stay readable."""
    return max(0.62, min(size[0] / 1200, size[1] / 900))


def length_in_words(length: float) -> str:
    """Format a length in mm: "100 mm", "200 µm"."""
    return f"{length:g} mm" if length >= 1 else f"{1e3 * length:.4g} {MICRO}m"


class DrawingSheet:
    """A sheet over a picture (h, w, 3), 0 to 1; pixels from the left and from the top.

    taken: the boxes of its labels.
    """

    def __init__(self, picture: Floats, theme: Theme) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        height, width = picture.shape[:2]
        self.size, self.theme, self.unit = (width, height), theme, unit_of((width, height))
        self.taken: list[Box] = []
        self.canvas: Any = FigureCanvasAgg(Figure((width / 72, height / 72), dpi=72))
        self.canvas.figure.patch.set_visible(False)
        self.picture = as_bytes(picture)
        self.axes: Any = self.canvas.figure.add_axes((0, 0, 1, 1))
        self.axes.set(xlim=(0, width), ylim=(height, 0), autoscale_on=False)
        self.axes.set_axis_off()

    def pixels(self) -> Any:
        """Return the picture with all that was drawn, (h, w, 3), 0 to 255."""
        drawn = np.asarray(self.canvas.buffer_rgba())  # without what figimage takes, 150 MB
        drawn[..., :3], drawn[..., 3] = self.picture, 255
        self.canvas.figure.draw(self.canvas.get_renderer())
        return drawn[..., :3].copy()

    # --- letters and lines ---------------------------------------------------------------------

    def text(
        self, at: Any, words: str, size: float, hue: str = "", bold: bool = False,
        anchor: tuple[str, str] = ("center", "center"),
    ) -> Any:  # fmt: skip
        """Draw words with a halo; anchor: the point of their box that is at a place."""
        from matplotlib.patheffects import Normal, Stroke

        halo = Stroke(linewidth=4.4 * self.unit, foreground=self.theme.panel, alpha=0.55)
        return self.axes.text(
            *at[:2], words, fontsize=size * self.unit, color=hue or self.theme.ink,
            weight="bold" if bold else "normal", ha=anchor[0], va=anchor[1],
            path_effects=[halo, Normal()],
        )  # fmt: skip

    def box(self, text: Any) -> Box:
        left, low, right, high = text.get_window_extent(self.canvas.get_renderer()).extents
        return left, self.size[1] - high, right, self.size[1] - low

    def write(self, at: Any, words: str, size: float, *more: Any, **options: Any) -> Box:
        """Draw words, and return their box, which is then taken."""
        self.taken.append(self.box(self.text(at, words, size, *more, **options)))
        return self.taken[-1]

    def place(self, text: Any, places: Any) -> Any:
        """Move a text to the first free place and return that, or remove the text and return
        None."""
        for at in places:
            text.set_position(at)
            left, top, right, bottom = box = self.box(text)
            inside = min(left, top, self.size[0] - right, self.size[1] - bottom) >= 2
            if inside and not any(
                left < b[2] and b[0] < right and top < b[3] and b[1] < bottom for b in self.taken
            ):
                self.taken.append(box)
                return at
        text.remove()
        return None

    def lines(self, parts: Any, hues: Any = None, width: float = 1.1, **more: Any) -> None:
        """Draw lines, each through points (n, 2)."""
        from matplotlib.collections import LineCollection

        drawn = LineCollection(
            parts, colors=self.theme.ink if hues is None else hues, linewidths=width * self.unit,
            capstyle="round", **more,
        )  # fmt: skip
        self.axes.add_collection(drawn, autolim=False)

    def arrow(self, tail: Any, tip: Any) -> None:
        drawn = {"arrowstyle": "-|>,head_length=0.9,head_width=0.26", "shrinkA": 0, "shrinkB": 0,
                 "mutation_scale": 10 * self.unit, "color": self.theme.ink,
                 "lw": self.unit}  # fmt: skip
        self.axes.annotate("", tip, tail, arrowprops=drawn)

    # --- labels --------------------------------------------------------------------------------

    def draw(self, label: Label, camera: Camera, corner: tuple[float, float] = (0, 0)) -> None:
        """Draw a label as a camera sees it, whose picture has its upper left corner here."""

        def projection(points: Any) -> Floats:
            return camera.project(np.array(points))[..., :2] + corner

        if isinstance(label, Dimension):
            self.dimension(label, *projection(label.ends))
        elif isinstance(label, Words):
            text = self.text((0, 0), label.words, label.size, label.hue, label.bold)
            self.place(text, projection(label.places) - [0, label.up * self.unit])
        else:
            points = projection(label.points)
            parts = np.stack([points[:-1], points[1:]], axis=1)
            whole = isinstance(label.hue, str)
            self.lines([points] if whole else parts, label.hue, label.width, ls=label.dashes)

    def dimension(self, label: Dimension, a: Floats, b: Floats) -> None:
        """Draw a dimension line with extension lines.

        It is moved further if its words would overlap others, and its arrows point from outside if
        there is no room between them; without any free place it is left out.
        """
        a, b = (a, b) if a[0] <= b[0] else (b, a)
        length = max(float(np.hypot(*(b - a))), 1e-9)
        along = (b - a) / length
        upward = (along[1], -along[0])
        aside = self.unit * np.array(upward if label.towards is None else label.towards)
        text = self.text((0, 0), label.words, label.size)
        left, _, right, _ = self.box(text)
        gap, reach = (right - left) / 2 + 7 * self.unit, 20 * self.unit
        fits = 2 * gap + 16 * self.unit < length
        angle = -float(np.degrees(np.arctan2(along[1], along[0])))
        text.set(rotation=angle + 180 * (angle < -80), rotation_mode="anchor")  # upward, not down
        shares = (0.5, 0.35, 0.65) if fits else (1 + (reach + gap) / length,)
        offs = {
            tuple(a + share * (b - a) + factor * label.off * aside): factor * label.off
            for factor in (1.0, 1.4, 1.8, 2.3, 3.0, 0.7)
            for share in shares
        }
        middle = self.place(text, list(offs))
        if middle is None:
            return
        start, end = a + offs[middle] * aside, b + offs[middle] * aside
        extensions = [[near + 6 * aside, far + 4 * aside] for near, far in ((a, start), (b, end))]
        self.lines(extensions, width=0.9, alpha=0.75)
        if fits:
            self.arrow(middle - gap * along, start)
            self.arrow(middle + gap * along, end)
        else:
            self.lines([[start, end]])
            self.arrow(start - reach * along, start)
            self.arrow(end + reach * along, end)

    def scale_bar(self, pixel: float, share: float, words: str) -> None:
        """Draw a bar of a round length at the lower edge, for the scale at the focus.

        pixel: mm.  share: of the width, at which the bar ends.
        """
        wanted = 0.16 * self.size[0] * pixel
        power = 10 ** np.floor(np.log10(wanted))
        length = max(n * power for n in (1, 2, 5) if n * power <= wanted)
        right, y = share * self.size[0] - 28 * self.unit, self.size[1] - 26 * self.unit
        left, end = right - length / pixel, 5 * self.unit
        self.lines([[(left, y), (right, y)]], width=2.2)
        self.lines([[(x, y - end), (x, y + end)] for x in (left, right)], width=1.6)
        at = ((left + right) / 2, y - 8 * self.unit)
        self.write(at, f"{length_in_words(length)}{words}", 13, anchor=("center", "bottom"))

    def caption(self, lines: Sequence[str]) -> None:
        """Write lines at the lower left, the last one as the main one."""
        left, low = 24 * self.unit, self.size[1] - 20 * self.unit
        for n, words in enumerate(reversed(lines)):
            hue = self.theme.faint if n else ""
            low = self.write((left, low), words, 13 if n else 14, hue, anchor=("left", "bottom"))[1]
            low -= 3 * self.unit

    def legend(self, title: str, rows: Sequence[tuple[str, str]]) -> None:
        """Draw colours and their meanings at the upper left."""
        from matplotlib.patches import Patch

        handles = [Patch(color=colour, label=words) for colour, words in rows]
        size = 15 * self.unit
        drawn = self.axes.legend(
            handles=handles, title=title, loc="upper left", alignment="left", frameon=False,
            fontsize=size, title_fontproperties={"size": size, "weight": "bold"},
            labelcolor=self.theme.ink, handlelength=1.0, handleheight=1.0,
            borderaxespad=1.4, labelspacing=0.7,
        )  # fmt: skip
        drawn.get_title().set_color(self.theme.ink)

    # --- insets --------------------------------------------------------------------------------

    def paste(self, inset: Inset, shown: Floats, main: Camera) -> None:
        """Draw an inset with its frame and title, and a line to its target in the main picture."""
        from matplotlib.patches import Circle, FancyBboxPatch

        (left, top), (width, height) = inset.corner, inset.camera.size
        middle = np.array([left + width / 2, top + height / 2])
        round_ = f"round,pad=0,rounding_size={0.055 * width}"
        outline: dict[str, Any] = {"fc": "none", "ec": inset.hue, "lw": 2.0 * self.unit}
        rim = (
            Circle(tuple(middle), width / 2, **outline)
            if inset.round
            else FancyBboxPatch((left, top), width, height, boxstyle=round_, **outline)
        )
        image = self.axes.imshow(as_bytes(shown), extent=(left, left + width, top + height, top),
                                 interpolation="none", aspect="auto")  # fmt: skip
        self.axes.set(xlim=(0, self.size[0]), ylim=(self.size[1], 0))
        self.axes.add_patch(rim)
        image.set_clip_path(rim)
        if not inset.round:
            x, y = middle
            cross = [[(left, y), (left + width, y)], [(x, top), (x, top + height)]]
            self.lines(cross, self.theme.faint, 0.8, alpha=0.5)
        self.taken.append((left, top, left + width, top + height))
        below = (middle[0], top + height + 6 * self.unit)
        title = self.write(below, inset.title, 14, inset.hue, bold=True, anchor=("center", "top"))
        below = (middle[0], title[3] + 2 * self.unit)
        note = self.write(below, inset.note, 12, anchor=("center", "top"))
        for label in inset.labels:
            self.draw(label, inset.camera, inset.corner)
        if inset.target is not None:
            self.leader(main.project(inset.target)[:2], inset, middle, note)

    def leader(self, target: Floats, inset: Inset, middle: Floats, note: Box) -> None:
        """Draw a line from an inset's rim, or from its title if that is in between, to a place."""
        from matplotlib.patches import Circle

        width, height = inset.camera.size
        aim = target - middle
        start = middle + aim / max(np.abs(2 * aim / [width, height]).max(), 1e-9)
        if inset.round:
            start = middle + aim / np.hypot(*aim) * width / 2
        left, _, right, low = note
        is_below = target[1] - low > abs(target[0] - middle[0])
        if is_below and left - 8 < start[0] < right + 8:
            start = np.array([middle[0], low + 2 * self.unit])
        ring, aim = 11 * self.unit, target - start
        self.lines([[start, target - aim / np.hypot(*aim) * ring]], inset.hue, 1.0)
        mark: dict[str, Any] = {"fc": "none", "ec": inset.hue, "lw": 1.5 * self.unit}
        self.axes.add_patch(Circle(tuple(target), ring, **mark))
