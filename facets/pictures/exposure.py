"""A picture of the rig from parts, floor, shade and light: what a camera's film would show."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from ..core.units import Floats
from .glow import Glow, glow
from .ground import Ground, backdrop
from .materials import Theme, rgb
from .occlusion import occlusion
from .raster import halo
from .scene import Stand
from .studio import Shot


def expose(
    stand: Stand, shot: Shot, theme: Theme, floor: Ground | None, laser: float, haze: float = 1.0,
    dark: Collection[int] = (),
) -> Floats:  # fmt: skip
    """(h, w, 3), 0 to 1. haze: how much light the air scatters out of the beams.  dark: sub-beams
    that are left out."""
    picture = assemble(shot, theme, floor)
    light = glow(stand, shot, laser, dark)
    return shine(picture, light, theme, haze) if theme.shines else stain(picture, light, theme, haze)


def assemble(shot: Shot, theme: Theme, floor: Ground | None) -> Floats:
    """Parts, their shade, and what is behind them; without light."""
    behind = backdrop(shot.camera, theme, floor)
    shade = occlusion(shot, 0.016 * shot.camera.height)[..., None]
    picture: Floats = shot.colour * shade + behind * (1 - shot.cover[..., None])
    return picture


def layers(light: Glow, theme: Theme, haze: float) -> list[tuple[Floats, Floats]]:
    """How much light there is, and its colour: beams, then surfaces."""
    found = [(haze * 0.9 * light.beam, np.array(rgb(theme.beam)))]
    for k, hue in enumerate(theme.hues):
        found.append((haze * 1.1 * light.sub_beams[k], np.array(rgb(hue))))
    return found


def shine(picture: Floats, light: Glow, theme: Theme, haze: float) -> Floats:
    """Light added to a dark picture: hues at its rim, white where there is most, and a halo."""
    total = np.zeros_like(picture)
    for amount, hue in layers(light, theme, haze):
        core = np.maximum(amount - 0.75, 0)
        add(total, amount, hue)
        add(total, core, np.full(3, 0.6))
    for k, hue in enumerate(theme.hues):
        add(total, 1.7 * light.surfaces[k], np.array(rgb(hue)))
        add(total, 1.6 * light.surfaces[k] ** 4, np.ones(3))
    total += 0.55 * halo(total, 0.004) + 0.40 * halo(total, 0.016)
    dark = np.exp(-1.25 * total)
    mixed: Floats = 1 - (1 - np.clip(picture, 0, 1)) * dark
    return mixed


def add(total: Floats, amount: Floats, colour: Floats) -> None:
    """Adds light of a colour to a picture, where there is any."""
    rows = np.flatnonzero(amount.any(axis=1))
    if len(rows):
        part = slice(rows[0], rows[-1] + 1)
        total[part] += amount[part, :, None] * colour


def stain(picture: Floats, light: Glow, theme: Theme, haze: float) -> Floats:
    """Light as ink on a bright picture."""
    for amount, hue in layers(light, theme, haze):
        wide = np.clip(1.15 * amount + 0.5 * halo(amount, 0.003), 0, None)
        cover = (0.92 * (1 - np.exp(-1.5 * wide)))[..., None]
        picture = picture * (1 - cover) + hue * cover
    for k, hue in enumerate(theme.hues):
        amount = light.surfaces[k]
        cover = (1 - np.exp(-3.5 * (amount + 0.3 * halo(amount, 0.003))))[..., None]
        hot = (np.clip(amount - 0.35, 0, 1) * 1.1)[..., None]
        picture = picture * (1 - cover) + (np.array(rgb(hue)) * (1 - hot) + hot) * cover
    mixed: Floats = picture
    return mixed
