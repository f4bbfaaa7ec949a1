"""The faces of the detectors as Fig. 2 of the paper, and the plan as Fig. 3."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.sensor import Psd, Sensor
from ..core.units import Floats
from ..model.arrays import readings
from . import scene, style
from .scene import Spot, Stand

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def spots_picture(sensor: Sensor, state: Floats) -> Figure:
    """Each detector's face, and below it what is on it, large."""
    stand, reading = Stand.of(sensor, state), readings(sensor, state)
    with style.in_rules(axes__grid=False):
        picture = style.figure(9.6, 6.9)
        panels = picture.subplots(2, 3)
        for k, letter in enumerate("ABC"):
            spot, centroid = scene.spot(stand, k), reading[3 * k : 3 * k + 2]
            face(panels[0, k], sensor.psds[k], spot, centroid)
            panels[0, k].set_title(f"PSD {letter}: {light_on(sensor.psds[k], reading[3 * k :])}")
            image = large(panels[1, k], spot, centroid)
        if image is not None:
            bar = picture.colorbar(image, ax=panels[1, :].tolist(), shrink=0.8)
            bar.set_label("irradiance over the beam's largest")
        handles, names = panels[1, 0].get_legend_handles_labels()
        picture.legend(handles, names, loc="outside lower center", ncols=len(names))
    return picture


def light_on(psd: Psd, reading: Floats) -> str:
    """What a detector's title says of its (psi, zeta, power)."""
    psi, zeta, power = reading[:3]
    if np.isnan(power):
        return "no light"
    beside = abs(psi) > psd.size_y / 2 or abs(zeta) > psd.size_z / 2
    return f"{1e3 * power:.1f} µW" + (" beside it" if beside else "")


def face(panel: Axes, psd: Psd, spot: Spot, centroid: Floats) -> None:
    """The whole sensitive area."""
    from matplotlib.patches import Rectangle

    corner = (-psd.size_y / 2, -psd.size_z / 2)
    panel.add_patch(
        Rectangle(corner, psd.size_y, psd.size_z, facecolor="#DCE6DC", edgecolor=style.INK)
    )
    if spot.grid.size:
        panel.pcolormesh(*spot.grid.transpose(2, 0, 1), spot.light, cmap="inferno", vmin=0, vmax=1,
                         shading="gouraud", rasterized=True)  # fmt: skip
    panel.plot(*centroid, "+", color=style.BLUE, ms=10)
    panel.axhline(0, color=style.GREY, lw=0.6)
    panel.axvline(0, color=style.GREY, lw=0.6)
    half = 0.54 * max(psd.size_y, psd.size_z)
    panel.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
    panel.set(xlabel="psi, mm", ylabel="zeta, mm")


def write(panel: Axes, text: str, place: Floats, size: float = 9) -> None:
    panel.annotate(text, (place[0], place[1]), ha="center", va="center", fontsize=size)


def large(panel: Axes, spot: Spot, centroid: Floats) -> Any:
    """The spot with its centroid R, the images of apex Q and beam S, and the circle cut away."""
    image = None
    if spot.grid.size:
        image = panel.pcolormesh(*spot.grid.transpose(2, 0, 1), spot.light, cmap="inferno", vmin=0,
                                 vmax=1, shading="gouraud", rasterized=True)  # fmt: skip
    panel.plot(*spot.circle.T, "--", color=style.GREY, lw=1, label="the beam's 1/e² circle")
    panel.plot(*spot.apex, "^", color=style.GREEN, label="Q, image of the apex")
    panel.plot(*spot.beam, "o", color=style.BLUE, mfc="none", label="S, of the beam's centre")
    panel.plot(*centroid, "+", color=style.BLUE, ms=12, mew=2, label="R, centroid")
    panel.set_aspect("equal", adjustable="datalim")
    panel.margins(0.1)
    panel.set(xlabel="psi, mm", ylabel="zeta, mm")
    return image


def plan_picture(sensor: Sensor, state: Floats) -> Figure:
    """Seen from above, to scale but for the mirror, with dimensions."""
    stand = Stand.of(sensor, state)
    with style.in_rules(axes__grid=False):
        picture = style.figure(6.4, 6.0)
        panel = picture.subplots()
        for k, (psd, letter) in enumerate(zip(sensor.psds, "ABC", strict=True)):
            ends = scene.detector(stand, k).points[:2, :2]
            panel.plot(*ends.T, color=style.GREEN, lw=5, solid_capstyle="butt")
            centre = psd.radius * np.array([np.cos(psd.azimuth), np.sin(psd.azimuth)])
            beam = scene.sub_beam(stand, k)
            if beam is not None:
                half = len(beam.points) // 2
                line = np.array([beam.points[:half].mean(0), beam.points[half:].mean(0)])[:, :2]
                panel.plot(*line.T, color=style.ORANGE, lw=1.2)
            text = f"PSD {letter}\n{psd.size_y:g} by {psd.size_z:g} mm"
            write(panel, text, 1.25 * centre)
            turn = 0.16 if np.cos(psd.azimuth) > 0 else -0.32
            side = (
                psd.radius
                * 0.55
                * np.array([np.cos(psd.azimuth + turn), np.sin(psd.azimuth + turn)])
            )
            label = f"{psd.radius:g} mm, {np.degrees(psd.azimuth):.0f}°"
            write(panel, label, side, 8)
        zoom = 0.05 * max(psd.radius for psd in sensor.psds) / scene.rim_of(sensor)
        for body in scene.mirror(stand):
            around = np.array(stand.at.apex)[:2]
            shape = around + zoom * (body.points[:, :2] - around)
            panel.fill(*shape.T, facecolor="#9FB4C7", edgecolor=style.INK, lw=1)
        far = 0.3 * max(psd.radius for psd in sensor.psds)
        write(panel, f"mirror drawn\n{zoom:.2g} times as large", np.array([far, -far / 2]), 8)
        panel.set(aspect="equal", xlabel="x_w, mm", ylabel="y_w, mm", title="from above")
        panel.margins(0.2)
    return picture
