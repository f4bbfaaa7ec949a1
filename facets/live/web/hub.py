"""The data for all pages of a run, and for each page the news that it has not received yet."""

from __future__ import annotations

import asyncio
import struct
import time
from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np

from ...core.names import READING_COLUMNS, STATE_COLUMNS
from ...core.units import Rows
from ...estimation.solution import UNCERTAINTY_PARTS
from .bins import AllBins, Bins, bin_columns

#: Width of the bins of the last two minutes, s.
NEAR_WIDTH_S = 0.01
#: Number of the bins of the last two minutes.
NEAR_BINS = 12_000
#: Width of the bins of the whole run at its beginning, s.
ALL_WIDTH_S = 0.001
#: Number of the bins of the whole run.
ALL_BINS = 32_768
#: Number of the bins of a recording, which is studied more closely and sent only once.
RECORDED_BINS = 131_072
#: Number of newest events that are kept.
EVENTS = 200
#: Level, whether the page must drop its earlier bins of that level, width (s), number of bins.
HEAD = struct.Struct("<IIdII")
#: The rate of samples is the mean over this time before now, s.
RATE_WINDOW_S = 2.0


def extra_columns(about: dict[str, Any]) -> tuple[str, ...]:
    """Return the columns that pages show in addition to the mirror's state.

    They are the object's pose and displacement, the auxiliary channels, and the standard
    uncertainties of pose and displacement.
    """
    of_object = set(about.get("object_columns", ()))
    poses = [f"{kind}_{name}" for kind in ("object", "displacement") for name in STATE_COLUMNS[:6]]
    poses = [name for name in poses if name in of_object]
    channels = [channel["column"] for channel in about.get("channels", ())]
    return (*poses, *channels, *(f"u_{name}" for name in poses))


def json_text(message: dict[str, Any]) -> str:
    """A message in JSON, in which NaN and infinity are null."""
    import orjson

    text: str = orjson.dumps(message, option=orjson.OPT_SERIALIZE_NUMPY).decode()
    return text


class Hub:
    """Samples, status and events of a run, as pages show them.

    about: of the run, for each page when it comes.
    """

    def __init__(self, about: dict[str, Any]) -> None:
        self.about = about
        self.origin: float | None = None
        all_bins = RECORDED_BINS if about.get("kind") == "replay" else ALL_BINS
        self.channels = extra_columns(about)
        self.all = AllBins(ALL_WIDTH_S, all_bins, self.channels)
        self.levels = [Bins(NEAR_WIDTH_S, NEAR_BINS, self.channels), self.all]
        self.newest: dict[str, Any] | None = None
        self.last = -1  # the highest number of a sample
        self.status: dict[str, Any] | None = None
        self.events: deque[dict[str, Any]] = deque(maxlen=EVENTS)
        self.happened = 0
        self.said: dict[str, str] = {}
        self.came: deque[tuple[float, int]] = deque()
        self.ended: dict[str, Any] | None = None
        self.pages: set[Page] = set()

    # messages of the run

    def take(self, rows: Rows) -> None:
        """Takes in rows of SAMPLE."""
        if not len(rows):
            return
        if self.origin is None and np.isfinite(rows["host_s"][0]):
            self.origin = float(rows["host_s"][0])
            if self.about.get("utc_known", True):
                self.about["origin_utc"] = float(rows["utc_s"][0])
            for page in self.pages:
                page.greeted = False
        times = rows["host_s"] - (np.nan if self.origin is None else self.origin)
        is_timed = np.isfinite(times)
        age = self.all.age
        for level in self.levels:
            level.add(times[is_timed], rows[is_timed])
        if self.all.age != age:
            for page in self.pages:
                page.changed[1] = None
        best = int(rows["seq"].argmax())
        if int(rows["seq"][best]) >= self.last:
            self.last = int(rows["seq"][best])
            self.newest = self.sample(rows[best], float(times[best]))
        self.came.append((time.monotonic(), len(rows)))

    def sample(self, row: Any, at: float) -> dict[str, Any]:
        """A sample in the units of its columns."""
        status = int(row["status"])

        def values(names: Iterable[str]) -> list[float]:
            return [float(row[name]) for name in names]

        return {
            "t": at,
            "utc": float(row["utc_s"]),
            "seq": int(row["seq"]),
            "status": self.about["statuses"].get(str(status), f"status {status}"),
            "pose": status == 0,
            "flags": int(row["flags"]),
            "state": values(STATE_COLUMNS),
            "u": values(f"u_{name}" for name in STATE_COLUMNS),
            "parts": {
                part: values(f"u_{part}_{name}" for name in STATE_COLUMNS)
                for part in UNCERTAINTY_PARTS
                if self.about.get("uncertainty_parts")
            },
            "reading": values(READING_COLUMNS),
            "residual": float(row["residual"]),
            "channels": values(self.channels),
        }

    def hear(self, status: dict[str, Any]) -> None:
        """Take in the status of the run, and make events of its new messages and counts."""
        at = self.now()
        before, self.said = self.said, kinds_of(status.get("messages", ()))
        for kind in self.said.keys() - before.keys():
            self.add_event(at, self.said[kind], "begins")
        for kind in before.keys() - self.said.keys():
            self.add_event(at, before[kind], "ends")
        counts = status.get("events", {})
        for name, count in counts.items():
            more = count - (self.status or {}).get("events", {}).get(name, 0)
            if more > 0:
                self.add_event(at, f"{name}: {more} more, {count} in all", "")
        for moment, text in status.pop("happened", ()):
            self.add_event(None if self.origin is None else moment - self.origin, text, "")
        self.status = status

    def add_event(self, at: float | None, text: str, what: str) -> None:
        """Add an event at a time, s, for all pages. what: its kind."""
        self.happened += 1
        self.events.append({"number": self.happened, "t": at, "text": text, "what": what})

    def end(self, reason: str, good: bool) -> None:
        """Announce to the pages that nothing more comes."""
        if self.ended is None:
            self.ended = {"type": "end", "reason": reason, "good": good}
            self.add_event(self.now(), reason, "")

    def now(self) -> float | None:
        """The time after the origin: by this machine's clock, or of a replay's newest sample, s;
        None before the first sample."""
        if self.origin is not None and self.about.get("kind") == "acquire":
            return time.monotonic() - self.origin
        return self.newest["t"] if self.newest else None

    def rate(self) -> float:
        """Return the mean rate of samples over the last RATE_WINDOW_S, 1/s."""
        now = time.monotonic()
        while self.came and now - self.came[0][0] > RATE_WINDOW_S:
            self.came.popleft()
        return sum(count for _, count in self.came) / RATE_WINDOW_S

    def share(self) -> None:
        """Mark the changed bins for each page, and wake the pages."""
        news = [level.take_changes() for level in self.levels]
        for page in self.pages:
            for old, new in zip(page.changed, news, strict=True):
                if old is not None:
                    old |= new
            page.wake.set()

    # messages to the pages

    def hello(self) -> str:
        """Return the first message to a page: columns, levels and the description of the run."""
        columns = bin_columns(self.channels)
        message = {"type": "hello", **self.about, "columns": columns, "states": STATE_COLUMNS}
        message["extras"] = self.channels
        message["levels"] = [{"width": level.width, "count": level.count} for level in self.levels]
        return json_text(message)

    def bins(self, level: int, numbers: set[int] | None) -> bytes | None:
        """Return the bins of these numbers as bytes, or all bins; None if none of these is kept."""
        bins, is_all = self.levels[level], numbers is None
        chosen = bins.present_numbers() if numbers is None else sorted(numbers)
        held, values = bins.values(np.array(chosen, np.int64))
        if not len(held) and not is_all:
            return None
        head = HEAD.pack(level, int(is_all), bins.width, len(held), 0)
        return head + held.astype("<i4").tobytes() + values.astype("<f4").tobytes()

    def news(self, since: int) -> str:
        """The newest sample, the state of the run and the events after the one numbered `since`."""
        message = {
            "type": "news",
            "sample": self.newest,
            "rate": self.rate(),
            "status": self.status,
            "events": [event for event in self.events if event["number"] > since],
        }
        return json_text(message)


def kinds_of(texts: Iterable[str]) -> dict[str, str]:
    """Return sentences by their words without the numbers, which change all the time."""
    return {"".join(c for c in text if not (c.isdigit() or c == ".")): text for text in texts}


class Page:
    """An open page, and the news that it has not received yet.

    changed: for each level the numbers of the bins that changed; None if the page needs all bins.
    """

    def __init__(self, hub: Hub) -> None:
        self.hub = hub
        self.wake = asyncio.Event()
        self.greeted = False
        self.changed: list[set[int] | None] = [None for _ in hub.levels]
        self.happened = 0
        self.finished = False

    def messages(self) -> list[str | bytes]:
        """Return the messages that the page needs now."""
        hub, messages = self.hub, list[str | bytes]()
        if not self.greeted:
            self.greeted, self.happened = True, 0
            self.changed = [None for _ in hub.levels]
            messages.append(hub.hello())
        for level, numbers in enumerate(self.changed):
            if (data := hub.bins(level, numbers)) is not None:
                messages.append(data)
            self.changed[level] = set()
        messages.append(hub.news(self.happened))
        self.happened = hub.happened
        if hub.ended and not self.finished:
            self.finished = True
            messages.append(json_text(hub.ended))
        return messages
