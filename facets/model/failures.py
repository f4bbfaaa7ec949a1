"""Exceptions of Python functions that compiled code has called; they cannot pass through it."""

from __future__ import annotations

import threading


class Failures(threading.local):
    """The exceptions of this thread that compiled code could not raise; raised once that code has
    ended."""

    def __init__(self) -> None:
        self.raised: list[BaseException] = []


FAILURES = Failures()


def raise_failure() -> None:
    """Raise the exception that Python raised while compiled code ran."""
    if FAILURES.raised:
        failure = FAILURES.raised[0]
        FAILURES.raised.clear()
        raise failure
