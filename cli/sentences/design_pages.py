"""Results about designs, printed and as pages."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from facets import design, files, pictures

from ..console import show_table
from .yields import error_rows, show_yields, tolerance_rows, yield_rows, yields_of

if TYPE_CHECKING:
    from facets.config import Config
    from facets.core.sensor import Sensor
    from facets.design.exploration import Space
    from facets.design.rounding import Rounded
    from facets.design.search import Optimum
    from facets.design.sheets import Rows
    from facets.pictures.reports.report_page import ReportSection

    from .yields import Yields


def write_gallery(
    settings: Config, space: Space, front: dict[str, Any], others: dict[str, Any] | None, path: Path
) -> None:
    """Write the page of the front's designs and of some others."""
    table, sensors = design.gallery.gallery(space, front, others)
    count = int((table["kind"] == "front").sum())
    some = f"Shown are {count} of the {len(front[space.names[0]])} designs on the front"
    if others is not None:
        shown = int((table["kind"] == "other").sum())
        some += f", and {shown} others of {len(others['design'])} sampled designs"
    goals = list(space.objectives)
    texts = design.gallery.texts_of(settings, sensors, path.parent)
    designs = pictures.exploration_page.ShownDesigns(table, sensors, texts)
    text = pictures.exploration_page.page(settings.name, space.names, goals, designs, f"{some}.")
    files.whole.write_text(path, text)


BREAKING = (
    "breaks a limit: the best layout stands at that limit, so that an error of this size to the\n"
    "wrong side leaves what is asked for. optimize.production.yield_percent asks for a layout\n"
    "with margins for its tolerances."
)


def objective_of(settings: Config, found: Optimum, made: Rounded | None) -> str:
    """Describe the objective of the layout in words."""
    best = found.best.objective if made is None else made.objective
    return design.report.objective_text(settings.layout.aim, best)


def show_layout(
    settings: Config, better: Config, found: Optimum, made: Rounded | None, paths: list[Path],
    proved: str, heads: int,
) -> tuple[dict[str, Any], list[ReportSection]]:  # fmt: skip
    """Print the layout; write its comparison as a table and as a picture; return the parts of its
    page and the table."""
    layout = settings.layout
    table = design.verification.compare(
        settings.sensor, better.sensor, layout, settings.range, layout.seed
    )
    files.tables.write_table(
        paths[0], table, files.provenance.provenance_header(settings, layout.seed)
    )
    pictures.style.save(pictures.layout.layout_picture(table), paths[1])
    show_objectives(settings, found, made)
    changed = design.tables.change_rows(settings, better.sensor, made, found.names)
    show_table("what changes", *changed, left=(0, 3))
    if any(row[3].endswith(design.tables.BREAKS) for row in changed[1]):
        typer.echo(f"{BREAKING}\n")
    compared = design.tables.comparison_rows(table)
    show_table("before and after: the worst over the volume (1 sigma), and symmetric ranges",
               *compared)  # fmt: skip
    reasons = show_reasons(settings, found)
    typer.echo(f"{proved}\n")
    built = []
    if heads:  # the settings of the configuration, and the optimised sensor
        yields = yields_of(settings, better.sensor, heads, layout.seed)
        show_yields(settings, yields)
        built = yield_sections(settings, yields)
    parts = design.tables.part_rows(found) if found.tried else None
    return table, sections_of(settings, changed, compared, reasons, built, parts, proved)


def show_objectives(settings: Config, found: Optimum, made: Rounded | None) -> None:
    """Print the objective before and after."""
    before = "the requirements are not met"
    if found.before == found.before:
        before = design.report.objective_text(settings.layout.aim, found.before)
    typer.echo(f"before: {before}")
    typer.echo(f"after:  {objective_of(settings, found, None)}")
    if made is not None:
        words = objective_of(settings, found, made)
        typer.echo(f"        {words}, in numbers that can be made")
    typer.echo("")


def show_reasons(settings: Config, found: Optimum) -> list[list[str]]:
    """Print the active constraints and the effect of larger parts; return them as rows."""
    active = [
        [f"{size:.2f}", group] for group, size in list(found.best.active_constraints.items())[:8]
    ]
    typer.echo("what holds it back, over the strongest:")
    for size, group in active:
        typer.echo(f"  {size:>5}  {group}")
    spare = found.problem.rows.spare
    price = 0.0
    if found.tried:
        price = design.branching.price_term(settings.layout, found.tried[0][0].price)
    more = design.report.gains(found.sensor, settings.layout, found.best.x, price, spare)
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


def write_report(
    settings: Config, sensor: Sensor, objective: str, table: dict[str, Any],
    sections: list[ReportSection], page: Path, scene: Path,
) -> None:  # fmt: skip
    """Write the page of a layout, and the scene for a mechanical designer."""
    import numpy as np

    pictures.render.save_scene(sensor, np.zeros(8), scene)
    summary = f"{objective[0].upper()}{objective[1:]}."
    head = pictures.report_page.ReportSection(
        "The head", (f"Lengths in mm. {scene.name} has it in three dimensions, with beams.",),
        drawing=pictures.head_drawing.drawing(sensor),
    )  # fmt: skip
    bars = pictures.report_page.inline(pictures.layout.layout_picture(table), "bars")
    drawn = pictures.report_page.ReportSection("The same, drawn", drawing=bars)
    origin = files.provenance.origin_line(settings)
    parts = [sections[0], head, *sections[1:3], drawn, *sections[3:]]
    with files.tables.Whole(page) as temporary:
        text = pictures.report_page.report(
            f"The layout found for {settings.name}", summary, parts, origin
        )
        temporary.write_text(text, "utf-8")


def sections_of(
    settings: Config, changed: Rows, compared: Rows, reasons: list[list[str]],
    built: list[ReportSection], parts: Rows | None, proof: str,
) -> list[ReportSection]:  # fmt: skip
    """Sections of a layout's page except drawings; quantities are in words, with units."""
    section, in_words = pictures.report_page.ReportSection, pictures.wording.rows_in_words
    found = [
        section("Requirements", rows=requirement(settings)),
        section("What changes", (), ["of the sensor", *changed[0][1:]], in_words(changed[1]),
                wide=True),
        section("Before and after", ("The worst over the volume (1 sigma), and symmetric ranges.",),
                compared[0], in_words(compared[1])),
        section("What limits the layout, and what more would give", rows=in_words(reasons)),
        *built,
    ]  # fmt: skip
    if parts is not None:
        found.append(section("Parts", (), *parts, wide=True))
    return [*found, section("Are readings unique?", (proof,))]


def write_tables(settings: Config, sections: list[ReportSection], path: Path) -> None:
    """Write the tables of a page under their titles."""
    tables = {
        part.title.partition(",")[0]: (part.headings or ("what", "value"), part.rows)
        for part in sections
        if part.rows
    }
    design.sheets.write_sheets(path, tables, files.provenance.origin_line(settings))


def yield_sections(settings: Config, found: Yields) -> list[ReportSection]:
    """Sections of a layout's page about its yield."""
    section = pictures.report_page.ReportSection
    words = (f"{found.count} heads built by simulation, as loose as calibrate.before says.",)
    parts = [section("Yield", words, *yield_rows(settings, found))]
    if found.accurate:
        within = ("Largest error in the volume, from rest; 95 % of the heads are within.",)
        parts.append(section("Accuracy", within, *error_rows(settings, found)))
    headings, rows = tolerance_rows(settings, found)
    rows = pictures.wording.rows_in_words(rows)
    return [*parts, section("Which tolerance costs most", (), headings, rows, wide=True)]


def requirement(settings: Config) -> list[list[str]]:
    """Rows that describe the requirements of the block `optimize`."""
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
