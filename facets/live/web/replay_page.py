"""The page of a recording that is solved again."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from ..recording.index import CLOSED
from ..recording.reader import utc_offset
from ..run.interruption import deferring
from ..streams.sample_rows import row_content, rows_of
from .page import WebPage
from .status import status_of_replay

if TYPE_CHECKING:
    from ..run.pipeline import Pipeline, RunPoses

#: Time between two checks whether the page is to end, s.
END_CHECK_INTERVAL_S = 0.1
#: Of what happened so much is told.
EVENTS = 150


def events_of(recording: Path) -> list[tuple[float, str]]:
    """The newest that happened in a run, as it was recorded: when, on the host's clock, and what.

    Moves of the stage are left out; a line that is torn is passed over.
    """
    try:
        lines = (recording / "events.jsonl").read_text("utf-8", errors="replace").splitlines()
    except OSError:
        return []
    found: deque[tuple[float, str]] = deque(maxlen=EVENTS)
    for line in lines:
        with suppress(ValueError, TypeError, KeyError, AttributeError):
            row = json.loads(line)
            name, moment = str(row.pop("event")), float(row.pop("monotonic"))
            row.pop("utc", None)
            more = ", ".join(phrase(key, value) for key, value in row.items() if says(value))
            if name not in ("move", CLOSED):
                found.append((moment, f"{name}: {more}" if more else name))
    return list(found)


def says(value: Any) -> bool:
    """Whether there is anything to tell of a value."""
    return (value == 0 and value is not False) or bool(value)


def phrase(name: str, value: Any) -> str:
    """A value of an event with its name, in words."""
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


class ReplayPage:
    """Shows poses as they are solved, and then all of them for as long as a person wants.

    In a `with` statement the page is closed at its end.
    """

    def __init__(
        self, pipeline: Pipeline, recording: Path, web: str, drawn: dict[str, str]
    ) -> None:
        self.pipeline, self.begin, self.ended = pipeline, time.monotonic(), 0.0
        offset = utc_offset(recording)
        self.offset, self.recording = offset or 0.0, recording
        more = {"kind": "replay", "recording": str(recording), "utc_known": offset is not None}
        more |= row_content(pipeline.config, pipeline.measurement)
        self.page = WebPage(pipeline.config, web, self.status, more, True, drawn=drawn)

    def status(self) -> dict[str, Any]:
        passed = (self.ended or time.monotonic()) - self.begin
        words = status_of_replay(self.pipeline, passed)
        return words | ({"finished": "The whole recording is solved."} if self.ended else {})

    def following(self, replayed: Iterable[RunPoses]) -> Iterator[RunPoses]:
        """The same poses; each is shown on its way."""
        for poses in replayed:
            self.page.send(rows_of(poses, self.offset).tobytes())
            self.page.show()
            yield poses
        self.ended = time.monotonic()
        self.page.tell(self.status() | {"happened": events_of(self.recording)})

    def stay(self, say: Callable[[str], None]) -> None:
        """Waits until ^C, SIGTERM or the end of the page's process."""
        say(f"the page stays at {self.page.url} until ^C")
        with deferring() as signals:
            while not signals and self.page.process.poll() is None and not self.page.trouble:
                time.sleep(END_CHECK_INTERVAL_S)
        if self.page.trouble:
            say(f"the page is gone: {self.page.trouble}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.page.close()
