"""Signals that end a program: handled as ^C is, so that whatever is open is closed.

A terminal that is closed sends SIGHUP, a system that shuts down SIGTERM. Both raise
`KeyboardInterrupt` where the program is, as SIGINT does; the exit status is then 128 and the
signal's number. A signal that is ignored when the program starts (`nohup`) stays ignored.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")
#: What typer makes of a `KeyboardInterrupt`.
INTERRUPTED = 130
_caught: list[int] = []


def caught() -> int | None:
    """The number of the first signal that came, if any. Code that swallowed it may ask."""
    return _caught[0] if _caught else None


def check() -> None:
    """Raises `KeyboardInterrupt` where a signal came and something kept it from ending the work."""
    if _caught:
        raise KeyboardInterrupt


def status() -> int:
    """The exit status of a program that a signal ended."""
    return 128 + (caught() or signal.SIGINT)


def status_of(code: Any) -> Any:
    """The exit status of a command that ended with `code`, by itself or after a signal.

    ^C is a way to end a command that runs on and on, and leaves it its own status.
    """
    return code if caught() in (None, signal.SIGINT) and code != INTERRUPTED else status()


def interrupt(number: int, _: FrameType | None) -> None:
    """Ends what is being done, at the first signal; while it ends, only ^C can hurry it."""
    again = bool(_caught)
    _caught.append(number)
    if not again or number == signal.SIGINT:
        raise KeyboardInterrupt


@contextmanager
def interrupting() -> Iterator[None]:
    """Within it the signals of NAMES interrupt; after it they do what they did before."""
    before: dict[int, Any] = {}
    _caught.clear()
    for name in NAMES:
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) not in (signal.SIG_IGN, None):
            before[number] = signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
