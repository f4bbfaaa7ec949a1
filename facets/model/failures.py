"""Exceptions of Python that compiled code has called, which cannot pass through it."""

from __future__ import annotations

import threading


class Failures(threading.local):
    """What went wrong in this thread where compiled code has called Python, which cannot raise
    through it; raised once the compiled code has ended."""

    def __init__(self) -> None:
        self.raised: list[BaseException] = []


FAILURES = Failures()


def raise_failure() -> None:
    """Raises what went wrong in Python while compiled code ran."""
    if FAILURES.raised:
        failure = FAILURES.raised[0]
        FAILURES.raised.clear()
        raise failure
