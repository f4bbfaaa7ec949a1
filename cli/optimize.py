"""`facets optimize`: the best layout for a volume, as a configuration."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .console import FINDING, load_config, show_table
from .options import ConfigName, Force, Plot, PlotKind

if TYPE_CHECKING:
    from facets.config import Config
    from facets.design.search import Optimum


CERTIFY = (
    "Pieces that a proof may look at, that readings determine states; some seconds. 0: no proof."
)


def optimize(
    config: ConfigName,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="The layout found, a YAML file.  [default: CONFIG-optimum.yaml]"
        ),
    ] = None,
    force: Force = False,
    plot: Plot = PlotKind.png,
    certify: Annotated[int, typer.Option(min=0, help=CERTIFY)] = 400,
) -> None:
    """Find the best layout by the config's block `optimize`.

    Varies what may vary, within bounds, from several starts, with each choice of parts from a
    catalogue; tells what holds the best one back, or which requirements can not be met together,
    with exit status 1. The result is a configuration for every command. Beside it a table and a
    picture compare it with what was, by the range, by the float model and by simulated readings.
    """
    from facets.core.errors import InputError
    from facets.design.search import optimize as run
    from facets.files import tables

    settings = load_config(config)
    path = output or Path(f"{settings.name}-optimum.yaml")
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"{path}: a configuration's name ends in .yaml")
    csv, picture = path.with_suffix(".csv"), path.with_suffix(f".{plot.value}")
    tables.refuse_to_overwrite([path, csv, picture], force)
    found = run(settings.sensor, settings.layout)
    show_parts(found)
    show_starts(found)
    if not found.best.found:
        refuse(found)
        raise typer.Exit(FINDING)
    better = write_config(settings, found, path)
    table = write_comparison(settings, better, csv, picture)
    show_result(settings, better, found, table)
    show_reasons(settings, found)
    if certify:
        show_proof(better, certify)
    typer.echo(f"{path}, {csv.name}, {picture.name}")


def write_config(settings: Config, found: Optimum, path: Path) -> Config:
    """The layout found, written and loaded again. Exits where it does not load."""
    from facets import load
    from facets.core.errors import ConfigError
    from facets.files import provenance, tables

    about = provenance.about(settings, settings.layout.seed)
    with tables.Whole(path) as temporary:
        temporary.write_text(as_yaml(settings, found, about), "utf-8")
    try:
        return load(path)
    except ConfigError as error:  # a sub-beam may miss a detector elsewhere than in the volume
        typer.echo(f"{path} is written, but does not load:\n{error}", err=True)
        raise typer.Exit(FINDING) from None


def write_comparison(settings: Config, better: Config, csv: Path, picture: Path) -> dict[str, Any]:
    """Before and after, as a table that is returned, and a picture."""
    from facets.design.verification import compare
    from facets.files import provenance, tables
    from facets.pictures import style
    from facets.pictures.layout import layout_picture

    layout = settings.layout
    table = compare(settings.sensor, better.sensor, layout, settings.range, layout.seed)
    tables.write_table(csv, table, provenance.about(settings, layout.seed))
    style.save(layout_picture(table), picture)
    return table


def show_parts(found: Optimum) -> None:
    """Each choice from the catalogue, the best first."""
    if not found.tried:
        return
    headings = ("detectors", "laser", "price", *found.names, "objective", "end")
    rows = []
    for choice, end in found.tried:
        price = "" if choice.price is None else f"{choice.price:.0f}"
        values = [f"{value:.4g}" for value in end.x]
        objective = f"{end.objective:.4g}" if end.found else "-"
        rows.append([choice.psd, choice.laser, price, *values, objective, end.status])
    show_table("parts, the best first", headings, rows, left=(0, 1, len(headings) - 1))


def show_starts(found: Optimum) -> None:
    headings = (*found.names, "objective", "seconds", "end")
    rows = []
    for end in found.results:
        values = [f"{value:.5g}" for value in end.x]
        rows.append([*values, f"{end.objective:.6g}", f"{end.seconds:.1f}", end.status])
    show_table("starts, the best first", headings, rows, left=(len(headings) - 1,))


def refuse(found: Optimum) -> None:
    typer.echo("no layout meets all that is asked for; these stand against each other:")
    for group, gap in found.best.shortfalls.items():
        typer.echo(f"  {group}: would have to give way by {100 * gap:.3g} % of its limit")


def show_result(settings: Config, better: Config, found: Optimum, table: dict[str, Any]) -> None:
    from facets.design.report import in_words
    from facets.design.variables import present_values

    aim = settings.layout.aim
    if found.before == found.before:
        typer.echo(f"before: {in_words(aim, found.before)}")
    else:
        typer.echo("before: not all that is asked for is kept")
    typer.echo(f"after:  {in_words(aim, found.best.objective)}\n")
    now, then = present_values(settings.sensor), present_values(better.sensor)
    for name in found.names:
        typer.echo(f"  {name:<16} {now[name]:10.4g} -> {then[name]:.6g}")
    show_comparison(table)


def show_comparison(table: dict[str, Any]) -> None:
    headings = ("quantity", "before", "after", "after / before", "simulated")
    rows = []
    for quantity, before, after, drawn in zip(*table.values(), strict=True):
        simulated = "" if drawn != drawn else f"{drawn:.3g}"
        ratio = f"{after / before:.2f}" if before > 0 < after else ""
        rows.append([quantity, f"{before:.3g}", f"{after:.3g}", ratio, simulated])
    title = "before and after: the worst over the volume (1 sigma), and ranges in all"
    typer.echo("")
    show_table(title, headings, rows)


def show_proof(better: Config, work: int) -> None:
    """Whether readings are proved to determine states, within so much work."""
    from facets.proof.designs import certify_design

    from .certificates import rounded_down

    found = certify_design(better.sensor, better.range, work)
    if isinstance(found, str):
        typer.echo(f"not proved that readings determine states: {found}\n")
    elif found.unique:
        typer.echo(
            "proved: within the ranges of its axes no two states have the same readings; margin"
            f" {rounded_down(found.margin)} or more, of 1 ({found.seconds:.1f} s)\n"
        )
    else:
        typer.echo(
            "not proved that readings determine states within the ranges of its axes, in the work"
            f" allowed: {found.reason or 'the inequality fails'} ({found.seconds:.1f} s);\n"
            "`facets jacobian --certify` says more\n"
        )


def show_reasons(settings: Config, found: Optimum) -> None:
    from facets.design.report import gains, in_words

    typer.echo("what holds it back, over the strongest:")
    for group, size in list(found.best.active_constraints.items())[:8]:
        typer.echo(f"  {size:5.2f}  {group}")
    more = gains(found.sensor, settings.layout, found.best.x)
    if more:
        typer.echo("\nwhat more would give:")
    for what, objective in more.items():
        typer.echo(f"  {what}: {in_words(settings.layout.aim, objective)}")
    typer.echo("")


def as_yaml(settings: Config, found: Optimum, about: dict[str, str]) -> str:
    """The configuration it came from, with what was changed."""
    from facets.config.geometry import written
    from facets.design.variables import sensor_of
    from facets.files.provenance import configuration

    best = sensor_of(found.sensor, found.names, found.best.x)
    keys = written(settings.resolved["sensor"], best)
    keys["noise"]["position_um"] = 1000 * best.noise.position
    if found.tried:
        choice = found.tried[0][0]
        about = {**about, "parts": f"{choice.psd} {choice.laser}"}
    return configuration(settings, keys, about)
