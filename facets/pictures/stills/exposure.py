"""A picture of the rig from parts, floor, shade and light, as a camera's film records it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from ...core.units import Floats
from .camera import Camera
from .glow import Glow, glow, surface
from .ground import Ground, backdrop
from .materials import THEMES, Theme, rgb
from .occlusion import occlusion
from .raster import halo
from .scene import Stand
from .studio import Shot


@dataclass(frozen=True)
class Lighting:
    """The light of a picture: from a laser that stands this far above the apex, mm.

    haze: the light that the air scatters out of the beams.  dark: sub-beams to omit.  bloom: the
    light that the lens spreads.
    """

    laser: float
    haze: float = 1.0
    dark: Collection[int] = ()
    bloom: float = 1.0


def expose(
    stand: Stand, shot: Shot, theme: Theme, floor: Ground | None, lighting: Lighting
) -> Floats:
    """Render the picture (h, w, 3), 0 to 1."""
    picture = assemble(shot, theme, floor)
    light = glow(stand, shot, lighting.laser, lighting.dark)
    return (
        shine(picture, light, theme, lighting.haze, lighting.bloom)
        if theme.shines
        else stain(picture, light, theme, lighting.haze)
    )


def assemble(shot: Shot, theme: Theme, floor: Ground | None) -> Floats:
    """Render the parts, their shade and the background, without light."""
    behind = backdrop(shot.camera, theme, floor)
    shade = occlusion(shot, 0.016 * shot.camera.height)[..., None]
    picture: Floats = shot.colour * shade + behind * (1 - shot.cover[..., None])
    return picture


def layers(light: Glow, theme: Theme, haze: float) -> list[tuple[Floats, Floats]]:
    """Return the amounts of light and their colours: beams, then surfaces."""
    lights = [(haze * 1.1 * light.beam, np.array(rgb(theme.beam)))]
    for k, hue in enumerate(theme.hues):
        lights.append((haze * 1.1 * light.sub_beams[k], np.array(rgb(hue))))
    return lights


def shine(picture: Floats, light: Glow, theme: Theme, haze: float, bloom: float = 1.0) -> Floats:
    """Add light to a dark picture: hues at its rim, white at its brightest, and a halo."""
    total: Floats = np.zeros(picture.shape, np.float32)
    for amount, hue in layers(light, theme, haze):
        core = np.maximum(amount - 0.75, 0)
        add(total, amount, deep(hue))
        add(total, core, np.full(3, 0.6))
    for k, name in enumerate(theme.hues):
        add(total, 2.0 * light.surfaces[k], deep(np.array(rgb(name))))
        add(total, 1.1 * bloom**0.5 * light.surfaces[k] ** 6, np.ones(3))
    soft = 0.55 * halo(total, 0.004, 1.5) + 0.40 * halo(total, 0.016, 5.0)
    total += bloom * soft
    dark = np.exp(-1.25 * total)
    mixed: Floats = 1 - (1 - np.clip(picture, 0, 1)) * dark
    return mixed


def deep(hue: Floats) -> Floats:
    """Deepen a hue, as light has it: its lesser parts are reduced."""
    light: Floats = hue**1.9
    return light


def add(total: Floats, amount: Floats, colour: Floats) -> None:
    """Add an amount of light of a colour to a picture."""
    rows = np.flatnonzero(amount.any(axis=1))
    if len(rows):
        part = slice(rows[0], rows[-1] + 1)
        total[part] += amount[part, :, None] * colour


def stain(picture: Floats, light: Glow, theme: Theme, haze: float) -> Floats:
    """Blend light as ink into a bright picture."""
    for amount, hue in layers(light, theme, haze):
        wide = np.clip(1.15 * amount + 0.5 * halo(amount, 0.003, 1.2), 0, None)
        cover = (0.92 * (1 - np.exp(-1.5 * wide)))[..., None]
        picture = picture * (1 - cover) + hue * cover
    for k, name in enumerate(theme.hues):
        amount = light.surfaces[k]
        cover = (1 - np.exp(-3.5 * (amount + 0.3 * halo(amount, 0.003, 1.2))))[..., None]
        hot = (np.clip(amount - 0.35, 0, 1) * 1.1)[..., None]
        picture = picture * (1 - cover) + (np.array(rgb(name)) * (1 - hot) + hot) * cover
    mixed: Floats = picture
    return mixed


#: Colours of a detector's face, square on: silicon, its contact ring, and its carrier.
SILICON, RING, CARRIER = "#0B1026", "#B08D3C", "#1A1D22"


def expose_face(stand: Stand, camera: Camera, k: int) -> Floats:
    """Render a detector's face and the light on it, square on from between window and silicon.

    It glows in either theme, as behind its dark bezel.
    """
    width, height = camera.size
    psd = stand.sensor.psds[k]
    y, x = np.indices((height, width)) + 0.5
    across, up = camera.aside(x, y)
    beyond = np.maximum(np.abs(across) - psd.size_y / 2, np.abs(up) - psd.size_z / 2)
    soft = 0.5 * camera.pixel
    picture = np.ones((height, width, 3)) * np.array(rgb(CARRIER))
    for edge, colour in ((0.03 * psd.size_z, RING), (0.0, SILICON)):
        cover = np.clip(0.5 - (beyond - edge) / (2 * soft), 0, 1)[..., None]
        picture = picture * (1 - cover) + np.array(rgb(colour)) * cover
    picture += 0.05 * np.clip(up / camera.extent + 0.3, 0, 1)[..., None] * (beyond < 0)[..., None]
    depth = np.full((height, width), camera.distance)
    shot = Shot(camera, picture, np.ones((height, width)), depth)
    nothing = np.zeros((height, width))
    shown = [nothing, nothing, nothing]
    shown[k] = surface(stand, shot, k)
    light = Glow((nothing, nothing, nothing), nothing, (shown[0], shown[1], shown[2]))
    return shine(picture, light, THEMES["dark"], 0.0, 3.0)
