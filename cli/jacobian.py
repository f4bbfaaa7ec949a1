"""`facets jacobian`: is the sensor invertible? Sampled as in Fig. 4, searched, and proved."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from facets import characterization, files, pictures
from facets.core.errors import InputError
from facets.core.names import STATE_COLUMNS, STATE_UNITS
from facets.files.whole import free_space

from .certificates import claim_for, prove, reach_file
from .console import FINDING, leave_out_picture, load_config, name_files
from .options import (
    Certify,
    ConfigName,
    Force,
    Look,
    Plot,
    PlotKind,
    Style,
    TableKind,
    folder_option,
    output_folder,
    seed_option,
)

if TYPE_CHECKING:
    from facets.characterization.ambiguity import AmbiguousPair
    from facets.characterization.singularity import Survey, Worst
    from facets.characterization.state_box import StateBox
    from facets.config import Config
    from facets.core.units import Floats


States = Annotated[int, typer.Option(min=1, help="Number of states to sample.")]
Uniform = Annotated[
    bool,
    typer.Option(
        "--uniform",
        help="Sample independent uniform random states. By default the states are a Sobol' "
        "sequence, which fills the box evenly.",
    ),
]
Box = Annotated[
    str | None,
    typer.Option(
        metavar="NAME=HALF|LOW:HIGH,...",
        help="Box of states, such as tx_mm=5,yaw_mrad=-10:20,offset_x_mm=0.1 (mm and mrad); axes "
        "left out stay at zero.  [default: the range of each axis, by the block `range`]",
    ),
]
LeftOut = Annotated[
    str,
    typer.Option(
        metavar="READING",
        help="Reading to leave out of the determinant of Eq. (11), which takes eight of the nine.",
    ),
]
SearchWorst = Annotated[
    bool,
    typer.Option(
        "--search-worst/--no-search-worst",
        help="Also search for the state with the smallest singular value.",
    ),
]
Reach = Annotated[
    bool,
    typer.Option(
        "--reach",
        help="Also find the largest scaling of the box for which the proof succeeds.",
    ),
]
Deviations = Annotated[
    float | None,
    typer.Option(
        min=0,
        help="Prove it for every sensor whose parameters lie within this many standard "
        "uncertainties of the calibrated values, or of the nominal values by `calibrate.before`.  "
        "[default: the sensor exactly as configured]",
    ),
]
Limit = Annotated[float, typer.Option(min=1, help="Stop the proof after this many seconds.")]
Threads = Annotated[
    int, typer.Option(min=0, help="Number of processor cores to use; 0 uses all cores.")
]
StateTable = Annotated[
    TableKind | None,
    typer.Option(
        "--state-table",
        help="Also write all sampled states as a table in this format.  [default: no table]",
    ),
]


@dataclass(frozen=True)
class Asked:
    """What is asked for: the draw, the box of states, and where the results go."""

    settings: Config
    domain: StateBox
    least_share: float | None
    states: int
    sampling: Literal["sobol", "uniform"]
    seed: int
    left_out: str
    threads: int
    folder: Path
    picture: Path
    table: Path | None
    start: float

    @property
    def density(self) -> Path:
        return self.folder / "density.csv"

    @property
    def record(self) -> Path:
        return self.folder / "run.yaml"

    @property
    def certificate(self) -> Path:
        return self.folder / "certificate.json"

    def files(self, certify: bool, reach: bool) -> list[Path]:
        paths = [self.picture, self.density, self.record]
        if self.table is not None:
            paths.append(self.table)
        paths += [self.certificate] * certify
        return [*paths, reach_file(self.certificate)] if certify and reach else paths


def jacobian(
    config: ConfigName,
    folder: Annotated[Path | None, folder_option("results/CONFIG-jacobian")] = None,
    force: Force = False,
    states: States = 200_000,
    uniform: Uniform = False,
    seed: Annotated[int, seed_option()] = 1,
    box: Box = None,
    left_out: LeftOut = "power_c",
    search_worst: SearchWorst = True,
    certify: Certify = 0,
    reach: Reach = False,
    tolerances: Deviations = None,
    limit: Limit = 300.0,
    threads: Threads = 1,
    state_table: StateTable = None,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
) -> None:
    """Check whether the readings determine the pose, over a box of states.

    Samples states and evaluates the determinant of the Jacobian without one reading (Eq. (11) and
    Fig. 4 of the paper) and its smallest singular value, in standard deviations of readings per
    µm or µrad. With --certify, proves with interval arithmetic that no state of the box is singular
    and that no two states have the same readings, and writes a certificate; exit status 1 if this
    is not proved. Without --box the box holds the whole range, if that can be proved.
    """

    settings = load_config(config)
    place = output_folder(folder, settings.name, "jacobian")
    sampling: Literal["sobol", "uniform"] = "uniform" if uniform else "sobol"
    asked = Asked(
        settings, *where(settings, box), states, sampling, seed, left_out, threads, place,
        place / f"jacobian.{plot.value}",
        place / f"states.{state_table.value}" if state_table else None, time.perf_counter(),
    )  # fmt: skip
    with files.tables.ResultSet():
        found, worst, pair = survey_box(asked, asked.files(certify > 0, reach), force, search_worst)
        results = write(asked, found, pair)
        if certify:
            results |= certify_and_report(asked, certify, limit, reach, tolerances, worst)
        write_record(asked, results, asked.files(certify > 0, reach))
    name_files(place, [file for file in asked.files(certify > 0, reach) if file.exists()])
    if certify and not results["unique"]:
        raise typer.Exit(FINDING)


def survey_box(
    asked: Asked, paths: list[Path], force: bool, search: bool
) -> tuple[Survey, Worst | None, AmbiguousPair | None]:
    """Draws, measures and reports; then the worst by a search, and two states of like readings."""

    files.tables.refuse_to_overwrite(paths, force)
    refuse_too_many(asked)
    found = measure(asked)
    report(asked, found)
    if not search:
        return found, None, None
    worst = search_worst(asked, found)
    alike = found.one_sign_where_lit
    pair = (
        None
        if alike
        else characterization.ambiguity.find_ambiguous_pair(asked.settings.sensor, worst.state)
    )
    show_pair(pair)
    return found, worst, pair


#: A draw that takes longer than this, s, is announced.
LONG = 10.0


def refuse_too_many(asked: Asked) -> None:
    """Says how long many states take; raises `InputError` where they can not be done."""

    if asked.states <= characterization.singularity.CHUNK:
        return
    seconds, memory, size = characterization.singularity.cost(
        asked.settings.sensor, asked.domain, asked.states, asked.left_out
    )
    about = f"about {duration(seconds)} on one core and {memory / 1e6:.0f} MB of memory"
    about += f", and {size / 1e9:.3g} GB as a table" * (asked.table is not None)
    if asked.states > characterization.singularity.MOST_STATES:
        most = characterization.singularity.MOST_STATES
        asks = f"--states is {asked.states:,}; allowed: up to {most:,}"
        raise InputError(f"{asks}; these would take {about}")
    if asked.table and size > free_space(asked.table):
        raise InputError(f"{asked.table}: the disk has no place for it: {about}")
    if seconds > LONG:
        typer.echo(f"{asked.states:,} states take {about}", err=True)


def duration(seconds: float) -> str:
    """In the unit that suits: "2.5 h"."""
    for unit, size in (("days", 86_400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.2g} s"


def measure(asked: Asked) -> Survey:
    """Draws and measures, chunk by chunk, with a progress bar; writes all states if asked for."""
    from rich.console import Console
    from rich.progress import track

    drawn = characterization.singularity.samples(
        asked.domain, asked.states, asked.sampling, asked.seed
    )
    chunks = track(
        drawn,
        "measuring",
        total=-(-asked.states // characterization.singularity.CHUNK),
        console=Console(stderr=True),
        transient=True,
        disable=asked.states <= 10 * characterization.singularity.CHUNK,
    )
    sensor = asked.settings.sensor
    with ExitStack() as stack:
        keep = keeper(asked, stack)
        return characterization.singularity.survey(
            sensor, iter(chunks), asked.left_out, True, asked.threads, keep
        )


def keeper(asked: Asked, stack: ExitStack) -> Callable[[Floats, Floats], None] | None:
    """What writes each chunk of states into the table, where one is asked for."""

    if asked.table is None:
        return None
    temporary = stack.enter_context(files.tables.Whole(asked.table))
    writer = files.tables.Writer(temporary, files.provenance.about(asked.settings, asked.seed))
    stack.callback(writer.close)
    return lambda states, values: writer.write(
        characterization.tables.state_columns(states, values)
    )


def write(asked: Asked, found: Survey, pair: AmbiguousPair | None) -> dict[str, Any]:
    """Table and picture; what the record says of them."""

    about = files.provenance.about(asked.settings, asked.seed)
    files.tables.write_table(asked.density, characterization.tables.density_columns(found), about)
    if found.states - found.dark > 1:
        pictures.style.save(
            pictures.singularity.survey_picture(found, asked.left_out, pair), asked.picture
        )
    else:
        leave_out_picture(asked.picture, "it takes two states with light or more")
    return {"states": found.states, "one_sign": found.one_sign}


def write_record(asked: Asked, results: dict[str, Any], paths: list[Path]) -> None:

    seconds = time.perf_counter() - asked.start
    files.provenance.write_record(asked.record, asked.settings, asked.seed, seconds, results, paths)


def where(settings: Config, box: str | None) -> tuple[StateBox, float | None]:
    """The box, and the least share of light for a proof: by the config's rules, or by the box."""

    if box is not None:
        return characterization.state_box.parse_box(box), None
    sensor, rules = settings.sensor, settings.range
    return characterization.state_box.range_box(
        sensor, rules
    ), characterization.state_box.least_share(sensor, rules)


def report(asked: Asked, found: Survey) -> None:

    settings, domain, left_out = asked.settings, asked.domain, asked.left_out
    seconds = time.perf_counter() - asked.start
    typer.echo(f"{settings.name}: {found.states} states, {seconds:.2f} s, of the box")
    for name, unit, low, high in zip(
        characterization.state_box.COLUMNS,
        characterization.state_box.UNITS,
        domain.low,
        domain.high,
        strict=True,
    ):
        typer.echo(f"  {name:<12} {low / unit:10.4g} to {high / unit:.4g}")
    below, zero, above = found.signs
    typer.echo(
        f"determinant without {left_out}: {above} above zero, {below} below"
        + (f", {zero} zero" if zero else "")
        + (f"; {found.dark} states leave a detector without a reading" if found.dark else "")
    )
    typer.echo(f"  from {found.low[0]:.4g} to {found.high[0]:.4g} (mm, mW, rad)")
    typer.echo(
        "  with psi to the side y = z x x of detectors whose x points outward; the paper draws it\n"
        "  negative, as it is with psi mirrored"
    )
    typer.echo(
        f"smallest singular value: {found.low[1]:.4g} to {found.high[1]:.4g} standard deviations\n"
        f"  per µm or µrad; condition number {found.low[2]:.4g} to {found.high[2]:.4g}"
    )
    tell("weakest drawn", settings, found.weakest)


def tell(title: str, settings: Config, worst: Worst) -> None:

    place = ", ".join(
        f"{name} {value / unit:.4g}"
        for name, value, unit in zip(STATE_COLUMNS, worst.state, STATE_UNITS, strict=True)
    )
    direction = characterization.singularity.in_words(
        characterization.singularity.weakest_direction(settings.sensor, worst.state)
    )
    typer.echo(f"{title}: {worst.values[1]:.4g}, for {direction}\n  at {place}")


def search_worst(asked: Asked, found: Survey) -> Worst:
    """The worst that a search finds, and how near the draw came to it."""

    settings, domain = asked.settings, asked.domain
    lowest = characterization.singularity.search(
        settings.sensor, domain, 0, asked.left_out, asked.seed
    )
    weakest = characterization.singularity.search(
        settings.sensor, domain, 1, asked.left_out, asked.seed
    )
    tell("weakest by search", settings, weakest)
    if found.one_sign:
        typer.echo(
            f"the search finds {lowest.values[0] / found.lowest.values[0]:.3g} times the least "
            f"determinant drawn, {weakest.values[1] / found.weakest.values[1]:.3g} times the least "
            "singular value"
        )
    elif not found.one_sign_where_lit:
        typer.echo("the determinant has both signs in the box: between them it is zero")
    else:
        typer.echo(
            f"no word on the whole box: {100 * found.dark / found.states:.3g} % of its states "
            "leave a detector without a reading"
        )
    return weakest


def show_pair(pair: AmbiguousPair | None) -> None:

    if pair is None:
        return
    typer.echo("two states with the same readings:")
    for name, unit, one, other in zip(
        STATE_COLUMNS, STATE_UNITS, pair.one, pair.other, strict=True
    ):
        typer.echo(f"  {name:<10} {one / unit:12.6g} {other / unit:12.6g}")


def certify_and_report(
    asked: Asked,
    work: int,
    limit: float,
    reach: bool,
    tolerances: float | None,
    worst: Worst | None,
) -> dict[str, Any]:
    """Proves and writes the certificate; what the record says of it."""

    weakest = None if worst is None else worst.state
    claim = claim_for(asked.settings, asked.domain, asked.least_share, tolerances, weakest)
    about = files.provenance.about(asked.settings, asked.seed)
    return prove(claim, work, limit, reach, asked.certificate, about)
