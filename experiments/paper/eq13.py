"""Eq. 13: the offset of the beam from the apex when the three powers are equal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import root

import facets
from facets.core.hues import DASHES, MARKS, chosen_hues
from facets.pictures import style
from facets.tracking.control import tracking_error

from .experiment import NONE, PaperClaim, Table, columns_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Eq. 13: the tracking error that equal powers leave"
CONFIG = "paper"
TURNS = {
    "roll": (1, 0, 0), "pitch": (0, 1, 0), "yaw": (0, 0, 1),
    "roll and pitch": (1, 1, 0), "roll against pitch": (1, -1, 0), "all three": (1, -1, 1),
}  # fmt: skip
ANGLES = (1, 2, 5, 10, 15, 20)
BOUND = 0.89


def remaining_offset(sensor: facets.Sensor, turn: Any) -> float:
    """Distance of beam and apex, um, at which Eq. (14) is zero; turn: rotation (3,), rad."""

    def unequal(place: Any) -> Any:
        """The tracking error (2,) of the powers with the beam at a place (2,), mm."""
        return tracking_error(facets.readings(sensor, np.array([0, 0, 0, *turn, *place]))[2::3])

    solution = root(unequal, [0.0, 0.0], tol=1e-14)
    return float(1e3 * np.hypot(*solution.x))


def compute(quick: bool) -> Table:
    sensor = facets.load(CONFIG).sensor
    rows = [
        (name, angle, remaining_offset(sensor, 1e-3 * angle * np.array(turn)))
        for name, turn in TURNS.items()
        for angle in ANGLES
    ]
    return columns_of("turn angle_mrad left_um", rows)


def claims(table: Table) -> list[PaperClaim]:
    ten = table["angle_mrad"] == 10
    at = dict(zip(table["turn"][ten].tolist(), table["left_um"][ten].tolist(), strict=True))
    less = "less than the bound, as said"
    return [
        PaperClaim("left at 10 mrad of roll", "um", BOUND, at["roll"], less),
        PaperClaim("left at 10 mrad of pitch", "um", BOUND, at["pitch"], less),
        PaperClaim("left at 10 mrad of yaw", "um", NONE, at["yaw"],
                   "yaw does not shift the powers"),
        PaperClaim("left at 10 mrad of roll and -10 of pitch", "um", BOUND,
                   at["roll against pitch"], "the bound holds for one tilt; for two at once, "
                   "which the paper allows, it does not"),
    ]  # fmt: skip


def picture(table: Table) -> Figure:
    hues = chosen_hues()
    with style.style_context():
        drawing = style.figure(style.SINGLE, 3.2)
        panel = drawing.subplots()
        for name, size in (("roll", 10), ("pitch", 5), ("roll against pitch", 5)):  # two coincide
            rows = table["turn"] == name
            panel.plot(table["angle_mrad"][rows], table["left_um"][rows], ms=size, label=name,
                       color=hues.axes.get(name, hues.grey), marker=MARKS.get(name, "*"),
                       ls=DASHES.get(name, "-"))  # fmt: skip
        panel.plot([0, 10], [BOUND, BOUND], color=hues.ink, ls=(0, (1, 1.5)), lw=1.6,
                   label="the paper's bound")  # fmt: skip
        panel.set(xlabel="each angle, mrad", ylabel="beam off the apex, µm", xlim=0, ylim=0)
        panel.legend()
    return drawing
