"""The proof for a design that a search has found, within a stated amount of work."""

from __future__ import annotations

from ..characterization.state_box import least_share, range_box
from ..core.errors import InputError
from ..core.rules import Rules
from ..core.sensor import Sensor
from .uniqueness import Certificate, Effort, certify

#: Boxes that a proof of a design examines by default.
MOST_PIECES = 400


def certify_design(sensor: Sensor, rules: Rules, work: int = MOST_PIECES) -> Certificate | str:
    """Certify the box of the ranges of a design's axes, or return why an axis has no range."""
    try:
        box = range_box(sensor, rules)
    except InputError as error:
        return str(error)
    return certify(sensor, box, least_share(sensor, rules), effort=Effort(work))


def proof_margin(sensor: Sensor, rules: Rules, work: int = MOST_PIECES) -> float:
    """Return the margin of the proof by `certify_design`, NaN if nothing was proved."""
    certificate = certify_design(sensor, rules, work)
    return (
        certificate.margin
        if isinstance(certificate, Certificate) and certificate.unique
        else float("nan")
    )
