"""Texts of certificates, which state no more than was proved."""

from __future__ import annotations

from typing import TYPE_CHECKING

from facets import characterization, proof
from facets.core.errors import InputError
from facets.core.names import STATE_COLUMNS, STATE_UNITS
from facets.core.plain_numbers import count_text

from .bounds import box_lines, light_text, piece_text, round_down

if TYPE_CHECKING:
    from facets.characterization.ambiguity import AmbiguousPair
    from facets.config import Config
    from facets.proof.uniqueness import Certificate

    from ..options.claims import Claim


def describe_set(claim: Claim, certificate: Certificate) -> list[str]:
    """Describe the states of the certificate and its assumptions."""
    light = light_text(certificate.least_share, claim.largest_power)
    lines = [f"taken: every state with {light}", "  and its pose in"]
    lines += box_lines(certificate.box.low, certificate.box.high)
    if claim.least_share is not None:
        lines.append(
            "  which are the ranges of the axes, each with the others at rest: where several axes\n"
            "  move together, some poses that keep the rules of the range lie outside of it"
        )
    lines.append(
        "  The model is the one that poses are solved with: collimated light, flat facets, no\n"
        "  other light and nothing that cuts it. That every facet faces the beam and every\n"
        "  sub-beam meets its detector's plane is part of what is proved. The laser's power may\n"
        "  be known or not, and the beam may be anywhere."
    )
    if claim.tolerances is not None:
        exact = ", ".join(claim.tolerances.exact) or "none"
        excluded = ", ".join(claim.tolerances.left_out) or "none"
        lines.append(
            f"  It holds for every sensor within the tolerances of {claim.tolerances.source};\n  "
            f"taken as exact: {exact}\n  not allowed for: {excluded}"
        )
    count = count_text(len(certificate.pieces), "piece")
    lines.append(f"  {count} proved, {certificate.seconds:.1f} s")
    return lines


def outcome(certificate: Certificate, pair: AmbiguousPair | None) -> str:
    """One of "proved", "counterexample" and "undecided"."""
    if certificate.unique:
        return "proved"
    return "undecided" if pair is None else "counterexample"


def verdict(certificate: Certificate, pair: AmbiguousPair | None) -> list[str]:
    lines = []
    if certificate.regular:
        bound = round_down(certificate.at_least)
        lines.append(
            f"proved: none is singular; |Eq. (11)| is {bound} or more (mm, mW, rad), a bound"
        )
    if certificate.unique:
        margin = round_down(certificate.margin)
        lines.append(
            f"proved: no two of them have the same readings; margin {margin} or more, of 1"
        )
        return lines
    if certificate.regular:
        lines.append("not proved: that no two of them have the same readings: the inequality fails,"
                     f" its margin being {round_down(certificate.margin)}")  # fmt: skip
    else:
        lines.append(
            f"not proved: {certificate.reason or 'some pieces were not done in the time given'}"
        )
        lines += [f"  not proved in {piece_text(piece)}" for piece in certificate.doubtful[:3]]
    return lines + describe_pair(pair)


def describe_pair(pair: AmbiguousPair | None) -> list[str]:
    if pair is None:
        return [
            "undecided: no two states of it with the same readings were found about its weakest "
            "state,\n  which proves nothing"
        ]
    rows = zip(STATE_COLUMNS, STATE_UNITS, pair.first, pair.second, strict=True)
    return [
        "counterexample, found by numbers: two states of it with the same readings",
        *(f"  {n:<10} {a / unit:12.6g} {b / unit:12.6g}" for n, unit, a, b in rows),
    ]


def prove_design(better: Config, work: int) -> str:
    """State whether it is proved with `work` boxes that readings determine states."""
    if not work:
        return "not proved: that the readings determine the pose (use --certify)"
    sensor, rules, places = better.sensor, better.range, characterization.state_box
    try:
        box = places.range_box(sensor, rules)
    except InputError as error:
        return f"not proved that readings determine states: {error}"
    fraction = places.least_share(sensor, rules)
    certificate = proof.uniqueness.certify(sensor, box, fraction, pieces=work)
    if not certificate.least_share:
        return f"not proved that readings determine states: {certificate.reason}"
    light = light_text(certificate.least_share, sensor.beam.power)
    states = f"states within the ranges of the axes and with {light}"
    seconds = f"({certificate.seconds:.1f} s)"
    if certificate.unique:
        margin = round_down(certificate.margin)
        return (
            f"proved: no two {states} have the same readings; margin {margin} or more, of 1 "
            f"{seconds}"
        )
    return (
        f"not proved that readings determine {states}, in the work allowed:"
        f" {certificate.reason or 'the inequality fails'} {seconds};\n"
        "`facets jacobian --certify` says more"
    )
