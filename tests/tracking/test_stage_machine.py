"""The whole of tracking under drawn faults, one upon the other: the stage keeps to its envelope.

`HYPOTHESIS_PROFILE=search pytest -s tests/tracking/test_stage_machine.py` tries far more sequences,
others each time, and prints what happened in them.
"""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from hypothesis import settings, strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    rule,
    run_state_machine_as_test,
)
from stage_world import CONTROLLER, KINDS, STAGE, WIRE, Tally, World

import facets
from facets.tracking import Arrival, BoardPermit, Envelope, Zaber, excursion

BENCH = facets.load("bench").stage
IS_STUDY = not settings.default.derandomize
#: Faults of one sequence: more of them would leave a stage that seldom moves.
MOST_FAULTS = 3


def sampled(*values):
    return st.sampled_from(values)


def shares(low=0.0, high=1.0):
    """Numbers with two digits, which are quick to read where something fails."""
    return st.integers(round(100 * low), round(100 * high)).map(lambda n: n / 100)


def limited(size, **more):
    """Settings with soft limits at the same distance all around."""
    return replace(BENCH, low=(-size, -size), high=(size, size), resumes_per_hour=1, **more)


SETTINGS = st.builds(
    limited,
    size=sampled(7.0, 1.0, 0.5),
    driver=sampled("zaber", "pi"),
    zero=st.tuples(shares(-0.2, 0.2), shares(-0.2, 0.2)),
    law=sampled("feedforward", "proportional", "pi"),
    max_speed=sampled(20.0, 2.0),
    max_step=sampled(0.5, 0.1, 0.01),
    rate=sampled(100.0, 50.0, 200.0),
    stale=sampled(0.05, 0.02),
    bridge=sampled(0.15, 0.06, 0.0),
    bridge_distance=sampled(1.0, 0.05),
    lag=sampled(0.008, 0.002, 0.03),
    acceleration=sampled(2000.0, 300.0),
    permit=sampled(None, "board"),
    resume=sampled("person", "auto"),
)
LENGTHS = sampled(0.06, 0.01, 0.3, 1.1)
AMOUNTS = shares()


class StageMachine(RuleBasedStateMachine):
    """A stage that follows a mirror, and all that can go wrong with it."""

    tally: Tally

    @initialize(
        stage=SETTINGS, start=st.tuples(shares(-0.7, 0.7), shares(-0.7, 0.7)),
        radius=shares(0, 1.2), turn=st.integers(-8, 8), seed=st.integers(0, 99),
        search=st.booleans(), again=sampled(True, True, False),
        early=sampled(*24 * [""], *WIRE, *STAGE), amount=AMOUNTS,
    )  # fmt: skip
    def start(self, stage, search, again, early, amount, **mirror):
        self.tally.counts["sequences"] += 1
        self.world = World(stage, tally=self.tally, **mirror)
        if early:
            self.world.suffer(early, 0.5, amount)
        self.world.start(search, again)

    @rule(kind=sampled(*KINDS, *WIRE, *STAGE), seconds=LENGTHS, amount=AMOUNTS, after=LENGTHS)
    def fail(self, kind, seconds, amount, after):
        if self.world.tracker and len(self.world.faults) < MOST_FAULTS:
            self.world.suffer(kind, seconds, amount)
        self.world.run(after)

    @rule(before=sampled(0.5, 0.01), after=LENGTHS)
    def resume(self, before, after):
        self.world.run(before)
        self.world.resume()
        self.world.run(after)

    def teardown(self):
        if hasattr(self, "world"):
            self.world.end()


@pytest.mark.parametrize(
    "count", [1000] if IS_STUDY else [15, pytest.param(60, marks=pytest.mark.slow)]
)
def test_no_sequence_of_faults_takes_the_stage_out_of_its_envelope(count):
    tally = Tally()
    machine = type("Machine", (StageMachine,), {"tally": tally})
    study = settings(max_examples=count, stateful_step_count=8)
    run_state_machine_as_test(machine, settings=study)
    counts, shares = tally.counts, tally.shares
    print(json.dumps({"counts": counts, "shares": shares}, indent=1, sort_keys=True))
    assert counts["move"] > 5 * counts["sequences"]
    assert shares["speed"] > 0.9  # the stage was driven to what is allowed, not spared
    assert shares["excursion"] < 1
    if IS_STUDY:
        names = [f"fault: {kind}" for kind in KINDS]
        names += ["found again", "resumes by a person", "resumes by auto"]
        names += ["resumes after the line was closed"]
        assert min(counts[name] for name in names) > 0


def following(radius=0.3, **more):
    """A world whose stage follows a slow mirror."""
    world = World(limited(7.0, **more), (0.0, 0.0), radius, 2, 0, Tally())
    world.start(search=False, again=False)
    world.run(0.05)
    assert not world.is_stopped
    return world


def disturb(kind, **more):
    """A world whose stage follows, after a fault of a kind."""
    world = following(**more)
    world.suffer(kind, 1.0, 0.6)
    world.run(1.5)
    return world


def go_anywhere(self, wanted, sampled, limits=None):
    self._driver.move(wanted)
    return wanted


def latch_for_now(self, reason, is_for_auto=False, latch=Envelope.latch):
    latch(self, reason, is_for_auto)
    self.latched = ""


def nothing(*_):
    return ""


@pytest.mark.parametrize(
    ("owner", "name", "instead", "kind", "words", "more"),
    [
        (Envelope, "go", go_anywhere, "jump", "is blamed", {}),
        (Envelope, "latch", latch_for_now, "dark", "was sent before anybody resumed", {}),
        (Envelope, "compare", nothing, "miswired", "unnoticed", {}),
        (Arrival, "complaint", nothing, "ignore", "unnoticed", {}),
        (BoardPermit, "allows_motion", lambda *_: True, "no permit", "after the permit",
         {"permit": "board"}),
        (Zaber, "prepare", nothing, "dark", "accelerated too much", {"radius": 1.0}),
    ],
)  # fmt: skip
def test_the_judge_sees_an_envelope_of_which_a_part_is_replaced(
    monkeypatch, owner, name, instead, kind, words, more
):
    monkeypatch.setattr(owner, name, instead)
    with pytest.raises(pytest.fail.Exception, match=words):
        disturb(kind, **more)


@pytest.mark.parametrize("kind", [kind for kind in CONTROLLER if kind != "foreign"])
def test_a_controller_that_disobeys_is_found_out(kind):
    assert disturb(kind).tally.counts[f"found out: {kind}"]


def test_a_permit_that_was_lost_while_the_stage_stood_is_asked_of_a_person():
    world = following(permit="board", resume="auto")
    world.suffer("dark", 0.4, 0.0)
    world.run(0.35)
    assert world.is_stopped
    world.suffer("no permit", 0.1, 0.0)
    world.run(1.6)
    assert world.is_stopped
    world.resume()
    world.run(0.1)
    assert not world.is_stopped


def test_the_excursion_of_the_page_on_hazards_is_that_of_the_default_settings():
    assert excursion(BENCH) == pytest.approx(1.7, abs=0.05)
