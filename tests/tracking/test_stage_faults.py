"""The whole of tracking under random faults, judged where the stage stands: never outside.

The suite tries few sequences, its studies 200, `experiments/stage_faults.py` thousands.
"""

from __future__ import annotations

import numpy as np
import pytest
from facets.experiments import stage_faults

from facets.tracking import Arrival, BoardPermit, Envelope, Pi, Zaber


@pytest.mark.parametrize("count", [80, pytest.param(200, marks=pytest.mark.study)])
@pytest.mark.slow
def test_no_sequence_of_faults_takes_the_stage_out_of_its_envelope(count):
    tried = stage_faults.run(range(count))
    assert tried.sequences == count
    assert set(tried.faults) == set(stage_faults.KINDS)
    assert set(tried.drivers) == {"zaber", "pi"}
    assert tried.moves > 20 * count
    assert tried.searches > 0
    assert tried.resumes > 0
    assert tried.most_speed > 0.9  # the stage was driven to what is allowed, not spared
    assert tried.stopped_by["the external permit is"] > 0
    assert tried.most_excursion < 1
    if count >= 200:
        assert set(tried.found_out) == set(stage_faults.CONTROLLER)
        assert min(tried.found_out.values()) > 5


@pytest.mark.parametrize("driver", ["zaber", "pi"])
def test_the_cable_may_be_pulled_at_any_byte(driver):
    cuts = range(0, 1500, 40)
    tried = stage_faults.pull_at_each_byte(driver, cuts)
    assert tried.sequences == len(cuts)
    assert tried.refused_at_start > 0
    assert tried.moves > 0


def fails(monkeypatch, owner, name, value, kinds=stage_faults.KINDS):
    """Whether some sequence is found to leave the envelope where that part of it is replaced."""
    with monkeypatch.context() as patch:
        patch.setattr(owner, name, value)
        for seed in range(60):
            try:
                stage_faults.sequence(seed, stage_faults.Tried(), kinds=kinds)
            except stage_faults.Broken:
                return True
    return False


def test_the_judge_sees_what_is_outside(monkeypatch):
    def go_anywhere(self, wanted, sampled, limits=None):
        self._driver.move(wanted)
        return wanted

    assert fails(monkeypatch, Envelope, "go", go_anywhere)
    assert fails(monkeypatch, Zaber, "prepare", lambda self: None)
    assert fails(monkeypatch, Pi, "prepare", lambda self: None)


@pytest.mark.slow
def test_the_judge_sees_a_stop_that_does_not_last_and_a_move_that_goes_astray(monkeypatch):
    latch = Envelope.latch

    def stop_for_now(self, reason, is_for_auto=False):
        latch(self, reason, is_for_auto)
        self.latched = ""

    assert fails(monkeypatch, Envelope, "latch", stop_for_now)
    assert fails(monkeypatch, Envelope, "compare", lambda self, time, beam: None, ("miswired",))
    assert fails(monkeypatch, Arrival, "complaint", lambda self, now, place: "", ("ignore",))
    assert fails(monkeypatch, BoardPermit, "allows_motion", lambda self, now: True, ("no permit",))


def test_a_fault_lasts_from_its_beginning_to_its_end():
    world = stage_faults.World(np.random.default_rng(1), stage_faults.Tried())
    world.faults = [stage_faults.Fault("dark", 10.0, 10.5, 0.0)]
    assert world.is_on("dark") is not None
    world.now = 10.5
    assert world.is_on("dark") is None
