"""Letters and lines over a picture: dimension lines, leader lines, a scale bar, captions.

Labels do not overlap: each has several candidate places and takes the first free one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ...core.units import Floats
from .materials import Theme, rgb

#: Letters and lines are drawn this many times larger, then averaged.
FINE = 2
#: Margin of a label for its halo.
PAD = 4 * FINE
Box = tuple[float, float, float, float]
Point = Sequence[float] | Floats
Points = Sequence[Point] | Floats


@lru_cache(maxsize=64)
def font(size: int, bold: bool = False) -> Any:
    import matplotlib
    from PIL import ImageFont

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)


def overlap(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


@dataclass(frozen=True)
class DimensionLine:
    """A dimension between two points, in pixels, with the words of its label and their size."""

    start: Floats
    end: Floats
    words: str
    size: float

    @property
    def length(self) -> float:
        return float(np.hypot(*(self.end - self.start)))

    @property
    def direction(self) -> Floats:
        """The unit vector from start to end."""
        direction: Floats = (self.end - self.start) / max(self.length, 1e-9)
        return direction

    @property
    def angle(self) -> float:
        """The angle at which the label can be read, rad."""
        angle = float(np.arctan2(-self.direction[1], self.direction[0]))
        return (angle + np.pi / 2) % np.pi - np.pi / 2


class DrawingSheet:
    """A transparent sheet over a picture; pixels from the left and from the top.

    taken: the boxes (left, top, right, bottom) of its labels.
    """

    def __init__(self, size: tuple[int, int], theme: Theme) -> None:
        from PIL import Image, ImageDraw

        self.size, self.theme = size, theme
        self.unit = max(0.62, min(size[0] / 1200, size[1] / 900))  # letters stay readable
        self.image = Image.new("RGBA", (size[0] * FINE, size[1] * FINE), (0, 0, 0, 0))
        self.draw = ImageDraw.Draw(self.image)
        self.taken: list[Box] = []

    def colour(self, colour: str, alpha: float = 1.0) -> tuple[int, int, int, int]:
        red, green, blue = (round(255 * part) for part in rgb(colour))
        return red, green, blue, round(255 * alpha)

    def points(self, points: Iterable[Point] | Floats) -> list[tuple[float, float]]:
        return [(float(p[0]) * FINE, float(p[1]) * FINE) for p in points]

    def line(
        self, points: Points, colour: str = "", width: float = 1.3, alpha: float = 1.0
    ) -> None:
        ink = self.colour(colour or self.theme.ink, alpha)
        thick = max(1, round(width * self.unit * FINE))
        self.draw.line(self.points(points), fill=ink, width=thick, joint="curve")

    def dashes(self, a: Point, b: Point, colour: str = "", width: float = 1.1) -> None:
        start, end = np.array(a[:2], float), np.array(b[:2], float)
        length = float(np.hypot(*(end - start)))
        step = 9 * self.unit
        for n in range(int(length / step) + 1):
            low, high = n * step, min(n * step + 0.55 * step, length)
            if high > low:
                ends = [start + (end - start) * t / length for t in (low, high)]
                self.line(ends, colour or self.theme.faint, width, 0.9)

    def dot(self, at: Point, radius: float, colour: str = "") -> None:
        x, y = self.points([at])[0]
        r = radius * self.unit * FINE
        self.draw.ellipse([x - r, y - r, x + r, y + r], fill=self.colour(colour or self.theme.ink))

    def arrow(self, tip: Point, along: Floats, colour: str = "") -> None:
        """Draw the head of an arrow that points along a unit vector."""
        size = 9.0 * self.unit
        aside = np.array([-along[1], along[0]])
        end = np.array(tip[:2], float)
        corners = [end, end - size * along + 0.28 * size * aside,
                   end - size * along - 0.28 * size * aside]  # fmt: skip
        self.draw.polygon(self.points(corners), fill=self.colour(colour or self.theme.ink))

    def measure(self, words: str, size: float = 14, bold: bool = False) -> tuple[float, float]:
        """Width and height of words, which may have several lines."""
        letters = font(max(6, round(size * self.unit * FINE)), bold)
        left, top, right, bottom = self.draw.multiline_textbbox(
            (0, 0), words, letters, spacing=4 * FINE
        )
        return (right - left) / FINE, (bottom - top) / FINE

    def write(
        self, at: Point, words: str, size: float = 14, colour: str = "", bold: bool = False,
        anchor: Point = (0.5, 0.5),
    ) -> Box:  # fmt: skip
        """Write words with the point `anchor` of their box (0 to 1) at a place; return the box."""
        return self.paste(self.label(words, size, colour, bold), at, anchor)

    def label(self, words: str, size: float, colour: str, bold: bool = False) -> Any:
        """Draw words with a halo, as a picture of their own."""
        from PIL import Image, ImageDraw

        letters = font(max(6, round(size * self.unit * FINE)), bold)
        spacing = 4 * FINE
        left, top, right, bottom = self.draw.multiline_textbbox(
            (0, 0), words, letters, spacing=spacing
        )
        label = Image.new("RGBA", (int(right - left + 2 * PAD), int(bottom - top + 2 * PAD)))
        pen, start = ImageDraw.Draw(label), (PAD - left, PAD - top)
        options: dict[str, Any] = {"font": letters, "spacing": spacing, "align": "left"}
        pen.multiline_text(
            start, words, fill=self.colour(self.theme.panel, 0.0), **options,
            stroke_width=round(2.2 * self.unit * FINE),
            stroke_fill=self.colour(self.theme.panel, 0.55),
        )  # fmt: skip
        pen.multiline_text(start, words, fill=self.colour(colour or self.theme.ink), **options)
        return label

    def paste(self, label: Any, at: Point, anchor: Point = (0.5, 0.5)) -> Box:
        """Put a label with the point `anchor` of its box (0 to 1) at a place; return the box."""
        x = at[0] * FINE - PAD - anchor[0] * (label.width - 2 * PAD)
        y = at[1] * FINE - PAD - anchor[1] * (label.height - 2 * PAD)
        self.image.alpha_composite(label, (max(0, round(x)), max(0, round(y))))
        box = (x / FINE, y / FINE, (x + label.width) / FINE, (y + label.height) / FINE)
        self.taken.append(box)
        return box

    def free(self, box: Box) -> bool:
        """Return whether a box is inside the picture and overlaps no label."""
        inside = (
            box[0] >= 2
            and box[1] >= 2
            and box[2] <= self.size[0] - 2
            and box[3] <= self.size[1] - 2
        )
        return inside and not any(overlap(box, other) for other in self.taken)

    def dimension(self, a: Point, b: Point, words: str, aside: Floats, size: float = 14) -> None:
        """Draw a dimension line between two points, moved aside by a vector, with extension lines.

        It is moved further if its label would overlap another, and its arrows point from outside if
        there is no room between them.
        """
        line = DimensionLine(np.array(a[:2], float), np.array(b[:2], float), words, size)
        angle = line.angle
        wide, high = self.measure(words, size)
        spread = np.abs([wide * np.cos(angle), wide * np.sin(angle)])
        half = spread / 2 + high / 2 + 3
        for factor in (1.0, 1.4, 1.8, 2.3, 3.0, 0.7):
            off = factor * aside
            for share in (0.5, 0.35, 0.65):
                middle = line.start + share * (line.end - line.start) + off
                box = (
                    middle[0] - half[0],
                    middle[1] - half[1],
                    middle[0] + half[0],
                    middle[1] + half[1],
                )
                if self.free(box):
                    self.dimension_at(line, off, middle)
                    return
        # if no place is free, omit the label rather than write over another

    def dimension_at(self, line: DimensionLine, off: Floats, middle: Floats) -> None:
        """Draw a dimension line moved by a vector `off`, with its label's middle at a place."""
        from PIL import Image

        over = off / max(float(np.hypot(*off)), 1e-9) * 4 * self.unit
        for point in (line.start, line.end):
            self.line([point + 1.5 * over, point + off + over], width=0.9, alpha=0.75)
        wide, _ = self.measure(line.words, line.size)
        start, end, along = line.start + off, line.end + off, line.direction
        if wide + 30 * self.unit < line.length:
            gap = (wide / 2 + 7 * self.unit) * along
            self.line([start, middle - gap], width=1.1)
            self.line([middle + gap, end], width=1.1)
            self.arrow(start, -along)
            self.arrow(end, along)
            label = self.label(line.words, line.size, "")
            if line.angle:
                degrees, bicubic = np.degrees(line.angle), Image.Resampling.BICUBIC
                label = label.rotate(degrees, resample=bicubic, expand=True)
            self.paste(label, middle)
            return
        reach = 20 * self.unit
        for point, sign in ((start, 1.0), (end, -1.0)):
            self.line([point, point - sign * reach * along], width=1.1)
            self.arrow(point, sign * along)
        self.line([start, end], width=1.1)
        self.write(end + (reach + wide / 2 + 6 * self.unit) * along, line.words, line.size)

    def scale_bar(self, pixel: float, at: Point, words: str = "", share: float = 0.16) -> None:
        """Draw a bar of a round length, for the scale at the focus. pixel: mm."""
        wanted = share * self.size[0] * pixel
        power = 10 ** np.floor(np.log10(wanted))
        length = max(n * power for n in (1, 2, 5) if n * power <= wanted)
        wide = length / pixel
        x, y = float(at[0]), float(at[1])
        left = x - wide
        self.line([(left, y), (x, y)], width=2.2)
        for end in (left, x):
            self.line([(end, y - 5 * self.unit), (end, y + 5 * self.unit)], width=1.6)
        self.write(
            (left + wide / 2, y - 8 * self.unit),
            f"{length_in_words(length)}{words}",
            13,
            anchor=(0.5, 1),
        )

    def draw_over(self, picture: Floats) -> Floats:
        """Return the picture (h, w, 3) with the sheet over it."""
        ink = np.asarray(self.image.convert("RGBa").reduce(FINE), np.float32) / 255
        mixed: Floats = picture * (1 - ink[..., 3:]) + ink[..., :3]
        return mixed


def length_in_words(length: float) -> str:
    """Format a length in mm: "100 mm", "200 µm"."""
    return f"{length:g} mm" if length >= 1 else f"{1e3 * length:.4g} µm"
