"""A virtual bench on ptys: a moving mirror, a board that counts its light, a stage for the beam.

It fails like real hardware, on demand: bits flip, bytes are lost or come twice, samples are
dropped, the board stalls or restarts, the cable is pulled, the beam is blocked, a converter is at
its end, the stage refuses or jams. Faults are counted, and the true states are written, to be
compared with the measured ones.
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
