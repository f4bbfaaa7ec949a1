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


def prove(
    claim: Claim, work: int, limit: float, reach: bool, file: Path, about: dict[str, str]
) -> dict[str, Any]:
    """Prove, print the result, and write the certificate; return the entries of the record."""
    settings = claim.settings
    found, cover = certify_range(claim, work, limit)
    proof.certificate.write_certificate(
        file, settings.sensor, found, about, settings.resolved, cover
    )
    pair = None if found.unique or not found.share else look_for_pair(claim, found)
    for line in [*describe_set(claim, found, cover), *verdict(found, pair)]:
        typer.echo(line)
    results = {
        "outcome": outcome(found, pair),
        "regular": found.regular,
        "unique": found.unique,
        "margin": found.margin,
        "holds_whole_range": cover is not None,
    }
    if reach and found.unique:
        results["reach"] = prove_reach(claim, found, file, about)
    elif reach and found.share:
        results["reach"] = prove_core(claim, found, file, about)
    return results


def certify_range(claim: Claim, work: int, limit: float) -> tuple[Certificate, RangeCover | None]:
    """Certify the whole range if possible, otherwise the box of the request."""
    sensor, share = claim.settings.sensor, claim.least_share
    cover = None
    if claim.whole_range and share is not None:
        cover = proof.range_cover.cover_range(sensor, claim.settings.range, share, claim.deviations)
    if cover is not None:
        found = certify_box(
            replace(claim, box=characterization.state_box.box_of_poses(cover.low, cover.high)),
            work,
            limit,
        )
        if found.unique:
            return found, cover
    return certify_box(claim, work, limit), None


def certify_box(claim: Claim, work: int, limit: float) -> Certificate:
    sensor, share = claim.settings.sensor, claim.least_share
    effort = proof.uniqueness.Effort(work, limit)
    with show_progress("proving") as tell:
        return proof.uniqueness.certify(
            sensor, claim.box, share, claim.deviations, effort, lambda done: tell(done, 1.0)
        )


def look_for_pair(claim: Claim, found: Certificate) -> PairSearch | None:
    """Search two states of the set with equal readings, starting at the weakest known state."""
    if claim.weakest is None:
        return None
    return characterization.ambiguity.find_pair_in_box(
        claim.settings.sensor, found.box, found.share, claim.weakest
    )


def write_beside(claim: Claim, proved: Certificate, file: Path, about: dict[str, str]) -> Path:
    """Write the certificate of another box of the same sensor beside the first."""
    beside = reach_file(file)
    proof.certificate.write_certificate(
        beside, claim.settings.sensor, proved, about, claim.settings.resolved
    )
    return beside


def prove_reach(claim: Claim, found: Certificate, file: Path, about: dict[str, str]) -> float:
    """Prove the largest enlarged box of poses; write its certificate beside the other."""
    factor, larger = proof.reach.find_reach(
        claim.settings.sensor, found.box, found.share, claim.deviations
    )
    if larger is None:
        typer.echo("no larger box of poses is proved, down to one 5 per cent larger")
        return factor
    beside = write_beside(claim, larger, file, about)
    typer.echo(
        f"proved too: a box of poses {round_down(factor)} times as large about zero, with the"
        f" same least light"
        + (
            ", the largest that is tried"
            if factor >= proof.reach.LARGEST_SCALING
            else "; a larger one may be too"
        )
        + f" ({beside.name})"
    )
    return factor


def prove_core(claim: Claim, found: Certificate, file: Path, about: dict[str, str]) -> float:
    """Prove the largest reduced box of poses; write its certificate beside the other."""
    factor, smaller = proof.reach.find_core(
        claim.settings.sensor, found.box, found.share, claim.deviations
    )
    if smaller is None:
        typer.echo("no smaller box of poses is proved either, down to a twelfth")
        return factor
    beside = write_beside(claim, smaller, file, about)
    typer.echo(
        f"proved: a box of poses {round_down(factor)} times as large about its middle, with the"
        f" same least light ({beside.name})"
    )
    return factor
