"""`facets reproduce`: the paper's figures, tables and claims, compared with stored references."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import completion
from .console import FINDING
from .options import Force, Look, Style

if TYPE_CHECKING:
    from facets.experiments.reproduce import ExperimentResult


def reproduce(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            help="Such as fig4, table2; none, or all, for all.",
            autocompletion=completion.words(completion.experiments),
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder of the report, tables and figures.")
    ] = Path("results/reproduce"),
    quick: Annotated[bool, typer.Option("--quick", help="Fewer samples.")] = False,
    force: Force = False,
    look: Style = Look.screen,
) -> None:
    """Reproduce the paper: each figure, table and claim, beside the paper's own numbers.

    Says of each experiment whether its numbers repeat the stored references, column by column, and
    how many of the paper's numbers they meet within a tenth. Exits with 1 where a reference is not
    repeated. Writes tables, figures and one page that holds them all.
    """
    from facets.experiments.report import write_report
    from facets.experiments.reproduce import chosen
    from facets.experiments.reproduce import reproduce as run

    from facets.files import tables

    wanted = chosen(names or [])
    report = output / "report.html"
    tables.refuse_to_overwrite([report], force)
    tables.refuse_to_overwrite([output / f"{name}.csv" for name in wanted], force=True)
    typer.echo(f"{'':11}  {'':4}  {'paper':>9}  {'ours':>9}  {'ratio':>7}")
    results = []
    with tables.ResultSet():
        for result in run(wanted, quick, output):
            show(result)
            results.append(result)
        write_report(report, results, quick)
    missed = [result.name for result in results if not result.repeats]
    seconds = sum(result.seconds for result in results)
    told = f"changed: {', '.join(missed)}" if missed else "all repeat the stored references"
    typer.echo(f"\n{len(results)} experiments in {seconds:.1f} s; {told}\n{report}")
    if missed:
        raise typer.Exit(FINDING)


def show(result: ExperimentResult) -> None:
    """Whether it repeats and agrees, the claims, and the columns that have changed."""
    from facets.experiments.report import number

    verdict = "repeats" if result.repeats else "CHANGED"
    typer.echo(f"\n{result.name:11}  {verdict}  {result.title} ({result.seconds:.1f} s)")
    met, count = result.agreement
    if count:
        typer.echo(f"{'':11}  within a tenth of the paper: {met} of its {count} numbers")
    for claim in result.claims:
        numbers = f"{number(claim.paper):>9}  {number(claim.ours):>9}  {number(claim.ratio):>7}"
        typer.echo(f"{'':11}  {'':4}  {numbers}  {claim.unit:9}  {claim.what}")
    for check in result.checks:
        if not check.repeats:
            off = "has other rows" if check.off != check.off else f"{check.off:.3g} times too far"
            typer.echo(f"{'':11}  CHANGED  {check.column}: {off} (allowed: {check.allowed})")
