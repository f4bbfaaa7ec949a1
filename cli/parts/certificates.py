"""The proof of `facets jacobian --certify`, and its certificates."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import typer

from facets import characterization, proof

from ..console import show_progress
from ..options.claims import Claim
from ..options.survey_request import reach_file
from ..sentences.bounds import round_down
from ..sentences.certificate import describe_set, outcome, verdict

if TYPE_CHECKING:
    from pathlib import Path

    from facets.characterization.ambiguity import PairSearch
    from facets.proof.range_cover import RangeCover
    from facets.proof.uniqueness import Certificate

#: Messages where no enlarged box is proved, and no reduced one.
NOT_PROVED = {
    True: "no larger box of poses is proved, down to one 5 per cent larger",
    False: "no smaller box of poses is proved either, down to a twelfth",
}


def prove(
    claim: Claim, work: int, limit: float, reach: bool, file: Path, about: dict[str, str]
) -> dict[str, Any]:
    """Prove, print the result, and write the certificate; return the entries of the record."""
    settings = claim.settings
    certificate, cover = certify_range(claim, work, limit)
    proof.certificate.write_certificate(
        file, settings.sensor, certificate, about, settings.resolved, cover
    )
    pair = (
        None if certificate.unique or not certificate.share else look_for_pair(claim, certificate)
    )
    for line in [*describe_set(claim, certificate, cover), *verdict(certificate, pair)]:
        typer.echo(line)
    results = {
        "outcome": outcome(certificate, pair),
        "regular": certificate.regular,
        "unique": certificate.unique,
        "margin": certificate.margin,
        "holds_whole_range": cover is not None,
    }
    if reach and (certificate.unique or certificate.share):
        results["reach"] = prove_other_box(claim, certificate, file, about)
    return results


def certify_range(claim: Claim, work: int, limit: float) -> tuple[Certificate, RangeCover | None]:
    """Certify the whole range if possible, otherwise the box of the request."""
    sensor, share = claim.settings.sensor, claim.least_share
    cover = None
    if claim.whole_range and share is not None:
        cover = proof.range_cover.cover_range(sensor, claim.settings.range, share, claim.deviations)
    if cover is not None:
        certificate = certify_box(
            replace(claim, box=characterization.state_box.box_of_poses(cover.low, cover.high)),
            work,
            limit,
        )
        if certificate.unique:
            return certificate, cover
    return certify_box(claim, work, limit), None


def certify_box(claim: Claim, work: int, limit: float) -> Certificate:
    sensor, share = claim.settings.sensor, claim.least_share
    effort = proof.uniqueness.Effort(work, limit)
    with show_progress("proving") as tell:
        return proof.uniqueness.certify(
            sensor, claim.box, share, claim.deviations, effort, lambda done: tell(done, 1.0)
        )


def look_for_pair(claim: Claim, certificate: Certificate) -> PairSearch | None:
    """Search two states of the set with equal readings, starting at the weakest known state."""
    if claim.weakest is None:
        return None
    return characterization.ambiguity.find_pair_in_box(
        claim.settings.sensor, certificate.box, certificate.share, claim.weakest
    )


def prove_other_box(
    claim: Claim, certificate: Certificate, file: Path, about: dict[str, str]
) -> float:
    """Prove the largest box of poses, enlarged if the box is proved and reduced if it is not; write
    its certificate beside the other, and return its size over that of the box."""
    larger = certificate.unique
    find = proof.reach.find_reach if larger else proof.reach.find_core
    settings = claim.settings
    factor, other = find(settings.sensor, certificate.box, certificate.share, claim.deviations)
    if other is None:
        typer.echo(NOT_PROVED[larger])
        return factor
    beside = reach_file(file)
    proof.certificate.write_certificate(beside, settings.sensor, other, about, settings.resolved)
    is_farthest = factor >= proof.reach.LARGEST_SCALING
    end = ", the largest that is tried" if is_farthest else "; a larger one may be too"
    typer.echo(
        f"proved{' too' * larger}: a box of poses {round_down(factor)} times as large about "
        f"{'zero' if larger else 'its middle'}, with the same least light{end * larger} "
        f"({beside.name})"
    )
    return factor
