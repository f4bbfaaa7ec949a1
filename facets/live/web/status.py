"""The status of a run for its page, in addition to the samples: counts, clock, stage, messages.

Each count has a name, a value and a unit; an unknown value is None, with the reason.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...tracking.control import tracking_error
from ..run.view import Item, item, round_digits, run_counts, stream_counts

if TYPE_CHECKING:
    from ...tracking.tracker import Tracker
    from ..run.live import Live
    from ..run.pipeline import Pipeline, RunPoses


def status_of(live: Live) -> dict[str, Any]:
    """Return the status of a run."""
    pipeline = live.pipeline
    return {
        **pipeline_status(pipeline, live.duration),
        "messages": live.messages(),
        "events": events(pipeline) | {"reconnected": live.reconnects},
        "counts": run_counts(live),
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
        **pipeline_status(pipeline, seconds),
        "messages": [text for text in messages if text],
        "stage": {"there": False, "why": "a replay moves nothing"},
        "published": [],
        "recording": "a recording that is solved again",
    }


def pipeline_status(pipeline: Pipeline, seconds: float) -> dict[str, Any]:
    """Return the part of a status that runs and replays share, after a time, s."""
    return {
        "seconds": round(seconds, 3),
        "events": events(pipeline),
        "counts": stream_counts(pipeline),
        "clock": clock(pipeline),
    }


def events(pipeline: Pipeline) -> dict[str, int]:
    """Return the counts that are reported as events when they increase."""
    flags = {name: count for name, count in pipeline.tally.flags.items() if count}
    return {
        "samples lost": pipeline.sequence.lost,
        "frames refused": pipeline.parser.corrupt,
        "restarts of the board": pipeline.sequence.restarts,
        **{name: count for name, count in flags.items() if name.startswith("marked")},
    }


def clock(pipeline: Pipeline) -> list[Item]:
    """The items on the board's clock."""
    host_time = pipeline.host_time
    slowness = "ppm slow" if host_time.ppm > 0 else "ppm fast"
    why, sigma = "too few samples have arrived yet", 1e6 * host_time.uncertainty
    items = [item("board's clock", abs(host_time.ppm), slowness, why)]
    if pipeline.config.acquire.timing == "arrival":
        why, sigma = "the times are those of arrival (acquire.timing)", float("nan")
    return [*items, item("u(time)", sigma, "µs", why)]


def recording(live: Live) -> str:
    """The state of the recording in words."""
    values = live.values()
    if "recording" not in values:
        return "nothing is recorded (--no-record)"
    lost = values["not_recorded_bytes"]
    return f"recorded in {values['recording']}" + (f"; {lost} bytes are not" if lost else "")


def stage(tracker: Tracker | None, newest: RunPoses | None) -> dict[str, Any]:
    """Return the stage's position, its target and the difference of both, in mm; the entry `there`
    is False without a stage or its position."""
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
