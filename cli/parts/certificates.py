"""The proof of `facets jacobian --certify`, and its certificates."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from facets import characterization, proof

from ..console import show_progress
from ..options.claims import Claim
from ..sentences.certificate import describe_set, outcome, verdict

if TYPE_CHECKING:
    from pathlib import Path

    from facets.characterization.ambiguity import AmbiguousPair
    from facets.proof.uniqueness import Certificate


def prove(claim: Claim, work: int, file: Path, about: dict[str, str]) -> dict[str, Any]:
    """Prove, print the result, and write the certificate; return the entries of the record."""
    settings = claim.settings
    certificate = certify_box(claim, work)
    proof.certificate.write_certificate(
        file, settings.sensor, certificate, about, settings.resolved
    )
    is_doubted = bool(not certificate.unique and certificate.least_share)
    pair = look_for_pair(claim, certificate) if is_doubted else None
    for line in [*describe_set(claim, certificate), *verdict(certificate, pair)]:
        print(line)
    return {
        "outcome": outcome(certificate, pair),
        "regular": certificate.regular,
        "unique": certificate.unique,
        "margin": certificate.margin,
    }


def certify_box(claim: Claim, work: int) -> Certificate:
    with show_progress("proving") as on_progress:
        return proof.uniqueness.certify(
            claim.settings.sensor,
            claim.box,
            claim.least_share,
            claim.deviations,
            work,
            lambda fraction: on_progress(fraction, 1.0),
        )


def look_for_pair(claim: Claim, certificate: Certificate) -> AmbiguousPair | None:
    """Search two states of the set with equal readings, starting at the weakest known state."""
    if claim.weakest is None:
        return None
    return characterization.ambiguity.find_pair_in_box(
        claim.settings.sensor, certificate.box, certificate.least_share, claim.weakest
    )
