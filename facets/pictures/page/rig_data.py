"""A sensor's bodies as data that `scene.js` and `faces.js` draw beside the light."""

from __future__ import annotations

import math
from typing import Any

from ...core.hues import DARK, LIGHT
from ...core.sensor import Sensor
from ...model.arrays import geometry_of
from ...optics.forward import Geometry, mirror_edges
from ..stills.scene import rim_of

#: The hues of A, B and C, by the page's theme.
HUES = {"light": LIGHT.detectors, "dark": DARK.detectors}
LETTERS = ("A", "B", "C")


def rig(sensor: Sensor) -> dict[str, Any]:
    """`bodies`, and hues: of A, B and C by theme."""
    hues = {theme: list(hues.values()) for theme, hues in HUES.items()}
    return {"hues": hues, **bodies(sensor, geometry_of(sensor))}


def bodies(sensor: Sensor, geometry: Geometry) -> dict[str, Any]:
    """mirror: its facets' normals, the angles of its edges about its axis (rad), its rim (mm).
    detectors: centre, axes and half sizes (mm).  beam: direction, diameters and sigmas (mm),
    rotation (rad), power (mW) and the radius (sigmas) at which an aperture ends it.

    `javascript.py` writes this text, too.
    """
    beam = sensor.beam
    return {
        "mirror": {
            "normals": [list(normal) for normal in geometry.normals],
            "edges": [math.atan2(edge[1], edge[0]) for edge in mirror_edges(geometry.normals)],
            "rim": rim_of(sensor),
        },
        "detectors": [
            {
                "letter": letter,
                "centre": list(centre),
                "axes": [list(axis) for axis in axes],
                "half": [psd.size_y / 2, psd.size_z / 2],
            }
            for letter, centre, axes, psd in zip(
                LETTERS, geometry.centres, geometry.axes, sensor.psds, strict=True
            )
        ],
        "beam": {
            "direction": list(geometry.direction),
            "diameter": [beam.diameter_x, beam.diameter_y],
            "sigma": [beam.diameter_x / 4, beam.diameter_y / 4],
            "rotation": beam.rotation,
            "power": beam.power,
            "aperture": min(geometry.openings.radius, 1e3),
        },
    }
