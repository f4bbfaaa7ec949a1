"""Runs on a virtual bench that shares their clock: no machine is too busy for them."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
from recorded import events_of
from stage_world import stage_on

import facets
from facets.core import Sine
from facets.live import Pipeline, Run, RunOptions, recorded_poses, summary

CONFIG = facets.load("bench")
PORTS = ("--port", "bench/board", "--stage-port", "bench/stage")
ZERO, ONES = (0.0,) * 8, (1.0,) * 8
#: A circle with a radius of 4 mm, once in 4 s, whose light only a stage that follows keeps.
CIRCLE = Sine(ZERO, (4.0, 4.0, *ZERO[2:]), ONES, (np.pi / 2, *ZERO[1:]), 400, 100.0)


@pytest.fixture(autouse=True)
def clock_without_pauses(monkeypatch):
    """Nobody watches: the clock advances as fast as the run computes."""
    hasty = SimpleNamespace(monotonic=time.monotonic, sleep=lambda _: None)
    monkeypatch.setattr("facets.live.virtual.in_process.time", hasty)


@pytest.fixture
def busy(monkeypatch):
    """A machine that stands still for longer than a watchdog waits, again and again."""
    numbers, solve = count(), Pipeline.solve

    def solve_late(pipeline, batch):
        if next(numbers) % 100 == 0:
            time.sleep(0.12)
        return solve(pipeline, batch)

    monkeypatch.setattr(Pipeline, "solve", solve_late)


def run_on(port, config=CONFIG, **options):
    run = Run.from_config(config, port, RunOptions(record="folder" in options, **options))
    run.acquire()
    return run


def test_a_stage_follows_on_a_busy_machine_and_nothing_is_late(tmp_path, busy):
    config = replace(CONFIG, motions={"circle": CIRCLE})
    run = run_on("virtual:circle,rate=500", config, track=True, seconds=2.0, folder=tmp_path / "r")
    live = run.live
    assert run.complaints() == []
    assert live.end - live.begin == pytest.approx(2.0, abs=0.01)
    assert live.tracker.envelope.stops == live.pipeline.sequence.lost == live.beam_loss.lost == 0
    assert live.tracker.moves == pytest.approx(200, abs=5)  # at `stage.rate_hz`
    poses, events = recorded_poses(tmp_path / "r"), events_of(tmp_path / "r")
    assert len(poses["seq"]) == pytest.approx(1000, abs=5)
    assert (poses["status"] == 0).all()
    assert np.hypot(poses["tx_mm"], poses["ty_mm"]) == pytest.approx(4.0, abs=0.01)
    moved = [event["monotonic"] for event in events if event["event"] == "move"]
    assert np.ptp(moved) == pytest.approx(np.ptp(poses["host_s"]), abs=0.03)


def test_a_stage_is_checked_on_a_busy_machine(busy):
    run = run_on("virtual:rest,rate=200", check_stage=True)
    assert run.complaints() == []
    assert "zaber virtual" in list(run.check_sentences(None))[-1]
    for axis in run.check.axes():
        assert axis.scale == pytest.approx(1.0, abs=1e-3)
        assert axis.delay == pytest.approx(CONFIG.stage.latency + CONFIG.stage.lag, abs=4e-3)


def test_a_stage_must_be_checked_before_it_follows(tmp_path, run_in_process):
    """`run_chain` follows a stage by the configuration that its check has written."""
    (tmp_path / "mine.yaml").write_text("extends: bench\nstage: {step_um: 0.2}\n")
    status, _, errors = run_in_process("acquire", "mine.yaml", "--track", *PORTS)
    assert status == 2
    assert "--check-stage" in errors
    assert "is not the stage that is configured now" in errors
    assert not (tmp_path / "recordings").exists()
    status, output, errors = run_in_process(
        "acquire", "mine.yaml", "--check-stage", "--port", "virtual:rest,rate=200,config=bench",
        "--plain", "--write", "bad.yaml",
    )  # fmt: skip
    assert status == 1, output + errors
    assert "correct stage.step_um" in errors
    assert not (tmp_path / "bad.yaml").exists()


def test_the_faults_of_a_board_are_those_that_the_run_counts():
    run = run_on("virtual:wobble,rate=2000,drop=5e-3,flip=5e-3", samples=4000, max_loss=1.0)
    pipeline, made = run.live.pipeline, run.reader.bench.count
    assert made.dropped + made.spoilt > 10
    assert pipeline.sequence.lost == pytest.approx(made.dropped + made.spoilt, abs=3)
    assert pipeline.tally.samples + pipeline.sequence.lost == pytest.approx(made.made, abs=50)


@pytest.mark.parametrize(
    ("driver", "faults", "reason"),
    [
        ("zaber", "", ""),
        ("pi", "", ""),
        ("pi", ",permit=1e4", "the external permit is not given"),
        ("zaber", ",block=1e4", "not every detector has light"),
    ],
)
def test_a_stage_with_a_permit_and_a_heartbeat_is_stopped_as_a_real_one(driver, faults, reason):
    stage = replace(CONFIG.stage, driver=driver, permit="board", heartbeat="board")
    config = replace(CONFIG, stage=stage)
    run = run_on(f"virtual:wobble,rate=500{faults}", config, track=True, seconds=0.5)
    assert reason in run.live.stage_stop
    assert bool(run.live.stage_stop) == bool(reason)
    assert bool(run.reader.bench.count.moves) == (not reason)
    text = "\n".join(summary(run.live))
    assert "p99" not in text  # by a clock that stands while the run computes
    assert "real-time priority" not in text


def test_only_a_virtual_stage_has_the_clock_of_a_virtual_bench(monkeypatch, tmp_path):
    (tmp_path / "empty").write_bytes(b"")
    monkeypatch.setattr("facets.live.stage_setup.open_line", lambda *_: stage_on(CONFIG.stage))
    real = Run.from_config(
        CONFIG,
        f"file:{tmp_path}/empty",
        RunOptions(record=False, track=True, stage_port="bench/stage"),
    )
    assert real.live.tracker.clock is real.live.tracker.envelope.clock is time.monotonic
    assert real.live.clock is time.monotonic
    real.abandon()
    virtual = Run.from_config(CONFIG, "virtual:rest", RunOptions(record=False, track=True))
    assert virtual.live.tracker.clock is virtual.live.clock is virtual.reader.bench.clock
    assert virtual.live.tracker.envelope.open_again().bench is virtual.reader.bench
    virtual.abandon()


@pytest.mark.parametrize(
    ("port", "stage", "options", "words"),
    [
        ("virtual:", {}, {}, "no motion ; its motions: "),
        ("virtual:cirkel", {}, {}, "no motion cirkel"),
        ("virtual:rest,rate=0", {}, {}, "rate is a whole number from 1 to 200000"),
        ("virtual:rest,flip=x", {}, {}, "flip=x"),
        ("virtual:rest,flop=1", {}, {}, "config, rate, reference, flip"),
        ("virtual:rest,config=none.yaml", {}, {}, "none.yaml"),
        ("virtual:rest", {}, {"stage_port": "COM3"}, "has a stage of its own"),
        ("virtual:rest", {"permit": "file:permit"}, {}, "nothing real may depend"),
        ("virtual:rest", {"heartbeat": "ni:Dev1/port0/line0"}, {}, "nothing real may depend"),
        ("virtual:rest", {"driver": "other"}, {}, "use zaber"),
    ],
)
def test_what_a_bench_in_the_process_cannot_be_is_refused(port, stage, options, words):
    config = replace(CONFIG, stage=replace(CONFIG.stage, **stage))
    with pytest.raises(facets.FacetsError, match=words):
        run_on(port, config, track=True, **options)
