"""What a page says of a run beside its samples: counts, rates, the stage, what to doubt.

Each is a name, a value and a unit; a value that is not known is None, with the reason.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...tracking.control import tracking_error
from ..run.view import round_digits

if TYPE_CHECKING:
    from ...tracking.tracker import Tracker
    from ..run.live import Live
    from ..run.pipeline import Pipeline, RunPoses

Item = dict[str, Any]


def item(name: str, value: Any, unit: str = "", why: str = "", bad: bool = False) -> Item:
    """why: the reason where the value is None.  bad: whether a person should look at it."""
    if isinstance(value, float):
        value = round_digits(value)
    return {"name": name, "value": value, "unit": unit, "why": why if value is None else "",
            "bad": bad}  # fmt: skip


def status_of(live: Live) -> dict[str, Any]:
    """Return the status of a run that goes on."""
    passed = max(live.now - live.begin, 1e-9)
    pipeline = live.pipeline
    return {
        "seconds": round(passed, 3),
        "messages": live.messages(),
        "events": events(pipeline) | {"reconnected": live.reconnects},
        "counts": [mean_rate(pipeline, passed), *counts(pipeline), *loop_counts(live)],
        "clock": clock(pipeline),
        "stage": stage(live.tracker, live.current),
        "published": [
            {key: publication[key] for key in ("address", "sent", "dropped", "trouble")}
            for publication in live.values().get("published", ())
        ],
        "recording": recording(live),
    }


def status_of_replay(pipeline: Pipeline, seconds: float) -> dict[str, Any]:
    """Return the status of a replay that has taken `seconds` s by now."""
    zero, board = pipeline.measurement.messages(), pipeline.board.trouble()
    messages = [*pipeline.doubts.said, *pipeline.times.messages, *zero, board]
    return {
        "seconds": round(seconds, 3),
        "messages": [text for text in messages if text],
        "events": events(pipeline),
        "counts": counts(pipeline),
        "clock": clock(pipeline),
        "stage": {"there": False, "why": "a replay moves nothing"},
        "published": [],
        "recording": "a recording that is solved again",
    }


def events(pipeline: Pipeline) -> dict[str, int]:
    """What is told when it becomes more."""
    flags = {name: count for name, count in pipeline.tally.flags.items() if count}
    return {
        "samples lost": pipeline.sequence.lost,
        "frames refused": pipeline.parser.corrupt,
        "restarts of the board": pipeline.sequence.restarts,
        **{name: count for name, count in flags.items() if name.startswith("marked")},
    }


def mean_rate(pipeline: Pipeline, passed: float) -> Item:
    return item("mean rate", pipeline.tally.samples / passed, "1/s")


def counts(pipeline: Pipeline) -> list[Item]:
    tally, sequence, parser = pipeline.tally, pipeline.sequence, pipeline.parser
    total = tally.samples + sequence.lost
    share = f" ({100 * sequence.lost / total:.3g} %)" if sequence.lost else ""
    items = [
        item("samples", tally.samples),
        item("lost", f"{sequence.lost}{share}", bad=sequence.lost > 0),
        item("frames refused", parser.corrupt, bad=parser.corrupt > 0),
        item("bytes passed over", parser.skipped, bad=parser.skipped > 0),
        item(
            "without a pose",
            tally.unsolved_count - tally.skipped_count,
            bad=tally.unsolved_count > tally.skipped_count,
        ),
        item("beyond chance", tally.misfit.flagged, bad=tally.misfit.is_mostly_flagged),
    ]
    items += [item(name, count, bad=True) for name, count in tally.flags.items() if count]
    if sequence.doubled:
        items.append(item("came twice", sequence.doubled, bad=True))
    if sequence.restarts:
        items.append(item("restarts", sequence.restarts, bad=True))
    return items


def loop_counts(live: Live) -> list[Item]:
    """How the loop keeps up."""
    skipped = live.pipeline.tally.skipped_count
    unknown = "no sample is solved yet, or the source is a file or virtual"
    return [
        item("latency p99", 1e3 * live.latency_p99(), "ms", unknown),
        item("waiting", live.backlog, "samples", bad=live.behind),
        item("solved late", live.late, bad=live.late > 0),
        item("left to a replay", skipped, bad=skipped > 0),
    ]


def clock(pipeline: Pipeline) -> list[Item]:
    known = pipeline.host_time
    slowness = "ppm slow" if known.ppm > 0 else "ppm fast"
    why, sigma = "too few samples have arrived yet", 1e6 * known.uncertainty
    items = [item("board's clock", abs(known.ppm), slowness, why)]
    if pipeline.config.acquire.timing == "arrival":
        why, sigma = "the times are those of arrival (acquire.timing)", float("nan")
    return [*items, item("u(time)", sigma, "µs", why)]


def recording(live: Live) -> str:
    known = live.values()
    if "recording" not in known:
        return "nothing is recorded (--no-record)"
    lost = known["not_recorded_bytes"]
    return f"recorded in {known['recording']}" + (f"; {lost} bytes are not" if lost else "")


def stage(tracker: Tracker | None, newest: RunPoses | None) -> dict[str, Any]:
    """Where the stage is, where it was sent, and what is left between; all in mm."""
    if tracker is None:
        return {"there": False, "why": "no stage is moved (--track moves one)"}
    envelope = tracker.envelope
    if envelope.encoder is None:
        return {"there": False, "why": "the stage has not reported its position yet"}
    place, sent = envelope.encoder.place, envelope.sent
    state: dict[str, Any] = {
        "there": True,
        "place": [round_digits(x) for x in place],
        "target": None,
        "error": None,
        "why": "its position was not commanded, or it was stopped",
        "state": tracker.state,
        "moves": tracker.moves,
        "stopped": envelope.latched,
        "chi": None,
    }
    if sent is not None:
        target = np.asarray(sent[1], dtype=float)
        state["target"] = [round_digits(x) for x in target]
        state["error"] = [round_digits(x) for x in place - target]
    if newest is not None:
        state["chi"] = [round_digits(x) for x in tracking_error(newest.readings[-1, 2::3])]
    return state
