"""`facets tolerances`: the share of heads that meet the requirements, by tolerance."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Annotated, Any

import typer

from facets import core, design, files
from facets.core.errors import InputError
from facets.core.names import FINE_COLUMNS, POSE

from .console import load_config, name_files, show_progress, show_table
from .options import (
    ConfigName,
    Force,
    Table,
    TableKind,
    folder_option,
    heads_option,
    output_folder,
    seed_option,
)

if TYPE_CHECKING:
    from facets.config import Config
    from facets.core.sensor import Sensor
    from facets.design.production import SimulatedHeads
    from facets.design.tolerancing import Sensitivity, YieldShares

#: Least number of simulated heads for a useful estimate of a yield.
LEAST_HEADS = 10
Rows = tuple[list[str], list[list[str]]]


def tolerances(
    config: ConfigName,
    folder: Annotated[Path | None, folder_option("results/CONFIG-tolerances")] = None,
    heads: Annotated[int, heads_option(f"{LEAST_HEADS} or more")] = 200,
    seed: Annotated[int, seed_option()] = 1,
    force: Force = False,
    table: Table = TableKind.csv,
) -> None:
    """Compute a design's yield and its most costly tolerance.

    The yield is the share of manufactured heads that meet the requirements: spots on the detectors,
    light, and the limits and accuracies of the block `optimize` over its volume, before and after a
    calibration. The heads' parameters vary with the standard uncertainties in `calibrate.before`.
    The yield is predicted by an expansion in the tolerances and counted on simulated heads. Writes
    a table of the tolerances and a table of the heads into the folder.
    """
    if heads < LEAST_HEADS:
        raise InputError(f"--heads is {heads}; give at least {LEAST_HEADS}")
    settings = load_config(config)
    place = output_folder(folder, settings.name, "tolerances")
    paths = [place / f"{name}.{table.value}" for name in ("tolerances", "heads")]
    files.tables.refuse_to_overwrite(paths, force)
    found = yields_of(settings, settings.sensor, heads, seed)
    show_yields(settings, found)
    about = files.provenance.provenance_header(settings, seed)
    with files.tables.ResultSet():
        files.tables.write_table(paths[0], sensitivity_columns(settings, found), about)
        files.tables.write_table(paths[1], head_columns(found.heads), about)
    name_files(place, paths)


class Yields:
    """A design's yields: predicted, simulated, and by tolerance.  count: of simulated heads."""

    def __init__(
        self,
        predicted: YieldShares,
        heads: SimulatedHeads,
        by_tolerance: list[Sensitivity],
        accurate: bool,
    ) -> None:
        self.predicted, self.heads, self.by_tolerance = predicted, heads, by_tolerance
        self.accurate = accurate
        self.count = len(heads.kept)


def yields_of(settings: Config, sensor: Sensor, heads: int, seed: int) -> Yields:
    """Compute the yields of a sensor's heads by `calibrate.before` and the block `optimize`."""
    built = design.assembly.assembly_of(sensor, settings.layout, settings.range, settings.calibrate)
    expansion = design.tolerancing.expand_margins(built)
    draws = design.tolerancing.draw_heads(built)
    made = show_progress(
        lambda tell: design.production.simulate_heads(built, heads, seed, tell), "building heads"
    )
    accurate = bool(built.asked.accuracy_axes)
    return Yields(
        design.tolerancing.predict_yields(expansion, draws),
        made,
        design.tolerancing.sensitivities(expansion, draws),
        accurate,
    )


def show_yields(settings: Config, found: Yields) -> None:
    title = f"yield, as loose as calibrate.before says, of {found.count} heads"
    show_table(title, *yield_rows(settings, found))
    if found.accurate:
        show_table("largest error in the volume, from rest: 95 % of the heads are within",
                   *error_rows(settings, found))  # fmt: skip
    else:
        typer.echo("optimize.accuracy names no axis, so that no accuracy is required")
    if found.heads.unsettled:
        typer.echo(f"{found.heads.unsettled} calibrations did not settle; their heads fail\n")
    show_table("tolerances, the most worth while first", *tolerance_rows(settings, found),
               left=(0, 4))  # fmt: skip
    if advice := margin_advice(settings, found):
        typer.echo(f"{fill(advice, 98)}\n")


#: Below this share of heads a design is said to leave too little margin.
FEW = 0.5


def margin_advice(settings: Config, found: Yields) -> str:
    """Advice for a design with a low yield; "" for a higher yield or without tolerances."""
    share = design.production.count_passes(found.heads)["kept"] / found.count
    if share >= FEW or not found.by_tolerance:
        return ""
    strongest = found.by_tolerance[0]
    words = (
        f"Only {percent(share)} of the heads keep spots, light and limits: the design leaves too "
        f"little margin, most of all for {strongest.key} ({strongest.worst}). The best layout for "
        "perfect heads stands at its limits"
    )
    if settings.layout.production:
        return f"{words}; choose smaller tolerances in calibrate.before, or weaker requirements."
    return (
        f"{words}. For a layout with margins set optimize.production.yield_percent, such as 95, "
        "and run `facets optimize` again; or take smaller tolerances in calibrate.before."
    )


def kinds_of(settings: Config, found: Yields) -> dict[str, str]:
    """Requirements of a head in words, by the fields of `tolerancing.YieldShares`."""
    kinds = {"kept": "spots, light and limits"}
    if found.accurate:
        kinds["built"] = "and accuracy, as built"
    if found.accurate and settings.layout.calibrated:
        kinds["calibrated"] = "and accuracy, calibrated"
    return kinds


def yield_rows(settings: Config, found: Yields) -> Rows:
    counts = design.production.count_passes(found.heads)
    rows = []
    for kind, words in kinds_of(settings, found).items():
        low, high = design.production.interval(counts[kind], found.count)
        rows.append(
            [words, percent(getattr(found.predicted, kind)), percent(counts[kind] / found.count),
             f"{100 * low:.1f} to {100 * high:.1f} %"]
        )  # fmt: skip
    return ["heads that keep", "predicted", "simulated", "95 % interval"], rows


def percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def error_rows(settings: Config, found: Yields) -> Rows:
    import numpy as np

    whole = found.heads.kept >= 0
    some = found.heads.errors[whole] if whole.any() else found.heads.errors
    rows = []
    for i, name in enumerate(POSE):
        allowed = settings.layout.accuracy[i]
        values = []
        for which in range(2):
            column = some[:, which, i]
            known = column[np.isfinite(column)]
            values.append(f"{np.percentile(known, 95):.3g}" if len(known) else "")
        asked = f"{allowed:g}" if np.isfinite(allowed) else ""
        rows.append([f"{name}, {core.units.unit_of(name).fine_unit}", asked, *values])
    return ["axis", "asked", "as built", "calibrated"], rows


def last_kind(settings: Config, found: Yields) -> str:
    """Return the field of the yield that includes all requirements."""
    return list(kinds_of(settings, found))[-1]


def tolerance_rows(settings: Config, found: Yields) -> Rows:
    kind = last_kind(settings, found)
    rows = [
        [row.key, f"{settings.calibrate.before[row.key]:g}", percent(getattr(row.alone, kind)),
         percent(getattr(row.halved, kind)), row.worst]
        for row in found.by_tolerance
    ]  # fmt: skip
    return ["calibrate.before", "is", "yield with it alone", "with it halved", "eats most of"], rows


def sensitivity_columns(settings: Config, found: Yields) -> dict[str, Any]:
    """Predicted yields by tolerance, in per cent; the first row is for unchanged tolerances."""
    import numpy as np

    rows = found.by_tolerance
    before = settings.calibrate.before
    columns: dict[str, Any] = {
        "tolerance": np.array(["", *(row.key for row in rows)]),
        "stated": np.array([np.nan, *(before[row.key] for row in rows)]),
    }
    for kind in kinds_of(settings, found):
        whole = getattr(found.predicted, kind)
        for case in ("alone", "halved"):
            values = [whole, *(getattr(getattr(row, case), kind) for row in rows)]
            columns[f"{kind}_{case}_percent"] = 100 * np.array(values)
    return columns | {"eats_most_of": np.array(["", *(row.worst.replace(",", "") for row in rows)])}


def head_columns(heads: SimulatedHeads) -> dict[str, Any]:
    """Columns of the simulated heads: their least margins and largest errors."""
    import numpy as np

    columns: dict[str, Any] = {
        "head": np.arange(len(heads.kept)),
        "margin": heads.kept,
        "accuracy_margin_built": heads.built,
        "accuracy_margin_calibrated": heads.known,
    }
    for which, case in enumerate(("built", "calibrated")):
        for i, name in enumerate(FINE_COLUMNS[:6]):
            columns[f"error_{name.removeprefix('u_')}_{case}"] = heads.errors[:, which, i]
    return columns
