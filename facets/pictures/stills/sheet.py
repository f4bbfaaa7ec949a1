"""Letters, lines and insets over a picture, drawn by matplotlib.

Labels are data: each has its places in the world, and a sheet draws it where a camera projects
these. Labels do not overlap: each has several candidate places and takes the first free one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from textwrap import fill
from typing import Any

import numpy as np

from ...core.units import MICRO, Floats
from .camera import Camera
from .exposure import Exposure
from .materials import Theme
from .studio import as_bytes

#: Left, top, right and bottom in pixels.
Box = tuple[float, float, float, float]
#: Fraction of the picture's width that a caption may take, and mean width of a letter in its size.
CAPTION_WIDTH, LETTER_WIDTH = 0.66, 0.6


@dataclass(frozen=True)
class Words:
    """Words at the first free one of several places (n, 3) in the world.

    size: of the letters, units of the sheet.  hue: colour, by default the theme's ink.  up: height
    of the words above the place, units of the sheet.
    """

    places: Floats
    words: str
    size: float
    hue: str = ""
    is_bold: bool = False
    up: float = 0.0


@dataclass(frozen=True)
class Dimension:
    """A dimension between two points (2, 3), drawn `off` units of the sheet from them.

    towards: direction of this offset in the picture, pixels; by default square to the dimension,
    upward.
    """

    ends: Any
    words: str
    off: float
    towards: Any = None
    size: float = 15


@dataclass(frozen=True)
class Polyline:
    """A line through points (n, 3), in one colour or in one for each of its n - 1 pieces."""

    points: Floats
    hue: str | Floats
    width: float
    dashes: Any = "solid"


Label = Words | Dimension | Polyline


@dataclass(frozen=True)
class Inset:
    """A magnified part of the picture.

    title, note: words below it.  camera, look: view of the part.  hue: colour of its frame.
    corner: its upper left corner, pixels.  target: place in the world that a line joins with it.
    is_round: whether the frame is a circle; a rectangle has lines through its middle.
    """

    title: str
    note: str
    camera: Camera
    look: Exposure
    hue: str
    corner: tuple[float, float]
    target: Floats | None = None
    is_round: bool = False
    labels: Sequence[Label] = field(default=())


def unit_of(size: tuple[int, int]) -> float:
    """Return the unit of letters and lines, pixels; letters stay readable."""
    return max(0.62, min(size[0] / 1200, size[1] / 900))


def length_in_words(length: float) -> str:
    """Format a length in mm: "100 mm", "200 µm"."""
    return f"{length:g} mm" if length >= 1 else f"{1e3 * length:.4g} {MICRO}m"


def round_down(value: float) -> float:
    """Return the largest of 1, 2, 3, 5, 10, ... (or 0.5, 0.3, ...) that is not larger."""
    power = 10.0 ** np.floor(np.log10(value) + 1e-12)
    largest = max(n * power for n in (1, 2, 3, 5) if n * power <= value * (1 + 1e-12))
    return float(f"{largest:.3g}")


class DrawingSheet:
    """A sheet over a picture (h, w, 3), 0 to 1, in pixels from the left and from the top.

    unit: pixels.  taken: boxes of the labels that it has.
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
        """Return the picture with everything drawn on it, (h, w, 3), 0 to 255."""
        drawn = np.asarray(self.canvas.buffer_rgba())  # figimage would need 150 MB more
        drawn[..., :3], drawn[..., 3] = self.picture, 255
        self.canvas.figure.draw(self.canvas.get_renderer())
        return drawn[..., :3].copy()

    # --- letters and lines ---------------------------------------------------------------------

    def text(
        self, place: Any, words: str, size: float, hue: str = "", is_bold: bool = False,
        anchor: tuple[str, str] = ("center", "center"),
    ) -> Any:  # fmt: skip
        """Draw words with a halo; `anchor` is the point of their box that lies at the place."""
        from matplotlib.patheffects import Normal, Stroke

        halo = Stroke(linewidth=4.4 * self.unit, foreground=self.theme.panel, alpha=0.55)
        return self.axes.text(
            *place[:2], words, fontsize=size * self.unit, color=hue or self.theme.ink,
            weight="bold" if is_bold else "normal", ha=anchor[0], va=anchor[1],
            path_effects=[halo, Normal()],
        )  # fmt: skip

    def box(self, text: Any) -> Box:
        x0, y0, x1, y1 = text.get_window_extent(self.canvas.get_renderer()).extents
        return x0, self.size[1] - y1, x1, self.size[1] - y0

    def write(self, place: Any, words: str, size: float, hue: str = "", **options: Any) -> Box:
        """Draw words below a place, and return their box, which is then taken."""
        text = self.text(place, words, size, hue, anchor=("center", "top"), **options)
        self.taken.append(self.box(text))
        return self.taken[-1]

    def place(self, text: Any, places: Any) -> Any:
        """Move a text to the first free place and return it; if none is free, remove the text."""
        for place in places:
            text.set_position(place)
            x0, y0, x1, y1 = box = self.box(text)
            is_inside = min(x0, y0, self.size[0] - x1, self.size[1] - y1) >= 2
            if is_inside and not any(
                x0 < b[2] and b[0] < x1 and y0 < b[3] and b[1] < y1 for b in self.taken
            ):
                self.taken.append(box)
                return place
        text.remove()
        return None

    def lines(self, parts: Any, hues: Any = None, width: float = 1.1, **options: Any) -> None:
        """Draw lines, each through points (n, 2) in pixels."""
        from matplotlib.collections import LineCollection

        drawn = LineCollection(
            parts, colors=self.theme.ink if hues is None else hues, linewidths=width * self.unit,
            capstyle="round", **options,
        )  # fmt: skip
        self.axes.add_collection(drawn, autolim=False)

    def arrow(self, tail: Any, tip: Any) -> None:
        drawn = {"arrowstyle": "-|>,head_length=0.9,head_width=0.26", "shrinkA": 0, "shrinkB": 0,
                 "mutation_scale": 10 * self.unit, "color": self.theme.ink,
                 "lw": self.unit}  # fmt: skip
        self.axes.annotate("", tip, tail, arrowprops=drawn)

    # --- labels --------------------------------------------------------------------------------

    def draw(self, label: Label, camera: Camera, corner: tuple[float, float] = (0, 0)) -> None:
        """Draw a label as a camera sees it; `corner` is the upper left one of its picture."""

        def projection(points: Any) -> Floats:
            return camera.project(np.array(points))[..., :2] + corner

        if isinstance(label, Dimension):
            self.dimension(label, *projection(label.ends))
        elif isinstance(label, Words):
            text = self.text((0, 0), label.words, label.size, label.hue, label.is_bold)
            self.place(text, projection(label.places) - [0, label.up * self.unit])
        else:
            points = projection(label.points)
            parts = np.stack([points[:-1], points[1:]], axis=1)
            is_one = isinstance(label.hue, str)
            self.lines([points] if is_one else parts, label.hue, label.width, ls=label.dashes)

    def dimension(self, label: Dimension, a: Floats, b: Floats) -> None:
        """Draw a dimension line with extension lines.

        It is moved further if its words would overlap others. If they do not fit between its ends,
        its arrows point from outside. Without a free place it is omitted.
        """
        a, b = (a, b) if a[0] <= b[0] else (b, a)
        length = max(float(np.hypot(*(b - a))), 1e-9)
        along = (b - a) / length
        upward = (along[1], -along[0])
        aside = self.unit * np.array(upward if label.towards is None else label.towards)
        text = self.text((0, 0), label.words, label.size)
        x0, _, x1, _ = self.box(text)
        gap, reach = (x1 - x0) / 2 + 7 * self.unit, 20 * self.unit
        fits = 2 * gap + 16 * self.unit < length
        angle = -float(np.degrees(np.arctan2(along[1], along[0])))
        text.set(rotation=angle + 180 * (angle < -80), rotation_mode="anchor")  # upward, not down
        fractions = (0.5, 0.35, 0.65) if fits else (1 + (reach + gap) / length,)
        offs = {
            tuple(a + fraction * (b - a) + factor * label.off * aside): factor * label.off
            for factor in (1.0, 1.4, 1.8, 2.3, 3.0, 0.7)
            for fraction in fractions
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

    def scale_bar(self, pixel: float, end: float, words: str) -> None:
        """Draw a bar of a round length at the lower edge, for the scale at the focus.

        pixel: size of a pixel, mm.  end: where the bar ends, as a fraction of the width.
        """
        length = round_down(0.16 * self.size[0] * pixel)
        stop, y, cap = end * self.size[0] - 28 * self.unit, self.foot(26), 5 * self.unit
        start = stop - length / pixel
        self.lines([[(start, y), (stop, y)]], width=2.2)
        self.lines([[(x, y - cap), (x, y + cap)] for x in (start, stop)], width=1.6)
        middle = ((start + stop) / 2, y - 8 * self.unit)
        self.note(middle, f"{length_in_words(length)}{words}", 13, ("center", "bottom"))

    def caption(self, lines: Sequence[str]) -> None:
        """Write lines at the lower left."""
        letters = int(CAPTION_WIDTH * self.size[0] / (14 * LETTER_WIDTH * self.unit))
        words = "\n".join(fill(line, letters) for line in lines)
        self.note((24 * self.unit, self.foot(20)), words, 14, ("left", "bottom"))

    def note(self, place: Any, words: str, size: float, anchor: tuple[str, str]) -> None:
        """Write words on a ground of their own, since parts may be behind them."""
        ground = {"fc": self.theme.panel, "ec": "none", "alpha": 0.6, "boxstyle": "round,pad=0.35"}
        text = self.text(place, words, size, anchor=anchor)
        text.set_bbox(ground)
        self.taken.append(self.box(text))

    def foot(self, height: float) -> float:
        """Convert a height above the lower edge, units of the sheet, to pixels from the top."""
        return float(self.size[1] - height * self.unit)

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

        (start, top), (width, height) = inset.corner, inset.camera.size
        end, low, x, y = start + width, top + height, start + width / 2, top + height / 2
        style = f"round,pad=0,rounding_size={0.055 * width}"
        outline: dict[str, Any] = {"fc": "none", "ec": inset.hue, "lw": 2.0 * self.unit}
        rim = (
            Circle((x, y), width / 2, **outline)
            if inset.is_round
            else FancyBboxPatch(inset.corner, width, height, boxstyle=style, **outline)
        )
        image = self.axes.imshow(as_bytes(shown), extent=(start, end, low, top),
                                 interpolation="none", aspect="auto")  # fmt: skip
        self.axes.set(xlim=(0, self.size[0]), ylim=(self.size[1], 0))
        self.axes.add_patch(rim)
        image.set_clip_path(rim)
        if not inset.is_round:
            cross = [[(start, y), (end, y)], [(x, top), (x, low)]]
            self.lines(cross, self.theme.faint, 0.8, alpha=0.5)
        self.taken.append((start, top, end, low))
        title = self.write((x, low + 6 * self.unit), inset.title, 14, inset.hue, is_bold=True)
        note = self.write((x, title[3] + 2 * self.unit), inset.note, 12)
        for label in inset.labels:
            self.draw(label, inset.camera, inset.corner)
        if inset.target is not None:
            self.leader(main.project(inset.target)[:2], inset, rim, note[3])

    def leader(self, target: Floats, inset: Inset, rim: Any, low: float) -> None:
        """Draw a line from an inset to a place: from its rim, or from below its note at `low`."""
        from matplotlib.patches import Circle

        middle = np.array(inset.corner) + np.array(inset.camera.size) / 2
        ring = Circle(tuple(target), 11 * self.unit, fc="none", ec=inset.hue, lw=1.5 * self.unit)
        self.axes.add_patch(ring)
        ends = {"shrinkA": 0, "shrinkB": 0, "patchA": rim, "patchB": ring}
        if target[1] - low > abs(target[0] - middle[0]):
            middle[1], ends["patchA"] = low + 2 * self.unit, None
        line = {"arrowstyle": "-", "color": inset.hue, "lw": self.unit, **ends}
        self.axes.annotate("", target, middle, arrowprops=line)
