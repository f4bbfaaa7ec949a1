"""A real-time priority for the threads that a stage or a detector board waits for.

On a busy machine each thread of a run waits for the processor, so that a pose becomes too old to
follow. Linux runs a program before all ordinary ones if the user has the right (root, or a limit
`rtprio` as for audio); on other systems nothing changes.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

#: The lowest of Linux's real-time priorities; it precedes every ordinary program.
PRIORITY = 1


@contextmanager
def urgent() -> Iterator[bool]:
    """Run the calling thread before ordinary programs; yields whether the system allows it.

    The priority stays ordinary on a machine with one processor, which the thread could occupy, and
    in threads and processes that the thread starts.
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
