"""Exposure of a picture: the rendered parts with their floor, shade in corners, and light."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ...core.units import Floats
from .camera import Camera, Rays
from .glow import Glow, glow
from .materials import THEMES, Theme, rgb
from .scene import PosedSensor
from .studio import Shot, Studio, as_bytes

#: Lights that cast shadows: direction, radius of the blur on the floor and its growth with height,
#: darkness, and the height at which the darkness is halved; mm.
SHADOWS = (((-0.45, -0.55, 1.6), 4.0, 0.16, 0.75, 1e9), ((0, 0, 1.0), 8.0, 0.5, 0.5, 60.0))
#: Side of the map of shadows, pixels; limits of the heights that share one blur, mm.
MAP, HEIGHTS = 256, (-1, 6, 24, 60, 130, 280, 1e9)
#: Number of directions in which neighbours shade a pixel, and their distances over the radius.
DIRECTIONS, STEPS = 6, (0.25, 0.6, 1.0)


@dataclass(frozen=True)
class Ghost:
    """Assemblies at a state, blended over the picture.

    front, behind: opacity where they are in front of the parts, and behind these.
    """

    assemblies: Collection[str]
    state: Floats
    front: float
    behind: float


@dataclass(frozen=True)
class Exposure:
    """Assemblies in a picture, by default those of the rig, and the strength of the light.

    haze: strength of the light that the air scatters out of the beams.  bloom: strength of the
    light that the lens spreads.  hidden: numbers of the sub-beams to omit.  floor: whether there is
    a floor.  glows: whether light glows in the light theme, too.
    """

    assemblies: Collection[str] = ()
    haze: float = 1.0
    bloom: float = 1.0
    hidden: Collection[int] = ()
    floor: bool = True
    glows: bool = False
    ghosts: Sequence[Ghost] = ()


def add_floor(studio: Studio, points: Floats, z: float, theme: Theme) -> None:
    """Add a floor at z with the shadows of parts with points (n, 3); it fades with distance."""
    reach = 1.35 * float(np.abs(points[:, :2]).max())
    shade = np.pad(floor_shade(studio, reach, z), MAP // 2)  # of twice the extent
    square = np.linspace(-2, 2, 2 * MAP) ** 2
    fade = np.exp(-1.6 * (square + square[:, None]))
    light = 1 - theme.shadow * shade
    opacity = 1 - (1 - fade) * light
    colour = rgb(theme.ground) * (fade * light / opacity)[..., None]
    studio.add_floor(as_bytes(np.dstack([colour, opacity])), 2 * reach, z)


def floor_shade(studio: Studio, reach: float, z: float) -> Floats:
    """Compute the darkness (h, w), 0 to 1, of shadows on the floor at z, over x and y from
    -reach to reach, mm. Higher parts have softer shadows.
    """
    from scipy.ndimage import gaussian_filter, map_coordinates

    side = np.linspace(-reach, reach, MAP)
    places = np.stack([*np.meshgrid(side, side), np.full((MAP, MAP), z)], axis=-1)
    light = np.ones((MAP, MAP))
    for direction, radius, growth, darkness, fading in SHADOWS:
        camera = Camera((0, 0, z), direction, 2.4 * reach, (MAP, MAP), upward=(0, 1, 0))
        shot = studio.take(camera)
        start, rate = Rays(camera, np.s_[0:MAP, 0:MAP]).coordinate(np.array([0, 0, 1.0]), (0, 0, z))
        height = start + rate * shot.depth
        pixels = np.moveaxis(camera.project(places)[..., 1::-1] - 0.5, -1, 0)
        for low, high in pairwise(HEIGHTS):
            part = (height > low) & (height <= high)
            mean = float(height[part].mean()) if part.any() else 0.0
            soft = gaussian_filter(1.0 * part, (radius + growth * mean) / camera.pixel)
            cast = map_coordinates(soft, pixels, order=1)
            light *= 1 - darkness / (1 + mean / fading) * cast
    return 1 - light


def blend(picture: Floats, cover: Floats, colour: Sequence[Any] | Floats) -> None:
    """Blend a colour (3,), or colours (3, h, w), over a picture with opacity (h, w), in place."""
    for n, part in enumerate(colour):
        picture[..., n] += cover * (part - picture[..., n])


def occlusion(shot: Shot) -> Floats:
    """Compute the fraction of ambient light that reaches each pixel, (h, w), 0 to 1.

    A pixel lies in a hollow if the mean depth of two opposite neighbours is smaller than its own,
    which is not so on a flat face, however slanted.
    """
    from scipy.ndimage import gaussian_filter

    depth = np.where(np.isfinite(shot.depth), shot.depth, 1e6)[::2, ::2]
    height, width = depth.shape
    radius, pixels = 0.016 * shot.camera.height, max(0.008 * len(shot.depth), 1.5)
    edge = int(pixels) + 1
    around = np.pad(depth, edge, "reflect", reflect_type="odd")  # continues flat faces
    shade: Floats = np.zeros(depth.shape)
    for turn in np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS:
        for step in STEPS:
            offset = np.rint(pixels * step * np.array([np.sin(turn), np.cos(turn)])).astype(int)
            neighbours = (
                around[row : row + height, column : column + width]
                for row, column in (edge + offset, edge - offset)
            )
            first, second = (np.clip(other - depth, -1.5 * radius, radius) for other in neighbours)
            is_near = np.clip(1.6 - 0.8 * np.abs(first - second) / radius, 0, 1)
            shade += np.clip(-(first + second) / radius, 0, 1) * is_near
    light = 1 - np.minimum(0.7, 1.3 * shade / (DIRECTIONS * len(STEPS)))
    soft = gaussian_filter(np.where(depth < 1e6, light, 1.0), 1.8)
    enlarged: Floats = np.repeat(np.repeat(soft.astype(np.float32), 2, axis=0), 2, axis=1)
    return enlarged[: shot.depth.shape[0], : shot.depth.shape[1]]


def expose(posed: PosedSensor, shot: Shot, theme: Theme, look: Exposure, laser: float) -> Floats:
    """Compute the picture (h, w, 3), 0 to 1; the beam begins `laser` mm above the apex."""
    fraction = np.linspace(0, 1, len(shot.depth), dtype=np.float32)[:, None, None]
    backdrop = rgb(theme.top) * (1 - fraction) + rgb(theme.bottom) * fraction
    picture = backdrop * (1 - shot.cover[..., None]) + shot.colour * occlusion(shot)[..., None]
    light = glow(posed, shot, laser, look.hidden)
    if theme.shines or look.glows:
        return shine(picture, light, theme if theme.shines else THEMES["dark"], look)
    return stain(picture, light, theme, look.haze)


def beams(light: Glow, theme: Theme, haze: float) -> list[tuple[Floats, Floats]]:
    """Return the amount of light (h, w) and the colour of the beam and of each sub-beam."""
    amounts, hues = [light.beam, *light.sub_beams], [theme.beam, *theme.hues]
    return [(1.1 * haze * part, rgb(hue)) for part, hue in zip(amounts, hues, strict=True)]


def shine(picture: Floats, light: Glow, theme: Theme, look: Exposure) -> Floats:
    """Add light to a dark picture: coloured at its rim, white at its brightest, with a halo."""
    total: Floats = np.zeros(picture.shape, np.float32)

    def add(amount: Floats, colour: Any) -> None:
        rows = np.flatnonzero(amount.any(axis=1))
        if len(rows):
            part = slice(rows[0], rows[-1] + 1)
            total[part] += amount[part, :, None] * colour

    for amount, hue in beams(light, theme, look.haze):
        add(amount, hue**1.9)  # deeper, as light has it
        add(np.maximum(amount - 0.75, 0), 0.6)
    for amount, name in zip(light.surfaces, theme.hues, strict=True):
        add(2.0 * amount, rgb(name) ** 1.9)
        add(1.1 * look.bloom**0.5 * amount**6, 1.0)
    total += look.bloom * (0.55 * halo(total, 0.004, 1.5) + 0.40 * halo(total, 0.016, 5.0))
    mixed: Floats = 1 - (1 - np.clip(picture, 0, 1)) * np.exp(-1.25 * total)
    return mixed


def stain(picture: Floats, light: Glow, theme: Theme, haze: float) -> Floats:
    """Blend light as ink into a bright picture (h, w, 3), 0 to 1, in place, and return it."""
    for amount, hue in beams(light, theme, haze):
        wide = 1.15 * amount + 0.5 * halo(amount, 0.003, 1.2)
        blend(picture, 0.92 * (1 - np.exp(-1.5 * wide)), hue)
    for amount, name in zip(light.surfaces, theme.hues, strict=True):
        cover = 1 - np.exp(-3.5 * (amount + 0.3 * halo(amount, 0.003, 1.2)))
        hot = np.clip(amount - 0.35, 0, 1) * 1.1
        blend(picture, cover, [hue * (1 - hot) + hot for hue in rgb(name)])
    return picture


def halo(light: Floats, fraction: float, minimum: float) -> Floats:
    """Blur light as a lens does, by a fraction of the picture's height or a minimum of pixels."""
    from scipy.ndimage import uniform_filter

    size = 2 * round(max(fraction * len(light), minimum)) + 1
    for _ in range(3):  # nearly a Gaussian
        light = uniform_filter(light, (size, size, 1)[: light.ndim])
    return light
