"""The virtual stages against their makers' own clients; extra `stages`, skipped without it."""

from __future__ import annotations

import select
import threading
import time

import numpy as np
import pytest

import facets
from facets.live.pi import PiController
from facets.live.virtual import Pty
from facets.live.zaber import ZaberDevice
from facets.tracking.stage import StageModel

STAGE = facets.load("bench").stage


@pytest.fixture
def serve(tmp_path):
    """Puts a device behind a pty, in a thread; gives the pty's name."""
    ending, threads, ptys = threading.Event(), [], []

    def run(device, pty):
        begin, rest = time.monotonic(), b""
        while not ending.is_set():
            ready, _, _ = select.select([pty.end], [], [], 0.01)
            device.model.advance(time.monotonic() - begin)
            if ready:
                *lines, rest = (rest + pty.read()).split(b"\n")
                for line in lines:
                    pty.write(device.answer(line.decode("ascii", "replace")).encode())

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
    ascii_ = pytest.importorskip("zaber_motion.ascii")
    units = pytest.importorskip("zaber_motion").Units
    model = StageModel(STAGE)
    with ascii_.Connection.open_serial_port(serve(ZaberDevice(model)), direct=True) as line:
        axis = line.get_device(1).get_axis(1)  # not identified: that would ask the network
        assert axis.get_position(units.NATIVE) == 0
        axis.move_absolute(5000, units.NATIVE, wait_until_idle=True)
        assert axis.get_position(units.NATIVE) == pytest.approx(5000, abs=2)
        axis.stop()
    np.testing.assert_allclose(model.place, [5000 * STAGE.step, 0], atol=1e-3)


def test_pipython_drives_the_virtual_stage(serve):
    pytest.importorskip("pipython")
    from pipython.pidevice.gcscommands import GCSCommands
    from pipython.pidevice.gcsmessages import GCSMessages
    from pipython.pidevice.interfaces.piserial import PISerial

    model = StageModel(STAGE)
    with PISerial(serve(PiController(model)), 115200) as line:
        stage = GCSCommands(GCSMessages(line))
        stage.MOV(["1", "2"], [1.0, 0.5])
        time.sleep(0.5)
        assert stage.qPOS(["1", "2"]) == pytest.approx({"1": 1.0, "2": 0.5}, abs=1e-3)
        stage.STP(noraise=True)
