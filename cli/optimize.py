"""`facets optimize`: the best layout for a volume, as a configuration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import facets
from facets import design, files, pictures, proof
from facets.core.errors import ConfigError, InputError

from .bounds import light_text, round_down
from .console import FINDING, load_config, show_progress, show_table
from .options import (
    Certify,
    ConfigName,
    Force,
    Look,
    Plot,
    PlotKind,
    Style,
    heads_option,
    output_option,
    report_option,
)
from .tolerances import error_rows, show_yields, tolerance_rows, yield_rows, yields_of

if TYPE_CHECKING:
    from facets.config import Config
    from facets.design.rounding import Rounded
    from facets.design.search import Optimum
    from facets.pictures.design_report import ReportSection


SHEETS = "File for all tables of the result: LaTeX (.tex) or a workbook (.xlsx, extra `sheets`)."
EXACT = "Write the optimum without rounding its numbers to values that can be manufactured."
REPORT = "the layout and its drawing, with a 3D scene beside it (FILE.gltf)"


def optimize(
    config: ConfigName,
    output: Annotated[
        Path | None,
        output_option("configuration with the optimal layout, YAML", "CONFIG-optimum.yaml"),
    ] = None,
    force: Force = False,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
    certify: Certify = 400,
    exact: Annotated[bool, typer.Option("--exact", help=EXACT)] = False,
    report: Annotated[Path | None, report_option(REPORT)] = None,
    heads: Annotated[int, heads_option("0 skips the simulation")] = 0,
    sheets: Annotated[Path | None, typer.Option("--sheets", metavar="FILE", help=SHEETS)] = None,
) -> None:
    """Find the layout that meets a requirement best.

    The requirement is the block `optimize` of the configuration.

    Varies the parameters named there within their bounds, from several starting layouts, and with
    every combination of parts from the catalogue, if there is one. Prints which requirements limit
    the optimum; if no layout meets all of them, prints which exclude each other and ends with exit
    status 1. Writes a configuration that extends CONFIG by the new values, rounded to values that
    can be manufactured, and beside it a table and a picture that compare it with CONFIG. With
    `optimize.production.yield_percent` the layout has margins, so that this share of the
    manufactured heads meets the requirements.
    """
    settings = load_config(config)
    path = output or Path(f"{settings.name}-optimum.yaml")
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"{path}: a configuration's name ends in .yaml")
    paths = [path.with_suffix(ending) for ending in (".csv", f".{plot.value}")]
    pages = pages_of(report) if report else []
    if sheets:
        design.sheets.require_writable(sheets)
        pages.append(sheets)
    files.tables.refuse_to_overwrite([path, *paths, *pages], force)
    ended: list[Optimum] = []
    show_progress(
        lambda tell: ended.append(design.search.optimize(settings.sensor, settings.layout, tell)),
        "searching",
    )
    found = ended[0]
    show_parts(found)
    show_starts(found)
    if not found.best.found:
        refuse(found)
        raise typer.Exit(FINDING)
    found = layout_for_yield(settings, found)
    made = None if exact else rounded_layout(settings, found)
    with files.tables.ResultSet():
        better = write_config(settings, found, made, path)
        if not isinstance(better, str):
            story = tell_story(settings, better, found, made, paths, certify, heads)
            if report:
                write_report(story, *pages[:2])
            if sheets:
                write_tables(story, sheets)
    if isinstance(better, str):
        typer.echo(f"{path} is written, but does not load:\n{better}", err=True)
        raise typer.Exit(FINDING)
    typer.echo(", ".join([str(path), *(file.name for file in (*paths, *pages))]))


def pages_of(report: Path) -> list[Path]:
    """The files of the report: the page and the scene beside it."""
    if report.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{report}: a page's name ends in .html")
    return [report, report.with_suffix(".gltf")]


def tell_story(
    settings: Config,
    better: Config,
    found: Optimum,
    made: Rounded | None,
    paths: list[Path],
    certify: int,
    heads: int,
) -> Story:
    """All that is said of the layout, printed; its comparison is written."""
    table = write_comparison(settings, better, *paths)
    show_result(settings, better, found, made, table)
    reasons = show_reasons(settings, found)
    proof = prove(better, certify)
    typer.echo(f"{proof}\n")
    built = show_heads(settings, better, heads)
    return Story(settings, better, found, made, table, reasons, proof, built)


def rounded_layout(settings: Config, found: Optimum) -> Rounded | None:
    """The layout in numbers that can be made; None where only the exact one keeps all."""
    made = design.rounding.round_design(found.problem, found.best.x)
    if made is None:
        typer.echo(
            "The layout was not rounded to manufacturable values, because no rounded layout nearby "
            "meets all requirements."
        )
    return made


def layout_for_yield(settings: Config, found: Optimum) -> Optimum:
    """The layout whose heads keep what is asked for with `production.yield_percent`, if that is
    given; exit status 1 where there is none."""

    layout = settings.layout
    if not layout.production:
        return found
    known = (layout, settings.range, settings.calibrate)
    robust = design.robust.robust_layout(found.problem, *known, found.best)
    share = f"{100 * layout.production:g} %"
    if not robust.result.found:
        typer.echo(f"no layout was found of whose heads {share} keep all that is asked for; with "
                   f"margins of {robust.factor:.3g} of their spreads these stand against each "
                   "other:")  # fmt: skip
        show_shortfalls(robust.result.shortfalls)
        raise typer.Exit(FINDING)
    was = design.report.objective_text(layout.aim, found.best.objective)
    typer.echo(
        f"for {share} of the heads spots, light and limits are kept with {robust.factor:.3g} of "
        f"the spreads that the tolerances give them (predicted {100 * robust.kept:.1f} %, "
        f"{robust.rounds} rounds);\nfor perfect heads alone it would be: {was}\n"
    )
    return replace(found, results=[robust.result, *found.results], problem=robust.problem)


def show_heads(
    settings: Config, better: Config, heads: int
) -> list[pictures.design_report.ReportSection]:
    """The yield of the layout, printed, and as parts of the page; nothing where no heads are built.

    The settings are those that were asked for; the sensor is the one that was found.
    """
    if not heads:
        return []

    found = yields_of(settings, better.sensor, heads, settings.layout.seed)
    show_yields(settings, found)
    words = (f"{heads} heads built by simulation, as loose as calibrate.before says.",)
    parts = [pictures.design_report.ReportSection("Yield", words, *yield_rows(settings, found))]
    if found.accurate:
        within = ("Largest error in the volume, from rest; 95 % of the heads are within.",)
        parts.append(
            pictures.design_report.ReportSection("Accuracy", within, *error_rows(settings, found))
        )
    headings, rows = tolerance_rows(settings, found)
    which = pictures.design_report.ReportSection(
        "Which tolerance costs most", (), headings, pictures.wording.rows_in_words(rows), wide=True
    )
    return [*parts, which]


def price_of(settings: Config, found: Optimum) -> float:
    """What the price of the parts adds to the objective."""
    return (
        design.branching.price_term(settings.layout, found.tried[0][0].price)
        if found.tried
        else 0.0
    )


def write_config(
    settings: Config, found: Optimum, made: Rounded | None, path: Path
) -> Config | str:
    """The layout found, written and loaded again; why, where it does not load."""

    about = files.provenance.provenance_header(settings, settings.layout.seed)
    with files.tables.Whole(path) as temporary:
        temporary.write_text(as_yaml(settings, found, made, path.parent, about), "utf-8")
    file = files.whole.readable_path(path)
    try:
        return replace(facets.load(file), name=path.stem, path=path.resolve())
    except ConfigError as error:  # a sub-beam may miss a detector elsewhere than in the volume
        return str(error).replace(file.name, path.name)


def write_comparison(settings: Config, better: Config, csv: Path, picture: Path) -> dict[str, Any]:
    """Before and after, as a table that is returned, and a picture."""
    layout = settings.layout
    table = design.verification.compare(
        settings.sensor, better.sensor, layout, settings.range, layout.seed
    )
    files.tables.write_table(csv, table, files.provenance.provenance_header(settings, layout.seed))
    pictures.style.save(pictures.layout.layout_picture(table), picture)
    return table


def show_parts(found: Optimum) -> None:
    """Each choice from the catalogue, the best first."""
    if found.tried:
        headings, rows = parts(found)
        left = (0, 1, 2, len(headings) - 1)
        show_table("parts, the best first", headings, rows[:SHOWN], left=left)
        if len(rows) < found.choices or len(rows) > SHOWN:
            typer.echo(
                f"{len(rows)} of {found.choices} choices were tried; the others cannot be better, "
                "or keep not all that is asked for\n"
            )


def parts(found: Optimum) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the choices that were tried."""
    headings = ["detectors", "laser", "amplifiers", "price", "weeks", *found.names, "objective",
                "end"]  # fmt: skip
    rows = []
    for choice, end in found.tried:
        price = "" if choice.price is None else f"{choice.price:.0f}"
        weeks = "" if choice.delivery is None else f"{choice.delivery:g}"
        values = [f"{value:.4g}" for value in end.x]
        objective = f"{end.objective:.4g}" if end.found else "-"
        parted = [choice.psd, choice.laser, choice.amplifier or "-", price, weeks]
        rows.append([*parted, *values, objective, end.status])
    return headings, rows


def show_starts(found: Optimum) -> None:
    headings = (*found.names, "objective", "seconds", "end")
    rows = []
    for end in found.results:
        values = [f"{value:.5g}" for value in end.x]
        rows.append([*values, f"{end.objective:.6g}", f"{end.seconds:.1f}", end.status])
    show_table("starts, the best first", headings, rows, left=(len(headings) - 1,))


def refuse(found: Optimum) -> None:
    typer.echo("no layout meets all that is asked for; these stand against each other:")
    show_shortfalls(found.best.shortfalls)


def show_shortfalls(shortfalls: dict[str, float]) -> None:
    for group, gap in shortfalls.items():
        typer.echo(f"  {group}: would have to give way by {100 * gap:.3g} % of its limit")


def show_result(
    settings: Config,
    better: Config,
    found: Optimum,
    made: Rounded | None,
    table: dict[str, Any],
) -> None:
    aim = settings.layout.aim
    if found.before == found.before:
        typer.echo(f"before: {design.report.objective_text(aim, found.before)}")
    else:
        typer.echo("before: not all that is asked for is kept")
    typer.echo(f"after:  {design.report.objective_text(aim, found.best.objective)}")
    if made is not None:
        words = design.report.objective_text(aim, made.objective)
        typer.echo(f"        {words}, in numbers that can be made")
    typer.echo("")
    headings, rows = changes(settings, better, made, found.names)
    show_table("what changes", headings, rows, left=(0, 3))
    if any(row[3].endswith(BREAKS) for row in rows):
        typer.echo(f"{BREAKING}\n")
    show_comparison(table)


def changes(
    settings: Config, better: Config, made: Rounded | None, names: list[str]
) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of all keys that changed, with what each may be off by."""
    allowed = tolerances(made, names)
    rows = []
    for key, before, after in design.changes.changes_of(settings, better.sensor):
        rows.append(
            [key, value_text(before), value_text(after), allowed.get(key.rpartition(".")[2], "")]
        )
    return ["sensor.", "before", "after", "made to"], rows


def value_text(value: Any) -> str:
    return f"{value:.7g}" if isinstance(value, float) else str(value)


#: What an error of the size that a number is made to can do, and what to do about that.
BREAKS = "breaks a limit"
BREAKING = (
    "breaks a limit: the best layout stands at that limit, so that an error of this size to the\n"
    "wrong side leaves what is asked for. optimize.production.yield_percent asks for a layout\n"
    "with margins for its tolerances."
)


def tolerances(made: Rounded | None, names: list[str]) -> dict[str, str]:
    """By the last part of a key: to what it is made, and what an error of that costs."""
    if made is None:
        return {}
    found = {}
    for name, step, cost in zip(names, made.steps, made.costs, strict=True):
        if step:
            worse = BREAKS if cost == float("inf") else f"costs up to {cost:.2g} %"
            found[KEYS.get(name, name)] = f"+- {step / 2:g}, which {worse}"
    return found


#: Variables whose key has another name.
KEYS = {"azimuth_b_deg": "azimuth_deg"} | {
    f"{kind}_{letter}_{key}": key
    for kind, keys in (
        ("facet", ("inclination_deg", "azimuth_deg")),
        ("psd", ("radius_mm", "azimuth_deg", "height_mm", "roll_mrad", "pitch_mrad", "yaw_mrad")),
    )
    for letter in "abc"
    for key in keys
}


def show_comparison(table: dict[str, Any]) -> None:
    show_table("before and after: the worst over the volume (1 sigma), and symmetric ranges",
               *comparison(table))  # fmt: skip


def comparison(table: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    headings = ["quantity", "before", "after", "after / before", "simulated"]
    rows = []
    for quantity, before, after, drawn in zip(*table.values(), strict=True):
        simulated = "" if drawn != drawn else f"{drawn:.3g}"
        ratio = f"{after / before:.2f}" if before > 0 < after else ""
        rows.append([str(quantity), f"{before:.3g}", f"{after:.3g}", ratio, simulated])
    return headings, rows


def prove(better: Config, work: int) -> str:
    """In words, whether readings are proved to determine states, within so much work."""

    if not work:
        return "not looked for: whether readings determine states (--certify)"
    found = proof.designs.certify_design(better.sensor, better.range, work)
    if isinstance(found, str):
        return f"not proved that readings determine states: {found}"
    if not found.share:
        return f"not proved that readings determine states: {found.reason}"
    states = (
        "states within the ranges of the axes and with"
        f" {light_text(found.share, better.sensor.beam.power)}"
    )
    if found.unique:
        return (
            f"proved: no two {states} have the same readings; margin {round_down(found.margin)}"
            f" or more, of 1 ({found.seconds:.1f} s)"
        )
    return (
        f"not proved that readings determine {states}, in the work allowed:"
        f" {found.reason or 'the inequality fails'} ({found.seconds:.1f} s);\n"
        "`facets jacobian --certify` says more"
    )


def show_reasons(settings: Config, found: Optimum) -> list[list[str]]:
    """What holds the layout back and what more would give, printed, and as rows."""
    active = [
        [f"{size:.2f}", group] for group, size in list(found.best.active_constraints.items())[:8]
    ]
    typer.echo("what holds it back, over the strongest:")
    for size, group in active:
        typer.echo(f"  {size:>5}  {group}")
    spare = found.problem.rows.spare
    more = design.report.gains(
        found.sensor, settings.layout, found.best.x, price_of(settings, found), spare
    )
    if more:
        typer.echo("\nwhat more would give:")
    given = [
        [what, design.report.objective_text(settings.layout.aim, value)]
        for what, value in more.items()
    ]
    for what, words in given:
        typer.echo(f"  {what}: {words}")
    typer.echo("")
    return [*([group, f"holds it back, {size} of the strongest"] for size, group in active), *given]


def as_yaml(
    settings: Config, found: Optimum, made: Rounded | None, folder: Path, about: dict[str, str]
) -> str:
    """The configuration it came from, extended by what was changed."""
    best = design.variables.sensor_of(
        found.sensor, found.names, found.best.x if made is None else made.x
    )
    if found.tried:
        choice = found.tried[0][0]
        about = {**about, "parts": choice.names}
    return design.changes.as_extension(settings, best, folder, about, tolerances(made, found.names))


#: Choices of parts in a table, at most.
SHOWN = 24


@dataclass(frozen=True)
class Story:
    """All that the report tells."""

    settings: Config
    better: Config
    found: Optimum
    made: Rounded | None
    table: dict[str, Any]
    reasons: list[list[str]]
    proof: str
    built: list[ReportSection]


def write_report(story: Story, page: Path, scene: Path) -> None:
    """The page, and the scene for a mechanical designer."""
    import numpy as np

    pictures.render.save_scene(story.better.sensor, np.zeros(8), scene)
    best = story.found.best.objective if story.made is None else story.made.objective
    words = design.report.objective_text(story.settings.layout.aim, best)
    summary = f"{words[0].upper()}{words[1:]}."
    command = files.provenance.command_line()
    origin = f"{command}; sha256 of the configuration {story.settings.sha256[:12]}"
    with files.tables.Whole(page) as temporary:
        text = pictures.design_report.report(
            story.settings.name, summary, sections(story, scene), origin
        )
        temporary.write_text(text, "utf-8")


def write_tables(story: Story, path: Path) -> None:
    """The tables of the report, by their titles."""
    found: dict[str, design.sheets.Rows] = {
        "What was asked for": (("asked", "value"), requirement(story.settings)),
        "What changes": changes_in_words(story),
        "Before and after": comparison_in_words(story),
        "What holds it back": (("what", "how"), pictures.wording.rows_in_words(story.reasons)),
    }
    if story.found.tried:
        found["Parts"] = parts(story.found)
    found |= {part.title: (part.headings, part.rows) for part in story.built}
    command = files.provenance.command_line()
    origin = f"{command}; sha256 of the configuration {story.settings.sha256[:12]}"
    design.sheets.write_sheets(path, found, origin)


def sections(story: Story, scene: Path) -> list[pictures.design_report.ReportSection]:
    """The parts of the page; quantities in words there, each with its unit."""
    asked = pictures.design_report.ReportSection(
        "What was asked for", rows=requirement(story.settings)
    )
    changed = pictures.design_report.ReportSection(
        "What changes", (), *changes_in_words(story), wide=True
    )
    head = pictures.design_report.ReportSection(
        "The head", (f"Lengths in mm. {scene.name} has it in three dimensions, with beams.",),
        drawing=pictures.head_drawing.drawing(story.better.sensor),
    )  # fmt: skip
    compared = pictures.design_report.ReportSection(
        "Before and after", ("The worst over the volume (1 sigma), and symmetric ranges.",),
        *comparison_in_words(story),
    )  # fmt: skip
    bars = pictures.design_report.ReportSection(
        "The same, drawn",
        drawing=pictures.design_report.inline(pictures.layout.layout_picture(story.table), "bars"),
    )
    reasons = pictures.design_report.ReportSection("What holds it back, and what more would give",
                      rows=pictures.wording.rows_in_words(story.reasons))  # fmt: skip
    found = [asked, head, changed, compared, bars, reasons, *story.built]
    if story.found.tried:
        found.append(
            pictures.design_report.ReportSection("Parts", (), *parts(story.found), wide=True)
        )
    found.append(pictures.design_report.ReportSection("Are readings unique?", (story.proof,)))
    return found


def changes_in_words(story: Story) -> tuple[list[str], list[list[str]]]:
    """What changes, with the keys of the sensor in words."""
    (_, *headings), rows = changes(story.settings, story.better, story.made, story.found.names)
    return ["of the sensor", *headings], pictures.wording.rows_in_words(rows)


def comparison_in_words(story: Story) -> tuple[list[str], list[list[str]]]:
    headings, rows = comparison(story.table)
    return headings, pictures.wording.rows_in_words(rows)


def requirement(settings: Config) -> list[list[str]]:
    """What the block `optimize` asks for, in words, as rows."""
    asked = settings.resolved["optimize"]
    aim = str(asked["aim"])
    rows = [["aim", pictures.wording.AIMS.get(aim, aim)], ["beam", str(asked["beam"])]]
    blocks = (("volume", "volume", "±"), ("unit", "uncertainty that counts as 1", ""),
              ("limit", "uncertainty at most", ""))  # fmt: skip
    for block, words, sign in blocks:
        values = [
            pictures.wording.amount(key, value, sign)
            for key, value in asked[block].items()
            if value
        ]
        if values:
            rows.append([words, ", ".join(values)])
    if asked["head_mm"]:
        rows.append(["diameter of the head", f"at most {asked['head_mm']:g} mm"])
    rows.append(["power on a detector", f"at least {asked['least_power_uw']:g} µW"])
    bounds = [
        pictures.wording.between(key, *bounds)
        for key, bounds in asked["variables"].items()
        if bounds
    ]
    return [*rows, ["may vary", ", ".join(bounds)]]
