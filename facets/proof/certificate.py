"""A certificate of uniqueness as a file: all that a checker needs, as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..characterization.state_box import COLUMNS, UNITS
from ..core.sensor import Sensor
from ..files.tables import Whole
from ..model.arrays import parameters
from .uniqueness import Certificate

#: What the file says of itself; a checker refuses another.
FORMAT = "facets uniqueness certificate 1"


def write_certificate(
    path: Path, sensor: Sensor, found: Certificate, about: dict[str, str]
) -> None:
    """mm, rad and mW; floats as they are, so that they read back the same."""
    content: dict[str, Any] = {
        "format": FORMAT,
        **about,
        "parameters": parameters(sensor),
        "box": {
            name: [low / unit, high / unit]
            for name, unit, low, high in zip(
                COLUMNS[:6], UNITS[:6], found.domain.low[:6], found.domain.high[:6], strict=True
            )
        },
        "low": found.domain.low[:6].tolist(),
        "high": found.domain.high[:6].tolist(),
        "least_share": found.share,
        "regular": found.regular,
        "unique": found.unique,
        "margin": found.margin,
        "least_determinant": found.at_least,
        "reason": found.reason,
        "seconds": found.seconds,
        "light": found.shares,
        "inverse": found.inverse.tolist(),
        "weights": found.weights.tolist(),
        "pieces": [piece._asdict() for piece in found.pieces],
        "doubtful": [piece._asdict() for piece in found.doubtful],
    }
    with Whole(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1), "utf-8")
