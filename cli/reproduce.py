"""`facets reproduce`: the paper's figures, tables and claims, compared with stored references."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from facets import core, files
from facets.core.plain_numbers import count_text

from .console import FINDING
from .options import Force, Look, Quick, Style, completion, folder_option

if TYPE_CHECKING:
    from facets.experiments.reproduce import ExperimentResult


def reproduce(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME",
            help="Names of figures and tables, such as fig4 or table2.  [default: all]",
            autocompletion=completion.words(completion.experiments),
        ),
    ] = None,
    folder: Annotated[Path, folder_option("")] = Path("results/reproduce"),
    quick: Quick = False,
    force: Force = False,
    look: Style = Look.screen,
) -> None:
    """Reproduce the paper's figures, tables and claims.

        facets reproduce
        facets reproduce fig4 table2 --quick

    Prints for each experiment whether its numbers equal the stored references, column by column,
    and how many of the paper's results they agree with to within 10 %. Writes the tables, the
    figures and the page report.html with all of them into the folder. Exit status 1 if a number
    differs from its stored reference.
    """
    from facets.experiments.report import write_report
    from facets.experiments.reproduce import reproduce as run, select_experiments

    selected = select_experiments(names or [])
    if "uniqueness" in selected:
        core.extras.require_extra("flint", "uniqueness")
    report = folder / "report.html"
    files.tables.refuse_to_overwrite([report], force)
    files.tables.refuse_to_overwrite([folder / f"{name}.csv" for name in selected], force=True)
    print(f"{'':11}  {'':4}  {'paper':>9}  {'ours':>9}  {'ratio':>7}")
    results = []
    with files.tables.ResultSet():
        for result in run(selected, quick, folder):
            show(result)
            results.append(result)
        write_report(report, results, quick)
    missed = [result.name for result in results if not result.repeats]
    seconds = sum(result.seconds for result in results)
    outcome = f"changed: {', '.join(missed)}" if missed else "all repeat the stored references"
    count = count_text(len(results), "experiment")
    print(f"\n{count} in {seconds:.1f} s; {outcome}\n{report}")
    if missed:
        raise typer.Exit(FINDING)


def show(result: ExperimentResult) -> None:
    """Print whether an experiment repeats and agrees, its claims, and the changed columns."""
    from facets.experiments.report import number

    verdict = "repeats" if result.repeats else "CHANGED"
    print(f"\n{result.name:11}  {verdict}  {result.title} ({result.seconds:.1f} s)")
    met, count = result.agreement
    if count:
        print(f"{'':11}  within 10 % of the paper: {met} of {count} results")
    for claim in result.claims:
        numbers = f"{number(claim.paper):>9}  {number(claim.ours):>9}  {number(claim.ratio):>7}"
        print(f"{'':11}  {'':4}  {numbers}  {claim.unit:9}  {claim.what}")
    for check in result.checks:
        if not check.repeats:
            off = "has other rows" if check.off != check.off else f"{check.off:.3g} times too far"
            print(f"{'':11}  CHANGED  {check.column}: {off} (allowed: {check.allowed})")
