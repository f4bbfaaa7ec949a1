"""The loop that solves what comes, on a clock that only the test moves."""

from __future__ import annotations

from dataclasses import replace
from itertools import repeat
from queue import Empty

import numpy as np
import pytest
from facets.experiments.studies import kills
from stage_world import stage_on
from streams import CALIBRATED, Clock, samples_of

import facets
from facets import Status
from facets.files import join_columns
from facets.live import (
    CLOCK_MOVED,
    PERMIT,
    SIZE,
    Block,
    Ending,
    Live,
    Loop,
    Pipeline,
    PoseComparison,
    Sink,
    locate,
    pack,
)
from facets.tracking import Encoder, Envelope, Law, Tracker

CONFIG = facets.load("bench")
EACH = 20
NEWEST_FIRST_AFTER_S = 0.05


class Board:
    """A reader whose blocks come when the clock says so."""

    port = error = None
    is_stepped = False

    def __init__(self, clock, count):
        self.clock, self.queue, size = clock, self, EACH * SIZE
        data = kills.stream(count * EACH)
        self.blocks = [
            Block(data[n * size : (n + 1) * size], clock.now + 2e-3 * (n + 1), None)
            for n in range(count)
        ]

    def next_block(self, wait=0.0):
        if wait and self.blocks:
            self.clock.now = max(self.clock.now, self.blocks[0].arrival)
        if not self.blocks or self.blocks[0].arrival > self.clock.now:
            raise Empty
        return self.blocks.pop(0)

    def empty(self):
        return not self.blocks

    def is_alive(self):
        return bool(self.blocks)


class Memory(Sink):
    """A recording in memory."""

    def __init__(self):
        self.events, self.parts = [], []

    def add_event(self, name, **details):
        self.events.append((name, details))

    def add_poses(self, poses):
        self.parts.append(poses.columns())


class Slow(Pipeline):
    """Takes time to solve, as faint light does. seconds: by batch."""

    def __init__(self, clock, seconds):
        super().__init__(CONFIG)
        self.clock, self.seconds = clock, iter(seconds)

    def solve(self, batch):
        self.clock.now += next(self.seconds)
        return super().solve(batch)


def run(seconds, count):
    """The run, the names of its events, its poses in order, and the messages after each batch."""
    clock, memory, messages = Clock(), Memory(), []
    live = Live(Slow(clock, seconds), clock, sinks=[memory])
    loop = Loop(live, Board(clock, count), lambda now: messages.append(now.messages()))
    loop.run(Ending())
    loop.finish()
    loop.report_end(0, [])
    live.end_events()
    live.deliver_events()
    columns = join_columns(memory.parts)
    order = np.argsort(columns["seq"])
    poses = {name: column[order] for name, column in columns.items()}
    assert memory.events[-1][1]["statuses"] == dict(live.pipeline.tally.statuses)
    return live, [name for name, _ in memory.events], poses, messages


def solve_in_turn(count):
    """What the poses are where there is all the time in the world."""
    pipeline = Pipeline(CONFIG)
    parts = [pipeline.feed(block.data, block.arrival) for block in Board(Clock(), count).blocks]
    return join_columns([part.columns() for part in parts])


def test_a_loop_in_time_solves_in_turn_and_says_nothing():
    live, events, poses, messages = run(repeat(1e-3), 50)
    assert not any(messages)
    assert events == ["end"]
    assert compare(poses, solve_in_turn(50)).is_same
    assert live.late == live.pipeline.tally.skipped_count == 0


def test_a_loop_that_falls_behind_says_so_keeps_up_with_the_newest_and_catches_up():
    """30 batches take 20 ms each, ten times what there is; then it goes fast again."""
    live, events, poses, messages = run([0.02] * 30 + [1e-4] * 470, 500)
    assert events == ["behind", "caught up", "end"]
    assert any(messages)
    assert not messages[-1]
    assert live.latency_p99() < NEWEST_FIRST_AFTER_S + 2 * 0.02 + 0.002
    assert live.late > 0
    assert live.pipeline.tally.skipped_count == 0
    assert len(poses["seq"]) == 500 * EACH
    # in whatever order they were solved, to the last bit
    assert compare(poses, solve_in_turn(500)).is_same


def test_what_there_is_never_time_for_is_given_up_by_name(monkeypatch):
    """Twice too slow for ever: all is accounted for, half is skipped, the newest is not old."""
    monkeypatch.setattr("facets.live.run.loop.GIVE_UP_AFTER_S", 0.5)
    monkeypatch.setattr("facets.live.run.loop.FINISH_S", 0.05)
    live, events, poses, _ = run(repeat(4e-3), 1_000)
    assert events == ["behind", "caught up", "end"]
    assert (poses["seq"] == np.arange(1_000 * EACH)).all()
    skipped = poses["status"] == Status.SKIPPED
    assert 0.35 < skipped.mean() < 0.55
    assert skipped.sum() == live.pipeline.tally.skipped_count
    assert np.isnan(poses["tx_mm"][skipped]).all()
    assert live.latency_p99() < NEWEST_FIRST_AFTER_S + 0.02


def test_nobody_who_tells_of_an_event_waits_for_those_who_hear_it():
    memory = Memory()
    live = Live(Pipeline(CONFIG), sinks=[memory])
    live.add_event("stop", reason="no light")
    assert not memory.events
    live.end_events()
    live.deliver_events()
    ((name, details),) = memory.events
    assert (name, details["reason"]) == ("stop", "no light")
    assert details.keys() >= {"monotonic", "utc"}


def follow(stage):
    """A run whose stage follows, its loop, and the port of the stage."""
    port, law = stage_on(stage), Law.from_sensor(CONFIG.sensor, stage)
    tracker = Tracker(Envelope(port, stage, print, port.clock), law)
    live = Live(Pipeline(CONFIG), Clock(), tracker=tracker)
    return live, Loop(live, Board(live.clock, 0)), port


def test_a_loss_of_the_board_s_permit_is_found_in_a_backlog_too():
    """25 ms without it in the midst of 75 ms that wait, of which the newest are solved first."""
    live, loop, port = follow(replace(CONFIG.stage, permit="board"))
    samples = samples_of(facets.readings(CONFIG.sensor, np.zeros((750, 8))))
    samples.flags[:] = PERMIT
    samples.flags[250:500] = 0
    for first in range(0, 750, 250):
        block = pack(samples.where(slice(first, first + 250)))
        loop.take(Block(block, port.now + 1e-4 * first, None))
    live.clock.now = port.now + 0.2
    loop.solve_batch()
    assert live.newest.seq[-1] == 749
    assert live.tracker.envelope.permit.allows_motion(port.now) is False


def test_a_stage_is_stopped_after_a_suspend_of_the_computer():
    """The board's clock goes on by a minute in which the computer's stands still, as on Linux."""
    live, loop, _ = follow(CONFIG.stage)
    samples = samples_of(facets.readings(CONFIG.sensor, np.zeros((12_000, 8))))
    samples.seq[10_000:] += 600_000
    samples.time[10_000:] += 60_000_000
    for first in range(0, 12_000, 100):
        assert (live.tracker.halted == CLOCK_MOVED) == (first > 10_000)
        block = pack(samples.where(slice(first, first + 100)))
        loop.take(Block(block, 10.0 + 1e-4 * first, None))


def compare(recorded, replayed):
    comparison = PoseComparison(iter([recorded]))
    comparison.add(replayed)
    comparison.finish()
    return comparison


def test_a_comparison_knows_what_it_can_not_compare():
    whole = solve_in_turn(10)
    part = {name: column.copy() for name, column in whole.items()}
    part["status"][20:40] = Status.SKIPPED
    part["tx_mm"][20:40] = np.nan
    comparison = compare(part, whole)
    assert (comparison.is_same, comparison.skipped, comparison.absent) == (True, 20, 0)
    assert compare(part, {name: column[60:] for name, column in whole.items()}).absent == 40
    part["tx_mm"][100] += 3 * part["u_tx_mm"][100]
    comparison = compare(part, whole)
    assert (comparison.is_same, comparison.different) == (False, 1)
    assert comparison.worst == pytest.approx(3)
    part["tx_mm"][100] = np.nan
    assert compare(part, whole).worst == np.inf


def test_skipped_samples_of_a_calibrated_rig_have_the_parts_of_an_uncertainty():
    pipeline = Pipeline(CALIBRATED)
    (batch,) = pipeline.take(kills.stream(40), 1_000.0)
    solved, skipped = pipeline.solve(batch).columns(), pipeline.skip(batch).columns()
    assert solved.keys() == skipped.keys()
    assert np.isnan(skipped["u_noise_tz_mm"]).all()
    before = {name: column for name, column in solved.items() if "u_noise" not in name}
    assert compare(before, solved).is_same  # a recording of before


def test_a_terminal_that_is_gone_ends_the_view_and_not_the_loop():
    clock = Clock()

    def show(_):
        raise OSError(5, "Input/output error")

    live = Live(Pipeline(CONFIG), clock)
    Loop(live, Board(clock, 10), show).run(Ending())
    assert live.pipeline.tally.samples == 10 * EACH


def test_the_place_of_a_moving_beam_is_known_as_well_as_its_age_and_speed_allow():
    config = replace(CONFIG, solve=replace(CONFIG.solve, beam="known"))
    encoder = Encoder(10.0, np.array([1.0, 2.0]), np.array([3.0, 4.0]))

    def beam_at(host):
        known = locate(config, np.array([host]), host, encoder)
        place, sigma = known["place"], known["place_sigma"]
        samples = facets.Samples(np.zeros((1, 9)), place=place, place_sigma=sigma)
        return facets.Measurement(config).knowledge(samples).beam

    beam = beam_at(10.02)
    assert beam.mean == pytest.approx(np.array([[1.06, 2.08]]) + CONFIG.solve.beam_offset)
    still = np.hypot(CONFIG.stage.accuracy, CONFIG.sensor.electronics.pointing)
    assert beam.sigma == pytest.approx(np.hypot(still, 5 * (1e-3 + 0.01)))  # half the way, and 1 ms
    assert beam_at(99.0) == "free"


def test_older_files_accept_poses_from_two_detectors(tmp_path):
    (tmp_path / "rig.yaml").write_text("extends: bench\nacquire: {detectors: 2}\n")
    assert not CONFIG.solve.accept_unchecked
    assert facets.load(tmp_path / "rig.yaml").solve.accept_unchecked


@pytest.mark.parametrize("offset", [0.0, 5.0])
def test_poses_of_another_geometry_are_not_believed_without_a_word(offset):
    """Detectors that stand elsewhere than the configuration says: solved, counted, and told."""
    psds = tuple(
        replace(psd, radius=psd.radius + offset * n) for n, psd in enumerate(CONFIG.sensor.psds)
    )
    options = replace(CONFIG.solve, beam="known")
    pipeline = Pipeline(replace(CONFIG, sensor=replace(CONFIG.sensor, psds=psds), solve=options))
    for block in Board(Clock(), 5).blocks:
        pipeline.feed(block.data, block.arrival)
    misfit = pipeline.tally.misfit
    assert misfit.judged == 100
    assert (misfit.flagged > 90) == bool(misfit.sentence) == (offset > 0)
    assert bool(Live(pipeline).messages()) == (offset > 0)


@pytest.mark.parametrize(
    ("light", "flag", "words"),
    [(np.nan, 1, "are saturated"), (0.0, 0, "light is lost on detector B")],
)
def test_what_can_not_be_believed_is_said_in_a_line_each_while_it_lasts(light, flag, words):
    """Every other sample: with two converters at their end, or with a dark detector B."""
    pipeline = Pipeline(CONFIG)
    (batch,) = pipeline.take(kills.stream(40), 1.0)
    batch.readings[::2, 3 : 9 if flag else 6] = light
    batch.flags[::2] |= flag
    status = pipeline.solve(batch).solution.status
    assert (
        (status[::2] == Status.SATURATED).sum() == pipeline.tally.statuses["saturated"] == 20 * flag
    )
    rows, fine = np.arange(5_000) % 40, np.zeros(5_000, bool)
    look, live = pipeline.doubts.add, Live(pipeline)
    look(batch.readings[rows], batch.flags[rows], fine, fine)
    (text,) = live.messages()
    assert words in text
    look(np.ones((5_000, 9)), np.zeros(5_000, np.uint8), fine, fine)
    assert live.messages() == []  # and no longer than it lasts
