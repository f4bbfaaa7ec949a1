"""Views of a run: a screen for a terminal, lines of text or JSON, and the summary at the end."""

from __future__ import annotations

import json
import os
from itertools import chain, product
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.hues import DARK, LIGHT, Hues
from ...core.names import ANGLES, DETECTORS, STATE, STATE_COLUMNS
from ...core.plain_numbers import short_number, times_text
from ...core.units import round_to
from ...detectors.counts import SATURATED
from ...detectors.noise import least_light
from ...estimation.solution import LABELS, Status
from ...tracking.control import tracking_error
from .live import Live
from .loop import CLOCK_MOVED
from .pipeline import FLAGS, Pipeline, RunPoses

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import Console, ConsoleOptions

#: A count or another value, with its unit.
Item = dict[str, Any]


def item(name: str, value: Any, unit: str = "", why: str = "", bad: bool = False) -> Item:
    """why: the reason where the value is None.  bad: whether a person should look at it."""
    if isinstance(value, float):
        value = round_digits(value)
    return {"name": name, "value": value, "unit": unit, "why": why if value is None else "",
            "bad": bad}  # fmt: skip


def values(live: Live) -> dict[str, Any]:
    """Return the newest sample and the counts so far, in the units of a display."""
    sequence, tally, parser = live.pipeline.sequence, live.pipeline.tally, live.pipeline.parser
    entries: dict[str, Any] = {
        "seconds": round(live.duration, 3),
        "samples": tally.samples,
        "rate_hz": round(tally.samples / live.duration, 1),
        "lost": sequence.lost,
        "loss": round(live.loss, 6),
        "silent_s": round(live.silence, 3),
        "corrupt": parser.corrupt,
        "skipped_bytes": parser.skipped,
        "doubled": sequence.doubled,
        "restarts": sequence.restarts,
        "reconnects": live.reconnects,
        "unsolved": tally.unsolved_count,
        "late": live.late,
        "skipped": tally.skipped_count,
        "misfit": tally.misfit.flagged,
        "flags": {name: count for name, count in tally.flags.items() if count},
        "latency_p99_ms": round_digits(1e3 * live.latency_p99()),
        "backlog": live.backlog,
        "behind_s": round(live.age, 3) if live.behind else 0.0,
        "clock_ppm": round_digits(live.pipeline.host_time.ppm),
        "u_time_us": round_digits(1e6 * live.pipeline.host_time.uncertainty),
        "note": "; ".join(live.messages()),
    }
    if live.pipeline.board.came:
        entries["board"] = live.pipeline.board.values()
    entries |= live.values()
    if live.current is not None:
        entries |= sample(live.current)
    if live.tracker:
        entries |= {
            "stage_mm": [round_digits(x) for x in live.tracker.encoder.place],
            "stage": live.tracker.state,
            "moves": live.tracker.moves,
            "bridged_gaps": live.tracker.bridges,
            "stops": live.tracker.envelope.stops,
            "beam_lost": round_digits(live.beam_loss.share),
        }
    return entries


def sample(poses: RunPoses) -> dict[str, Any]:
    """Return the newest of some poses: in mm and mrad, with uncertainties in um and urad."""
    columns, reading = newest_row(poses), poses.readings[-1]
    entries: dict[str, Any] = {"status": LABELS[int(columns["status"])]}
    entries |= {name: round_digits(columns[name]) for name in STATE_COLUMNS}
    for name, value in columns.items():
        if name.startswith("u_") and name not in poses.object:
            fine = name.replace("_mm", "_um").replace("_mrad", "_urad")
            entries[fine] = round_digits(1e3 * value)
    entries |= {name: round_digits(columns[name]) for name in poses.object}
    entries["spots_mm"] = [[round_digits(x) for x in reading[3 * k : 3 * k + 2]] for k in range(3)]
    entries["powers_uw"] = [round_digits(1e3 * power) for power in reading[2::3]]
    entries["tracking_error"] = [round_digits(x) for x in tracking_error(reading[2::3])]
    if poses.channels:
        entries["channels"] = {name: round_digits(columns[name]) for name in poses.channels}
    return entries


def newest_row(poses: RunPoses) -> dict[str, Any]:
    """Return the last sample of some poses with its columns, as a recording has them."""
    return {name: column[-1] for name, column in poses.columns().items()}


def round_digits(value: float) -> float | None:
    """Round to six digits; None for NaN and infinity, which JSON cannot represent."""
    return float(f"{value:.6g}") if np.isfinite(value) else None


def json_line(live: Live) -> str:
    """The state of the run as one line of JSON."""
    return json.dumps(values(live))


def pose_in_words(now: dict[str, Any]) -> str:
    """Return the newest pose of `values`, each number to two digits of its uncertainty, or the
    status of a sample without a pose."""
    if now.get("status") != Status.CONVERGED.label:
        return str(now.get("status", "no pose"))
    parts = []
    for names, unit, fine in ((STATE[:3], "mm", "um"), (ANGLES, "mrad", "urad")):
        for n in names:
            u = 1e-3 * (now[f"u_{n}_{fine}"] or 0.0)
            parts.append(f"{n} {round_to(now[f'{n}_{unit}'], u)}")
        parts.append(f"{unit} ")
    return " ".join(parts).rstrip()


def plain_line(live: Live) -> str:
    """The state of the run as one line of text."""
    now = values(live)
    percent = f" ({100 * now['loss']:.3g} %)" if now["loss"] else ""
    text = f"{now['seconds']:.1f} s  {pose_in_words(now)}  {now['rate_hz']:.0f}/s"
    text += f"  lost {now['lost']}{percent}  corrupt {now['corrupt']}  unsolved {now['unsolved']}"
    if now["late"] or now["skipped"]:
        text += f"  late {now['late']}  skipped {now['skipped']}"
    if now["latency_p99_ms"] is not None:
        text += f"  p99 {now['latency_p99_ms']:.1f} ms"
    if "stage" in now:
        text += f"  stage {now['stage']}"
    if dropped := sum(target["dropped"] for target in now.get("published", ())):
        text += f"  not published {dropped}"
    return text + (f"  [{now['note']}]" if now["note"] else "")


def summary(live: Live) -> Iterator[str]:
    """Yield the sentences at the end of a run."""
    if live.tracker:
        yield live.beam_loss.sentence
    yield plain_line(live)
    yield f"{live.pipeline.tally.samples} samples, {100 * live.loss:.4f} % lost"
    details = (stage_sentences(live), sample_sentences(live), loop_sentences(live))
    for text in chain(*details):
        yield f"  {text}"


def stage_sentences(live: Live) -> Iterator[str]:
    """Yield sentences on how the stage followed, if there is one."""
    if not live.tracker:
        return
    if live.tracker.bridges:
        yield f"{live.tracker.bridges} gaps were bridged by the predicted motion"
    if stops := live.tracker.envelope.stops:
        ended = "is stopped since then" if live.stage_stop else "was resumed after each"
        yield f"the stage was stopped {times_text(stops)}, and {ended}"
    if live.beam_loss.lost and live.latency and not live.is_urgent:  # no bench in the process
        yield (
            "the run had no real-time priority; with it a busy machine loses the beam less often, "
            "see 'With other programs on the machine' in docs/commands/acquire.md"
        )


def sample_sentences(live: Live) -> Iterator[str]:
    """Yield the numbers of samples with each status and flag, and doubts about the poses."""
    tally, full = live.pipeline.tally, FLAGS[SATURATED]
    for words, count in tally.statuses.items():
        if words not in (Status.CONVERGED.label, full) and count:
            yield f"{count} {words}"
    for words, count in tally.flags.items():
        without = f", {tally.statuses[full]} of them without a pose" if words == full else ""
        if count:
            yield f"{count} {words}{without}"
    yield from live.pipeline.measurement.sentences()


def loop_sentences(live: Live) -> Iterator[str]:
    """Yield sentences on the loop, on the board and its clock, and on the sinks."""
    skipped = live.pipeline.tally.skipped_count
    if live.late or skipped:
        yield (
            f"the loop fell behind: {live.late} samples were solved after newer ones, {skipped} "
            "were skipped; `facets replay` solves them"
        )
    if live.pipeline.board.came:
        yield live.pipeline.board.sentence()
    yield from clock_sentences(live)
    if without := live.time_without_samples:
        yield f"no sample came for {without:.1f} s of the {live.now - live.begin:.1f} s"
    for sink in live.sinks:
        yield from sink.sentences()
    yield from live.pipeline.sequence.sentences()


def clock_sentences(live: Live) -> Iterator[str]:
    """Yield the uncertainty of the samples' times, and the drift of the board's clock."""
    clock = live.pipeline.host_time
    if live.pipeline.config.acquire.timing == "envelope" and np.isfinite(clock.uncertainty):
        yield (
            f"the newest samples' times are known to {short_number(1e6 * clock.uncertainty, 2)} µs "
            f"(1 sigma), earlier ones to {short_number(1e6 * clock.worst, 2)} µs, in addition to "
            "the error of acquire.least_delay_ms"
        )
    if (moves := clock.moves - live.pipeline.sequence.breaks) > 0:
        yield f"{CLOCK_MOVED}, {times_text(moves)}"
    yield from live.pipeline.times.messages
    if clock.is_held and clock.is_known:
        most = 1e6 * (abs(clock.rate) + clock.rate_sigma)
        yield (
            f"by the arrivals, the board's clock may be up to {most:.0f} ppm off, more than a "
            "quartz is; a longer run tells"
        )
    elif np.isfinite(clock.ppm) and not clock.complaint:
        yield (
            f"the board's clock is {abs(clock.ppm):.3g} ppm {'slow' if clock.ppm > 0 else 'fast'}"
            f", +- {1e6 * clock.known[1]:.2g}"
        )


class Screen:
    """The screen that rich renders: pose, spots and powers of the detectors, and counts.

    Detectors and axes have the hues that they have in every picture.
    """

    def __init__(self, live: Live) -> None:
        self.live = live

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Any]:
        now = values(self.live)
        yield pose_table(self.live.current)
        yield detector_table(self.live)
        yield from lower_lines(self.live, now)


def terminal_hues() -> Hues:
    """Return the hues for a dark ground, or a light one by COLORFGBG (such as "0;15")."""
    ground = os.environ.get("COLORFGBG", "").rpartition(";")[2]
    return LIGHT if ground in ("7", "15") else DARK


def pose_table(newest: RunPoses | None) -> Any:
    """Return a table with a line for each component of the mirror's state, of the object's pose and
    of its displacement, each after a bar in the hue of its axis."""
    from rich.table import Table
    from rich.text import Text

    hues, columns = terminal_hues(), {} if newest is None else newest_row(newest)
    table = Table("", "value", "u (1 sigma)", box=None, pad_edge=False)
    of_object = product(("object_", "displacement_"), STATE_COLUMNS[:6])
    for kind, column in (*product([""], STATE_COLUMNS), *of_object):
        if kind and kind + column not in columns:
            continue
        axis, _, unit = column.rpartition("_")
        value, size = (float(columns.get(f"{u}{kind}{column}", "nan")) for u in ("", "u_"))
        table.add_row(
            Text.assemble(("▌", hues.axes[axis]), f"{kind}{axis}".replace("_", " ")),
            f"{value:+.5f} {unit}" if np.isfinite(value) else "-",
            f"{1e3 * size:.3g} µ{unit[1:]}" if np.isfinite(size) else "-",
        )
    return table


def stream_counts(pipeline: Pipeline) -> list[Item]:
    """Return the numbers of samples, of lost ones and of faults."""
    tally, sequence, parser = pipeline.tally, pipeline.sequence, pipeline.parser
    total = tally.samples + sequence.lost
    percent = f" ({100 * sequence.lost / total:.3g} %)" if sequence.lost else ""
    faults = {
        "frames refused": parser.corrupt,
        "bytes passed over": parser.skipped,
        "without a pose": tally.unsolved_count - tally.skipped_count,
    }
    rare = {**tally.flags, "came twice": sequence.doubled, "restarts": sequence.restarts}
    return [
        item("samples", tally.samples),
        item("lost", f"{sequence.lost}{percent}", bad=sequence.lost > 0),
        *(item(name, count, bad=count > 0) for name, count in faults.items()),
        item("beyond chance", tally.misfit.flagged, bad=tally.misfit.is_mostly_flagged),
        *(item(name, count, bad=True) for name, count in rare.items() if count),
    ]


def run_counts(live: Live) -> list[Item]:
    """Return the counts of the stream and of the loop's backlog."""
    tally = live.pipeline.tally
    skipped = tally.skipped_count
    unknown = "no sample is solved yet, or the source is a file or virtual"
    return [
        item("mean rate", tally.samples / live.duration, "1/s"),
        *stream_counts(live.pipeline),
        item("latency p99", 1e3 * live.latency_p99(), "ms", unknown),
        item("waiting", live.backlog, "samples", bad=live.behind),
        item("solved late", live.late, bad=live.late > 0),
        item("left to a replay", skipped, bad=skipped > 0),
    ]


def lower_lines(live: Live, now: dict[str, Any]) -> Iterator[Any]:
    """Yield the lines below the tables: the counts, with faults highlighted, and messages."""
    from rich.text import Text

    alarm = f"bold {terminal_hues().alarm}"
    words = Text()
    for entry in run_counts(live):
        value = "-" if entry["value"] is None else entry["value"]
        words.append(f"{entry['name']} {value} {entry['unit']}".rstrip(), alarm * entry["bad"])
        words.append("   ")
    yield words
    for line in more(now):
        yield Text(line)
    if now["note"]:
        yield Text(now["note"], alarm)


def detector_table(live: Live) -> Any:
    """Return a table with a line for each detector, in its hue: position and power of the spot."""
    from rich.table import Table
    from rich.text import Text

    table = Table("", "psi", "zeta", "light", box=None, pad_edge=False)
    reading = np.full(9, np.nan) if live.current is None else live.current.readings[-1]
    for k, name in enumerate(DETECTORS):
        places = reading[3 * k : 3 * k + 2].tolist()
        shown = [f"{place:+.4f} mm" if np.isfinite(place) else "-" for place in places]
        title = Text.assemble(("▌", terminal_hues().detectors[name]), name.upper())
        table.add_row(title, *shown, light(live, k, float(reading[3 * k + 2])))
    return table


def light(live: Live, k: int, power: float) -> str:
    """A detector's light in words."""
    if (newest := live.current) is None:
        return "-"
    if np.isnan(power):
        return "full" if newest.flags[-1] & SATURATED else "no light"
    sensor = live.pipeline.config.sensor
    return f"{1e3 * power:.1f} µW" if power > least_light(sensor)[k] else "no light"


def more(now: dict[str, Any]) -> Iterator[str]:
    """Yield lines on channels, stage, board poses and publications, as far as the run has them."""
    if "channels" in now:
        yield "   ".join(
            f"{column} {'-' if value is None else f'{value:.5g}'}"
            for column, value in now["channels"].items()
        )
    if "stage" in now:
        error = now.get("tracking_error") or [None, None]
        shown = ", ".join("-" if x is None else f"{x:+.4f}" for x in error)
        yield (
            f"stage {now['stage_mm']} mm, {now['stage']}, {now['moves']} moves   Eq. (14): {shown}"
        )
    if "board" in now:
        yield (
            f"board: {now['board']['came']} poses of its own, at most "
            f"{now['board']['worst_u']:.2g} u from these"
        )
    for target in now.get("published", ()):
        yield f"{target['address']}: {target['sent']} published, {target['dropped']} dropped"
