"""The page of a recording that is solved again."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.closing import ClosedAtExit
from ..recording.index import CLOSED
from ..recording.reader import utc_offset
from ..run.interruption import deferring
from ..streams.publication import Publications
from .page import WebPage
from .status import status_of_replay

if TYPE_CHECKING:
    from ..run.pipeline import Pipeline, RunPoses

#: Time between two checks whether the page is to end, ms.
END_CHECK_INTERVAL_MS = 100
#: Maximum number of events that are sent to a page.
EVENTS = 150


def events_of(recording: Path) -> list[tuple[float, str]]:
    """Return the newest recorded events of a run: each time on the host's clock, s, and words.

    Moves of the stage and torn lines are excluded.
    """
    try:
        lines = (recording / "events.jsonl").read_text("utf-8", errors="replace").splitlines()
    except OSError:
        return []
    events: deque[tuple[float, str]] = deque(maxlen=EVENTS)
    for line in lines:
        with suppress(ValueError, TypeError, KeyError, AttributeError):
            row = json.loads(line)
            name, moment = str(row.pop("event")), float(row.pop("monotonic"))
            row.pop("utc", None)
            more = ", ".join(phrase(key, value) for key, value in row.items() if value)
            if name not in ("move", CLOSED):
                events.append((moment, f"{name}: {more}" if more else name))
    return list(events)


def phrase(name: str, value: Any) -> str:
    """Return a value of an event with its name, in words."""
    name = name.replace("_", " ")
    if value is True:
        return name
    if isinstance(value, float):
        value = f"{value:.4g}"
    elif isinstance(value, list):
        value = "; ".join(map(str, value))
    elif isinstance(value, dict):
        value = ", ".join(f"{count} {words}" for words, count in value.items())
    return f"{name} {value}"


class ReplayPage(ClosedAtExit):
    """Shows poses as they are solved, and then all of them for as long as a person wants.

    The page has an outlet of its own, because it stays after the publications of a replay, whose
    subscribers learn from their end that all poses have come. A `with` statement closes the page at
    its end.
    """

    def __init__(
        self, pipeline: Pipeline, recording: Path, web: str, drawn: dict[str, str]
    ) -> None:
        self.pipeline, self.begin, self.ended = pipeline, time.monotonic(), 0.0
        offset = utc_offset(recording)
        self.recording, config = recording, pipeline.config
        self.publications = Publications([], config, True, offset or 0.0, pipeline.measurement)
        more = {"kind": "replay", "recording": str(recording), "utc_known": offset is not None}
        outlet = self.publications.outlet
        try:
            self.page = WebPage(outlet, config, web, self.status, more, drawn=drawn)
        except BaseException:
            outlet.close()
            raise

    def status(self) -> dict[str, Any]:
        """The status of the replay, and whether it is complete."""
        passed = (self.ended or time.monotonic()) - self.begin
        words = status_of_replay(self.pipeline, passed)
        return words | ({"finished": "The whole recording is solved."} if self.ended else {})

    def following(self, replayed: Iterable[RunPoses]) -> Iterator[RunPoses]:
        """Yield the same poses, and show each of them."""
        for poses in replayed:
            self.publications.add_poses(poses)
            self.publications.outlet.refresh()
            yield poses
        self.ended = time.monotonic()
        self.publications.outlet.send_status(
            self.status() | {"happened": events_of(self.recording)}
        )

    def stay(self, say: Callable[[str], None]) -> None:
        """Wait until ^C, SIGTERM or the end of the page's process."""
        say(f"the page stays at {self.page.url} until ^C")
        with deferring() as signals:
            while not (signals or self.page.trouble):
                self.publications.outlet.hear(END_CHECK_INTERVAL_MS)
        if self.page.trouble:
            say(f"the page is gone: {self.page.trouble}")

    def close(self) -> None:
        """End the page's process."""
        self.publications.close()
