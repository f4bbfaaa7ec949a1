"""A virtual bench on ptys: a moving mirror, a board that counts its light, a stage for the beam.

As nasty as real hardware, on demand: bits flip, bytes are lost or come twice, samples are dropped,
the board stalls or restarts, the cable is pulled, the beam is blocked, a converter is at its end,
the stage refuses or jams. Everything is counted, and the truth is written down, to be compared with
what was measured.
"""

from .bench import Bench, truth_of
from .board import DROPPED, SENT, SPOILT, TRUTH, Board
from .faults import Faults
from .mirror import Mirror
from .pty import Pty

__all__ = [
    "DROPPED",
    "SENT",
    "SPOILT",
    "TRUTH",
    "Bench",
    "Board",
    "Faults",
    "Mirror",
    "Pty",
    "truth_of",
]
