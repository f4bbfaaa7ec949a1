"""Signals that end a program, handled as ^C is, so that all open files are closed.

A terminal that is closed sends SIGHUP, a system that shuts down SIGTERM. Both raise
`KeyboardInterrupt` where the program is, as SIGINT does; the exit status is then 128 and the
signal's number. A signal that is ignored when the program starts (`nohup`) stays ignored. SIGUSR1,
which resumes a stopped stage, is ignored while there is none, for example before it is opened.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")
#: The exit status that typer gives after a `KeyboardInterrupt`.
INTERRUPTED = 130
_caught: list[int] = []


def caught() -> int | None:
    """Number of the first signal that came, if any, for code that caught its exception."""
    return _caught[0] if _caught else None


def check() -> None:
    """Raise `KeyboardInterrupt` if a signal came that did not end the work."""
    if _caught:
        raise KeyboardInterrupt


def status() -> int:
    """The exit status of a program that a signal ended."""
    return 128 + (caught() or signal.SIGINT)


def status_of(code: Any) -> Any:
    """The exit status of a command that ended with `code`, by itself or after a signal.

    A command that runs until it is stopped keeps its own status after ^C.
    """
    return code if caught() in (None, signal.SIGINT) and code != INTERRUPTED else status()


def interrupt(number: int, _: FrameType | None) -> None:
    """End the work at the first signal; while it ends, only ^C can interrupt again."""
    is_first = not _caught
    _caught.append(number)
    if is_first or number == signal.SIGINT:
        raise KeyboardInterrupt


@contextmanager
def interrupting() -> Iterator[None]:
    """Context in which the signals of NAMES interrupt; afterwards their handlers are restored."""
    before: dict[int, Any] = {}
    _caught.clear()
    for name in NAMES:
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) not in (signal.SIG_IGN, None):
            before[number] = signal.signal(number, interrupt)
    if hasattr(signal, "SIGUSR1"):
        before[signal.SIGUSR1] = signal.signal(signal.SIGUSR1, signal.SIG_IGN)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
