"""Stand-ins for the packages of National Instruments and of pylablib, by their documentation.

They accept those arguments of nidaqmx 1.7 and pylablib 1.4 that are used.
"""

from __future__ import annotations

import sys
import types
from collections import namedtuple
from enum import Enum
from typing import ClassVar

import numpy as np

Velocity = namedtuple("TVelocityParams", ["min_velocity", "acceleration", "max_velocity"])
Readings = namedtuple("TQuadDetectorReadings", ["xdiff", "ydiff", "sum", "xpos", "ypos"])


AcquisitionType = Enum("AcquisitionType", "FINITE CONTINUOUS")
TerminalConfiguration = Enum("TerminalConfiguration", "RSE NRSE DIFF DEFAULT")


class DaqError(Exception):
    def __init__(self, message, error_code):
        super().__init__(message)
        self.error_code = error_code


class Channels(list):
    def add_ai_voltage_chan(self, physical_channel, terminal_config, min_val, max_val):
        device, _, span = physical_channel.partition("/ai")
        if device != "Dev1":
            raise DaqError("Device identifier is invalid.", -200220)
        first, _, last = span.partition(":")
        self.extend(range(int(first), int(last or first) + 1))
        self.limits, self.terminal = (min_val, max_val), terminal_config


class Lines(list):
    add_di_chan = add_do_chan = list.append


class Timing:
    samp_clk_rate = 0.0

    def cfg_samp_clk_timing(self, rate, sample_mode, samps_per_chan):
        assert sample_mode is AcquisitionType.CONTINUOUS
        self.samp_clk_rate, self.buffer = rate, samps_per_chan


class Stream:
    """Sampled voltages (number of channels, n) that have not been read."""

    def __init__(self):
        self.volts, self.error = np.zeros((12, 0)), None

    @property
    def avail_samp_per_chan(self):
        if self.error:
            raise self.error
        return self.volts.shape[1]


class Task:
    open: ClassVar = []

    def __init__(self):
        self.ai_channels, self.timing, self.in_stream = Channels(), Timing(), Stream()
        self.di_channels, self.do_channels, self.level = Lines(), Lines(), False
        self.started = False
        Task.open.append(self)

    def start(self):
        self.started = True

    def read(self):
        assert self.di_channels
        return self.level

    def write(self, data):
        assert self.do_channels
        self.level = data

    def close(self):
        Task.open.remove(self)


class AnalogMultiChannelReader:
    def __init__(self, task_in_stream):
        self.stream = task_in_stream

    def read_many_sample(self, data, number_of_samples_per_channel, timeout):
        assert data.shape == (len(self.stream.volts), number_of_samples_per_channel)
        data[:] = self.stream.volts[:, :number_of_samples_per_channel]
        self.stream.volts = self.stream.volts[:, number_of_samples_per_channel:]


class KinesisMotor:
    """One axis of a stage's model (or two channels), in user units of `scale` steps."""

    model = None  # a StageModel, set by the test
    axes: ClassVar = {"27000001": 0, "27000002": 1}
    units, homed, keeps = "user_step", True, None

    def __init__(self, conn, scale):
        if conn not in self.axes and conn != "70000001":
            raise RuntimeError(f"no device {conn}")
        self.conn, self.closed, self.scale = conn, False, scale

    def axis(self, channel):
        if self.closed:
            raise RuntimeError("the device is closed")
        return self.axes.get(self.conn, channel - 1)

    def get_scale_units(self):
        return self.units

    def is_homed(self, channel):
        return self.homed

    def get_position(self, channel):
        axis = self.axis(channel)
        return float(self.model.place[axis] - self.model.settings.zero[axis])

    def move_to(self, position, channel):
        axis = self.axis(channel)
        self.model.target[axis] = position + self.model.settings.zero[axis]
        self.model.braking = False

    def stop(self, immediate, sync, channel):
        axis = self.axis(channel)
        self.model.target[axis] = self.model.place[axis]
        self.model.speed[axis] = 0.0

    def wait_for_stop(self, channel, timeout):
        self.axis(channel)

    def setup_velocity(self, acceleration, max_velocity, channel):
        unit = self.scale * self.model.settings.step
        self.model.max_speed, self.model.acceleration = max_velocity * unit, acceleration * unit

    def get_velocity_parameters(self, channel):
        unit = self.scale * self.model.settings.step
        own = Velocity(0.0, self.model.acceleration / unit, self.model.max_speed / unit)
        return self.keeps or own

    def close(self):
        self.closed = True


class KinesisQuadDetector:
    """A controller with a head, whose readings are set by the test."""

    volts: ClassVar = {}

    def __init__(self, conn):
        if conn not in self.volts:
            raise RuntimeError(f"no device {conn}")
        self.conn = conn

    def get_readings(self):
        return Readings(*self.volts[self.conn], 0.0, 0.0)

    def close(self):
        pass


def install(monkeypatch):
    """Install the stand-ins in place of the packages."""

    def module(name, **parts):
        found = types.ModuleType(name)
        vars(found).update(parts)
        monkeypatch.setitem(sys.modules, name, found)
        return found

    module("nidaqmx", Task=Task, DaqError=DaqError)
    module(
        "nidaqmx.constants",
        AcquisitionType=AcquisitionType,
        TerminalConfiguration=TerminalConfiguration,
    )
    module("nidaqmx.stream_readers", AnalogMultiChannelReader=AnalogMultiChannelReader)
    thorlabs = types.SimpleNamespace(
        KinesisMotor=KinesisMotor, KinesisQuadDetector=KinesisQuadDetector
    )
    module("pylablib")
    module("pylablib.devices", Thorlabs=thorlabs)
    monkeypatch.setitem(sys.modules, "pylablib.devices.Thorlabs", thorlabs)
