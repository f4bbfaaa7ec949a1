"""Sources by the makers' packages, against stand-ins of these: no hardware was there."""

from __future__ import annotations

import inspect
from dataclasses import replace

import makers
import numpy as np
import pytest

import facets
from facets.core import AuxiliaryChannel
from facets.detectors import counts_to_xy_sum, readings_to_counts
from facets.live import (
    ELECTRODES,
    XY_SUM,
    FixedFrames,
    Pipeline,
    PortError,
    PortInUse,
    check_missing,
    check_source,
    open_port,
)
from facets.live.sources.ni_card import counts_of_volts, frames_of
from facets.tracking import Heartbeat, StageError, close_line, open_permit

CONFIG = facets.load("bench")
NAME = "ni:Dev1/ai0:11?rate=20000&bits=16&range=10"
HEADS = "thorlabs:69000001,69000002,69000003?rate=1000"


@pytest.fixture
def installed(monkeypatch):
    monkeypatch.setattr(makers.Task, "open", [])
    makers.install(monkeypatch)


def electronics():
    return replace(CONFIG.electronics, adc_bits=16, adc_range=10.0)


def light(count):
    """Readings of a mirror that yaws, and the counts of their electrodes."""
    state = np.zeros((count, 8))
    state[:, 5] = 1e-3 * np.sin(np.arange(count) / 20)
    exact = facets.readings(CONFIG.sensor, state)
    return state, readings_to_counts(CONFIG.sensor, electronics(), exact)


def test_a_card_is_a_port(installed):
    _, counts = light(300)
    expected = frames_of(counts, np.arange(300), 50.0 * np.arange(300), ELECTRODES)

    def send(_):
        (task,) = makers.Task.open
        assert task.started
        task.in_stream.volts = counts.T * (10 / 2**16)

    check_source(lambda: open_port(NAME, 0), send, expected)
    assert makers.Task.open == []


def test_a_card_gives_the_poses_of_its_light(installed):
    state, counts = light(300)
    with open_port(NAME, 0) as port:
        task = port.task
        assert task.ai_channels.limits == (-10, 10)
        assert task.timing.buffer == 200_000
        assert port.read() == b""
        task.in_stream.volts = counts.T * (10 / 2**16)
        sensor = replace(CONFIG.sensor, electronics=electronics())
        pipeline = Pipeline(replace(CONFIG, sensor=sensor))
        found = pipeline.feed(port.read(), 1.0)
        task.in_stream.volts = counts.T[:, :1] * (10 / 2**16)
        more = pipeline.feed(port.read(), 1.1)
        assert more.seq.tolist() == [300]
        assert more.time[0] - found.time[0] == 300 * 50
    np.testing.assert_allclose(found.solution.state[:, 5], state[:, 5], atol=2e-6)


def test_voltages_after_the_twelfth_are_auxiliary_channels(installed):
    _, counts = light(20)
    force = np.linspace(-3, 3, 20)
    channel = AuxiliaryChannel("force", "N", scale=4.0)
    config = replace(CONFIG, acquire=replace(CONFIG.acquire, channels=(channel,)))
    with open_port(NAME.replace("0:11", "0:12"), 0) as port:
        port.task.in_stream.volts = np.vstack([counts.T * (10 / 2**16), force])
        found = Pipeline(config).feed(port.read(), 1.0)
    np.testing.assert_allclose(found.channels["force_n"], 4 * force, rtol=1e-6)


def test_too_much_light_is_told_as_saturation():
    counts = counts_of_volts(np.array([9.0, 10.0, 12.0, -12.0]), 16, 10.0)
    assert counts.tolist() == [58982, 65535, 65535, -65535]


@pytest.mark.parametrize(
    ("name", "kind", "words"),
    [
        ("ni:Dev2/ai0:11", PortError, "identifier is invalid"),
        ("ni:Dev1/ai0:7", PortInUse, "8 channels; needed: 12"),
        ("ni:Dev1/ai0:27", PortInUse, "28 channels; .* up to 15 auxiliary"),
        ("ni:Dev1/ai0:11?speed=3", PortInUse, "of the options"),
        ("ni:Dev1/ai0:11?rate=fast", PortInUse, "fast"),
        ("ni:Dev1/ai0:11?rate=-1", PortInUse, "positive"),
        ("ni:Dev1/ai0:11?terminal=what", PortInUse, "terminal=rse"),
        ("thorlabs:1,2", PortInUse, "three controllers"),
        ("thorlabs:1,2,3", PortError, "no device 1"),
    ],
)
def test_what_can_not_be_opened_is_told(installed, name, kind, words):
    makers.KinesisQuadDetector.volts = {}
    with pytest.raises(kind, match=words):
        open_port(name, 0)
    check_missing(lambda: open_port(name, 0))
    assert makers.Task.open == []


def test_a_card_that_goes_away_and_one_that_is_taken_are_told(installed, monkeypatch):
    port = open_port(NAME, 0)
    port.task.in_stream.error = makers.DaqError("samples were overwritten", -200279)
    with pytest.raises(PortError, match="went away: samples were overwritten"):
        port.read()
    port.close()

    def taken(_):
        raise makers.DaqError("the resource is reserved", -50103)

    monkeypatch.setattr(makers.Task, "start", taken)
    with pytest.raises(PortInUse, match="reserved"):
        open_port(NAME, 0)


@pytest.mark.parametrize(("name", "package"), [(NAME, "nidaqmx"), (HEADS, "pylablib")])
def test_a_package_that_is_not_installed_is_named(name, package, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(PortInUse, match=f"needs {package}"):
        open_port(name, 0)


def test_three_heads_give_the_pose_of_their_light(installed):
    state, counts = light(40)
    volts = counts_to_xy_sum(electronics(), counts)[-1].reshape(3, 4)[:, :3] * (10 / 2**16)
    makers.KinesisQuadDetector.volts = dict(
        zip(("69000001", "69000002", "69000003"), volts, strict=True)
    )
    with open_port(HEADS, 0) as port:
        data = port.read() + port.read()
        samples = FixedFrames().feed(data)
        assert samples.kind.tolist() == [XY_SUM] * 2
        assert samples.seq.tolist() == [0, 1]
        sensor = replace(CONFIG.sensor, electronics=electronics())
        found = Pipeline(replace(CONFIG, sensor=sensor)).feed(data, 1.0)
        makers.KinesisQuadDetector.volts = {}
        with pytest.raises(PortError, match="went away"):
            port.read()
    np.testing.assert_allclose(found.solution.state[:, 5], state[-1, 5], atol=5e-6)


def test_the_stand_ins_take_what_the_packages_take():
    nidaqmx = pytest.importorskip("nidaqmx", reason="the maker's package is not installed")
    from nidaqmx.stream_readers import AnalogMultiChannelReader

    task = nidaqmx.task
    pairs = [
        (makers.Channels.add_ai_voltage_chan,
         task.collections.AIChannelCollection.add_ai_voltage_chan),
        (makers.Lines.add_di_chan, task.collections.DIChannelCollection.add_di_chan),
        (makers.Lines.add_do_chan, task.collections.DOChannelCollection.add_do_chan),
        (makers.Timing.cfg_samp_clk_timing, task.Timing.cfg_samp_clk_timing),
        (makers.AnalogMultiChannelReader.read_many_sample,
         AnalogMultiChannelReader.read_many_sample),
    ]  # fmt: skip
    for ours, theirs in pairs:
        assert list(inspect.signature(ours).parameters) == list(
            inspect.signature(theirs).parameters
        )


def test_a_card_gives_the_permit_and_takes_the_heartbeat(installed):
    permit = open_permit("ni:Dev1/port0/line0", 0.05)
    assert permit.task.di_channels == ["Dev1/port0/line0"]
    assert permit.allows_motion(0.0) is False
    permit.task.level = True
    assert permit.allows_motion(0.0) is True
    heartbeat = Heartbeat("ni:Dev1/port0/line1")
    levels = []
    for now in np.arange(0.0, 0.3, 0.03):
        heartbeat.beat(now, may_move=now < 0.2)
        levels.append(heartbeat.card.task.level)
    assert levels[:7] == [True, False] * 3 + [True]
    assert len(set(levels[6:])) == 1  # it stands still while the stage may not move
    for line in (permit, heartbeat):
        close_line(line)
    assert makers.Task.open == []


def test_a_card_that_is_not_there_is_told():
    with pytest.raises(StageError, match="nidaqmx"):
        open_permit("ni:Dev1/port0/line0", 0.05)


def test_the_stand_in_of_pylablib_takes_what_it_takes():
    pylablib = pytest.importorskip("pylablib.devices.Thorlabs", reason="pylablib is not installed")
    for ours, theirs in (
        (makers.KinesisMotor, pylablib.KinesisMotor),
        (makers.KinesisQuadDetector, pylablib.KinesisQuadDetector),
    ):
        for name in ("get_position", "move_to", "stop", "wait_for_stop", "get_readings"):
            if hasattr(ours, name):
                assert hasattr(theirs, name)
