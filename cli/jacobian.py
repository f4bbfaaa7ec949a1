"""`facets jacobian`: is the sensor invertible? Sampled as in Fig. 4, searched, and proved."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .simulate import PlotKind, TableKind

if TYPE_CHECKING:
    from facets.characterization.singularity import Survey, Worst
    from facets.characterization.state_box import Domain
    from facets.config import Config
    from facets.proof.uniqueness import Certificate


class Sampling(StrEnum):
    sobol = "sobol"
    uniform = "uniform"


def jacobian(
    config: Annotated[str, typer.Argument(help="Name of a shipped config, or a YAML file.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="Folder for the results.  [default: results/CONFIG-jacobian]"
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace older results.")] = False,
    states: Annotated[int, typer.Option(min=1, help="How many to draw.")] = 200_000,
    sampling: Annotated[Sampling, typer.Option(help="How they are drawn.")] = Sampling.sobol,
    seed: Annotated[int, typer.Option(min=0, help="Of the draw and of the search.")] = 1,
    box: Annotated[
        str | None,
        typer.Option(
            help="Where, as tx_mm=5,yaw_mrad=-10:20,offset_x_mm=0.1; axes left out stay at zero.  "
            "[default: the ranges of the axes by the config's `range`]"
        ),
    ] = None,
    left_out: Annotated[
        str, typer.Option(help="The reading that the determinant lacks.")
    ] = "power_c",
    search: Annotated[
        bool, typer.Option("--search/--no-search", help="Look for the worst state, besides.")
    ] = True,
    certify: Annotated[
        bool, typer.Option("--certify", help="Prove it, by intervals, over the whole box.")
    ] = False,
    reach: Annotated[
        bool, typer.Option("--reach", help="And how much larger a box can be for the proof.")
    ] = False,
    limit: Annotated[float, typer.Option(min=1, help="Seconds for a proof.")] = 300.0,
    threads: Annotated[int, typer.Option(min=0, help="0: all cores.")] = 1,
    table: Annotated[
        TableKind | None, typer.Option(help="Also write all states, as this kind of table.")
    ] = None,
    plot: Annotated[PlotKind, typer.Option(help="Kind of the picture.")] = PlotKind.png,
) -> None:
    """Tell whether readings determine states, over a box of states.

    Draws states and looks at the sign of the determinant of Eq. (11), as Fig. 4 of the paper, and
    at the smallest singular value, which has a meaning. With --certify, proves by intervals that no
    state of the box is singular and that no two have the same readings, and writes a certificate.
    """
    import time

    from facets import load
    from facets.characterization.ambiguity import twins
    from facets.files import provenance, tables
    from facets.pictures import style
    from facets.pictures.singularity import survey_picture

    settings = load(config)
    folder = output or Path("results") / f"{settings.name}-jacobian"
    picture, density, story = (
        folder / f"jacobian.{plot.value}",
        folder / "density.csv",
        folder / "run.yaml",
    )
    proof = folder / "certificate.json"
    everything = folder / f"states.{table.value}" if table else None
    files = [picture, density, story, *([everything] if everything else [])]
    tables.refuse_to_overwrite([*files, *([proof] if certify else [])], force)
    domain, share = where(settings, box)
    start = time.perf_counter()
    about = provenance.about(settings, seed)
    found = surveyed(settings, domain, states, sampling, seed, left_out, threads, everything, about)
    report(settings, domain, found, time.perf_counter() - start, left_out)
    pair = None
    if search:
        worst = searched(settings, domain, found, left_out, seed)
        pair = None if found.one_sign else twins(settings.sensor, worst.state)
        show_pair(pair)
    tables.write_table(density, density_columns(found), about)
    style.save(survey_picture(found, left_out, pair), picture)
    results: dict[str, Any] = {"states": found.states, "one_sign": found.one_sign}
    if certify:
        results |= proved(settings, domain, share, limit, reach, proof, about)
        files.append(proof)
    provenance.write_record(story, settings, seed, time.perf_counter() - start, results)
    typer.echo(f"{folder}/: {', '.join(file.name for file in files)}")
    if certify and not results["unique"]:
        raise typer.Exit(1)


def where(settings: Config, box: str | None) -> tuple[Domain, float | None]:
    """The box, and the least share of light for a proof: by the config's rules, or by the box."""
    from facets.characterization.state_box import domain_of, least_share, range_domain

    if box is not None:
        return domain_of(box), None
    sensor, rules = settings.sensor, settings.range
    return range_domain(sensor, rules), least_share(sensor, rules)


def surveyed(
    settings: Config,
    domain: Domain,
    states: int,
    sampling: Sampling,
    seed: int,
    left_out: str,
    threads: int,
    everything: Path | None,
    about: dict[str, str],
) -> Survey:
    """Draws and measures, chunk by chunk, with a progress bar; writes all states if asked for."""
    from contextlib import ExitStack

    from rich.console import Console
    from rich.progress import track

    from facets.characterization.singularity import CHUNK, samples, survey
    from facets.files import tables

    chunks = track(
        samples(domain, states, sampling.value, seed),
        "measuring",
        total=-(-states // CHUNK),
        console=Console(stderr=True),
        transient=True,
        disable=states <= 10 * CHUNK,
    )
    with ExitStack() as stack:
        writer = None
        if everything:
            writer = tables.Writer(stack.enter_context(tables.Whole(everything)), about)
            stack.callback(writer.close)

        def keep(drawn: Any, values: Any) -> None:
            if writer is not None:
                writer.write(state_columns(drawn, values))

        return survey(settings.sensor, iter(chunks), left_out, True, threads, keep)


def state_columns(states: Any, values: Any) -> dict[str, Any]:
    from facets.characterization.state_box import apex_offset
    from facets.core.names import STATE_COLUMNS, STATE_UNITS

    columns = {name: states[:, i] / STATE_UNITS[i] for i, name in enumerate(STATE_COLUMNS)}
    names = ("determinant", "smallest_singular_value", "condition_number")
    columns["apex_offset_mm"] = apex_offset(states)
    return columns | {name: values[:, i] for i, name in enumerate(names)}


def density_columns(found: Survey) -> dict[str, Any]:
    """Classes of apex offset and determinant that hold states."""
    import numpy as np

    offsets, levels = found.edges[0], found.edges[1]
    i, j = np.nonzero(found.counts)
    return {
        "apex_offset_from_mm": offsets[i],
        "apex_offset_to_mm": offsets[i + 1],
        "determinant_from": levels[j],
        "determinant_to": levels[j + 1],
        "states": found.counts[i, j].astype(int),
    }


def report(settings: Config, domain: Domain, found: Survey, seconds: float, left_out: str) -> None:
    from facets.characterization.state_box import COLUMNS, UNITS

    typer.echo(f"{settings.name}: {found.states} states, {seconds:.2f} s, of the box")
    for name, unit, low, high in zip(COLUMNS, UNITS, domain.low, domain.high, strict=True):
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
        f"  per um or urad; condition number {found.low[2]:.4g} to {found.high[2]:.4g}"
    )
    tell("weakest drawn", settings, found.weakest)


def tell(title: str, settings: Config, worst: Worst) -> None:
    from facets.characterization.singularity import in_words, weakest_direction
    from facets.core.names import STATE_COLUMNS, STATE_UNITS

    place = ", ".join(
        f"{name} {value / unit:.4g}"
        for name, value, unit in zip(STATE_COLUMNS, worst.state, STATE_UNITS, strict=True)
    )
    direction = in_words(weakest_direction(settings.sensor, worst.state))
    typer.echo(f"{title}: {worst.values[1]:.4g}, for {direction}\n  at {place}")


def searched(settings: Config, domain: Domain, found: Survey, left_out: str, seed: int) -> Worst:
    """The worst that a search finds, and how near the draw came to it."""
    from facets.characterization.singularity import search

    lowest = search(settings.sensor, domain, 0, left_out, seed)
    weakest = search(settings.sensor, domain, 1, left_out, seed)
    tell("weakest by search", settings, weakest)
    if found.one_sign:
        typer.echo(
            f"the search finds {lowest.values[0] / found.lowest.values[0]:.3g} times the least "
            f"determinant drawn, {weakest.values[1] / found.weakest.values[1]:.3g} times the least "
            "singular value"
        )
    else:
        typer.echo("the determinant has both signs in the box: between them it is zero")
    return weakest


def show_pair(pair: Any) -> None:
    from facets.core.names import STATE_COLUMNS, STATE_UNITS

    if pair is None:
        return
    typer.echo("two states with the same readings:")
    for name, unit, one, other in zip(
        STATE_COLUMNS, STATE_UNITS, pair.one, pair.other, strict=True
    ):
        typer.echo(f"  {name:<10} {one / unit:12.6g} {other / unit:12.6g}")


def proved(
    settings: Config,
    domain: Domain,
    share: float | None,
    limit: float,
    reach: bool,
    file: Path,
    about: dict[str, str],
) -> dict[str, Any]:
    from rich.console import Console
    from rich.progress import Progress

    from facets.proof.certificate import write_certificate
    from facets.proof.uniqueness import certify, reach_of

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("proving", total=1.0)
        found = certify(
            settings.sensor, domain, share, limit, lambda d: progress.update(task, completed=d)
        )
    write_certificate(file, settings.sensor, found, about)
    for line in verdict(settings, found):
        typer.echo(line)
    results = {"regular": found.regular, "unique": found.unique, "margin": found.margin}
    if reach and found.unique:
        factor = reach_of(settings.sensor, domain, found.share, limit)
        typer.echo(f"the proof holds for a box of poses up to {factor:.3g} times as large")
        results["reach"] = factor
    return results


def verdict(settings: Config, found: Certificate) -> list[str]:
    power = 1000 * found.share * settings.sensor.beam.power
    lines = [
        f"taken: every state with its pose in the box and at least {power:.4g} uW on each detector"
        f" ({len(found.pieces)} pieces proved, {found.seconds:.1f} s)"
    ]
    if found.regular:
        lines.append(f"proved: none is singular; |determinant| is at least {found.at_least:.3g}")
    if found.unique:
        lines.append("proved: no two of them have the same readings")
    elif found.regular:
        lines.append("not proved: that no two of them have the same readings")
    else:
        lines.append(f"not proved: {found.reason or 'some pieces were not done in time'}")
        lines += [f"  not proved in {piece_text(piece)}" for piece in found.doubtful[:3]]
    return lines


def piece_text(piece: Any) -> str:
    from facets.characterization.state_box import COLUMNS, UNITS

    return ", ".join(
        f"{name} {low / unit:.4g} to {high / unit:.4g}"
        for name, unit, low, high in zip(COLUMNS, UNITS, piece.low, piece.high, strict=False)
    )
