"""`facets optimize`: the best layout for a volume, as a configuration."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from facets.config import Config
    from facets.optimize import Optimum


def optimize(
    config: Annotated[str, typer.Argument(help="Name of a shipped config, or a YAML file.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="The layout found, a YAML file.  [default: CONFIG-optimum.yaml]"
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an older file.")] = False,
) -> None:
    """Find the best layout by the config's block `optimize`.

    Varies what may vary, within bounds, from several starts; tells what holds the best one back, or
    which requirements can not be met together. The result is a configuration for every command.
    """
    from facets import load, record, tables
    from facets.errors import ConfigError
    from facets.optimize import optimize as run

    settings = load(config)
    path = output or Path(f"{settings.name}-optimum.yaml")
    if path.suffix.lower() not in (".yaml", ".yml"):
        from facets.errors import InputError

        raise InputError(f"{path}: a configuration's name ends in .yaml")
    tables.refuse_to_overwrite([path], force)
    found = run(settings.sensor, settings.layout)
    show_starts(found)
    if not found.best.found:
        refuse(found)
        raise typer.Exit(1)
    about = record.about(settings, settings.layout.seed)
    with tables.Whole(path) as temporary:
        temporary.write_text(as_yaml(settings, found, about), "utf-8")
    try:
        better = load(path)
    except ConfigError as error:  # a sub-beam may miss a detector elsewhere than in the volume
        typer.echo(f"{path} is written, but does not load:\n{error}", err=True)
        raise typer.Exit(1) from None
    show_result(settings, better, found)
    typer.echo(f"{path}")


def show_starts(found: Optimum) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(title="starts, the best first", title_justify="left", box=None)
    for name in (*found.names, "objective", "seconds", "end"):
        table.add_column(name, justify="left" if name == "end" else "right", no_wrap=True)
    for end in found.ends:
        values = [f"{value:.5g}" for value in end.x]
        table.add_row(*values, f"{end.objective:.6g}", f"{end.seconds:.1f}", end.status)
    Console(highlight=False, width=140).print(table, "")


def refuse(found: Optimum) -> None:
    typer.echo("no layout meets all that is asked for; these stand against each other:")
    for group, gap in found.best.missing.items():
        typer.echo(f"  {group}: would have to give way by {100 * gap:.3g} % of its limit")


def show_result(settings: Config, better: Config, found: Optimum) -> None:
    from facets.layout import present
    from facets.names import POSE
    from facets.optimize import gains, in_words, worst_over
    from facets.plots import unit_of

    aim = settings.layout.aim
    if found.before == found.before:
        typer.echo(f"before: {in_words(aim, found.before)}")
    else:
        typer.echo("before: not all that is asked for is kept")
    typer.echo(f"after:  {in_words(aim, found.best.objective)}\n")
    now, then = present(settings.sensor), present(better.sensor)
    for name in found.names:
        typer.echo(f"  {name:<16} {now[name]:10.4g} -> {then[name]:.6g}")
    typer.echo("\nworst uncertainty over the volume, 1 sigma, by the float model:")
    old, new = (worst_over(c.sensor, settings.layout) for c in (settings, better))
    for i, name in enumerate(POSE):
        gain = f"{old[i] / new[i]:.2f} times as fine"
        typer.echo(f"  {name:<6} {old[i]:8.3g} -> {new[i]:8.3g} {unit_of(name)[2]:<5} {gain}")
    typer.echo("\nwhat holds it back, over the strongest:")
    for group, size in list(found.best.pressing.items())[:8]:
        typer.echo(f"  {size:5.2f}  {group}")
    typer.echo("\nwhat more would give:")
    for what, objective in gains(settings.sensor, settings.layout, found.best.x).items():
        typer.echo(f"  {what}: {in_words(aim, objective)}")
    typer.echo("")


def as_yaml(settings: Config, found: Optimum, about: dict[str, str]) -> str:
    """The configuration it came from, with what was changed; how it was made above."""
    from io import StringIO

    from ruamel.yaml import YAML

    stream = StringIO()
    for key, value in about.items():
        stream.write(f"# {key}: {' '.join(value.split())}\n")
    YAML().dump({**settings.resolved, "sensor": changed(settings, found)}, stream)
    return stream.getvalue()


def changed(settings: Config, found: Optimum) -> dict[str, Any]:
    """The resolved `sensor` block with the variables at their best."""
    from copy import deepcopy
    from math import radians, tan

    keys = deepcopy(settings.resolved["sensor"])
    value = dict(zip(found.names, (float(x) for x in found.best.x), strict=True))
    for k, letter in enumerate("abc"):
        psd, facet = keys["psd"][letter], keys["mirror"][letter]
        psd["radius_mm"] = value.get("radius_mm", psd["radius_mm"])
        psd["pitch_mrad"] = value.get("pitch_mrad", psd["pitch_mrad"])
        if "size_mm" in value:
            psd["size_mm"] = [value["size_mm"]] * 2
        if "inclination_deg" in value:
            facet["inclination_deg"] = value["inclination_deg"]
            psd["height_mm"] = psd["radius_mm"] / tan(2 * radians(value["inclination_deg"]))
        if "azimuth_b_deg" in value and k > 0:
            turn = value["azimuth_b_deg"] if k == 1 else 360 - value["azimuth_b_deg"]
            facet["azimuth_deg"] = psd["azimuth_deg"] = turn
    if "diameter_mm" in value:
        keys["beam"]["diameter_mm"] = [value["diameter_mm"]] * 2
    keys["beam"]["power_mw"] = value.get("power_mw", keys["beam"]["power_mw"])
    return keys
