"""Results about designs, printed and as pages."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from facets import design, files, pictures

from ..console import draw_extra, show_table
from .yields import error_rows, show_yields, tolerance_rows, yield_rows, yields_of

if TYPE_CHECKING:
    from facets.config import Config
    from facets.design.exploration.space import Space
    from facets.design.optimisation.rounding import Rounded
    from facets.design.optimisation.search import Optimum
    from facets.design.results.tables import Rows
    from facets.pictures.reports.report_page import ReportSection

    from .yields import Yields


def write_gallery(
    settings: Config, space: Space, front: dict[str, Any], others: dict[str, Any] | None, path: Path
) -> None:
    """Write the page of the front's designs and of some others."""
    table, sensors = design.exploration.gallery.gallery(space, front, others)
    count = int((table["kind"] == "front").sum())
    some = f"Shown are {count} of the {len(front[space.names[0]])} designs on the front"
    if others is not None:
        shown = int((table["kind"] == "other").sum())
        some += f", and {shown} others of {len(others['design'])} sampled designs"
    goals = list(space.objectives)
    texts = design.exploration.gallery.texts_of(settings, sensors, path.parent)
    designs = pictures.exploration_page.ShownDesigns(table, sensors, texts)
    text = pictures.exploration_page.page(settings.name, space.names, goals, designs, f"{some}.")
    files.whole.write_text(path, text)


BREAKING = (
    "breaks a limit: the best layout lies at that limit, so that an error of this size to the\n"
    "wrong side violates a requirement. optimize.production.yield_percent asks for a layout\n"
    "with margins for its tolerances."
)


@dataclass(frozen=True)
class NewLayout:
    """A layout that was found for a configuration.

    rounded: the optimum in values that can be manufactured, if it was rounded.  better: the
    configuration with the layout.
    """

    settings: Config
    optimum: Optimum
    rounded: Rounded | None
    better: Config

    @property
    def objective(self) -> str:
        """The objective of the layout in words."""
        best = self.rounded or self.optimum.best
        return design.results.tables.objective_text(self.settings.layout.aim, best.objective)


def show_layout(
    layout: NewLayout, paths: list[Path], proved: str, heads: int
) -> tuple[dict[str, Any], list[ReportSection]]:
    """Print the layout; write its comparison as a table and as a picture; return the parts of its
    page and the table."""
    settings, sensor = layout.settings, layout.better.sensor
    required = settings.layout
    table = design.results.verification.compare(
        settings.sensor, sensor, required, settings.range, required.seed
    )
    files.tables.write_table(
        paths[0], table, files.provenance.provenance_header(settings, required.seed)
    )
    draw_extra(paths[1], pictures.layout.layout_picture, table)
    show_objectives(layout)
    names = layout.optimum.names
    changed = design.results.tables.change_rows(settings, sensor, layout.rounded, names)
    show_table("what changes", *changed, left_columns=(0, 3))
    if any(row[3].endswith(design.results.tables.BREAKS) for row in changed[1]):
        print(f"{BREAKING}\n")
    compared = design.results.tables.comparison_rows(table)
    show_table("before and after: the worst over the volume (1 sigma), and symmetric ranges",
               *compared)  # fmt: skip
    reasons = show_reasons(settings, layout.optimum)
    print(f"{proved}\n")
    built = []
    if heads:  # the settings of the configuration, and the optimised sensor
        yields = yields_of(settings, sensor, heads, required.seed)
        show_yields(settings, yields)
        built = yield_sections(settings, yields)
    return table, sections_of(layout, changed, compared, reasons, built, proved)


def show_objectives(layout: NewLayout) -> None:
    """Print the objective before and after."""
    before, exact = "the requirements are not met", replace(layout, rounded=None).objective
    if layout.optimum.before == layout.optimum.before:
        aim = layout.settings.layout.aim
        before = design.results.tables.objective_text(aim, layout.optimum.before)
    print(f"before: {before}")
    print(f"after:  {exact}")
    if layout.rounded is not None:
        print(f"        {layout.objective}, in numbers that can be made")
    print("")


def show_reasons(settings: Config, optimum: Optimum) -> list[list[str]]:
    """Print the active constraints and the effect of larger parts; return them as rows."""
    active = [
        [f"{size:.2f}", group] for group, size in list(optimum.best.active_constraints.items())[:8]
    ]
    print("what holds it back, over the strongest:")
    for size, group in active:
        print(f"  {size:>5}  {group}")
    more = design.optimisation.search.gains(optimum, settings.layout)
    if more:
        print("\nwhat more would give:")
    improvements = [
        [what, design.results.tables.objective_text(settings.layout.aim, value)]
        for what, value in more.items()
    ]
    for what, words in improvements:
        print(f"  {what}: {words}")
    print("")
    return [
        *([group, f"holds it back, {size} of the strongest"] for size, group in active),
        *improvements,
    ]


def write_report(
    layout: NewLayout, table: dict[str, Any], sections: list[ReportSection], page: Path, scene: Path
) -> None:
    """Write the page of a layout, and the scene for a mechanical designer."""
    import numpy as np

    sensor, objective = layout.better.sensor, layout.objective
    pictures.render.save_scene(sensor, np.zeros(8), scene)
    summary = f"{objective[0].upper()}{objective[1:]}."
    head = pictures.report_page.ReportSection(
        "The head", (f"Lengths in mm. {scene.name} has it in three dimensions, with beams.",),
        drawing=pictures.head_drawing.drawing(sensor),
    )  # fmt: skip
    bars = pictures.report_page.inline(pictures.layout.layout_picture(table), "bars")
    drawn = pictures.report_page.ReportSection("The same, drawn", drawing=bars)
    parts = [sections[0], head, *sections[1:3], drawn, *sections[3:]]
    title = f"The layout found for {layout.settings.name}"
    origin = files.provenance.origin_line(layout.settings)
    files.whole.write_text(page, pictures.report_page.report(title, summary, parts, origin))


def sections_of(
    layout: NewLayout, changed: Rows, compared: Rows, reasons: list[list[str]],
    built: list[ReportSection], proof: str,
) -> list[ReportSection]:  # fmt: skip
    """Sections of a layout's page except drawings; quantities are in words, with units."""
    section, in_words = pictures.report_page.ReportSection, pictures.wording.rows_in_words
    sections = [
        section("Requirements", rows=requirement(layout.settings)),
        section("What changes", (), ["of the sensor", *changed[0][1:]], in_words(changed[1]),
                wide=True),
        section("Before and after", ("The worst over the volume (1 sigma), and symmetric ranges.",),
                compared[0], in_words(compared[1])),
        section("What limits the layout, and what more would give", rows=in_words(reasons)),
        *built,
    ]  # fmt: skip
    if layout.optimum.tried:
        parts = design.results.tables.part_rows(layout.optimum, layout.settings.layout.aim)
        sections.append(section("Parts", (), *parts, wide=True))
    return [*sections, section("Are readings unique?", (proof,))]


def yield_sections(settings: Config, yields: Yields) -> list[ReportSection]:
    """Sections of a layout's page about its yield."""
    section = pictures.report_page.ReportSection
    words = (f"{yields.count} heads built by simulation, as loose as calibrate.before says.",)
    parts = [section("Yield", words, *yield_rows(settings, yields))]
    if yields.accurate:
        within = ("Largest error in the volume, from rest; 95 % of the heads are within.",)
        parts.append(section("Accuracy", within, *error_rows(settings, yields)))
    headings, rows = tolerance_rows(settings, yields)
    rows = pictures.wording.rows_in_words(rows)
    return [*parts, section("Which tolerance costs most", (), headings, rows, wide=True)]


def requirement(settings: Config) -> list[list[str]]:
    """Rows that describe the requirements of the block `optimize`."""
    keys = settings.resolved["optimize"]
    aim = str(keys["aim"])
    rows = [["aim", pictures.wording.AIMS.get(aim, aim)], ["beam", str(keys["beam"])]]
    blocks = (("volume", "volume", "±"), ("unit", "uncertainty that counts as 1", ""),
              ("limit", "uncertainty at most", ""))  # fmt: skip
    for block, words, sign in blocks:
        values = [
            pictures.wording.amount(key, value, sign) for key, value in keys[block].items() if value
        ]
        if values:
            rows.append([words, ", ".join(values)])
    if keys["head_mm"]:
        rows.append(["diameter of the head", f"at most {keys['head_mm']:g} mm"])
    rows.append(["power on a detector", f"at least {keys['least_power_uw']:g} µW"])
    bounds = [
        pictures.wording.between(key, *bounds)
        for key, bounds in keys["variables"].items()
        if bounds
    ]
    return [*rows, ["may vary", ", ".join(bounds)]]
