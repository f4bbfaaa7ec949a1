"""A design's yield: its computation, and its tables."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING

from facets import core, design
from facets.core.names import POSE

from ..console import show_progress, show_table

if TYPE_CHECKING:
    from facets.config import Config
    from facets.core.sensor import Sensor
    from facets.design.results.tables import Rows
    from facets.design.tolerances.heads import SimulatedHeads
    from facets.design.tolerances.prediction import Sensitivity, YieldFractions


class Yields:
    """A design's yields: predicted, simulated, and by tolerance.

    nominal: least margin of the perfect head, and its name.  count: of simulated heads.
    """

    def __init__(
        self,
        nominal: tuple[float, str],
        predicted: YieldFractions,
        heads: SimulatedHeads,
        by_tolerance: list[Sensitivity],
        accurate: bool,
    ) -> None:
        self.predicted, self.heads, self.by_tolerance = predicted, heads, by_tolerance
        self.nominal, self.accurate = nominal, accurate
        self.count = len(heads.within_limits)


def yields_of(settings: Config, sensor: Sensor, heads: int, seed: int) -> Yields:
    """Compute the yields of a sensor's heads by `calibrate.before` and the block `optimize`."""
    heads_of = design.tolerances.heads.HeadSettings(
        settings.layout, settings.range, settings.calibrate
    )
    built = heads_of.assembly_of(sensor)
    expansion = design.tolerances.prediction.expand_margins(built)
    draws = design.tolerances.prediction.draw_heads(built)
    with show_progress("building heads") as on_progress:
        made = design.tolerances.heads.simulate_heads(built, heads, seed, on_progress)
    accurate = bool(built.requirement.accuracy_axes)
    worst = int(expansion.margins.argmin())
    return Yields(
        (float(expansion.margins[worst]), expansion.group(worst)),
        design.tolerances.prediction.predict_yields(expansion, draws),
        made,
        design.tolerances.prediction.sensitivities(expansion, draws),
        accurate,
    )


def show_yields(settings: Config, yields: Yields) -> None:
    if fault := nominal_fault(settings, yields):
        print(f"{fill(fault, 98)}\n")
    title = f"yield, as loose as calibrate.before says, of {yields.count} heads"
    show_table(title, *yield_rows(settings, yields))
    if yields.accurate:
        show_table("largest error in the volume, from rest: 95 % of the heads are within",
                   *error_rows(settings, yields))  # fmt: skip
    else:
        print("optimize.accuracy names no axis, so that no accuracy is required")
    if yields.heads.unsettled:
        print(f"{yields.heads.unsettled} calibrations did not settle; their heads fail\n")
    show_table("tolerances, the most worth while first", *tolerance_rows(settings, yields),
               left_columns=(0, 4))  # fmt: skip
    for advice in filter(None, (exact_tolerances(yields), margin_advice(settings, yields))):
        print(f"{fill(advice, 98)}\n")


def exact_tolerances(yields: Yields) -> str:
    """State which tolerances do not vary from head to head; "" if all do."""
    varied, words = [row.key for row in yields.by_tolerance], design.tolerances.prediction.OF_HEADS
    exact = [key + words[key] for key in words if key not in varied]
    if not exact:
        return ""
    return (
        f"Not varied from head to head: {', '.join(exact)}. A standard uncertainty in "
        "calibrate.before includes the part of each in the yield; laser_percent needs "
        "calibrate.laser: constant, too."
    )


#: Margins that are negative by no more than this are zero but for rounding.
ROUNDING = 1e-6


def nominal_fault(settings: Config, yields: Yields) -> str:
    """Name the requirement that the perfect head violates most; "" if it meets all."""
    margin, name = yields.nominal
    if margin >= -ROUNDING:
        return ""
    default = settings.layout.volume == core.layout.Layout().volume
    return (
        "The perfect head itself violates the requirements in the volume"
        f"{' (optimize.volume is the default)' if default else ''}, so that smaller tolerances "
        f"cannot help. The worst margin is {100 * margin:.3g} %: {name} (spots in per cent of half "
        "a detector, all else of the limit). Find a layout that meets the requirements with "
        "`facets optimize`, or set another optimize.volume."
    )


#: A yield below this value means that a design has too little margin.
LOW_YIELD = 0.5


def margin_advice(settings: Config, yields: Yields) -> str:
    """Advice for a design with a low yield; "" for a higher yield or without tolerances."""
    fraction = design.tolerances.heads.count_passes(yields.heads)["within_limits"] / yields.count
    if fraction >= LOW_YIELD or not yields.by_tolerance or nominal_fault(settings, yields):
        return ""
    strongest = yields.by_tolerance[0]
    words = (
        f"Only {percent(fraction)} of the heads keep spots, light and limits: the design has too "
        f"little margin, most of all for {strongest.key} ({strongest.worst}). The best layout for "
        "perfect heads lies at its limits"
    )
    if settings.layout.production:
        return f"{words}; choose smaller tolerances in calibrate.before, or weaker requirements."
    return (
        f"{words}. For a layout with margins set optimize.production.yield_percent, such as 95, "
        "and run `facets optimize` again; or take smaller tolerances in calibrate.before."
    )


def kinds_of(settings: Config, yields: Yields) -> dict[str, str]:
    """Requirements of a head in words, by the fields of `prediction.YieldFractions`."""
    kinds = {"within_limits": "spots, light and limits"}
    if yields.accurate:
        kinds["built"] = "and accuracy, as built"
    if yields.accurate and settings.layout.calibrated:
        kinds["calibrated"] = "and accuracy, calibrated"
    return kinds


def yield_rows(settings: Config, yields: Yields) -> Rows:
    counts = design.tolerances.heads.count_passes(yields.heads)
    rows = []
    for kind, words in kinds_of(settings, yields).items():
        low, high = design.tolerances.heads.interval(counts[kind], yields.count)
        rows.append(
            [words, percent(getattr(yields.predicted, kind)), percent(counts[kind] / yields.count),
             f"{100 * low:.1f} to {100 * high:.1f} %"]
        )  # fmt: skip
    return ["heads that keep", "predicted", "simulated", "95 % interval"], rows


def percent(fraction: float) -> str:
    return f"{100 * fraction:.1f} %"


def error_rows(settings: Config, yields: Yields) -> Rows:
    import numpy as np

    passing = yields.heads.within_limits >= 0
    some = yields.heads.errors[passing] if passing.any() else yields.heads.errors
    rows = []
    for i, name in enumerate(POSE):
        allowed = settings.layout.accuracy[i]
        values = []
        for which in range(2):
            column = some[:, which, i]
            finite = column[np.isfinite(column)]
            values.append(f"{np.percentile(finite, 95):.3g}" if len(finite) else "")
        required = f"{allowed:g}" if np.isfinite(allowed) else ""
        rows.append([f"{name}, {core.units.unit_of(name).fine_unit}", required, *values])
    return ["axis", "required", "as built", "calibrated"], rows


def last_kind(settings: Config, yields: Yields) -> str:
    """Return the field of the yield that includes all requirements."""
    return list(kinds_of(settings, yields))[-1]


def tolerance_rows(settings: Config, yields: Yields) -> Rows:
    kind = last_kind(settings, yields)
    rows = [
        [row.key + design.tolerances.prediction.OF_HEADS[row.key],
         f"{settings.calibrate.before[row.key]:g}", percent(getattr(row.alone, kind)),
         percent(getattr(row.halved, kind)), row.worst]
        for row in yields.by_tolerance
    ]  # fmt: skip
    return ["calibrate.before", "is", "yield with it alone", "with it halved", "eats most of"], rows
