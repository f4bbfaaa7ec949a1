"""The virtual stages against their makers' own clients, which the extra `stages` brings along."""

from __future__ import annotations

import select
import threading
import time

import numpy as np
import pytest
from pipython.pidevice.gcscommands import GCSCommands
from pipython.pidevice.gcsmessages import GCSMessages
from pipython.pidevice.interfaces.piserial import PISerial
from zaber_motion import Units
from zaber_motion.ascii import Connection

import facets
from facets.live import PiController, Pty, ZaberDevice
from facets.tracking import StageModel

STAGE = facets.load("bench").stage


@pytest.fixture
def serve(tmp_path):
    """Puts a device behind a pty, in a thread; gives the pty's name."""
    ending, threads, ptys = threading.Event(), [], []

    def run(device, pty):
        begin = time.monotonic()
        while not ending.is_set():
            ready, _, _ = select.select([pty.end], [], [], 0.01)
            device.model.advance(time.monotonic() - begin)
            if ready:
                pty.write(device.receive(pty.read()))

    def start(device):
        pty = Pty(tmp_path / f"port{len(ptys)}")
        ptys.append(pty)
        threads.append(threading.Thread(target=run, args=(device, pty)))
        threads[-1].start()
        return pty.name

    yield start
    ending.set()
    for thread in threads:
        thread.join()
    for pty in ptys:
        pty.close()


def test_zaber_motion_drives_the_virtual_stage(serve):
    model = StageModel(STAGE)
    with Connection.open_serial_port(serve(ZaberDevice(model)), direct=True) as line:
        axis = line.get_device(1).get_axis(1)  # not identified: that would ask the network
        assert axis.get_position(Units.NATIVE) == 0
        axis.move_absolute(5000, Units.NATIVE, wait_until_idle=True)
        assert axis.get_position(Units.NATIVE) == pytest.approx(5000, abs=2)
        axis.stop()
    np.testing.assert_allclose(model.place, [5000 * STAGE.step, 0], atol=1e-3)


@pytest.mark.slow
def test_pipython_drives_the_virtual_stage(serve):
    model = StageModel(STAGE)
    with PISerial(serve(PiController(model)), 115200) as line:
        stage = GCSCommands(GCSMessages(line))
        stage.VEL(["1", "2"], [10.0, 10.0])
        stage.MOV(["1", "2"], [1.0, 0.5])
        while not (model.is_settled and model.place[0] > 0.9):
            time.sleep(0.01)
        assert stage.qPOS(["1", "2"]) == pytest.approx({"1": 1.0, "2": 0.5}, abs=1e-3)
        stage.STP(noraise=True)
    assert model.max_speed == 10.0
