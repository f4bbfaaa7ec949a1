"""Letters and lines over a picture: dimension lines, leader lines, a scale bar, captions.

Labels do not overlap: each has several candidate places and takes the first free one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ...core.units import Floats
from .materials import Theme, rgb

#: Letters and lines are drawn this many times larger, then averaged.
FINE = 2
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
        anchor: Point = (0.5, 0.5), halo: bool = True, angle: float = 0.0, take: bool = True,
    ) -> Box:  # fmt: skip
        """Write words with the point `anchor` of their box (0 to 1) at a place; return the box."""
        from PIL import Image, ImageDraw

        letters = font(max(6, round(size * self.unit * FINE)), bold)
        spacing = 4 * FINE
        left, top, right, bottom = self.draw.multiline_textbbox(
            (0, 0), words, letters, spacing=spacing
        )
        pad = 4 * FINE
        label = Image.new("RGBA", (int(right - left + 2 * pad), int(bottom - top + 2 * pad)))
        pen = ImageDraw.Draw(label)
        options: dict[str, Any] = {"font": letters, "spacing": spacing, "align": "left"}
        if halo:
            options |= {"stroke_width": round(2.2 * self.unit * FINE),
                        "stroke_fill": self.colour(self.theme.panel, 0.55)}  # fmt: skip
            pen.multiline_text(
                (pad - left, pad - top), words, fill=self.colour(self.theme.panel, 0.0), **options
            )
            options = {"font": letters, "spacing": spacing, "align": "left"}
        pen.multiline_text(
            (pad - left, pad - top), words, fill=self.colour(colour or self.theme.ink), **options
        )
        if angle:
            label = label.rotate(np.degrees(angle), resample=Image.Resampling.BICUBIC, expand=True)
        x = at[0] * FINE - pad - anchor[0] * (label.width - 2 * pad)
        y = at[1] * FINE - pad - anchor[1] * (label.height - 2 * pad)
        self.image.alpha_composite(label, (max(0, round(x)), max(0, round(y))))
        box = (x / FINE, y / FINE, (x + label.width) / FINE, (y + label.height) / FINE)
        if take:
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

    def dimension(
        self, a: Point, b: Point, words: str, aside: Floats, size: float = 14, colour: str = ""
    ) -> None:
        """Draw a dimension line between two points, moved aside by a vector, with extension lines.

        It is moved further if its label would overlap another, and its arrows point from outside if
        there is no room between them.
        """
        start, end = np.array(a[:2], float), np.array(b[:2], float)
        length = float(np.hypot(*(end - start)))
        along = (end - start) / max(length, 1e-9)
        angle = float(np.arctan2(-along[1], along[0]))
        angle = (angle + np.pi / 2) % np.pi - np.pi / 2
        wide, high = self.measure(words, size)
        spread = np.abs([wide * np.cos(angle), wide * np.sin(angle)])
        half = spread / 2 + high / 2 + 3
        for factor in (1.0, 1.4, 1.8, 2.3, 3.0, 0.7):
            off = factor * aside
            for share in (0.5, 0.35, 0.65):
                middle = start + share * (end - start) + off
                box = (
                    middle[0] - half[0],
                    middle[1] - half[1],
                    middle[0] + half[0],
                    middle[1] + half[1],
                )
                if self.free(box):
                    self.dimension_at(start, end, off, along, middle, words, size, colour, angle)
                    return
        # if no place is free, omit the label rather than write over another

    def dimension_at(
        self, start: Floats, end: Floats, off: Floats, along: Floats, middle: Floats, words: str,
        size: float, colour: str, angle: float,
    ) -> None:  # fmt: skip
        ink = colour or self.theme.ink
        over = off / max(float(np.hypot(*off)), 1e-9) * 4 * self.unit
        for point in (start, end):
            self.line([point + 1.5 * over, point + off + over], ink, 0.9, 0.75)
        wide, _ = self.measure(words, size)
        length = float(np.hypot(*(end - start)))
        if wide + 30 * self.unit < length:
            gap = (wide / 2 + 7 * self.unit) * along
            self.line([start + off, middle - gap], ink, 1.1)
            self.line([middle + gap, end + off], ink, 1.1)
            self.arrow(start + off, -along, ink)
            self.arrow(end + off, along, ink)
            self.write(middle, words, size, ink, angle=angle)
            return
        reach = 20 * self.unit
        for point, sign in ((start + off, 1.0), (end + off, -1.0)):
            self.line([point, point - sign * reach * along], ink, 1.1)
            self.arrow(point, sign * along, ink)
        self.line([start + off, end + off], ink, 1.1)
        aside = end + off + (reach + wide / 2 + 6 * self.unit) * along
        self.write(aside, words, size, ink)

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
