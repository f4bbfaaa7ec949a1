"""Magnified insets: their places in a picture, their frames and their leader lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

from ...core.units import Floats
from .camera import Camera
from .lettering import FINE, Box, DrawingSheet


@dataclass(frozen=True)
class Inset:
    """A magnified part of the picture.

    title: written under it.  target: its place in the world.  camera: that takes it.
    hue: of its frame.  round: whether it is a circle.  note: a second line of its title.
    cross: whether lines mark its middle.
    """

    title: str
    target: Floats
    camera: Camera
    hue: str
    round: bool = False
    note: str = ""
    cross: bool = False


def assign(targets: Sequence[Floats], slots: Sequence[Floats]) -> list[int]:
    """Return the slot of each target, pixels: leader lines do not cross and are short in total."""
    best: tuple[float, Sequence[int]] = (np.inf, ())
    for order in permutations(range(len(slots)), len(targets)):
        lines = [(target, slots[n]) for target, n in zip(targets, order, strict=True)]
        cost = sum(float(np.hypot(*(b - a))) for a, b in lines)
        cost += 1e4 * sum(
            crossing(*line, *earlier) for n, line in enumerate(lines) for earlier in lines[:n]
        )
        if cost < best[0]:
            best = (cost, order)
    return list(best[1])


def crossing(a: Floats, b: Floats, c: Floats, d: Floats) -> bool:
    """Whether the segments from a to b and from c to d cross."""

    def turn(p: Floats, q: Floats, r: Floats) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return turn(a, b, c) * turn(a, b, d) < 0 and turn(c, d, a) * turn(c, d, b) < 0


def paste(picture: Floats, shown: Floats, corner: tuple[int, int], circle: bool) -> None:
    """Paste a small picture into a larger one, in place, with rounded corners or as a circle."""
    from PIL import Image, ImageDraw

    height, width = shown.shape[:2]
    mask = Image.new("L", (width * 4, height * 4))
    pen = ImageDraw.Draw(mask)
    radius = min(width, height) * (2 if circle else 0.22)
    pen.rounded_rectangle([0, 0, width * 4 - 1, height * 4 - 1], radius, fill=255)
    cover = np.asarray(mask.reduce(4), float)[..., None] / 255
    left, top = corner
    part = picture[top : top + height, left : left + width]
    inside = np.s_[: part.shape[0], : part.shape[1]]  # a small picture may crop it
    part[:] = part * (1 - cover[inside]) + shown[inside] * cover[inside]


def frame(sheet: DrawingSheet, inset: Inset, corner: tuple[int, int], size: tuple[int, int]) -> Box:
    """Draw the rim of an inset and its title below; return the title's box."""
    left, top = corner
    width, height = size
    radius = min(width, height) * (0.5 if inset.round else 0.055) * FINE
    if inset.cross:
        x, y = left + width / 2, top + height / 2
        for a, b in (((left, y), (left + width, y)), ((x, top), (x, top + height))):
            sheet.line([a, b], sheet.theme.faint, 0.8, 0.5)
    box = [left * FINE, top * FINE, (left + width) * FINE, (top + height) * FINE]
    thick = max(2, round(2.0 * sheet.unit * FINE))
    sheet.draw.rounded_rectangle(box, radius, outline=sheet.colour(inset.hue), width=thick)
    sheet.taken.append((left, top, left + width, top + height))
    below = (left + width / 2, top + height + 6 * sheet.unit)
    title = sheet.write(below, inset.title, 14, inset.hue, bold=True, anchor=(0.5, 0))
    if inset.note:
        return sheet.write((below[0], title[3]), inset.note, 12, sheet.theme.ink, anchor=(0.5, 0))
    return title


def leader(
    sheet: DrawingSheet,
    inset: Inset,
    target: Floats,
    corner: Any,
    size: Any,
    title: Box | None = None,
) -> None:
    """Draw a line from an inset's target to its rim, or to its title if that is in between."""
    middle = np.array(corner, float) + np.array(size) / 2
    aim = target[:2] - middle
    length = float(np.hypot(*aim))
    start = middle + aim / max(np.abs(aim / (np.array(size) / 2)).max(), 1e-9)
    if inset.round:
        start = middle + aim / length * size[0] / 2
    if title and target[1] > title[3] and title[0] - 8 < start[0] < title[2] + 8:
        start = np.array([middle[0], title[3] + 2 * sheet.unit])
        aim = target[:2] - start
        length = float(np.hypot(*aim))
    ring = 11 * sheet.unit
    sheet.line([start, target[:2] - aim / length * ring], inset.hue, 1.4, 0.95)
    x, y = target[:2] * FINE
    r = ring * FINE
    sheet.draw.ellipse([x - r, y - r, x + r, y + r], outline=sheet.colour(inset.hue),
                       width=max(1, round(1.5 * sheet.unit * FINE)))  # fmt: skip
