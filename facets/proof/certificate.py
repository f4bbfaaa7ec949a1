"""A certificate of uniqueness as a JSON file with everything that a checker needs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..core.sensor import Sensor
from ..files.tables import Whole
from ..model.arrays import parameters
from .range_cover import RangeCover
from .uniqueness import Certificate

#: The format of the file; a checker refuses any other.
FORMAT = "facets uniqueness certificate 2"


def write_certificate(
    path: Path,
    sensor: Sensor,
    found: Certificate,
    about: dict[str, str],
    resolved: dict[str, Any] | None = None,
    cover: RangeCover | None = None,
) -> None:
    """Write a certificate in mm, rad and mW, with floats that read back the same.

    resolved: the configuration whose checksum `about` has.  cover: the box proved to contain the
    measurement range. An unsuccessful certificate is written too, and the checker refuses it.
    """
    content = {
        "format": FORMAT,
        **about,
        "resolved": resolved,
        "parameters": parameters(sensor),
        "tolerances": found.tolerances,
        **certificate_claims(found),
        **certificate_proof(found),
        "range": None if cover is None else certificate_range(cover),
    }
    with Whole(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1), "utf-8")


def certificate_claims(found: Certificate) -> dict[str, Any]:
    """Return the claims about the box of poses and about the least share of the light."""
    return {
        "low": found.box.low[:6].tolist(),
        "high": found.box.high[:6].tolist(),
        "least_share": found.share,
        "regular": found.regular,
        "unique": found.unique,
        "margin": found.margin,
        "least_determinant": found.at_least,
        "reason": found.reason,
        "seconds": found.seconds,
        "work": found.work,
    }


def certificate_proof(found: Certificate) -> dict[str, Any]:
    """Return the evidence for the claims."""
    return {
        "light": found.shares,
        "middles": found.middles,
        "inverse": found.inverse.tolist(),
        "weights": found.weights.tolist(),
        "pieces": [piece._asdict() for piece in found.pieces],
        "doubtful": [piece._asdict() for piece in found.doubtful],
    }


def certificate_range(cover: RangeCover) -> dict[str, Any]:
    return {
        "farthest": cover.farthest,
        "halves_mm": cover.halves,
        "whole_spot": cover.whole,
        "boxes": cover.work,
    }
