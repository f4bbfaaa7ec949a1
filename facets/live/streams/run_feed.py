"""The samples of a run in a process that it has started, and the replies to the run."""

from __future__ import annotations

import json
import sys
import time
from contextlib import suppress
from typing import Any

import zmq

from ...core.units import Rows
from .subscription import Subscription
from .zeromq import (
    END,
    FROM,
    LINGER_MS,
    REPORT_INTERVAL_S,
    SAMPLES,
    SHORT_HIGH_WATER_MARK,
    START_TIMEOUT_S,
    STATUS,
)


class RunFeed(Subscription):
    """Samples and status of the run that started this process, until it ends.

    setup: values that the run gives to this process alone.  has_end: whether the run has announced
    its end, instead of breaking off.
    """

    def __init__(self) -> None:
        self.setup: dict[str, Any] = json.load(sys.stdin)
        self.token, self.has_end, self.due = self.setup["token"].encode(), False, 0.0
        options = {zmq.RCVHWM: SHORT_HIGH_WATER_MARK, zmq.LINGER: LINGER_MS}
        topics = (self.token, SAMPLES, STATUS, END)
        if not self.connect(self.setup["endpoint"], topics, options, START_TIMEOUT_S):
            raise SystemExit("the run has gone")
        self.next = 0

    def take(self, most: int, wait_ms: int = 0) -> tuple[list[Rows], list[dict[str, Any]]]:
        """Return the rows and statuses that have come; read no further message after `most` rows.

        wait_ms: longest time to wait for the first message.
        """
        parts, statuses, remaining = list[Rows](), list[dict[str, Any]](), most
        while remaining > 0 and not self.ended and (message := self.receive(wait_ms)):
            topic, *content = message
            wait_ms = 0
            if topic == SAMPLES:
                parts.append(self.read_rows(*content))
                remaining -= len(parts[-1])
            elif topic == STATUS:
                statuses.append(json.loads(content[0]))
            elif topic == END:
                self.ended = self.has_end = True
        return parts, statuses

    def report_loss(self, missed: int) -> None:
        """Do nothing, because `report` states the loss."""

    def report(self, sent: int, receivers: int | None) -> None:
        """Report the counts of samples to the run, at intervals and at the end."""
        if self.ended or time.monotonic() >= self.due:
            self.due = time.monotonic() + REPORT_INTERVAL_S
            self.reply(sent=sent, dropped=self.next - sent, receivers=receivers)

    def reply(self, **words: Any) -> None:
        """Send values to the run; nothing happens if it has ended."""
        with suppress(zmq.ZMQError):
            self.socket.send(FROM + self.token + b" " + json.dumps(words).encode(), zmq.NOBLOCK)
