"""A real-time priority: asked for, taken back, and not left to others."""

from __future__ import annotations

import os
import sys
import threading

import pytest

from facets.tracking import urgent

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="Linux alone has these calls")


def test_it_is_taken_back_and_not_passed_on():
    before = os.sched_getscheduler(0)
    with urgent() as allowed:
        policy = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
        assert (policy == os.SCHED_RR) == (allowed or before == os.SCHED_RR)
        inside = []
        thread = threading.Thread(target=lambda: inside.append(os.sched_getscheduler(0)))
        thread.start()
        thread.join()
        if allowed:
            assert inside == [os.SCHED_OTHER]
    assert os.sched_getscheduler(0) == before


def test_a_single_processor_is_not_occupied(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    with urgent() as allowed:
        assert not allowed
