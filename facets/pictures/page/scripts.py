"""What draws a rig, for a page that receives its states from elsewhere."""

from __future__ import annotations

import json

from ...core.sensor import Sensor
from .model import model, text_of
from .rig_data import rig


def rig_scripts(sensor: Sensor) -> dict[str, str]:
    """Return the shared style and the scripts by name, in loading order.

    They define `THREE`, `Digits`, `Model`, `RIG`, `Rig`, `Faces` and `Parts`; see their heads.
    """
    names = ("digits", "scene", "faces", "parts")
    return {
        "base.css": text_of("base.css"),
        "three.min.js": text_of("vendor/three.min.js"),
        "model.js": model(sensor),
        "data.js": f"const RIG = {json.dumps(rig(sensor))};\n",
        **{f"{name}.js": text_of(f"{name}.js") for name in names},
    }
