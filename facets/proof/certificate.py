"""A certificate of uniqueness as a JSON file with everything that a checker needs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..core.sensor import Sensor
from ..files.whole import write_text
from ..model.arrays import parameters
from .uniqueness import Certificate

#: The format of the file; a checker refuses any other.
FORMAT = "facets uniqueness certificate 2"


def write_certificate(
    path: Path,
    sensor: Sensor,
    certificate: Certificate,
    about: dict[str, str],
    resolved: dict[str, Any] | None = None,
) -> None:
    """Write a certificate in mm, rad and mW, with floats that read back the same.

    resolved: the configuration of the checksum in `about`. An unsuccessful certificate is also
    written, and the checker refuses it.
    """
    content = {
        "format": FORMAT,
        **about,
        "resolved": resolved,
        "parameters": parameters(sensor),
        "tolerances": certificate.tolerances,
        **certificate_claims(certificate),
        **certificate_proof(certificate),
    }
    write_text(path, json.dumps(content, indent=1))


def certificate_claims(certificate: Certificate) -> dict[str, Any]:
    """Return the claims about the box of poses and about the light on each facet."""
    return {
        "low": certificate.box.low[:6].tolist(),
        "high": certificate.box.high[:6].tolist(),
        "least_share": certificate.least_share,
        "regular": certificate.regular,
        "unique": certificate.unique,
        "margin": certificate.margin,
        "least_determinant": certificate.at_least,
        "reason": certificate.reason,
        "seconds": certificate.seconds,
        "work": certificate.work,
    }


def certificate_proof(certificate: Certificate) -> dict[str, Any]:
    """Return the evidence for the claims."""
    return {
        "light": certificate.shares,
        "middles": certificate.middles,
        "inverse": certificate.inverse.tolist(),
        "weights": certificate.weights.tolist(),
        "pieces": [piece._asdict() for piece in certificate.pieces],
        "doubtful": [piece._asdict() for piece in certificate.doubtful],
    }
