"""A drawing of a head as SVG: plan and section, with its dimensions."""

from __future__ import annotations

from collections.abc import Iterable
from math import cos, degrees, hypot, sin, tan

import numpy as np

from ...core.names import DETECTORS
from ...core.sensor import Sensor
from ...core.units import Floats
from ...model.arrays import geometry_of, readings
from .wording import typeset

#: Size of each of the two views, in units of the picture, and the margin around it.
SIZE, EDGE = 300.0, 46.0
#: Colours, as custom properties of the page that shows the drawing.
INK, GREY, SOFT, RULE = (f"var(--{name})" for name in ("ink", "grey", "soft", "rule"))
FONT = "font-family='sans-serif' font-size='11'"


def drawing(sensor: Sensor) -> str:
    """Draw the plan, and each detector's section through the axis, to one scale, as SVG."""
    geometry = geometry_of(sensor)
    centres, sides = np.array(geometry.centres), np.array(geometry.axes)[:, -2:]
    spots = np.nan_to_num(readings(sensor, np.zeros(8))).reshape(3, 3)[:, :2]
    lit = centres + (spots[:, :, None] * sides).sum(axis=1)
    scale = (SIZE - 2 * EDGE) / (2.15 * float(np.hypot(centres[:, 0], centres[:, 1]).max()))
    parts = [*plan(sensor, centres, sides, lit, scale), *section(sensor, centres, lit, scale)]
    reach = np.abs(centres[:, 2]).max() + max(psd.size_z for psd in sensor.psds) / 2
    below = max(SIZE, SIZE / 2 + scale * reach + EDGE)
    return (
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {2 * SIZE + EDGE:.0f} {below:.0f}' "
        f"width='{2 * SIZE + EDGE:.0f}' role='img' aria-label='the head from above and in section'>"
        f"{''.join(parts)}</svg>"
    )


def line(
    a: Iterable[float], b: Iterable[float], colour: str, width: float, dashes: str = ""
) -> str:
    (x1, y1), (x2, y2) = a, b
    dash = f" stroke-dasharray='{dashes}'" if dashes else ""
    return (
        f"<line x1='{x1:.2f}' y1='{y1:.2f}' x2='{x2:.2f}' y2='{y2:.2f}' stroke='{colour}' "
        f"stroke-width='{width}'{dash}/>"
    )


def text(x: float, y: float, words: str, anchor: str = "middle", colour: str = "") -> str:
    place = f"x='{x:.1f}' y='{y:.1f}' text-anchor='{anchor}'"
    return f"<text {place} {FONT} fill='{colour or INK}'>{typeset(words)}</text>"


def plan(sensor: Sensor, centres: Floats, sides: Floats, spots: Floats, scale: float) -> list[str]:
    """Draw the plan, x to the right and y up."""
    middle = SIZE / 2

    def pixel_of(place: Floats) -> tuple[float, float]:
        return middle + scale * float(place[0]), middle - scale * float(place[1])

    radius = float(np.hypot(centres[:, 0], centres[:, 1]).max())
    parts = [
        f"<circle cx='{middle}' cy='{middle}' r='{scale * radius:.2f}' fill='none' "
        f"stroke='{GREY}' stroke-dasharray='4 3'/>"
    ]
    for k, psd in enumerate(sensor.psds):
        reach = sides[k, 0] * psd.size_y / 2
        hue = f"var(--{DETECTORS[k]})"
        parts.append(line((middle, middle), pixel_of(spots[k]), hue, 1))
        parts.append(line(pixel_of(centres[k] - reach), pixel_of(centres[k] + reach), hue, 4))
        out = centres[k] * (1 + 17 / (scale * hypot(*centres[k, :2])))
        x, y = pixel_of(out)
        parts.append(text(x, y + 4, f"{DETECTORS[k].upper()} {degrees(psd.azimuth):.4g}\u00b0"))
    parts.append(f"<circle cx='{middle}' cy='{middle}' r='3' fill='{INK}'/>")
    beam = sensor.beam
    width = f"{beam.diameter_x:.4g}" + (
        "" if beam.diameter_x == beam.diameter_y else f" x {beam.diameter_y:.4g}"
    )
    parts.append(text(middle, SIZE - 8, f"head \u2300 {2 * radius:.4g} mm, beam \u2300 {width} mm"))
    return parts


def section(sensor: Sensor, centres: Floats, spots: Floats, scale: float) -> list[str]:
    """Draw the half plane of each detector through the axis, outward to the right and z up."""
    axis, middle = SIZE + EDGE, SIZE / 2
    parts = [line((axis, 14), (axis, middle), INK, 1.4)]
    parts.append(text(axis + 6, 22, "beam", "start"))
    drawn: set[tuple[float, ...]] = set()
    different = len({(p.radius, p.height, p.pitch, p.size_z) for p in sensor.psds}) > 1
    for k, (facet, psd) in enumerate(zip(sensor.facets, sensor.psds, strict=True)):
        r, z = hypot(*centres[k, :2]), float(centres[k, 2])
        what = (round(r, 3), round(z, 3), round(psd.pitch, 5), round(facet.inclination, 5))
        if what in drawn:
            continue
        drawn.add(what)
        hue = f"var(--{DETECTORS[k]})" if different else SOFT
        along = 34.0
        end = (axis + along * cos(facet.inclination), middle + along * sin(facet.inclination))
        parts.append(line((axis, middle), end, INK, 2))
        spot = (axis + scale * hypot(*spots[k, :2]), middle - scale * float(spots[k, 2]))
        parts.append(line((axis, middle), spot, hue, 1))
        lean = tan(psd.pitch)
        half = scale * psd.size_z / 2 / hypot(1, lean)
        x, y = axis + scale * r, middle - scale * z
        parts.append(line((x - half * lean, y + half), (x + half * lean, y - half), hue, 4))
        name = DETECTORS[k].upper() if different else "each"
        words = [f"{name}: R {r:.5g} mm", f"height {z:.5g} mm", f"pitch {1e3 * psd.pitch:.4g} mrad",
                 f"area {psd.size_y:.4g} x {psd.size_z:.4g} mm",
                 f"facet at {degrees(facet.inclination):.4g}\u00b0"]  # fmt: skip
        top = 40 + 70 * (len(drawn) - 1)
        right = axis + SIZE - EDGE
        parts += [text(right, top + 13 * n, word, "end") for n, word in enumerate(words)]
    parts.append(line((axis, middle), (axis + SIZE - EDGE, middle), RULE, 0.8, "4 3"))
    return parts
