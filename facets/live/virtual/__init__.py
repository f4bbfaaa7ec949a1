"""A virtual bench on ptys: a moving mirror, a board that counts its light, a stage for the beam.

It fails like real hardware, on demand. Bits flip, bytes are lost or come twice, samples are
dropped, the board stalls or restarts, or the cable is pulled. The beam is blocked, a converter
saturates, or the stage refuses or jams. Faults are counted, and the true states are written for
comparison with the measured ones.
"""

from .bench import Bench, truth_of
from .board import DROPPED, SENT, SPOILT, TRUTH, BenchSetup, Board
from .faults import Faults
from .mirror import Mirror
from .pty import Pty

__all__ = [
    "DROPPED",
    "SENT",
    "SPOILT",
    "TRUTH",
    "Bench",
    "BenchSetup",
    "Board",
    "Faults",
    "Mirror",
    "Pty",
    "truth_of",
]
