"""The loop that solves what comes, on a clock that only the test moves."""

from __future__ import annotations

from dataclasses import replace
from queue import Empty

import numpy as np
import pytest
from facets.experiments import kills

import facets
from facets import Status
from facets.live import (
    FULL,
    SIZE,
    SKIPPED,
    TWO_DETECTORS,
    Block,
    Ending,
    Live,
    Loop,
    Pipeline,
    Sink,
    compare,
    join_columns,
    join_poses,
    pose_columns,
)
from facets.live.run import loop as module

CONFIG = facets.load("bench")
EACH = 20


class Clock:
    now = 1_000.0

    def monotonic(self):
        return self.now


class Board:
    """A reader whose blocks come when the clock says so; every 2 ms one."""

    port = error = None

    def __init__(self, clock, count, every=2e-3):
        self.clock, self.queue = clock, self
        data = kills.stream(count * EACH)
        size = EACH * SIZE
        self.blocks = [
            Block(data[n * size : (n + 1) * size], clock.now + every * (n + 1), None)
            for n in range(count)
        ]

    def get(self, timeout):
        if not self.blocks:
            raise Empty
        self.clock.now = max(self.clock.now, self.blocks[0].arrival)
        return self.get_nowait()

    def get_nowait(self):
        if not self.blocks or self.blocks[0].arrival > self.clock.now:
            raise Empty
        return self.blocks.pop(0)

    def empty(self):
        return not self.blocks

    def is_alive(self):
        return bool(self.blocks)


class Kept(Sink):
    """A recording in memory."""

    def __init__(self):
        self.events, self.parts = [], []

    def add_event(self, name, **more):
        self.events.append((name, more))

    def add_poses(self, poses):
        self.parts.append(pose_columns(poses))


class Slow(Pipeline):
    """Takes time to solve, as faint light does. seconds: by batch, then the last for ever."""

    def __init__(self, clock, seconds):
        super().__init__(CONFIG)
        self.clock, self.seconds = clock, list(seconds)

    def solve(self, batch):
        self.clock.now += self.seconds.pop(0) if len(self.seconds) > 1 else self.seconds[0]
        return super().solve(batch)


def run(monkeypatch, seconds, count):
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    monkeypatch.setattr("facets.live.run.live.time", clock)
    kept = Kept()
    live = Live(Slow(clock, seconds), sinks=[kept], begin=clock.now)
    seen = []
    loop = Loop(live, Board(clock, count), lambda now: seen.append(now.messages()))
    loop.run(Ending())
    loop.finish()
    loop.report_end(0, [])
    return live, kept, seen


def in_order(columns):
    order = np.argsort(columns["seq"])
    return {name: column[order] for name, column in columns.items()}


def in_turn(count):
    """What the poses are where there is all the time in the world."""
    pipeline = Pipeline(CONFIG)
    parts = [pipeline.feed(b.data, b.arrival) for b in Board(Clock(), count).blocks]
    return join_columns([pose_columns(part) for part in parts])


def test_a_loop_in_time_solves_in_turn_and_says_nothing(monkeypatch):
    live, kept, seen = run(monkeypatch, [1e-3], 50)
    assert not any(seen)
    assert [name for name, _ in kept.events] == ["end"]
    columns = join_columns(kept.parts)
    assert (np.diff(columns["seq"]) == 1).all()
    assert compare(columns, in_turn(50)).is_same
    assert live.late == live.pipeline.tally.skipped_count == 0


def test_a_loop_that_falls_behind_says_so_keeps_up_with_the_newest_and_catches_up(monkeypatch):
    """30 batches take 20 ms each, ten times what there is; then it goes fast again."""
    live, kept, seen = run(monkeypatch, [0.02] * 30 + [1e-4], 500)
    names = [name for name, _ in kept.events]
    assert names == ["behind", "caught up", "end"]
    assert any("the newest samples are solved first" in text for part in seen for text in part)
    assert not seen[-1]
    assert live.latency_p99() < module.NEWEST_FIRST_AFTER_S + 2 * 0.02 + 0.002
    assert live.late > 0
    assert live.pipeline.tally.skipped_count == 0
    found = compare(in_order(join_columns(kept.parts)), in_turn(500))
    assert found.is_same  # in whatever order they were solved, to the last bit
    assert found.recorded == 500 * EACH


def test_what_there_is_never_time_for_is_given_up_by_name(monkeypatch):
    """Twice too slow for ever: all is accounted for, half is skipped, the newest is not old."""
    monkeypatch.setattr(module, "GIVE_UP_AFTER_S", 0.5)
    monkeypatch.setattr(module, "FINISH_S", 0.05)
    live, kept, _ = run(monkeypatch, [4e-3], 1_000)
    assert [name for name, _ in kept.events] == ["behind", "caught up", "end"]
    columns = in_order(join_columns(kept.parts))
    assert (columns["seq"] == np.arange(1_000 * EACH)).all()
    skipped = columns["status"] == SKIPPED
    assert 0.35 < skipped.mean() < 0.55
    assert skipped.sum() == live.pipeline.tally.skipped_count
    assert np.isnan(columns["tx_mm"][skipped]).all()
    assert live.latency_p99() < module.NEWEST_FIRST_AFTER_S + 0.02
    assert kept.events[-1][1]["statuses"]["skipped"] == skipped.sum()


def test_a_comparison_knows_what_it_can_not_compare():
    whole = in_turn(10)
    part = {name: column.copy() for name, column in whole.items()}
    part["status"][20:40] = SKIPPED
    part["tx_mm"][20:40] = np.nan
    found = compare(part, whole)
    assert (found.is_same, found.skipped, found.absent) == (True, 20, 0)
    less = {name: column[60:] for name, column in whole.items()}
    assert compare(part, less).absent == 40
    part["tx_mm"][100] += 3 * part["u_tx_mm"][100]
    found = compare(part, whole)
    assert (found.is_same, found.different) == (False, 1)
    assert found.worst == pytest.approx(3)
    part["tx_mm"][100] = np.nan
    assert compare(part, whole).worst == np.inf
    assert compare({}, whole).is_same


def test_poses_of_a_calibrated_rig_have_the_parts_of_their_uncertainty():
    """Also where samples were skipped; a recording of before, without the parts, compares."""
    known = facets.Calibration(("psd_a.height",), ((1e-6,),))
    pipeline = Pipeline(replace(CONFIG, sensor=replace(CONFIG.sensor, calibration=known)))
    batches = pipeline.take(kills.stream(40), 1_000.0)
    poses = [pipeline.solve(batches[0]), pipeline.skip(batches[0])]
    columns = pose_columns(join_poses(poses))
    whole = columns["u_noise_tz_mm"] ** 2 + columns["u_calibration_tz_mm"] ** 2
    np.testing.assert_allclose(whole[:40], columns["u_tz_mm"][:40] ** 2, rtol=1e-3)
    assert (columns["u_calibration_tz_mm"][:40] > 1e-4).all()
    assert np.isnan(whole[40:]).all()
    columns = {name: column[:40] for name, column in columns.items()}
    before = {name: column for name, column in columns.items() if "u_noise" not in name}
    before["tx_mm"] = before["tx_mm"] + columns["u_tx_mm"]
    assert compare(before, columns).worst == pytest.approx(1)


def test_a_terminal_that_is_gone_ends_the_view_and_not_the_loop(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)

    def show(_):
        raise OSError(5, "Input/output error")

    kept = Kept()
    live = Live(Pipeline(CONFIG), sinks=[kept])
    Loop(live, Board(clock, 10), show).run(Ending())
    assert live.pipeline.tally.samples == 10 * EACH


@pytest.mark.parametrize("light", [np.nan, 0.0, 1e-6, -1.0])
def test_a_sample_without_light_takes_no_step(light):
    """Screened by the estimator, before it is solved; see `Pipeline.solve`."""
    from dataclasses import replace

    pipeline = Pipeline(CONFIG)
    (batch,) = pipeline.take(kills.stream(40), 1.0)
    dark = batch.readings.copy()
    dark[:, 2::3] = light
    poses = pipeline.solve(replace(batch, aligned=dark))
    assert (poses.solution.iterations == 0).all()
    assert not poses.solution.ok.any()
    far = batch.readings.copy()
    far[:, ::3] = 50.0
    assert (pipeline.solve(replace(batch, aligned=far)).solution.iterations == 0).all()


def test_two_detectors_give_no_pose_that_nothing_checks():
    """Though they have one: of a mirror that stands far away here, and fits to the last digit."""
    from dataclasses import replace

    far = np.array([-3.6924, -6.3704, 0, 0, 0, 0, 0, 0])
    reading = facets.readings(CONFIG.sensor, far)
    found = facets.solve(CONFIG.sensor, reading, beam="known", accept_unchecked=True)
    assert found.ok
    assert found.used.tolist() == [True, True, False]
    assert found.residual < 1e-6
    assert np.abs(found.state - far).max() > 1.0
    statuses = {}
    for accept in (True, False):
        options = replace(CONFIG.solve, beam="known", accept_unchecked=accept)
        pipeline = Pipeline(replace(CONFIG, solve=options))
        (batch,) = pipeline.take(kills.stream(40), 1.0)
        batch.readings[10:30, 3:6] = np.nan
        solution = pipeline.solve(batch).solution
        assert (solution.converged == np.isfinite(solution.state).all(axis=1)).all()
        finite = np.isfinite(solution.covariance).all(axis=(1, 2))
        assert (solution.converged == finite).all()
        statuses[accept] = pipeline.tally.statuses
    assert statuses[True] == {"converged": 40}
    assert statuses[False] == {"converged": 20, "unchecked": 20}


def test_older_files_ask_for_poses_of_two_detectors_in_their_own_words(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text("extends: bench\nacquire: {detectors: 2}\n")
    assert facets.load(path).solve.accept_unchecked
    assert not CONFIG.solve.accept_unchecked


def test_poses_of_another_geometry_are_not_believed_without_a_word():
    """Detectors that stand elsewhere than the configuration says: solved, counted, and told."""
    from dataclasses import replace

    psds = tuple(replace(p, radius=p.radius + 5 * k) for k, p in enumerate(CONFIG.sensor.psds))
    wrong = replace(
        CONFIG, sensor=replace(CONFIG.sensor, psds=psds), solve=replace(CONFIG.solve, beam="known")
    )
    right = replace(CONFIG, solve=wrong.solve)
    found = {}
    for name, config in (("right", right), ("wrong", wrong)):
        pipeline = Pipeline(config)
        pipeline.feed(kills.stream(100), 1_000.0)
        found[name] = pipeline.tally.misfit
    assert found["right"].judged == found["wrong"].judged == 100
    assert found["right"].sentence == ""
    assert found["wrong"].is_mostly_flagged
    assert "residual beyond chance" in found["wrong"].sentence


def test_what_can_not_be_believed_is_said_in_a_line_each_while_it_lasts():
    """Saturation, lost light and a residual beyond chance, each in one of three runs."""
    from facets.live.run.doubts import LOOKED_AT

    rounds = LOOKED_AT // 40 + 1
    spoils = {
        "are saturated": lambda batch: spoil(batch.readings, batch.flags, full=True),
        "light is lost on detector B": lambda batch: spoil(batch.readings, batch.flags, full=False),
        "": lambda batch: None,
    }
    for words, spoilt in spoils.items():
        pipeline = Pipeline(CONFIG)
        (batch,) = pipeline.take(kills.stream(40), 1.0)
        spoilt(batch)
        status = pipeline.solve(batch).solution.status
        for _ in range(rounds):
            pipeline.doubts.add(batch.readings, batch.flags, *np.zeros((2, 40), bool))
        live = Live(pipeline)
        assert [words in text for text in live.messages()] == ([True] if words else [])
        if words == "are saturated":
            assert pipeline.tally.statuses["saturated"] == 20
            assert (status[::2] == FULL).all()
        for _ in range(rounds):  # and no longer than it lasts
            pipeline.doubts.add(np.ones((40, 9)), np.zeros(40, np.uint8), *np.zeros((2, 40), bool))
        assert live.messages() == []
        for _ in range(rounds):
            pipeline.doubts.add(
                np.ones((40, 9)), np.zeros(40, np.uint8), np.arange(40) < 4, np.zeros(40, bool)
            )
        (text,) = live.messages()
        assert "10 % of the newest poses have a residual beyond chance" in text


def spoil(readings, flags, full):
    """Every other sample: with two converters at their end, or with a dark detector B."""
    readings[::2, 3:6] = np.nan if full else 0.0
    if full:
        readings[::2, 6:9] = np.nan
        flags[::2] |= 1


def test_a_sample_that_was_called_non_finite_is_the_same_as_one_called_saturated():
    old, new = in_turn(2), in_turn(2)
    old["status"][:5], new["status"][:5] = Status.NON_FINITE, FULL
    assert compare(old, new).is_same
    new["status"][9] = FULL
    assert compare(old, new).different == 1


def test_a_sample_that_was_called_two_detectors_only_is_the_same_as_one_called_unchecked():
    old, new = in_turn(2), in_turn(2)
    old["status"][:5], new["status"][:5] = TWO_DETECTORS, Status.UNCHECKED
    assert compare(old, new).is_same
    new["status"][9] = Status.UNCHECKED
    assert compare(old, new).different == 1
