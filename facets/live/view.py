"""What a person, a pipe or another program sees of a run."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.names import ANGLES, DETECTORS, STATE
from ..estimation.solver import Status
from ..model.arrays import half_sizes
from ..tracking.control import tracking_error
from .acquire import Live

if TYPE_CHECKING:
    from rich.console import Group

#: A PSD's face in characters: across and down.
WIDE, HIGH = 21, 9


def values(live: Live) -> dict[str, Any]:
    """The newest sample and the counts so far, in the units that people see."""
    passed = max(time.monotonic() - live.begin, 1e-9)
    sequence, tally, parser = live.pipeline.sequence, live.pipeline.tally, live.pipeline.parser
    found: dict[str, Any] = {
        "seconds": round(passed, 3),
        "samples": tally.samples,
        "rate_hz": round(tally.samples / passed, 1),
        "lost": sequence.lost,
        "corrupt": parser.corrupt,
        "skipped_bytes": parser.skipped,
        "doubled": sequence.doubled,
        "restarts": sequence.restarts,
        "reconnects": live.reconnects,
        "unsolved": tally.samples - tally.statuses[Status.CONVERGED.label],
        "flags": {name: count for name, count in tally.flags.items() if count},
        "latency_p99_ms": rounded(1e3 * live.ninety_nine()),
        "backlog": live.backlog,
        "clock_ppm": rounded(live.pipeline.drift.ppm),
        "note": live.note,
    }
    if live.newest is not None:
        found |= sample(live)
    if live.tracker:
        found |= {
            "stage_mm": [rounded(x) for x in live.tracker.encoder.place],
            "stage": live.tracker.stopped or "following",
            "moves": live.tracker.moves,
        }
    return found


def sample(live: Live) -> dict[str, Any]:
    poses = live.newest
    assert poses is not None
    solution, reading = poses.solution, poses.readings[-1]
    state, sigma = solution.state[-1], solution.uncertainty[-1]
    found: dict[str, Any] = {"status": Status(int(solution.status[-1])).label}
    for i, name in enumerate(STATE):
        angle = name in ANGLES
        key = f"{name}_mrad" if angle else f"{name}_mm"
        found[key] = rounded(state[i] * (1e3 if angle else 1))
        fine = "urad" if angle else "um"
        found[f"u_{name}_{fine}"] = rounded(sigma[i] * (1e6 if angle else 1e3))
    found["spots_mm"] = [[rounded(x) for x in reading[3 * k : 3 * k + 2]] for k in range(3)]
    found["powers_uw"] = [rounded(1e3 * power) for power in reading[2::3]]
    found["tracking_error"] = [rounded(x) for x in tracking_error(reading[2::3])]
    return found


def rounded(value: float) -> float | None:
    """Six digits; None for what is no number, which JSON has no word for."""
    return float(f"{value:.6g}") if np.isfinite(value) else None


def json_line(live: Live) -> str:
    return json.dumps(values(live))


def plain_line(live: Live) -> str:
    now = values(live)
    pose = "no pose"
    if now.get("status") == Status.CONVERGED.label:
        places = " ".join(f"{now[f'{n}_mm']:+.4f}" for n in STATE[:3])
        angles = " ".join(f"{now[f'{n}_mrad']:+.4f}" for n in ANGLES)
        pose = f"{places} mm {angles} mrad"
    elif "status" in now:
        pose = now["status"]
    text = f"{now['seconds']:.1f} s  {pose}  {now['rate_hz']:.0f}/s  lost {now['lost']}"
    text += f"  corrupt {now['corrupt']}  unsolved {now['unsolved']}"
    if now["latency_p99_ms"] is not None:
        text += f"  p99 {now['latency_p99_ms']:.1f} ms"
    if "stage" in now:
        text += f"  stage {now['stage']}"
    return text + (f"  [{now['note']}]" if now["note"] else "")


def panel(live: Live) -> Group:
    """Pose, three PSD faces with their spots and powers, and how the stream does."""
    from rich.columns import Columns
    from rich.console import Group
    from rich.table import Table

    now = values(live)
    table = Table(box=None, title_justify="left")
    for heading in ("", "value", "u (1 sigma)"):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    for name in STATE:
        unit, fine = ("mrad", "urad") if name in ANGLES else ("mm", "um")
        value, sigma = now.get(f"{name}_{unit}"), now.get(f"u_{name}_{fine}")
        shown = "-" if value is None else f"{value:+.5f} {unit}"
        table.add_row(name, shown, "-" if sigma is None else f"{sigma:.3g} {fine}")
    return Group(table, Columns([face(live, k) for k in range(3)]), stream(now))


def face(live: Live, k: int) -> Any:
    """One detector: its area with the spot on it, and a bar of its power."""
    from rich.panel import Panel

    rows = [[" "] * WIDE for _ in range(HIGH)]
    rows[HIGH // 2] = ["·"] * WIDE
    for row in rows:
        row[WIDE // 2] = "·"
    power = float("nan")
    if live.newest is not None:
        y, z, power = live.newest.readings[-1, 3 * k : 3 * k + 3]
        half = half_sizes(live.pipeline.config.sensor)[k]
        if np.isfinite([y, z]).all() and abs(y) <= half[0] and abs(z) <= half[1]:
            across = round((y / half[0] + 1) / 2 * (WIDE - 1))
            rows[round((1 - z / half[1]) / 2 * (HIGH - 1))][across] = "●"
    share = power / live.pipeline.config.sensor.beam.power
    bar = "█" * round(WIDE * min(max(share, 0), 1)) if np.isfinite(share) else ""
    text = "\n".join("".join(row) for row in rows) + f"\n{bar:<{WIDE}}"
    title = f"PSD {DETECTORS[k].upper()}  {1e3 * power:.1f} uW"
    return Panel(text, title=title, width=WIDE + 4)


def stream(now: dict[str, Any]) -> str:
    latency = now["latency_p99_ms"]
    text = (
        f"{now['samples']} samples, {now['rate_hz']:.0f}/s   lost {now['lost']}   "
        f"corrupt {now['corrupt']}   unsolved {now['unsolved']}   backlog {now['backlog']}   "
        f"p99 {'-' if latency is None else f'{latency:.1f} ms'}"
    )
    if "stage" in now:
        error = now.get("tracking_error") or [None, None]
        shown = ", ".join("-" if x is None else f"{x:+.4f}" for x in error)
        text += f"\nstage {now['stage_mm']} mm, {now['stage']}, {now['moves']} moves"
        text += f"   Eq. (14): {shown}"
    if now["flags"]:
        text += "\n" + ", ".join(f"{count} {name}" for name, count in now["flags"].items())
    return text + (f"\n{now['note']}" if now["note"] else "")
