"""Sources by the makers' packages, against stand-ins of these: no hardware was there."""

from __future__ import annotations

from dataclasses import replace

import makers
import numpy as np
import pytest

import facets
from facets.core import AuxiliaryChannel
from facets.detectors import counts_to_xy_sum, readings_to_counts
from facets.live import (
    ELECTRODES,
    FixedFrames,
    Pipeline,
    PortError,
    PortInUse,
    RawSamples,
    check_missing,
    check_source,
    open_port,
    pack,
)
from facets.tracking import Heartbeat, close_line, open_permit

CONFIG = facets.load("bench")
ELECTRONICS = replace(CONFIG.electronics, adc_bits=16, adc_range=10.0)
SENSOR = replace(CONFIG.sensor, electronics=ELECTRONICS)
NAME = "ni:Dev1/ai0:11?rate=20000&bits=16&range=10"
HEADS = "thorlabs:69000001,69000002,69000003?rate=1000"


@pytest.fixture
def installed(monkeypatch):
    monkeypatch.setattr(makers.Task, "open", [])
    makers.install(monkeypatch)


def light(count):
    """The yaw of a mirror, rad, and the voltages of its electrodes (count, 12)."""
    state = np.zeros((count, 8))
    state[:, 5] = 1e-3 * np.sin(np.arange(count) / 20)
    counts = readings_to_counts(SENSOR, ELECTRONICS, facets.readings(SENSOR, state))
    return state[:, 5], counts, counts * (10 / 2**16)


def test_a_card_is_a_port(installed):
    _, counts, volts = light(300)
    number = np.arange(300, dtype=np.uint32)
    kind = np.full(300, ELECTRODES, np.uint8)

    def send(_):
        (task,) = makers.Task.open
        assert task.started
        assert task.ai_channels.limits == (-10, 10)
        task.in_stream.volts = volts.T

    expected = pack(RawSamples(kind, 0 * kind, number, 50 * number, counts))
    check_source(lambda: open_port(NAME, 0), send, expected)
    assert makers.Task.open == []


def test_a_card_gives_the_poses_of_its_light_and_voltages_after_the_twelfth_as_channels(installed):
    yaw, _, volts = light(300)
    force = np.linspace(-3, 3, 300)
    channel = AuxiliaryChannel("force", "N", scale=4.0)
    acquire = replace(CONFIG.acquire, channels=(channel,))
    pipeline = Pipeline(replace(CONFIG, sensor=SENSOR, acquire=acquire))
    with open_port(NAME.replace("0:11", "0:12"), 0) as port:
        port.task.in_stream.volts = np.vstack([volts.T, force])
        poses = pipeline.feed(port.read(), 1.0)
        port.task.in_stream.volts = np.zeros((13, 1))
        more = pipeline.feed(port.read(), 1.1)
    np.testing.assert_allclose(poses.solution.state[:, 5], yaw, atol=2e-6)
    np.testing.assert_allclose(poses.channels["force_n"], 4 * force, rtol=1e-6)
    assert more.seq.tolist() == [300]
    assert more.time[0] - poses.time[0] == 300 * 50


def test_too_much_light_is_told_as_saturation(installed):
    with open_port(NAME, 0) as port:
        assert port.read() == b""
        port.task.in_stream.volts = np.repeat([[9.0, 10.0, 12.0, -12.0]], 12, axis=0)
        counts = FixedFrames().feed(port.read()).counts
    assert counts.T.tolist() == 12 * [[58982, 65535, 65535, -65535]]


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
    with open_port(NAME, 0) as port:
        port.task.in_stream.error = makers.DaqError("samples were overwritten", -200279)
        with pytest.raises(PortError, match="went away: samples were overwritten"):
            port.read()

    def refuse(_):
        raise makers.DaqError("the resource is reserved", -50103)

    monkeypatch.setattr(makers.Task, "start", refuse)
    with pytest.raises(PortInUse, match="reserved"):
        open_port(NAME, 0)


def test_three_heads_give_the_pose_of_their_light(installed):
    yaw, counts, _ = light(40)
    volts = counts_to_xy_sum(ELECTRONICS, counts)[-1].reshape(3, 4)[:, :3] * (10 / 2**16)
    numbers = ("69000001", "69000002", "69000003")
    makers.KinesisQuadDetector.volts = dict(zip(numbers, volts, strict=True))
    with open_port(HEADS, 0) as port:
        data = port.read() + port.read()
        makers.KinesisQuadDetector.volts = {}
        with pytest.raises(PortError, match="went away"):
            port.read()
    poses = Pipeline(replace(CONFIG, sensor=SENSOR)).feed(data, 1.0)
    assert poses.seq.tolist() == [0, 1]
    np.testing.assert_allclose(poses.solution.state[:, 5], yaw[-1], atol=5e-6)


def test_a_card_gives_the_permit_and_takes_the_heartbeat(installed):
    permit = open_permit("ni:Dev1/port0/line0", 0.05)
    assert permit.allows_motion(0.0) is False
    permit.task.level = True
    assert permit.allows_motion(0.0) is False  # until somebody resumes
    permit.was_lost = False
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
