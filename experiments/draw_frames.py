"""The drawing of frames and symbols in the documentation.

    python -m facets.experiments.draw_frames docs/frames.svg

Not to scale: the mirror is some millimetres wide and the detectors stand 250 mm off.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon, Rectangle

from facets.core.hues import LIGHT, use_style
from facets.pictures import style

INK, BEAM, MIRROR = LIGHT.ink, LIGHT.alarm, LIGHT.grey


def arrow(axes: Axes, start: Any, step: Any, label: str, colour: str = INK) -> None:
    axes.annotate(
        "", start + step, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.4}
    )
    place = start + step * (1 + 0.14 / np.linalg.norm(step) * 1.2)
    write(axes, place, label, color=colour, fontsize=11)


def write(axes: Axes, place: Any, text: str, **style: Any) -> None:
    axes.text(place[0], place[1], text, ha="center", va="center", **style)


def direction(degrees: float) -> Any:
    return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])


def plan(axes: Axes) -> None:
    """Seen from above: edges, facets, detectors and their azimuths."""
    rim = [0.62 * direction(angle) for angle in (-60, 60, 180)]
    axes.add_patch(Polygon(rim, facecolor=MIRROR, edgecolor=INK, alpha=0.5))
    for corner in rim:
        axes.plot(*np.transpose([[0, 0], corner]), color=INK, lw=1)
    axes.plot(0, 0, "o", color=BEAM, ms=5)
    for letter, azimuth in zip("ABC", (0, 120, 240), strict=True):
        out = direction(azimuth)
        side, hue = np.array([-out[1], out[0]]), LIGHT.detectors[letter.lower()]
        axes.plot(*np.transpose([0.18 * out, 2.0 * out]), color=hue, lw=1.2, ls="--")
        write(axes, 0.2 * direction(azimuth - 18), letter, fontsize=9)
        axes.plot(*np.transpose([2 * out - 0.55 * side, 2 * out + 0.55 * side]), color=hue, lw=5)
        write(axes, 2.05 * out - 0.85 * side, f"PSD {letter}", color=hue)
        arrow(axes, 2 * out, 0.55 * out, f"$x_{letter.lower()}$", hue)
        arrow(axes, 2 * out, 0.72 * side, rf"$\psi_{letter.lower()}$", hue)
    arrow(axes, np.zeros(2), 0.95 * direction(0), "", INK)
    arrow(axes, np.zeros(2), 0.95 * direction(90), "$y_w$", INK)
    axes.text(1.02, -0.16, "$x_w$", ha="center")
    axes.text(1.45, 0.12, "250 mm", color=LIGHT.detectors["a"], ha="center", fontsize=9)
    axes.set_title("from above ($z_w$ towards you)", fontsize=11)
    axes.set(xlim=(-2.2, 3), ylim=(-2.6, 2.6))


def elevation(axes: Axes) -> None:
    """Seen along -y: the beam comes down, facet A sends it to PSD A."""
    apex, hue = np.array([0.0, 0.0]), LIGHT.detectors["a"]
    axes.add_patch(
        Polygon([(0, 0), (0.6, -0.6), (-1.2, -0.6)], facecolor=MIRROR, edgecolor=INK, alpha=0.5)
    )
    axes.add_patch(Rectangle((-0.09, 0), 0.18, 2.2, color=BEAM, alpha=0.25, lw=0))
    axes.plot([0.05, 0.05], [2.2, -0.05], color=BEAM, lw=1.2)
    axes.plot([0.05, 2.4], [-0.05, -0.05], color=hue, lw=1.2, ls="--")
    axes.text(0.16, 1.75, "laser beam, centre $(b_x, b_y)$,\npower $P$, $1/e^2$ diameter $\\phi_l$",
              color=BEAM, fontsize=9)  # fmt: skip
    axes.plot([2.4, 2.4], [-0.65, 0.65], color=hue, lw=5)
    axes.text(2.4, -0.85, "PSD A", color=hue, ha="center")
    arrow(axes, np.array([2.4, 0.0]), np.array([0.55, 0.0]), "$x_a$", hue)
    arrow(axes, np.array([2.4, 0.0]), np.array([0.0, 0.95]), r"$\zeta_a$", hue)
    arrow(axes, apex, np.array([0.75, 0.0]), "", INK)
    axes.text(0.72, 0.12, "$x_w$", ha="center")
    arrow(axes, apex, np.array([0.0, 1.25]), "", INK)
    axes.text(-0.22, 1.2, "$z_w$", ha="center")
    axes.text(-0.95, 0.12, "apex\n$(t_x, t_y, t_z)$", ha="center", fontsize=9)
    axes.text(0.08, -0.45, "45°", fontsize=9)
    axes.text(-1.25, -1.0, "roll, pitch, yaw about $x$, $y$, $z$:\n"
              r"$R = R_z(\mathrm{yaw})\,R_y(\mathrm{pitch})\,R_x(\mathrm{roll})$",
              fontsize=9, va="top")  # fmt: skip
    axes.set_title("from the side ($y_w$ away from you)", fontsize=11)
    axes.set(xlim=(-1.6, 3.4), ylim=(-2.2, 2.4))


def main() -> None:
    with use_style("paper"), style.style_context():
        figure = style.figure(10.5, 5)
        left, right = figure.subplots(1, 2)
        plan(left)
        elevation(right)
        for axes in (left, right):
            axes.set_aspect("equal")
            axes.axis("off")
        style.save(figure, Path(sys.argv[1]))


if __name__ == "__main__":
    main()
