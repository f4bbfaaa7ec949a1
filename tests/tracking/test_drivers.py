"""What every driver of a stage must do: ours, and one that another package brings."""

from __future__ import annotations

import threading
from dataclasses import replace
from importlib.metadata import EntryPoint

import makers
import numpy as np
import pytest

import facets
from facets.live import PiController, ZaberDevice
from facets.tracking import Envelope, StageError, StageModel
from facets.tracking import drivers as module
from facets.tracking.contract import check_driver
from facets.tracking.drivers import open_driver

STAGE = replace(facets.load("bench").stage, zero=(0.5, 0.0))
OTHER = replace(STAGE, driver="other")


class Bench:
    """A stage's model and its clock; `port` puts an emulator behind a serial line."""

    def __init__(self, settings):
        self.settings, self.model, self.now = settings, StageModel(settings), 10.0
        self.model.now, self.model.STEP = self.now, 1e-3
        self.turn, self.replies, self.closed = threading.Lock(), b"", False
        zaber = settings.driver == "zaber"
        self.device = ZaberDevice(self.model) if zaber else PiController(self.model)

    def clock(self):
        return self.now

    def wait(self, seconds):
        with self.turn:
            self.now += seconds
            self.model.advance(self.now)

    def write(self, data):
        if self.closed:
            raise OSError("the port is closed")
        with self.turn:
            self.replies += self.device.receive(data)

    def read(self, size):
        if not self.replies:
            self.wait(0.02)
        with self.turn:
            data, self.replies = self.replies[:size], self.replies[size:]
        return data

    def close(self):
        self.closed = True


@pytest.mark.parametrize("driver", ["zaber", "pi"])
def test_drivers_of_serial_lines_keep_the_contract(driver):
    settings = replace(STAGE, driver=driver)
    bench = Bench(settings)
    check_driver(lambda: open_driver(bench, settings, bench.clock), settings, bench.wait,
                 bench.clock)  # fmt: skip
    assert bench.closed


@pytest.fixture
def bench(monkeypatch):
    """A bench whose axes are motors of pylablib."""
    makers.install(monkeypatch)
    found = Bench(OTHER)
    monkeypatch.setattr(makers.KinesisMotor, "model", found.model)
    return found


@pytest.mark.parametrize("name", ["kinesis:27000001,27000002", "kinesis:70000001"])
def test_kinesis_keeps_the_contract(bench, name):
    check_driver(lambda: open_driver(name, OTHER, bench.clock), OTHER, bench.wait, bench.clock)
    assert bench.model.max_speed == OTHER.max_speed


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("homed", False, "axis x has no reference"),
        ("units", "internal", "cannot be limited"),
        ("keeps", makers.Velocity(0.0, 1.0, 1e3), "keeps the limits"),
        ("keeps", makers.Velocity(0.0, 0.0, 1.0), "keeps the limits"),
    ],
)
def test_a_kinesis_stage_that_can_not_be_held_back_is_not_used(
    bench, monkeypatch, name, value, words
):
    monkeypatch.setattr(makers.KinesisMotor, name, value)
    with pytest.raises(StageError, match=words):
        Envelope("kinesis:27000001,27000002", OTHER, lambda *_, **__: None, bench.clock)


def test_native_limits_of_a_kinesis_stage_are_in_steps_and_given_back(bench):
    bench.model.max_speed, bench.model.acceleration = 7.0, 900.0
    settings = replace(OTHER, step=OTHER.step / 1000, native_limits=(20_000, 3_000_000))
    envelope = Envelope("kinesis:70000001", settings, lambda *_, **__: None, bench.clock)
    assert (bench.model.max_speed, bench.model.acceleration) == pytest.approx((2.0, 300.0))
    assert envelope.close()
    assert (bench.model.max_speed, bench.model.acceleration) == pytest.approx((7.0, 900.0))


def test_the_envelope_holds_back_a_kinesis_stage(bench):
    """No further than a step, and a stop at the end, whatever is asked for."""
    events = []
    envelope = Envelope("kinesis:27000001,27000002", OTHER,
                        lambda name, **_: events.append(name), bench.clock)  # fmt: skip
    begin = bench.model.place.copy()
    sent = envelope.go(np.array([100.0, 100.0]), bench.now)
    assert np.abs(sent - begin).max() <= OTHER.max_step
    bench.wait(5.0)
    assert np.abs(bench.model.place - sent).max() < 1e-3
    assert envelope.close()
    assert events == ["stop"]


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

    def cry(self):
        self.model.halt()

    def close(self):
        self.closed = True


MODELS = {}


@pytest.fixture
def mine(monkeypatch):
    """An entry point as an installed package would have it, and its bench."""
    known = [EntryPoint("mine", f"{__name__}:Mine", module.GROUP),
             EntryPoint("none", f"{__name__}:object", module.GROUP)]  # fmt: skip
    monkeypatch.setattr(
        EntryPoint, "load", lambda self: Mine if self.name == "mine" else lambda *_: object()
    )
    monkeypatch.setattr(
        module,
        "entry_points",
        lambda group, name=None: [one for one in known if name in (None, one.name)],
    )
    found = Bench(OTHER)
    MODELS["mine:1"] = found.model
    return found


def test_another_packages_driver_keeps_the_contract_and_is_held_back(mine):
    check_driver(lambda: open_driver("mine:1", OTHER, mine.clock), OTHER, mine.wait, mine.clock)
    envelope = Envelope("mine:1", OTHER, lambda *_, **__: None, mine.clock)
    begin = mine.model.place.copy()
    sent = envelope.go(np.array([5.0, 5.0]), mine.now)
    assert np.hypot(*(sent - begin)) <= OTHER.max_step
    assert envelope.go(np.array([5.0, 5.0]), mine.now - 1.0) is None
    mine.model.place[0] = np.nan
    with pytest.raises(StageError, match="an invalid position"):
        envelope.look()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mine:broken", "RuntimeError: board 7"),
        ("none:1", "gives no driver: it has no prepare, place, move, stop, cry, close"),
        ("what:1", "there is no driver for a stage of that name; .* kinesis:, mine:, none:"),
        ("/dev/ttyUSB0", "there is no driver"),
    ],
)
def test_what_is_no_driver_is_told(mine, name, words):
    with pytest.raises(StageError, match=words):
        Envelope(name, OTHER, lambda *_, **__: None, mine.clock)


def test_a_driver_that_can_not_hold_native_limits_is_refused_them(mine):
    with pytest.raises(StageError, match="it has no give_back"):
        Envelope("mine:1", replace(OTHER, native_limits=(1, 1)), lambda *_, **__: None, mine.clock)


def test_a_kinesis_stage_needs_its_package_and_its_numbers(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "pylablib", None)
    for name, words in (
        ("kinesis:27000001,27000002", "needs pylablib"),
        ("kinesis:x", "serial numbers"),
        ("kinesis:1,2,3", "serial numbers"),
    ):
        with pytest.raises(StageError, match=words):
            open_driver(name, OTHER, lambda: 0.0)


class Faulty(Mine):
    """A driver with one fault of each kind."""

    fault = ""

    def place(self):
        found = super().place()
        return {"nan": found * np.nan, "list": found.tolist(), "three": np.zeros(3)}.get(
            self.fault, found
        )

    def cry(self):
        if self.fault != "deaf":
            super().cry()

    def move(self, place):
        if self.fault == "fast":
            self.model.place = np.array(place)
        if self.fault == "open":
            self.closed = False
        super().move(place + 0.1 if self.fault == "past" else place)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("nan", r"place\(\) gives"),
        ("list", "gives no array"),
        ("three", "has the shape"),
        ("deaf", r"cry\(\) did not stop|still moves after cry"),
        ("fast", "faster than max_speed"),
        ("past", "stands at|past its goal"),
        ("open", "closed takes moves"),
    ],
)
def test_the_contract_finds_faults(mine, fault, words):
    def opened():
        driver = Faulty("mine:1", OTHER)
        driver.fault = fault
        return driver

    with pytest.raises(AssertionError, match=words):
        check_driver(opened, OTHER, mine.wait, mine.clock)
