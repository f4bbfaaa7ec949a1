"""What a person sees of a run, on terminals of any size."""

from __future__ import annotations

import io
import json
import re
import time
from types import SimpleNamespace

import numpy as np
import pytest
from facets.experiments.studies import kills
from rich.console import Console
from streams import BENCH, CALIBRATED, Clock

from facets.live import Live, Pipeline
from facets.live.run import view


def live(light=1.0, config=BENCH, clock=time.monotonic):
    """A run whose newest sample has so much of its light."""
    now = Live(Pipeline(config), clock)
    now.newest = now.pipeline.feed(kills.stream(60), 1.0)
    now.newest.readings[:, 2::3] *= light
    return now


def drawn(now, wide=80, high=40):
    console = Console(width=wide, height=high, file=io.StringIO(), legacy_windows=False)
    console.print(view.Screen(now))
    return console.file.getvalue()


def test_all_three_detectors_are_seen_and_the_parts_of_uncertainties_are_in_json():
    text = drawn(live())
    assert max(map(len, text.splitlines())) <= 80
    assert re.findall(r"▌([ABC]) .*µW", text) == ["A", "B", "C"]
    now = view.values(live(config=CALIBRATED))
    whole = now["u_noise_tz_um"] ** 2 + now["u_calibration_tz_um"] ** 2
    assert whole == pytest.approx(now["u_tz_um"] ** 2, rel=1e-3)


@pytest.mark.parametrize(("error", "latched"), [("gone", ""), ("", "the beam is lost")])
def test_a_stopped_stage_is_said_before_all_else(error, latched):
    now, envelope = live(), SimpleNamespace(latched=latched)
    now.note = "unplugged; waiting for it to come back"
    now.tracker = SimpleNamespace(error=error, note="", is_resumable=True, envelope=envelope)
    first, second = now.messages()
    assert first.startswith(f"the stage is stopped, the recording goes on: {error or latched}")
    assert second == now.note


def test_no_light_is_called_so():
    for light in (0.0, np.nan):
        text = drawn(live(light))
        assert "no light" in text
        assert "nan" not in text
    assert "-" in drawn(Live(Pipeline(BENCH)))


def test_a_line_names_the_axes_and_shows_two_digits_of_the_noise():
    now = live()
    place, fine = re.search(r"tz (-?\d+\.(\d+)) mm  roll", view.plain_line(now)).groups()
    values, step = view.values(now), 10.0 ** -len(fine)
    assert 10 <= 1e-3 * values["u_tz_um"] / step < 100
    assert float(place) == pytest.approx(values["tz_mm"], abs=step)


def test_a_loop_that_is_behind_says_so_in_every_view():
    now = live()
    now.behind, now.age, now.late = True, 1.5, 7
    values = json.loads(view.json_line(now))
    for text in (view.plain_line(now), values["note"], drawn(now, 200)):
        assert "1.5 s behind" in text
    assert (values["behind_s"], values["late"]) == (1.5, 7)
    assert any("fell behind: 7 samples" in line for line in view.summary(now))


@pytest.fixture
def clock():
    """A clock that stands; the test moves it."""
    return Clock()


def test_the_last_pose_of_a_silent_board_is_not_the_present_one(clock):
    now = live(clock=clock)
    now.add_arrival(clock.now)
    clock.now += 0.9
    assert "yaw_mrad" in view.values(now)
    assert not now.messages()
    clock.now += 8.1
    values = json.loads(view.json_line(now))
    assert "yaw_mrad" not in values
    assert (values["loss"], values["silent_s"]) == (1.0, 9.0)
    line, screen = view.plain_line(now), drawn(now)
    assert "no pose" in line
    for text in (values["note"], screen):
        assert "no sample has come for 9 s" in text
    assert "µW" not in screen
    assert any("100.0000 % lost" in line for line in view.summary(now))
    now.backlog = 10  # samples that wait are no silence
    assert not now.messages()
    now.backlog = 0
    now.add_arrival(clock.now)
    assert "yaw_mrad" in view.values(now)


def test_a_slow_board_is_not_silent_between_its_samples(clock):
    now = live(clock=clock)
    now.pipeline.tally.samples = 0
    for _ in range(3):
        clock.now += 20
        now.pipeline.tally.samples += 1
        now.add_arrival(clock.now)
    clock.now += 20
    assert not now.messages()
    assert now.loss == 0


def test_a_note_on_a_line_without_samples_ends_with_the_first_sample(clock):
    now = Live(Pipeline(BENCH), clock, begin=clock.now)
    clock.now += 3
    assert "no bytes arrive" in now.messages()[0]
    now.bytes = 1
    assert "bytes arrive, but no sample" in now.messages()[0]
    now.add_arrival(clock.now)
    assert not now.messages()
