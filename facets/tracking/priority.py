"""A real-time priority for the threads that a stage or a detector board waits for.

Beside other programs each thread of a run waits for the processor, one after the other: on a busy
machine a pose then is too old to follow. Linux lets a program before all ordinary ones where the
user may ask for that (root, or a limit `rtprio` as for audio); elsewhere nothing changes.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

#: The lowest of Linux's real-time priorities, which goes before every ordinary program.
PRIORITY = 1


@contextmanager
def urgent() -> Iterator[bool]:
    """Within it the calling thread goes before ordinary programs; gives whether that is allowed.

    Not on a machine with one processor, which it could take for itself. Threads and processes that
    it starts are ordinary ones.
    """
    allowed = False
    if sys.platform == "linux" and len(os.sched_getaffinity(0)) > 1:
        policy, before = os.sched_getscheduler(0), os.sched_getparam(0)
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
            allowed = True
    try:
        yield allowed
    finally:
        if allowed:
            with suppress(OSError):
                os.sched_setscheduler(0, policy, before)
