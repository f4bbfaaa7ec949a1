"""`facets tolerances`: the yield of heads that meet the requirements, by tolerance."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from facets import core
from facets.core.errors import InputError
from facets.core.names import FINE_COLUMNS

from .console import FINDING, load_config
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
from .results import ResultFolder
from .sentences.yields import Yields, kinds_of, nominal_fault, show_yields, yields_of

if TYPE_CHECKING:
    from facets.config import Config
    from facets.design.tolerances.heads import SimulatedHeads

#: Least number of simulated heads for a useful estimate of a yield.
LEAST_HEADS = 10


def tolerances(
    config: ConfigName,
    folder: Annotated[Path | None, folder_option("results/CONFIG-tolerances")] = None,
    heads: Annotated[int, heads_option(f"{LEAST_HEADS} or more")] = 200,
    seed: Annotated[int, seed_option()] = 1,
    force: Force = False,
    table: Table = TableKind.csv,
) -> None:
    """Compute a design's yield and its most costly tolerance.

        facets tolerances market --heads 500

    The yield is the fraction of manufactured heads that meet the requirements: spots on the
    detectors, light, and the limits and accuracies of the block `optimize` over its volume, before
    and after a calibration. The heads' parameters vary with the standard uncertainties in
    `calibrate.before`. The yield is predicted by an expansion in the tolerances and counted on
    simulated heads. Writes a table of the tolerances and a table of the heads into the folder.
    Exit status 1 if even the perfect head violates a requirement.
    """
    if heads < LEAST_HEADS:
        raise InputError(f"--heads is {heads}; give at least {LEAST_HEADS}")
    settings = load_config(config)
    names = [f"{name}.{table.value}" for name in ("tolerances", "heads")]
    results = ResultFolder(output_folder(folder, settings.name, "tolerances"), names, force)
    if replace(settings.layout, object=None) == core.layout.Layout():
        print(
            f"{settings.name} has no block `optimize`, so that the heads are judged by its default "
            f"requirements (see `facets config show {config}`).\n"
        )
    yields = yields_of(settings, settings.sensor, heads, seed)
    show_yields(settings, yields)
    with results.publish(settings, seed) as (by_tolerance, by_head):
        results.write_table(by_tolerance, sensitivity_columns(settings, yields))
        results.write_table(by_head, head_columns(yields.heads))
    results.name()
    if nominal_fault(settings, yields):
        raise typer.Exit(FINDING)


def sensitivity_columns(settings: Config, yields: Yields) -> dict[str, Any]:
    """Predicted yields by tolerance, in per cent; the first row is for unchanged tolerances."""
    import numpy as np

    rows = yields.by_tolerance
    before = settings.calibrate.before
    columns: dict[str, Any] = {
        "tolerance": np.array(["", *(row.key for row in rows)]),
        "stated": np.array([np.nan, *(before[row.key] for row in rows)]),
    }
    for kind in kinds_of(settings, yields):
        unchanged = getattr(yields.predicted, kind)
        for case in ("alone", "halved"):
            values = [unchanged, *(getattr(getattr(row, case), kind) for row in rows)]
            columns[f"{kind}_{case}_percent"] = 100 * np.array(values)
    return columns | {"eats_most_of": np.array(["", *(row.worst.replace(",", "") for row in rows)])}


def head_columns(heads: SimulatedHeads) -> dict[str, Any]:
    """Columns of the simulated heads: their least margins and largest errors."""
    import numpy as np

    columns: dict[str, Any] = {
        "head": np.arange(len(heads.within_limits)),
        "margin": heads.within_limits,
        "accuracy_margin_built": heads.built,
        "accuracy_margin_calibrated": heads.calibrated,
    }
    for which, case in enumerate(("built", "calibrated")):
        for i, name in enumerate(FINE_COLUMNS[:6]):
            columns[f"error_{name.removeprefix('u_')}_{case}"] = heads.errors[:, which, i]
    return columns
