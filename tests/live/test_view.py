"""What a person sees of a run, on terminals of any size."""

from __future__ import annotations

import io
import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from facets.experiments import kills
from rich.console import Console

import facets
from facets.core import DARK, LIGHT
from facets.live import Live, Pipeline
from facets.live.run import view

CONFIG = facets.load("bench")


def live(light=1.0):
    """A run whose newest sample has so much of its light."""
    now = Live(Pipeline(CONFIG))
    now.newest = now.pipeline.feed(kills.stream(60), 1.0)
    now.newest.readings[:, 2::3] *= light
    return now


def drawn(now, wide, high=40):
    console = Console(width=wide, height=high, file=io.StringIO(), legacy_windows=False)
    console.print(view.Screen(now))
    return console.file.getvalue().splitlines()


@pytest.mark.parametrize("wide", [30, 45, 80, 200])
@pytest.mark.parametrize("high", [24, 60])
def test_all_three_detectors_are_seen_on_any_terminal(wide, high):
    lines = drawn(live(), wide, high)
    assert max(map(len, lines)) <= wide
    assert sum(line.count("●") for line in lines) == 3
    assert any(all(f"{letter} " in line for letter in "ABC") for line in lines)
    if wide >= 45:
        assert sum(line.count("µW") for line in lines) == 3
        assert len(lines) <= high


def test_a_stopped_stage_is_said_before_all_else():
    now, envelope = live(), SimpleNamespace(latched="the beam is lost")
    now.note = "unplugged; waiting for it to come back"
    now.tracker = SimpleNamespace(error="", note="", is_resumable=True, envelope=envelope)
    first, second = now.messages()
    assert first.startswith("the stage is stopped, the recording goes on: the beam is lost")
    assert second == now.note


def test_the_parts_of_an_uncertainty_are_seen_where_there_is_space():
    known = facets.Calibration(("psd_a.height",), ((1e-6,),))
    config = replace(CONFIG, sensor=replace(CONFIG.sensor, calibration=known))
    now = Live(Pipeline(config))
    now.newest = now.pipeline.feed(kills.stream(60), 1.0)
    values = view.values(now)
    whole = values["u_noise_tz_um"] ** 2 + values["u_calibration_tz_um"] ** 2
    assert whole == pytest.approx(values["u_tz_um"] ** 2, rel=1e-3)
    for wide in (30, 62, 90, 120):
        lines = drawn(now, wide)
        assert max(map(len, lines)) <= wide
        assert ("calibration" in "".join(lines)) == (wide >= 90)
        assert sum(line.count("●") for line in lines) == 3
    assert "calibration" not in "".join(drawn(live(), 120))


def test_no_light_is_called_so():
    for light in (0.0, np.nan):
        text = "\n".join(drawn(live(light), 80))
        assert "no light" in text
        assert "nan" not in text
    assert "-" in "\n".join(drawn(Live(Pipeline(CONFIG)), 80))


def test_a_line_names_the_axes_and_shows_two_digits_of_the_noise():
    found = view.plain_line(live())
    place, fine = re.search(r"tz (-?\d+\.(\d+)) mm  roll", found).groups()
    assert 10 <= 10 ** len(fine) * 1e-3 * view.values(live())["u_tz_um"] < 100
    assert float(place) == pytest.approx(view.values(live())["tz_mm"], abs=10.0 ** -len(fine))


def test_a_loop_that_is_behind_says_so_in_every_view():
    now = live()
    now.behind, now.age, now.late = True, 1.5, 7
    words = "1.5 s behind"
    assert words in view.plain_line(now)
    found = json.loads(view.json_line(now))
    assert words in found["note"]
    assert (found["behind_s"], found["late"], found["skipped"]) == (1.5, 7, 0)
    assert words in "\n".join(drawn(now, 200))
    assert any("fell behind: 7 samples" in line for line in view.summary(now))


@pytest.fixture
def clock(monkeypatch):
    """A clock that stands; the test moves it."""
    clock = SimpleNamespace(now=1000.0, monotonic=lambda: clock.now)
    monkeypatch.setattr("facets.live.run.live.time", clock)
    return clock


def test_the_last_pose_of_a_silent_board_is_not_the_present_one(clock):
    now = live()
    now.add_arrival(clock.now)
    clock.now += 0.9
    assert "yaw_mrad" in view.values(now)
    assert not now.messages()
    clock.now += 8.1
    found = json.loads(view.json_line(now))
    assert "yaw_mrad" not in found
    assert (found["loss"], found["silent_s"]) == (1.0, 9.0)
    assert "no pose" in view.plain_line(now)
    assert "lost 0 (100 %)" in view.plain_line(now)
    assert "no sample has come for 9 s" in found["note"]
    assert "no sample has come for 9 s" in "\n".join(drawn(now, 80))
    assert "●" not in "\n".join(drawn(now, 80))
    assert any("100.0000 % lost" in line for line in view.summary(now))
    now.backlog = 10  # samples that wait are no silence
    assert not now.messages()
    now.backlog = 0
    now.add_arrival(clock.now)
    assert "yaw_mrad" in view.values(now)
    assert not now.messages()


def test_a_slow_board_is_not_silent_between_its_samples(clock):
    now = live()
    now.pipeline.tally.samples = 0
    for _ in range(3):
        clock.now += 20
        now.pipeline.tally.samples += 1
        now.add_arrival(clock.now)
    clock.now += 20
    assert not now.messages()
    assert now.loss == 0


def test_a_note_on_a_line_without_samples_ends_with_the_first_sample(clock):
    now = Live(Pipeline(CONFIG), begin=clock.now)
    clock.now += 3
    assert "no bytes arrive" in now.messages()[0]
    now.bytes = 1
    assert "bytes arrive, but no sample" in now.messages()[0]
    now.add_arrival(clock.now)
    assert not now.messages()


@pytest.mark.parametrize("steps", [(2e-3, 2e-3), (1e-3, 2e-3)], ids=["board", "both clocks"])
def test_fewer_samples_than_before_are_told(clock, steps):
    """By the board's clock, or where this became as slow as the samples."""
    now, arrival = Live(Pipeline(CONFIG)), clock.now
    sequence = now.pipeline.sequence
    sequence.seq = sequence.time = 0
    for part in range(100):
        is_slow = part >= 50
        sequence.seq += 100
        sequence.time += int(1e8 * (steps[0] if is_slow else 1e-3))
        arrival += 100 * (steps[1] if is_slow else 1e-3)
        now.add_arrival(arrival)
        clock.now = arrival
        assert is_slow or not now.messages()
    assert now.messages() == ["only 500 samples come per second; before, there were 1000"]


def hues_in(now, wide=80):
    """The hues that a screen with all of them shows, as "#RRGGBB"."""
    console = Console(width=wide, height=24, file=io.StringIO(), force_terminal=True,
                      color_system="truecolor", legacy_windows=False)  # fmt: skip
    console.print(view.Screen(now))
    codes = re.findall(r"38;2;(\d+);(\d+);(\d+)", console.file.getvalue())
    return {"#" + "".join(f"{int(part):02X}" for part in code) for code in codes}


@pytest.mark.parametrize(("ground", "hues"), [("15;0", DARK), ("", DARK), ("0;15", LIGHT)])
def test_detectors_and_axes_have_their_hues(monkeypatch, ground, hues):
    monkeypatch.setenv("COLORFGBG", ground)
    monkeypatch.delenv("NO_COLOR", raising=False)
    found = hues_in(live())
    assert {*hues.detectors.values(), *hues.axes.values()} <= found
    assert hues.alarm not in found


def test_a_fault_stands_out(monkeypatch):
    monkeypatch.setenv("COLORFGBG", "15;0")
    monkeypatch.delenv("NO_COLOR", raising=False)
    now = live()
    now.late = 7
    assert DARK.alarm in hues_in(now)
    assert DARK.alarm in hues_in(now, 45)


def test_at_eighty_columns_all_stands_within_a_small_terminal():
    lines = drawn(live(), 80, 24)
    assert len(lines) <= 24
    assert any(line.lstrip("▌").startswith("tx") and "samples" in line for line in lines)
    assert any("p99" in line for line in lines)
