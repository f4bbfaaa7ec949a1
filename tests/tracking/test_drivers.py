"""What every driver of a stage must do: ours, and one that another package brings."""

from __future__ import annotations

from dataclasses import replace

import makers
import numpy as np
import pytest
from stage_world import stage_on

import facets
from facets.tracking import Envelope, StageError, check_driver, open_driver

STAGE = replace(facets.load("bench").stage, zero=(0.5, 0.0))
OTHER = replace(STAGE, driver="other")


def check(port, bench, settings=OTHER):
    check_driver(
        lambda: open_driver(port, settings, bench.clock), settings, bench.wait, bench.clock
    )


@pytest.mark.parametrize("driver", ["zaber", "pi"])
def test_drivers_of_serial_lines_keep_the_contract(driver):
    settings = replace(STAGE, driver=driver)
    bench = stage_on(settings)
    check(bench, bench, settings)
    assert bench.closed


@pytest.fixture
def bench(monkeypatch):
    """A bench whose axes are motors of pylablib."""
    makers.install(monkeypatch)
    found = stage_on(STAGE)
    monkeypatch.setattr(makers.KinesisMotor, "model", found.model)
    return found


@pytest.mark.parametrize("name", ["kinesis:27000001,27000002", "kinesis:70000001"])
def test_kinesis_keeps_the_contract(bench, name):
    check(name, bench)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("homed", False, "axis x has no reference"),
        ("units", "internal", "cannot be limited"),
        ("keeps", makers.Velocity(0.0, 1.0, 1e3), "keeps the limits"),
    ],
)
def test_a_kinesis_stage_that_can_not_be_held_back_is_not_used(
    bench, monkeypatch, name, value, words
):
    monkeypatch.setattr(makers.KinesisMotor, name, value)
    with pytest.raises(StageError, match=words):
        Envelope("kinesis:27000001,27000002", OTHER, print, bench.clock)


def test_native_limits_of_a_kinesis_stage_are_in_steps_and_given_back(bench):
    bench.model.max_speed, bench.model.acceleration = 7.0, 900.0
    settings = replace(OTHER, step=OTHER.step / 1000, native_limits=(20_000, 3_000_000))
    envelope = Envelope("kinesis:70000001", settings, print, bench.clock)
    assert (bench.model.max_speed, bench.model.acceleration) == pytest.approx((2.0, 300.0))
    assert envelope.close()
    assert (bench.model.max_speed, bench.model.acceleration) == pytest.approx((7.0, 900.0))


class Mine:
    """A driver as another package would write it: a model that it moves itself."""

    def __init__(self, name, settings):
        if name == "mine:broken":
            raise RuntimeError("board 7")
        self.model = MODELS[name]
        self.closed = False

    def prepare(self):
        self.stop()

    def place(self):
        return self.model.place.copy()

    def move(self, place):
        if self.closed:
            raise RuntimeError("closed")
        self.model.target, self.model.braking = np.array(place), False

    def stop(self, patience=5.0):
        self.model.halt()

    def emergency_stop(self):
        self.model.halt()

    def close(self):
        self.closed = True


MODELS = {}


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """Entry points of an installed package, `mine` and `none`, and their bench."""
    about = tmp_path / "mine-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Name: mine\nVersion: 1\n")
    (about / "entry_points.txt").write_text(
        f"[facets.stages]\nmine = {__name__}:Mine\nnone = operator:is_\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    found = stage_on(STAGE)
    MODELS["mine:1"] = found.model
    return found


def test_another_packages_driver_keeps_the_contract_and_is_held_back(mine):
    check("mine:1", mine)
    envelope = Envelope("mine:1", OTHER, print, mine.clock)
    mine.model.place[0] = np.nan
    with pytest.raises(StageError, match="an invalid position"):
        envelope.look()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mine:broken", "RuntimeError: board 7"),
        ("none:1", "gives no driver: it has no prepare, place, move, stop, emergency_stop, close"),
        ("what:1", "there is no driver for a stage of that name; .* kinesis:, mine:, none:"),
        ("mine:1", "it has no restore_limits"),
    ],
)
def test_what_is_no_driver_is_told(mine, name, words):
    with pytest.raises(StageError, match=words):
        Envelope(name, replace(OTHER, native_limits=(1, 1)), print, mine.clock)


def test_a_driver_with_a_missing_method_is_closed(mine, monkeypatch):
    closed = []
    monkeypatch.delattr(Mine, "emergency_stop")
    monkeypatch.setattr(Mine, "close", lambda self: closed.append(self))
    with pytest.raises(StageError, match="it has no emergency_stop"):
        Envelope("mine:1", OTHER, print, mine.clock)
    assert len(closed) == 1


class Faulty(Mine):
    """A driver with one fault of each kind."""

    fault = ""

    def place(self):
        place = super().place()
        return place * np.nan if self.fault == "nan" else place

    def emergency_stop(self):
        if self.fault != "deaf":
            super().emergency_stop()

    def move(self, place):
        if self.fault == "fast":
            self.model.place = np.array(place)
        super().move(place + 0.1 if self.fault == "past" else place)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("nan", r"place\(\) gives"),
        ("deaf", r"emergency_stop\(\) did not stop|still moves after emergency_stop"),
        ("fast", "faster than max_speed"),
        ("past", "the stage is at .*, not at|past its goal"),
    ],
)
def test_the_contract_finds_faults(mine, fault, words):
    def opened():
        driver = Faulty("mine:1", OTHER)
        driver.fault = fault
        return driver

    with pytest.raises(AssertionError, match=words):
        check_driver(opened, OTHER, mine.wait, mine.clock)
