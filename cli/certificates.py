"""What `facets jacobian --certify` proves, in words that are no stronger than what was proved."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import typer

from facets import characterization, core, proof
from facets.core.names import STATE_COLUMNS, STATE_UNITS

from .bounds import box_lines, light_text, piece_text, round_down

if TYPE_CHECKING:
    from pathlib import Path

    from facets.characterization.ambiguity import PairSearch
    from facets.characterization.state_box import StateBox
    from facets.config import Config
    from facets.core.units import Floats
    from facets.proof.range_cover import RangeCover
    from facets.proof.tolerances import Tolerances
    from facets.proof.uniqueness import Certificate


@dataclass(frozen=True)
class Claim:
    """What is to be proved: of which sensors and which states.

    least_share: of the light, on each facet; None for the least anywhere in the box with its
    offsets.  whole_range: whether the box is to hold every pose that keeps the rules.
    weakest: the weakest state that a search found, from where to look for a counterexample.
    """

    settings: Config
    box: StateBox
    least_share: float | None
    whole_range: bool
    tolerances: Tolerances | None
    weakest: Floats | None

    @property
    def largest_power(self) -> float:
        """Of the laser, mW."""
        power = self.settings.sensor.beam.power
        return power if self.deviations is None else power + self.deviations[0]

    @property
    def deviations(self) -> tuple[float, ...] | None:
        return None if self.tolerances is None else self.tolerances.values


def claim_for(
    settings: Config,
    box: StateBox,
    least_share: float | None,
    factor: float | None,
    weakest: Floats | None,
) -> Claim:
    """factor: of the standard uncertainties that are allowed for; None for the sensor as it is."""
    known = None if factor is None else proof.tolerances.calibration_tolerances(settings, factor)
    whole = least_share is not None
    if whole and known is not None:
        least_share = characterization.state_box.least_share(
            settings.sensor, settings.range, known.values[0]
        )
    return Claim(settings, box, least_share, whole, known, weakest)


def prove(
    claim: Claim, work: int, limit: float, reach: bool, file: Path, about: dict[str, str]
) -> dict[str, Any]:
    """Proves, says what, and writes the certificate; what the record says of it."""
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
    """The whole range, where it can be; else the box that was given."""
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
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("proving", total=1.0)

        def tell(done: float) -> None:
            progress.update(task, completed=done)

        sensor, share = claim.settings.sensor, claim.least_share
        return proof.uniqueness.certify(
            sensor, claim.box, share, limit, tell, claim.deviations, work
        )


def look_for_pair(claim: Claim, found: Certificate) -> PairSearch | None:
    """Two states of the set with equal readings, from the weakest state that is known."""
    if claim.weakest is None:
        return None
    return characterization.ambiguity.find_pair_in_box(
        claim.settings.sensor, found.box, found.share, claim.weakest
    )


def write_beside(claim: Claim, proved: Certificate, file: Path, about: dict[str, str]) -> Path:
    """The certificate of another box of the same sensor, beside the first."""
    beside = reach_file(file)
    proof.certificate.write_certificate(
        beside, claim.settings.sensor, proved, about, claim.settings.resolved
    )
    return beside


def prove_reach(claim: Claim, found: Certificate, file: Path, about: dict[str, str]) -> float:
    """How much larger a box of poses is proved too; its certificate beside the other."""
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
            if factor >= proof.reach.FARTHEST
            else "; a larger one may be too"
        )
        + f" ({beside.name})"
    )
    return factor


def prove_core(claim: Claim, found: Certificate, file: Path, about: dict[str, str]) -> float:
    """How much smaller a box of poses is proved; its certificate beside the other."""
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


def reach_file(file: Path) -> Path:
    return file.with_name(f"{file.stem}-reach{file.suffix}")


def describe_set(claim: Claim, found: Certificate, cover: RangeCover | None) -> list[str]:
    """Which states the certificate is about, and what it takes for granted."""
    light = light_text(found.share, claim.largest_power)
    lines = [f"taken: every state with {light}", "  and its pose in"]
    lines += box_lines(found.box.low, found.box.high)
    lines += describe_range(claim, cover)
    lines.append(
        "  The model is the one that poses are solved with: collimated light, flat facets, no\n"
        "  other light and nothing that cuts it. That every facet faces the beam and every\n"
        "  sub-beam meets its detector's plane is part of what is proved. The laser's power may\n"
        "  be known or not, and the beam may stand anywhere."
    )
    if claim.settings.sensor.imperfections != core.sensor.Imperfections():
        lines.append(
            "  sensor.imperfections is no part of it: the solver does not know them either"
        )
    if claim.tolerances is not None:
        exact = ", ".join(claim.tolerances.exact) or "none"
        left_out = ", ".join(claim.tolerances.left_out) or "none"
        lines.append(
            f"  It holds for every sensor within the tolerances of {claim.tolerances.source};\n  "
            f"taken as exact: {exact}\n  not allowed for: {left_out}"
        )
    lines.append(f"  {len(found.pieces)} pieces proved, {found.seconds:.1f} s")
    return lines


def describe_range(claim: Claim, cover: RangeCover | None) -> list[str]:
    if cover is not None:
        lengths = ", ".join(round_down(far) for far in cover.farthest[:3])
        angles = ", ".join(round_down(far, 3, 1000) for far in cover.farthest[3:])
        return [
            "  The certificate's box, whose ends are rounded inwards here, holds every pose that\n"
            "  keeps the rules of the range, for any place of the beam and any power up to that,\n"
            f"  of those within {lengths} mm and {angles} mrad; this is proved by intervals."
        ]
    if claim.whole_range:
        return [
            "  which are the ranges of the axes, each with the others at rest: where several axes\n"
            "  move together, some poses that keep the rules of the range lie outside of it"
        ]
    return []


def outcome(found: Certificate, pair: PairSearch | None) -> str:
    """One of "proved", "counterexample" and "undecided"."""
    if found.unique:
        return "proved"
    return "counterexample" if pair is not None and pair.outside == 0 else "undecided"


def verdict(found: Certificate, pair: PairSearch | None) -> list[str]:
    lines = []
    if found.regular:
        bound = round_down(found.at_least)
        lines.append(
            f"proved: none is singular; |Eq. (11)| is {bound} or more (mm, mW, rad), a bound"
        )
    if found.unique:
        margin = round_down(found.margin)
        lines.append(
            f"proved: no two of them have the same readings; margin {margin} or more, of 1"
        )
        return lines
    if found.regular:
        lines.append("not proved: that no two of them have the same readings: the inequality fails,"
                     f" its margin being {round_down(found.margin)}")  # fmt: skip
    else:
        lines.append(f"not proved: {found.reason or 'some pieces were not done in the time given'}")
        lines += [f"  not proved in {piece_text(piece)}" for piece in found.doubtful[:3]]
    return lines + describe_pair(pair)


def describe_pair(pair: PairSearch | None) -> list[str]:
    if pair is None:
        return ["undecided: two states with the same readings were not looked for"]
    if pair.pair is None:
        length = (
            characterization.ambiguity.MAX_STEPS * characterization.ambiguity.STEP_UM_URAD / 1000
        )
        return [
            "undecided: no two states with the same readings were found, which proves nothing;\n"
            "  the way of which the readings tell least was followed from the weakest state for"
            f" {length:.0f} mm or mrad"
        ]
    if pair.outside > 0:
        by = f"{pair.outside:.3g} of its half width, or of a power's logarithm"
        lines = [f"undecided: the nearest two states with the same readings lie outside by {by}"]
    else:
        lines = ["counterexample, found by numbers: two states of it with the same readings"]
    rows = zip(STATE_COLUMNS, STATE_UNITS, pair.pair.one, pair.pair.other, strict=True)
    return lines + [f"  {n:<10} {a / unit:12.6g} {b / unit:12.6g}" for n, unit, a, b in rows]
