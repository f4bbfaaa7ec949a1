"""The model of one sensor as JavaScript: its numbers, and the optics that they go into."""

from __future__ import annotations

from collections.abc import Callable
from importlib.resources import files
from typing import Any

from ...core.sensor import Sensor
from ...model.arrays import geometry_of
from ...optics import bench_light, curved_light, cut_light, detected, forward, limits, rays
from .javascript import javascript, literal, name_of

#: The optics' readings: of ideal light, of truncated light, of a bench's light, and of both.
READINGS: dict[tuple[bool, bool], Callable[..., Any]] = {
    (False, False): forward.readings,
    (True, False): detected.readings,
    (False, True): bench_light.readings,
    (True, True): cut_light.readings,
}
#: The functions with which `light.js` draws.
DRAWN = (
    forward.dark_scene,
    curved_light.apparent_scene,
    rays.hit,
    rays.reflect,
    rays.flight,
    rays.land,
)

MODEL = """\
const Model = (() => {{
{numbers}
{optics}

// The sensor at rest, as vectors; mm, mW.
const geometry = {geometry};
// Where the outlines of light that is cut are kept.
const workspace = [0, 1, 2].map(() => Array.from({{length: {most}}}, () => new Array({columns})));

{light}
return {{
  geometry,
  // The nine readings (psi, zeta, power of a, b, c; mm, mW) at a state (8,); mm, rad.
  readings: (state) => {readings}(geometry, state{workspace}).flat(),
  // What there is to draw at a state; see light.js.
  drawing: (state) => Light.drawing(geometry, state),
  onFacet: Light.onFacet,
}};
}})();
"""


def text_of(name: str) -> str:
    """Read a file of this folder."""
    return files(__package__).joinpath(name).read_text("utf-8")


def model(sensor: Sensor) -> str:
    """Return JavaScript that defines `Model`: readings and drawing of a sensor at a state."""
    cut = sensor.apertures.cut
    readings = READINGS[cut, sensor.light.on]
    return MODEL.format(
        numbers=text_of("numbers.js"),
        optics=javascript(readings, *DRAWN),
        geometry=literal(geometry_of(sensor)),
        light=text_of("light.js"),
        readings=name_of(readings),
        workspace=", workspace" if cut else "",
        most=limits.MOST_SIDES,
        columns=limits.COLUMNS,
    )
