"""The scripts that draw a rig, for a page that receives its states from elsewhere."""

from __future__ import annotations

import json

from ...core.sensor import Sensor
from .model import model, text_of
from .rig_data import rig


def rig_scripts(sensor: Sensor) -> dict[str, str]:
    """Return the scripts by name, in loading order.

    They define `THREE`, `Model`, `RIG`, `Rig` and `Faces`; see the heads of `scene.js` and
    `faces.js`.
    """
    return {
        "three.min.js": text_of("vendor/three.min.js"),
        "model.js": model(sensor),
        "data.js": f"const RIG = {json.dumps(rig(sensor))};\n",
        "scene.js": text_of("scene.js"),
        "faces.js": text_of("faces.js"),
    }
