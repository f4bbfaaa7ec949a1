"""What is said of causes that a fit has no unknowns for, see `unmodelled`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..core.names import ANGLES, DETECTORS, POSE
from .misfit import KINDS, Finding
from .outliers import POWER_ACCURACY
from .unmodelled import (
    APART_CHANCE,
    BEAM,
    CHIP,
    FRINGES,
    GHOST,
    LEAST_CHANCE,
    MODES,
    SEAT,
    SHAPE,
    Trace,
    Unmodelled,
)

#: What light does is reported where its size is above this multiple of the accuracy of the model of
#: real light: by polynomials that fit anything, and by the columns of one cause.
SHAPE_FACTOR, CAUSE_FACTOR = 2.0, 1.0
#: Light and reference are not told apart where their logarithms of chance differ by less than this
#: share: the linear model of large errors is not more accurate.
UNDECIDED_SHARE = 0.1


def unmodelled_findings(unmodelled: Unmodelled) -> list[Finding]:
    """Findings that forbid the use of a fit whose model lacks something."""
    changes = change_findings(unmodelled.changes, unmodelled.rows)
    light = light_finding(unmodelled)
    return [*changes, light] if light else changes


def light_finding(unmodelled: Unmodelled) -> Finding | None:
    """A finding on light that is not that of the model, and its likeliest cause."""
    likely = [
        trace for trace in unmodelled.light
        if trace.log_chance < np.log(LEAST_CHANCE) and trace.size / unmodelled.powers
        > POWER_ACCURACY * (SHAPE_FACTOR if trace.cause == SHAPE else CAUSE_FACTOR)
    ]  # fmt: skip
    if not likely:
        return None
    best = likely[0]
    ratio = unmodelled.reference.log_chance / best.log_chance
    if ratio > 1 - UNDECIDED_SHARE:
        return group_finding(ratio > 1 + UNDECIDED_SHARE)
    effect = (
        "The powers follow the mirror's place in a way that no unknown explains (by "
        f"{100 * best.size / unmodelled.powers:.2g} % of a power, r.m.s.): the light's "
        "cross-section is not that of the model. "
    )
    causes = (
        "Perhaps the beam is not Gaussian (other modes, a second reflex, fringes) or the mirror's "
        "tip is chipped."
        if best.cause == SHAPE
        else f"The likeliest cause: {describe_light(best)}.{alternatives(likely, describe_light)}"
    )
    return Finding(True, (
        f"{effect}{causes} x and y may be off by several times what is stated; look at the tip "
        "with a microscope and at the beam with a camera, clean it with a pinhole or a fibre, and "
        "tilt windows that reflect."
    ))  # fmt: skip


def group_finding(is_clear: bool) -> Finding:
    """A finding on residuals that errors of the reference explain as well as any light, or clearly
    better."""
    group = (
        "The reference's axes are not what they are said to be (scales, squareness, an offset from "
        "the line of measurement, a bow)"
        if is_clear
        else "Either the reference's axes or the light's cross-section are not what they are said "
        "to be, and these samples cannot tell which"
    )
    return Finding(True, (
        f"{group}: the residuals follow the motion in a way that no unknown explains. Measure "
        "again with the mirror turned by 120 degrees on the reference (seat_deg): errors of the "
        "reference stay with its axes, those of the light with the facets."
    ))  # fmt: skip


def alternatives(likely: list[Trace], describe: Callable[[Trace], str]) -> str:
    """A sentence on the causes that cannot be told apart from the first, if there are any."""
    limit = likely[0].log_chance + np.log(APART_CHANCE)
    others = [trace for trace in likely[1:] if trace.cause != SHAPE and trace.log_chance < limit]
    if not others:
        return ""
    words = " or ".join(describe(trace) for trace in others)
    return f" It could be {words} as well: these samples cannot tell."


def describe_light(trace: Trace) -> str:
    if trace.cause == CHIP:  # beside an area that all facets have in common, so others may be less
        largest = max(float(trace.amounts.max()), 0.0)
        parts = [k.upper() for k, area in zip(DETECTORS, trace.amounts, strict=True)
                 if area > 0.4 * largest > 0]  # fmt: skip
        facets = "all facets" if len(parts) == 3 else " and ".join(f"facet {k}" for k in parts)
        return f"the mirror's tip is chipped on {facets or 'some facets'}"
    if trace.cause == GHOST:
        return "a second reflex beside the beam, or a beam that is not symmetric"
    if trace.cause == MODES:
        return "a beam with other modes beside the Gaussian one"
    if trace.cause == FRINGES:
        return f"fringes across the beam, {trace.at:.2g} mm apart, or dust of such a size"
    return (
        f"fringes of the window of detector {trace.cause[-1].upper()}, {trace.at:.2g} mm apart in "
        "the spot's place or in z"
    )


def change_findings(changes: list[Trace], rows: NDArray[np.int64]) -> list[Finding]:
    """A finding on what jumped or drifted during the motion, and when.  rows: numbers of the
    samples."""
    if not changes:
        return []
    first = changes[0]
    others = alternatives(
        changes, lambda trace: f"{trace.cause} that {'jumped' if trace.at else 'drifted'}"
    )
    if not first.at:
        return [Finding(False, (
            f"Probably {first.cause} drifted during the motion: the residuals follow the rows' "
            f"order as they would then.{others} Give time_s, or let it warm up before."
        ))]  # fmt: skip
    before, after = rows[int(first.at) - 1 : int(first.at) + 1]
    return [Finding(True, (
        f"Between rows {before} and {after} {first.cause} jumped, by {step_size(first)}: "
        f"something is loose or was touched.{others} Fasten it and calibrate again, or calibrate "
        "with the rows behind it alone."
    ))]  # fmt: skip


def centre_findings(centre: float) -> list[Finding]:
    """A finding on a common offset of x and y, which no residual shows.  centre: the standard
    uncertainty of the light's middle, mm."""
    if not centre:
        return []
    return [Finding(False, (
        f"x and y of all poses may be off together by {1e3 * centre:.2g} um (standard uncertainty, "
        "included in what is stated), because a faint second reflex, a beam that is not quite "
        "Gaussian or a chipped tip moves the light's middle and leaves no residual. Differences of "
        "x and y do not have this error (calibrate.before.beam_profile_percent)."
    ))]  # fmt: skip


def step_size(step: Trace) -> str:
    if "gain" in step.cause:
        return f"{100 * step.amounts[0]:.3g} %"
    if step.cause == SEAT:
        sizes = [
            f"{factor * size:.3g} {unit} in {name}"
            for name, size in zip(POSE, step.amounts, strict=True)
            for factor, unit in [(1e6, "urad") if name in ANGLES else (1e3, "um")]
        ]
        return ", ".join(sizes)
    axes = ("x", "y") if step.cause == BEAM else KINDS[:2]
    parts = zip(axes, step.amounts, strict=True)
    return " and ".join(f"{1e3 * size:.3g} um along {name}" for name, size in parts)
