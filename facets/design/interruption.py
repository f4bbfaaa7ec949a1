"""Signals that come while a solver computes: it swallows what their handlers raise.

casadi asks Python for signals now and then, ends the solver where a handler raises, and returns
where that left it, as if it had found nothing. Here the handler is asked again when it has.
"""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Any

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")


def run_solver(solver: Any, **problem: Any) -> Any:
    """`solver(**problem)`, whose interruption is one: the signal's own handler then has its way.

    A signal that would end the program at once still does.
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
        found = solver(**problem)
    except Exception:
        if not came:
            raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    for number in came:
        handler = before[number]
        assert callable(handler)
        handler(number, None)
    return found
