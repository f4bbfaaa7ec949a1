"""Signals during work with casadi, which swallows the exceptions of their handlers.

casadi checks Python's signals now and then, ends a solver where a handler raises, and returns the
solver's last point, as if it had found nothing; while it makes or frees a function it goes on. Here
the handler is then called again.
"""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Any

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")


def run_solver(solver: Any, **problem: Any) -> Any:
    """Call `solver(**problem)` and, after an interruption, call the signal's own handler.

    A signal that ends the program at once still ends it.
    """
    if threading.current_thread() is not threading.main_thread():
        return solver(**problem)
    came: list[int] = []

    def interrupt(number: int, _: FrameType | None) -> None:
        came.append(number)
        raise KeyboardInterrupt

    numbers = [getattr(signal, name) for name in NAMES if hasattr(signal, name)]
    before = {n: signal.getsignal(n) for n in numbers if callable(signal.getsignal(n))}
    try:
        for number in before:
            signal.signal(number, interrupt)
        result = solver(**problem)
    except (Exception, KeyboardInterrupt):
        if not came:
            raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    for number in came:
        handler = before[number]
        assert callable(handler)
        handler(number, None)
    return result
