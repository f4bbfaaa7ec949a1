"""The scripts that draw a rig, for a page that receives its states from elsewhere."""

from __future__ import annotations

import json

from ...core.hues import DARK, LIGHT
from ...core.sensor import Sensor
from .model import model, text_of

#: The hues of A, B and C, by the page's theme.
HUES = {theme: [*hues.detectors.values()] for theme, hues in (("light", LIGHT), ("dark", DARK))}
#: Script that defines `RIG`, the bodies of a rig with these hues; it needs `Model`.
RIG = f"const RIG = {{hues: {json.dumps(HUES)}, ...Model.bodies()}};\n"


def rig_scripts(sensor: Sensor) -> dict[str, str]:
    """Return the shared style and the scripts by name, in loading order.

    They define `THREE`, `Digits`, `Model`, `RIG`, `Rig`, `Faces` and `Parts`, which the comments at
    their beginnings describe.
    """
    names = ("digits", "scene", "faces", "parts")
    return {
        "base.css": text_of("base.css"),
        "three.min.js": text_of("vendor/three.min.js"),
        "model.js": model(sensor),
        "data.js": RIG,
        **{f"{name}.js": text_of(f"{name}.js") for name in names},
    }
