"""The virtual stages against their makers' own clients, which the extra `stages` brings along."""

from __future__ import annotations

import select
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

import facets
from facets.live import PiController, Pty, ZaberDevice
from facets.tracking import StageModel

STAGE = facets.load("bench").stage


@contextmanager
def served(device, path):
    """Put a device behind a pty, in a thread; give the pty's name."""
    pty, ending = Pty(path), threading.Event()

    def run():
        begin = time.monotonic()
        while not ending.is_set():
            ready, _, _ = select.select([pty.end], [], [], 0.01)
            device.model.advance(time.monotonic() - begin)
            if ready:
                pty.write(device.receive(pty.read()))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    yield pty.name
    ending.set()
    thread.join()
    pty.close()


def test_zaber_motion_drives_the_virtual_stage(tmp_path):
    from zaber_motion import Units
    from zaber_motion.ascii import Connection

    model = StageModel(STAGE)
    with (
        served(ZaberDevice(model), tmp_path / "port") as name,
        Connection.open_serial_port(name, direct=True) as line,
    ):
        axis = line.get_device(1).get_axis(1)  # not identified: that would ask the network
        assert axis.get_position(Units.NATIVE) == 0
        axis.move_absolute(5000, Units.NATIVE, wait_until_idle=True)
        assert axis.get_position(Units.NATIVE) == pytest.approx(5000, abs=2)
        axis.stop()
    np.testing.assert_allclose(model.place, [5000 * STAGE.step, 0], atol=1e-3)


@pytest.mark.slow
def test_pipython_drives_the_virtual_stage(tmp_path):
    from pipython.pidevice.gcs2.gcs2commands import GCS2Commands
    from pipython.pidevice.gcsmessages import GCSMessages
    from pipython.pidevice.interfaces.piserial import PISerial

    model = StageModel(STAGE)
    with (
        served(PiController(model), tmp_path / "port") as name,
        PISerial(name, 115200) as line,
    ):
        stage = GCS2Commands(GCSMessages(line))
        stage.VEL(["1", "2"], [10.0, 10.0])
        stage.MOV(["1", "2"], [1.0, 0.5])
        while not (model.is_settled and model.place[0] > 0.9):
            time.sleep(0.01)
        assert stage.qPOS(["1", "2"]) == pytest.approx({"1": 1.0, "2": 0.5}, abs=1e-3)
        stage.STP(noraise=True)
    assert model.max_speed == 10.0
