"""Sampling a design space or following its front, for `facets explore`."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from facets import characterization, config as configuration, core, design, files, pictures
from facets.core.plain_numbers import count_text

from ..console import FINDING, draw_extra, show_progress, show_table, skip_picture
from ..options import require_yaml
from ..results import name_files
from ..sentences.design_pages import write_gallery

if TYPE_CHECKING:
    from facets.config import Config
    from facets.design.exploration.space import Space

#: Maximum number of designs from which the sensitivity indices are computed.
PILOT = 10_000


@dataclass(frozen=True)
class Exploration:
    """The explored space and the places of its results.  picture: format of the picture."""

    settings: Config
    space: Space
    folder: Path
    picture: str
    report: Path | None

    @property
    def header(self) -> dict[str, str]:
        return files.provenance.provenance_header(self.settings, self.space.seed)

    def write_page(self, front: dict[str, Any], others: dict[str, Any] | None) -> None:
        if self.report is not None:
            page, made = self.report, (self.settings, self.space, front, others)
            draw_extra(page, write_gallery, *made, page)

    def name_results(self, paths: list[Path]) -> None:
        if self.report is not None and self.report.exists():
            print(f"{self.report}: the designs as a page")
        name_files(self.folder, paths)


def sample(job: Exploration, paths: list[Path], scheduler: str | None, force: bool) -> None:
    """Compute the designs that are missing in the folder."""
    core.extras.require_extra("pyarrow", "a search's parts")
    space, folder = job.space, job.folder
    if scheduler:
        print(design.exploration.runs.cluster_words(scheduler))
    # an interrupted run has written them
    files.tables.refuse_to_overwrite(paths, force=True)
    design.exploration.runs.prepare(folder, space, force)
    with show_progress("exploring") as on_progress:
        design.exploration.runs.explore(space, folder, job.header, scheduler, on_progress)


def write(job: Exploration, paths: list[Path], seconds: float) -> None:
    """Write designs, front, picture and page; exit status 1 if no design is on the front."""
    space, goals = job.space, list(job.space.objectives)
    every, front_table, picture = paths
    with files.tables.ResultSet():
        table = design.exploration.runs.collect(job.folder)
        best = design.exploration.space.front(table, goals)
        pilot = {name: column[:PILOT] for name, column in table.items()}
        indices = characterization.sensitivity.sensitivity(pilot, space.names, goals)
        files.tables.write_table(every, table, job.header)
        on_front = {name: column[best] for name, column in table.items()}
        files.tables.write_table(front_table, on_front, job.header)
        print("\n".join(design.exploration.runs.summary(table, best, goals, indices, seconds)))
        present = show_own_measures(space)
        drawing = pictures.exploration.front_picture(table, best, goals, indices, present)
        if drawing is None:
            skip_picture(picture, "the front needs at least two designs that have all objectives")
        else:
            draw_extra(picture, lambda: drawing)
        if best.any():
            job.write_page(design.exploration.gallery.best_of(table, goals, best), table)
    job.name_results(paths)
    if not best.any():
        raise typer.Exit(FINDING)


def follow_front(job: Exploration, points: int) -> None:
    """Follow the front; write its table, picture and page; exit status 1 if there is none."""
    space, goals = job.space, list(job.space.objectives)
    paths = [job.folder / name for name in ("pareto.csv", f"pareto.{job.picture}")]
    with files.tables.ResultSet():
        files.tables.refuse_to_overwrite(paths, force=True)
        begin = time.perf_counter()
        with show_progress("following the front") as on_progress:
            pareto = design.exploration.front.pareto_front(space, points, space.seed, on_progress)
        seconds = time.perf_counter() - begin
        if not len(pareto.designs):
            print("The search found no design that meets all requirements.")
            raise typer.Exit(FINDING)
        table = design.exploration.front.columns(pareto)
        files.tables.write_table(paths[0], table, job.header)
        headings, rows = design.exploration.front.some_rows(pareto)
        points_text = count_text(len(pareto.designs), "point")
        title = f"{points_text} on the front, {seconds:.1f} s; some of them"
        show_table(title, headings, rows, left_columns=(len(headings) - 1,))
        if pareto.left_out:
            print(
                f"{count_text(pareto.left_out, 'more point')} excluded: an exact evaluation gave "
                "other values"
            )
        cloud = design.exploration.runs.collect_older(space, job.folder)
        present = show_own_measures(space)
        make = pictures.exploration.pareto_picture
        draw_extra(paths[1], make, table, goals, cloud, present)
        job.write_page(table, cloud)
    job.name_results(paths)


def show_own_measures(space: Space) -> dict[str, float]:
    """Print the measures of the unchanged sensor in one line; return them."""
    _, values, why = design.exploration.gallery.present_design(space)
    present = dict(zip(design.exploration.space.MEASURES, values.tolist(), strict=True))
    shown = ", ".join(f"{name} {present[name]:.4g}" for name in space.objectives)
    print(f"as it is: {why or shown}")
    return present


def write_pick(
    settings: Config, space: Space, file: Path, number: int, output: Path | None, force: bool
) -> None:
    """Write one design of an earlier run as a configuration that extends that of the run."""
    path = output or Path(f"{settings.name}-{number}.yaml")
    require_yaml(path)
    files.tables.refuse_to_overwrite([path], force, configuration.source_files(settings))
    chosen = design.exploration.gallery.choose_design(settings, space, file, number)
    x, words = design.exploration.gallery.make_buildable(space, chosen)
    print("\n".join(words))
    sensor = design.variables.sensor_of(space.sensor, space.names, x)
    about = files.provenance.provenance_header(settings) | {"design": f"{number} of {file.name}"}
    design.results.changes.write_design(settings, sensor, path, about)
    for key, before, after in design.results.changes.changes_of(settings, sensor):
        print(f"  {key:<24} {before} -> {after}")
    print(f"{path}: design {number} of {file}")
