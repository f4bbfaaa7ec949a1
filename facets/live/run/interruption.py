"""Signals that end a run in good order, and the signal that resumes a stopped stage."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ...tracking.tracker import Tracker

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")


@contextmanager
def deferring() -> Iterator[list[int]]:
    """Defer signals that would interrupt the block: yield a list to which they are appended.

    At the end of the block the handler of the first one is called. A `KeyboardInterrupt` that it
    raises is dropped, because the work has ended in good order. Outside the main thread, and for
    signals that end a program at once, nothing is deferred.
    """
    came: list[int] = []
    before: dict[int, Callable[[int, FrameType | None], Any]] = {}
    if threading.current_thread() is threading.main_thread():
        for number in (getattr(signal, name) for name in NAMES if hasattr(signal, name)):
            handler = signal.getsignal(number)
            if callable(handler):
                before[number] = handler
                signal.signal(number, lambda number, _: came.append(number))
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        with suppress(KeyboardInterrupt):
            for number in came[:1]:
                before[number](number, None)


@contextmanager
def resume_by_signal(tracker: Tracker) -> Iterator[None]:
    """Let SIGUSR1 resume a stopped stage within the block, if the system has this signal."""
    number = getattr(signal, "SIGUSR1", None)
    if number is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(number, lambda *_: tracker.resume("SIGUSR1"))
    try:
        yield
    finally:
        # a late one is no reason to end
        signal.signal(number, before if callable(before) else signal.SIG_IGN)
