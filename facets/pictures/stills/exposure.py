"""A picture of the rig from parts, floor, shade and light, as a camera's film records it."""

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
from .scene import Stand
from .studio import Shot, Studio

#: Lights that cast shadows: direction, radius of the blur on the floor and its growth by height,
#: darkness, and the height at which this has halved; mm.
SHADOWS = (((-0.45, -0.55, 1.6), 4.0, 0.16, 0.75, 1e9), ((0, 0, 1.0), 8.0, 0.5, 0.5, 60.0))
#: Side of the map of shadows, pixels, and the heights between which shadows have one blur, mm.
MAP, HEIGHTS = 256, (-1, 6, 24, 60, 130, 280, 1e9)
#: Directions across a pixel in which neighbours shade it, and distances, shares of the radius.
DIRECTIONS, STEPS = 6, (0.25, 0.6, 1.0)


@dataclass(frozen=True)
class Ghost:
    """Assemblies at a state, blended over the picture by shares in front of it and behind."""

    assemblies: Collection[str]
    state: Floats
    front: float
    behind: float


@dataclass(frozen=True)
class Exposure:
    """What a picture shows: assemblies, by default those of the rig, and how.

    haze: the light that the air scatters out of the beams.  bloom: the light that the lens spreads.
    dark: sub-beams to omit.  floor: whether it has one.  glows: light glows in a bright theme, too.
    """

    assemblies: Collection[str] = ()
    haze: float = 1.0
    bloom: float = 1.0
    dark: Collection[int] = ()
    floor: bool = True
    glows: bool = False
    ghosts: Sequence[Ghost] = ()


@dataclass(frozen=True)
class Floor:
    """A floor at z with a map of the darkness of shadows, over x and y from -reach to reach."""

    z: float
    reach: float
    shade: Floats


def floor_under(studio: Studio, points: Floats, z: float) -> Floor:
    """Make the floor at z with the shadows of parts with points (n, 3): the higher a part is, the
    softer its shadow."""
    from scipy.ndimage import gaussian_filter, map_coordinates

    reach = 1.35 * float(np.abs(points[:, :2]).max())
    side = np.linspace(-reach, reach, MAP)
    places = np.stack([*np.meshgrid(side, side), np.full((MAP, MAP), z)], axis=-1)
    light = np.ones((MAP, MAP))
    for direction, radius, growth, darkness, fading in SHADOWS:
        camera = Camera((0, 0, z), direction, 2.4 * reach, (MAP, MAP), away=9 * reach,
                        upward=(0, 1, 0))  # fmt: skip
        shot = studio.take(camera, sharpness=1)
        start, rate = Rays(camera).coordinate(np.array([0, 0, 1.0]), (0, 0, z))
        height = start + rate * shot.depth
        pixels = np.moveaxis(camera.project(places)[..., 1::-1] - 0.5, -1, 0)
        for low, high in pairwise(HEIGHTS):
            part = (height > low) & (height <= high)
            above = float(height[part].mean()) if part.any() else 0.0
            soft = gaussian_filter(1.0 * part, (radius + growth * above) / camera.pixel)
            cast = map_coordinates(soft, pixels, order=1)
            light *= 1 - darkness / (1 + above / fading) * cast
    return Floor(z, reach, 1 - light)


def backdrop(camera: Camera, theme: Theme, floor: Floor | None) -> Floats:
    """Render the background, (h, w, 3): a floor that fades into a gradient."""
    from scipy.ndimage import map_coordinates

    width, height = camera.size
    share = np.linspace(0, 1, height)[:, None, None]
    behind = rgb(theme.top) * (1 - share) + rgb(theme.bottom) * share
    picture: Floats = np.repeat(behind.astype(np.float32), width, axis=1)
    if floor is None:
        return picture
    rays, point = Rays(camera), (0, 0, floor.z)
    depth, above = rays.meet(point, np.array([0, 0, 1.0]))
    x, y = (
        (start + rate * depth) / floor.reach
        for start, rate in (rays.coordinate(axis, point) for axis in np.eye(3)[:2])
    )
    place = np.broadcast_arrays(y, x)
    shade = map_coordinates(floor.shade, [(at + 1) / 2 * (MAP - 1) for at in place], order=1)
    fade = np.exp(-1.6 * (x**2 + y**2)) * (above & (depth > 0))
    blend(picture, fade, rgb(theme.ground))
    lit: Floats = 1 - theme.shadow * shade * (fade > 0)
    picture *= lit[..., None]
    return picture


def blend(picture: Floats, cover: Floats, colour: Sequence[Any] | Floats) -> None:
    """Blend a colour, or colours (3, h, w), over a picture by shares (h, w), in place."""
    for n, part in enumerate(colour):
        picture[..., n] += cover * (part - picture[..., n])


def occlusion(shot: Shot) -> Floats:
    """Return the share of ambient light that reaches each pixel, (h, w), 0 to 1.

    A pixel lies in a hollow if two opposite neighbours are on average nearer; a flat face does not,
    however slanted.
    """
    from scipy.ndimage import gaussian_filter

    here = np.where(np.isfinite(shot.depth), shot.depth, 1e6)[::2, ::2]
    height, width = here.shape
    radius, pixels = 0.016 * shot.camera.height, max(0.008 * len(shot.depth), 1.5)
    edge = int(pixels) + 1
    around = np.pad(here, edge, "reflect", reflect_type="odd")  # as flat faces go on
    taken: Floats = np.zeros(here.shape)
    for turn in np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS:
        for step in STEPS:
            way = np.rint(pixels * step * np.array([np.sin(turn), np.cos(turn)])).astype(int)
            neighbours = (
                around[row : row + height, column : column + width]
                for row, column in (edge + way, edge - way)
            )
            first, second = (np.clip(depth - here, -1.5 * radius, radius) for depth in neighbours)
            near = np.clip(1.6 - 0.8 * np.abs(first - second) / radius, 0, 1)
            taken += np.clip(-(first + second) / radius, 0, 1) * near
    light = 1 - np.minimum(0.7, 1.3 * taken / (DIRECTIONS * len(STEPS)))
    soft = gaussian_filter(np.where(here < 1e6, light, 1.0), 1.8)
    whole: Floats = np.repeat(np.repeat(soft.astype(np.float32), 2, axis=0), 2, axis=1)
    return whole[: shot.depth.shape[0], : shot.depth.shape[1]]


def expose(
    stand: Stand, shot: Shot, theme: Theme, floor: Floor | None, look: Exposure, laser: float
) -> Floats:
    """Render the picture (h, w, 3), 0 to 1; the beam begins `laser` mm above the apex."""
    picture = backdrop(shot.camera, theme, floor if look.floor else None)
    picture *= 1 - shot.cover[..., None]
    picture += shot.colour * occlusion(shot)[..., None]
    light = glow(stand, shot, laser, look.dark)
    if theme.shines or look.glows:
        return shine(picture, light, theme if theme.shines else THEMES["dark"], look)
    return stain(picture, light, theme, look.haze)


def beams(light: Glow, theme: Theme, haze: float) -> list[tuple[Floats, Floats]]:
    """Return the amounts of light of the beams, and their colours."""
    amounts, hues = [light.beam, *light.sub_beams], [theme.beam, *theme.hues]
    return [(1.1 * haze * part, rgb(hue)) for part, hue in zip(amounts, hues, strict=True)]


def shine(picture: Floats, light: Glow, theme: Theme, look: Exposure) -> Floats:
    """Add light to a dark picture: hues at its rim, white at its brightest, and a halo."""
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
    """Blend light as ink into a bright picture."""
    for amount, hue in beams(light, theme, haze):
        wide = 1.15 * amount + 0.5 * halo(amount, 0.003, 1.2)
        blend(picture, 0.92 * (1 - np.exp(-1.5 * wide)), hue)
    for amount, name in zip(light.surfaces, theme.hues, strict=True):
        cover = 1 - np.exp(-3.5 * (amount + 0.3 * halo(amount, 0.003, 1.2)))
        hot = np.clip(amount - 0.35, 0, 1) * 1.1
        blend(picture, cover, [hue * (1 - hot) + hot for hue in rgb(name)])
    return picture


def halo(light: Floats, share: float, least: float) -> Floats:
    """Blur light as a lens does; share: of the picture's height, with a least number of pixels."""
    from scipy.ndimage import uniform_filter

    size = 2 * round(max(share * len(light), least)) + 1
    for _ in range(3):  # nearly a Gaussian
        light = uniform_filter(light, (size, size, 1)[: light.ndim])
    return light
