"""`facets explore`: a design space, on all cores or a cluster, and its Pareto front."""

from __future__ import annotations

import time
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from facets import characterization, design, files, pictures, proof
from facets.core.errors import InputError

from . import completion
from .console import FINDING, leave_out_picture, load_config, name_files, show_progress, show_table
from .options import (
    Certify,
    ConfigName,
    Force,
    Look,
    Plot,
    PlotKind,
    Style,
    Table,
    TableKind,
    folder_option,
    output_folder,
    output_option,
    report_option,
    seed_option,
)

if TYPE_CHECKING:
    from facets.characterization.sensitivity import Index
    from facets.config import Config
    from facets.core.units import Booleans, Floats
    from facets.design.exploration import Space

#: Designs that the indices of sensitivity are made from, at most.
PILOT = 10_000
GOALS = ("head_mm", "u_roll_urad", "range_roll_mrad")


class Draw(StrEnum):
    sobol = "sobol"
    lhs = "lhs"
    grid = "grid"


Objectives = Annotated[
    list[str] | None,
    typer.Option(
        metavar="MEASURE",
        help="Quantity to optimise, such as head_mm, u_tx_um or range_tx_mm; can be repeated.  "
        f"[default: {', '.join(GOALS)}]",
        autocompletion=completion.words(completion.measures),
    ),
]
Every = Annotated[
    bool,
    typer.Option(
        "--every",
        help="Compute the ranges also for designs that cannot be on the Pareto front.",
    ),
]
Required = Annotated[
    bool,
    typer.Option(
        "--required", help="Use only designs that meet all requirements of the block `optimize`."
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Address of the scheduler of a Dask cluster.  [default: all cores of this machine]",
    ),
]
Front = Annotated[
    bool,
    typer.Option(
        "--front",
        help="Follow the Pareto front by continuation instead of sampling designs, with the "
        "exchange rate between the objectives; sampled designs in the folder are compared with it.",
    ),
]
Report = Annotated[
    Path | None,
    report_option(
        "interactive plots, and each design's drawing and YAML; it needs the extra `pages`"
    ),
]
Pick = Annotated[
    int | None,
    typer.Option(
        min=0,
        metavar="N",
        help="Write a configuration (-o) of design N in the folder of an earlier run, instead of "
        "exploring: column `design` of front.csv, or with --front column `point` of pareto.csv.",
    ),
]
Picked = Annotated[
    Path | None, output_option("configuration of the design of --pick, YAML", "CONFIG-N.yaml")
]
Points = Annotated[
    int,
    typer.Option(
        min=3, max=10_000, help="Approximate number of points on the front, with --front."
    ),
]
Number = Annotated[int, typer.Option(min=2, max=10**9, help="Minimum number of designs to sample.")]
Sampling = Annotated[
    Draw,
    typer.Option(
        help="Method of sampling designs: Sobol' sequence, Latin hypercube, or regular grid."
    ),
]
NoTable = Annotated[
    bool,
    typer.Option(
        "--no-table", help="Write no table of all designs; the data set in parts/ holds them too."
    ),
]
Part = Annotated[
    str | None,
    typer.Option(
        "--share",
        metavar="K/N",
        help="Compute only share K (1 to N) of N of the designs, for job arrays: N processes with "
        "the same folder and the same other options compute all of them.",
    ),
]
Gather = Annotated[
    bool,
    typer.Option(
        "--gather",
        help="Write the results from the designs that all shares have computed in the folder, "
        "without computing any.",
    ),
]


def explore(
    config: ConfigName,
    folder: Annotated[Path | None, folder_option("results/CONFIG-explore")] = None,
    designs: Number = 1000,
    sampling: Sampling = Draw.sobol,
    seed: Annotated[int, seed_option()] = 1,
    objective: Objectives = None,
    every: Every = False,
    required: Required = False,
    scheduler: Scheduler = None,
    share: Part = None,
    gather: Gather = False,
    force: Force = False,
    table: Table = TableKind.parquet,
    no_table: NoTable = False,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
    certify: Certify = 0,
    front: Front = False,
    points: Points = 100,
    report: Report = None,
    pick: Pick = None,
    output: Picked = None,
) -> None:
    """Sample a design space and find its Pareto front.

    Varies the parameters in `optimize.variables`, and computes the ranges and uncertainties of each
    design and which designs no other one beats in all objectives. The results are written part by
    part: the same command continues an interrupted run, and --force starts again. Ranges, which
    take most of the time, are not computed for designs that cannot be on the front. Exit status 1
    if no design has all objectives.
    """
    settings = load_config(config)
    design.exploration.require_measures(goals := objective or list(GOALS))
    space = design.exploration.enlarge_parts(design.exploration.Space(
        settings.sensor, settings.range, settings.layout, sampling.value, designs, seed,
        tuple(goals), every, required,
    ))  # fmt: skip
    part = share_of(share)
    refuse_together(
        {"--share": share, "--gather": gather},
        {"--share": share, "--gather": gather, "--front": front, "--pick": pick is not None,
         "--scheduler": scheduler, "--force": force} | (
            {"--report": report, "--certify": certify} if share else {}
        ),
    )  # fmt: skip
    if pick is not None:
        write_pick(settings, space, folder, front, pick, output, force)
        return
    if output is not None:
        raise InputError(f"-o {output}: -o is the file that --pick writes; the folder is --folder")
    place = output_folder(folder, settings.name, "explore")
    require_page(report, force)
    whole = "parts" if no_table else f"designs.{table.value}"
    paths = [place / n for n in (whole, "front.csv", f"front.{plot.value}")]
    about = files.provenance.provenance_header(settings, seed)
    require_same(settings, place, force)
    if front:
        with files.tables.ResultSet():
            followed, paths = follow_front(space, place, points, about, plot)
            if report:
                write_page(settings, space, followed, older_designs(space, place), report)
        name_results(place, paths, report)
        return
    if scheduler:
        typer.echo(design.exploration.cluster_words(scheduler))
    begin(space, place, paths, about, force)
    start = time.perf_counter()
    if gather:
        design.exploration.require_whole(space, place)
    else:
        show_progress(
            lambda tell: design.exploration.explore(space, place, about, scheduler, tell, part)
        )
    if part:
        count = len(design.exploration.parts_of(space, part))
        typer.echo(f"{place}/parts/: the {count} parts of share {part} are there")
        return
    with files.tables.ResultSet():
        best = write(space, place, paths, about, time.perf_counter() - start, certify)
        if report and best.any():
            drawn = design.exploration.collect(place)
            write_page(settings, space, design.gallery.best_of(drawn, goals, best), drawn, report)
    name_results(place, paths, report)
    if not best.any():
        raise typer.Exit(FINDING)


def share_of(text: str | None) -> design.exploration.Share | None:
    """'3/16' as the third of sixteen shares."""
    if text is None:
        return None
    number, slash, count = text.partition("/")
    if slash and number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count):
        return design.exploration.Share(int(number), int(count))
    raise InputError(
        f"--share is {text!r}; allowed: K/N, whole numbers with K from 1 to N, as 3/16"
    )


def refuse_together(some: dict[str, Any], others: dict[str, Any]) -> None:
    """Refuses two options of which one has no meaning beside the other."""
    for name in (name for name, value in some.items() if value):
        for other in (other for other, value in others.items() if value and other != name):
            raise InputError(f"{name} and {other} cannot be given together")


def name_results(folder: Path, paths: list[Path], page: Path | None) -> None:
    if page is not None and page.exists():
        typer.echo(f"{page}: the designs as a page")
    name_files(folder, paths)


def require_same(settings: Config, folder: Path, force: bool) -> None:
    """Refuses a folder with designs of another configuration, which `force` lets go."""
    tabled = [folder / name for name in ("front.csv", "pareto.csv")]
    remedy = "--force begins anew, --folder names another one"
    for file in [
        *design.exploration.parts_in(folder)[:1],
        *(file for file in tabled if file.exists()),
    ]:
        try:
            files.provenance.require_origin(file, files.tables.read_head(file), settings, remedy)
        except InputError:
            if not force:
                raise
            design.exploration.forget(folder)


def begin(
    space: Space, folder: Path, paths: list[Path], about: dict[str, str], force: bool
) -> None:
    """Refuses what cannot be searched or written, before the folder is made."""
    paths = [file for file in paths if file.suffix]
    files.tables.refuse_to_overwrite(
        paths, force=True
    )  # a run that goes on has written them before
    design.exploration.require_variables(space)
    design.exploration.prepare(folder, space, about, force)


def write(
    space: Space,
    folder: Path,
    paths: list[Path],
    about: dict[str, str],
    seconds: float,
    certify: int,
) -> Booleans:
    """Designs, their front and its picture; returns which designs are on the front.

    certify: pieces that the proof of each of these may look at; 0 for none.
    """

    designs, front_table, picture = paths
    goals = list(space.objectives)
    table = design.exploration.collect(folder)
    best = design.exploration.front(table, goals)
    pilot = {name: column[: min(space.pilot, PILOT)] for name, column in table.items()}
    indices = characterization.sensitivity.sensitivity(pilot, space.names, goals)
    if designs.suffix:
        files.tables.write_table(designs, table, about)
    beaten_by_none = {n: c[best] for n, c in table.items()}
    if certify:
        beaten_by_none["proof_margin"] = proof_margins(space, beaten_by_none, certify)
    files.tables.write_table(front_table, beaten_by_none, about)
    report(table, best, goals, indices, seconds)
    drawing = pictures.exploration.front_picture(table, best, goals, indices, own_measures(space))
    if drawing is None:
        leave_out_picture(picture, "it takes two designs that have all objectives")
    else:
        pictures.style.save(drawing, picture)
    return best


def proof_margins(space: Space, table: dict[str, Any], work: int) -> Floats:
    """(n,) the margin of each design's proof that readings determine states; NaN without one."""
    import numpy as np

    designs = np.stack([table[name] for name in space.names], axis=1)
    margins = [
        proof.designs.proof_margin(
            design.variables.sensor_of(space.sensor, space.names, x), space.rules, work
        )
        for x in designs
    ]
    proved = int(np.isfinite(margins).sum())
    typer.echo(f"of the front's {len(margins)} designs, {proved} are proved: readings determine"
               " states within the ranges of their axes and with the least light of the rules of"
               " `range` on each detector (proof_margin)")  # fmt: skip
    return np.array(margins)


def follow_front(
    space: Space, folder: Path, points: int, about: dict[str, str], plot: PlotKind
) -> tuple[dict[str, Any], list[Path]]:
    """The front by continuation, and the files of its table and picture; exit status 1 where there
    is none."""

    paths = [folder / "pareto.csv", folder / f"pareto.{plot.value}"]
    files.tables.refuse_to_overwrite(paths, force=True)
    start = time.perf_counter()
    made: list[design.front.Front] = []
    show_progress(
        lambda tell: made.append(design.front.pareto_front(space, points, space.seed, tell)),
        "following the front",
    )
    found, seconds = made[0], time.perf_counter() - start
    if not len(found.designs):
        typer.echo("no design keeps all that is asked for, as far as the search can tell")
        raise typer.Exit(FINDING)
    table = design.front.columns(found)
    files.tables.write_table(paths[0], table, about)
    cloud = older_designs(space, folder)
    report_front(found, seconds)
    if cloud is not None:
        report_against(
            design.front.compare_with_designs(found, cloud),
            len(cloud["design"]),
            space.objectives[0],
        )
    pictures.style.save(
        pictures.exploration.pareto_picture(
            table, list(space.objectives), cloud, own_measures(space)
        ),
        paths[1],
    )
    return table, paths


def own_measures(space: Space) -> dict[str, float]:
    """The sensor as it is, by the measures of designs, and said in one line."""
    _, values, why = design.gallery.own_design(space)
    own = dict(zip(design.exploration.MEASURES, values.tolist(), strict=True))
    shown = ", ".join(f"{name} {own[name]:.4g}" for name in space.objectives)
    typer.echo(f"as it is: {why or shown}")
    return own


def require_page(report: Path | None, force: bool) -> None:
    """Refuses what cannot be written before anything is computed."""
    if report is None:
        return
    if report.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{report}: a page's name ends in .html")
    files.tables.refuse_to_overwrite([report], force)
    pictures.exploration_page.plotly_text()


def write_page(
    settings: Config,
    space: Space,
    front: dict[str, Any],
    others: dict[str, Any] | None,
    path: Path,
) -> None:
    """The page of the front's designs, and of some others."""
    table, sensors = design.gallery.gallery(space, front, others)
    count = int((table["kind"] == "front").sum())
    some = f"Shown are {count} of the {len(front[space.names[0]])} designs on the front"
    if others is not None:
        shown = int((table["kind"] == "other").sum())
        some += f", and {shown} others of {len(others['design'])} designs that were drawn"
    goals = list(space.objectives)
    with files.tables.Whole(path) as temporary:
        texts = design.gallery.texts_of(settings, sensors, path.parent)
        text = pictures.exploration_page.page(
            settings.name, space.names, goals, table, sensors, texts, f"{some}."
        )
        temporary.write_text(text, "utf-8")


def write_pick(
    settings: Config,
    space: Space,
    source: Path | None,
    front: bool,
    number: int,
    output: Path | None,
    force: bool,
) -> None:
    """One design of an earlier run, as a configuration that extends the one it is made from."""
    path = output or Path(f"{settings.name}-{number}.yaml")
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"{path}: a configuration's name ends in .yaml")
    files.tables.refuse_to_overwrite([path], force)
    file = output_folder(source, settings.name, "explore") / (
        "pareto.csv" if front else "front.csv"
    )
    x = makeable(space, chosen_design(settings, space, file, front, number))
    sensor = design.variables.sensor_of(space.sensor, space.names, x)
    about = files.provenance.provenance_header(settings) | {"design": f"{number} of {file.name}"}
    with files.tables.Whole(path) as temporary:
        temporary.write_text(
            design.changes.as_extension(settings, sensor, path.parent, about), "utf-8"
        )
    for key, before, after in design.changes.changes_of(settings, sensor):
        typer.echo(f"  {key:<24} {before} -> {after}")
    typer.echo(f"{path}: design {number} of {file}")


def makeable(space: Space, x: Floats) -> Floats:
    """The design in numbers that can be made, where it is still one, with what that costs."""
    made = design.gallery.round_to_steps(space, x)
    (_, exact), (why, values) = (
        design.exploration.measure_design(space, x),
        design.exploration.measure_design(space, made),
    )
    if why:
        typer.echo(
            f"The design was not rounded to manufacturable values: {design.survey.SKIPPED[why]}"
        )
        return x
    for name in space.objectives:
        place = design.exploration.MEASURES.index(name)
        typer.echo(f"{name}: {exact[place]:.4g} as found, {values[place]:.4g} rounded")
    return made


def chosen_design(settings: Config, space: Space, file: Path, front: bool, number: int) -> Floats:
    """The variables of one design of a table that an earlier run of the configuration wrote."""
    import numpy as np

    if not file.is_file():
        raise InputError(f"{file}: no such file; run `facets explore` first, or name its folder "
                         "by --folder")  # fmt: skip
    remedy = f"name the configuration that it was made from, or explore {settings.name} first"
    files.provenance.require_origin(file, files.tables.read_head(file), settings, remedy)
    key, names = "point" if front else "design", space.names
    chunks = [chunk.columns for chunk in files.tables.read_chunks(file, [key, *names])]
    table = {name: np.concatenate([chunk[name] for chunk in chunks]) for name in (key, *names)}
    rows = np.flatnonzero(table[key] == number)
    if not len(rows):
        some = ", ".join(f"{n:.0f}" for n in table[key][:8])
        raise InputError(f"{file}: has no {key} {number}; it has {some} and so on")
    return np.array([table[name][rows[0]] for name in names])


def older_designs(space: Space, folder: Path) -> dict[str, Any] | None:
    """The designs that an earlier run of the same configuration has left in a folder."""
    if not design.exploration.parts_in(folder):
        return None
    table = design.exploration.collect(folder)
    names = [*space.names, *space.objectives]
    return table if all(name in table for name in names) else None


def report_front(found: Any, seconds: float) -> None:

    first = found.objectives[found.walk.first]
    others = [name for name in found.objectives if name != first]
    headings = [*found.walk.trade.problem.names, first, *others,
                *(f"{first} per {name}" for name in others), "held back most by"]  # fmt: skip
    rows = []
    count = len(found.designs)
    for n in sorted({round(k * (count - 1) / 10) for k in range(11)}):
        measures = [
            found.measures[n][design.exploration.MEASURES.index(name)] for name in (first, *others)
        ]
        prices = [found.prices[n][found.objectives.index(name)] for name in others]
        holds = next(
            (group for group in found.active[n] if not design.front.is_objective(group)), ""
        )
        rows.append([*(f"{value:.4g}" for value in (*found.designs[n], *measures)),
                     *(f"{price:.3g}" for price in prices), holds])  # fmt: skip
    show_table(f"{count} points on the front, {seconds:.1f} s; some of them", headings, rows,
               left=(len(headings) - 1,))  # fmt: skip
    if found.left_out:
        typer.echo(
            f"{found.left_out} more are left out: measured again, they are not what was found"
        )


def report_against(found: Any, count: int, first: str) -> None:
    import numpy as np

    who = "none of them beats" if not found.beaten else f"they beat {found.beaten} points of"
    typer.echo(f"beside the {count} designs in the folder: {who} the front")
    if len(found.gains):
        typer.echo(
            f"  at what the best {len(found.gains)} of these have in all else, the front's {first} "
            f"is better by {np.median(found.gains):.2g} % (median; {found.gains.min():.2g} to "
            f"{found.gains.max():.2g} %)"
        )


def report(
    table: dict[str, Any],
    best: Booleans,
    goals: list[str],
    indices: dict[str, dict[str, Index]],
    seconds: float,
) -> None:
    import numpy as np

    skipped, spent = table["skipped"], table["seconds"]
    typer.echo(f"{len(skipped)} designs, {seconds:.1f} s in this run")
    full = np.median(spent[skipped == ""]) if (skipped == "").any() else np.nan
    for reason in np.unique(skipped):
        each = spent[skipped == reason]
        saved = f", {full * len(each) - each.sum():.0f} core seconds saved" if reason else ""
        told = f"{1e3 * np.median(each):.2f} ms each{saved}"
        typer.echo(f"  {len(each):7} {reason or 'looked at'} ({told})")
    typer.echo(f"{int(best.sum())} are beaten by none in {', '.join(goals)}")
    for name, found in indices.items():
        shown = ", ".join(f"{key} {s.value:.2f} +- {s.half:.2f}" for key, s in found.items())
        typer.echo(f"  {name} follows: {shown}")
