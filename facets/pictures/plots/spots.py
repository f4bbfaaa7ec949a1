"""Pictures of the detectors' faces as Fig. 2 of the paper, and of the plan as Fig. 3."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.hues import chosen_hues
from ...core.names import DETECTORS
from ...core.sensor import Psd, Sensor
from ...core.units import Floats
from ...model.arrays import readings
from .. import style
from ..stills import scene
from ..stills.scene import PosedSensor, SpotLight

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def spots_picture(sensor: Sensor, state: Floats) -> Figure:
    """Draw each detector's face and, below it, its light enlarged."""
    posed, reading = PosedSensor.from_state(sensor, state), readings(sensor, state)
    image = None
    with style.style_context(axes__grid=False):
        picture = style.figure(style.FULL, 5.2)
        panels = picture.subplots(2, 3)
        for k, letter in enumerate(DETECTORS):
            spot, centroid = scene.spot(posed, k), reading[3 * k : 3 * k + 2]
            upper, lower = panels[:, k]
            face(upper, sensor.psds[k], spot, centroid, letter)
            upper.set_title(f"{letter.upper()}: {light_on(sensor.psds[k], reading[3 * k :])}",
                            color=chosen_hues().detectors[letter])  # fmt: skip
            image = large(lower, spot, centroid, letter) or image
        for panel in panels[:, 0]:
            panel.set_ylabel("zeta, mm")
        if image is not None:
            words = "irradiance, its largest is 1"
            style.colour_bar(picture, image, panels[1].tolist(), words, shrink=0.9, pad=0.01)
        style.panels_legend(picture, panels[1, :1], 2)
    return picture


def light_on(psd: Psd, reading: Floats) -> str:
    """Return the title of a detector's panel from its reading (psi, zeta, power)."""
    psi, zeta, power = reading[:3]
    if np.isnan(power):
        return "no light"
    is_outside = abs(psi) > psd.size_y / 2 or abs(zeta) > psd.size_z / 2
    return f"{1e3 * power:.1f} µW" + (", outside it" if is_outside else "")


def face(panel: Axes, psd: Psd, spot: SpotLight, centroid: Floats, letter: str) -> None:
    """Draw the sensitive area with the spot."""
    from matplotlib.patches import Rectangle

    hues = chosen_hues()
    corner = (-psd.size_y / 2, -psd.size_z / 2)
    panel.add_patch(Rectangle(corner, psd.size_y, psd.size_z, facecolor=(hues.rule, 0.45),
                              edgecolor=hues.detectors[letter], lw=1.8))  # fmt: skip
    if spot.grid.size:
        shine(panel, spot)
    panel.plot(*centroid, "o", ms=13, mfc="none", mec=hues.detectors[letter], mew=1.4)
    panel.axhline(0, color=hues.grey, lw=0.6)
    panel.axvline(0, color=hues.grey, lw=0.6)
    half = 0.54 * max(psd.size_y, psd.size_z)
    panel.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
    panel.set_xlabel("psi, mm")


def shine(panel: Axes, spot: SpotLight) -> Any:
    """Draw the spot's irradiance, transparent without light."""
    light = np.ma.masked_less(spot.light, 0.004)
    return panel.pcolormesh(*spot.grid.transpose(2, 0, 1), light, cmap="inferno", vmin=0, vmax=1,
                            shading="gouraud", rasterized=True)  # fmt: skip


def write(panel: Axes, text: str, place: Floats, degrees: float = 0.0) -> None:
    panel.annotate(text, (place[0], place[1]), ha="center", va="center", fontsize=style.LEAST,
                   linespacing=1.25, rotation=degrees, rotation_mode="anchor")  # fmt: skip


def large(panel: Axes, spot: SpotLight, centroid: Floats, letter: str) -> Any:
    """Draw a spot with its centroid R, the images of apex (Q) and beam (S), and the circle."""
    hues = chosen_hues()
    image = shine(panel, spot) if spot.grid.size else None
    panel.plot(*spot.circle.T, "--", color=hues.grey, lw=1, label="the beam's 1/e² circle")
    halo: dict[str, Any] = {"mec": "#101010", "mew": 0.9, "ls": ""}
    panel.plot(*spot.apex, "^", color="#FFFFFF", ms=7, label="Q, image of the apex", **halo)
    panel.plot(*spot.beam, "o", color="#FFFFFF", ms=6, label="S, of the beam's centre", **halo)
    panel.plot(*centroid, "P", color=hues.detectors[letter], ms=9, label="R, centroid",
               mec="#FFFFFF", mew=0.9, ls="")  # fmt: skip
    panel.set_aspect("equal", adjustable="datalim")
    panel.margins(0.1)
    panel.locator_params(axis="x", nbins=2)
    panel.locator_params(axis="y", nbins=4)
    panel.set_xlabel("psi, mm")
    return image


def plan_picture(sensor: Sensor, state: Floats) -> Figure:
    """Draw the plan with dimensions, to scale except for the mirror."""
    posed, hues = PosedSensor.from_state(sensor, state), chosen_hues()
    far = max(psd.radius for psd in sensor.psds)
    with style.style_context(axes__grid=False):
        picture = style.figure(5.0, 4.9)
        panel = picture.subplots()
        for k, letter in enumerate(DETECTORS):
            detector(panel, posed, k, sensor.psds[k], hues.detectors[letter], letter)
        zoom = 0.05 * far / scene.rim_of(sensor)
        around = np.array(posed.at.apex)[:2]
        for facet in scene.mirror(posed)[..., :2]:
            shape = around + zoom * (facet - around)
            panel.fill(*shape.T, facecolor=hues.grey, edgecolor=hues.ink, lw=1, alpha=0.7)
        title = f"from above, the mirror {zoom:.2g} times as large"
        panel.set(aspect="equal", xlabel="x_w, mm", ylabel="y_w, mm", title=title)
        panel.margins(0.22)
    return picture


def detector(panel: Axes, posed: PosedSensor, k: int, psd: Psd, hue: str, letter: str) -> None:
    """Draw a detector, the sub-beam to it, and its dimensions."""
    centre, axis = (np.array(at[k], float) for at in (posed.geometry.centres, posed.geometry.axes))
    ends = (centre + [[-psd.size_y / 2], [psd.size_y / 2]] * axis[1])[:, :2]
    panel.plot(*ends.T, color=hue, lw=5, solid_capstyle="butt")
    out = np.array([np.cos(psd.azimuth), np.sin(psd.azimuth)])
    rims = scene.rims(posed, k)
    if rims.size:
        panel.plot(*rims.mean(axis=1)[:, :2].T, color=hue, lw=1.4)
    away = 1.16 + 0.16 * abs(out[0])
    sizes = f"{psd.size_y:g} x {psd.size_z:g} mm"
    write(panel, f"{letter.upper()}\n{sizes}", away * psd.radius * out)
    turned = (np.degrees(psd.azimuth) + 90) % 180 - 90  # along the beam, never upside down
    up = np.array([-np.sin(np.radians(turned)), np.cos(np.radians(turned))])
    text = f"{psd.radius:g} mm, {np.degrees(psd.azimuth):.0f}°"
    write(panel, text, psd.radius * (0.58 * out + 0.055 * up), turned)
