"""Fig. 11: motions in x and in y of several mm, the beam following by feedback."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import facets
from facets.core.hues import chosen_hues
from facets.detectors.noise import add_noise
from facets.pictures import style
from facets.tracking.closed_loop import simulate_following

from .experiment import NONE, PaperClaim, Table
from .motion import error_band

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Fig. 11: motions in x and y with mirror tracking"
CONFIG = "bench"
#: Amplitude of the swing, mm, which covers most of Fig. 10's range.
REACH = {"x": 6.0, "y": 5.0}
SECONDS, RATE = 8.0, 1000


def compute(quick: bool) -> Table:
    """Swing the mirror once along each axis; the stage's encoder gives the beam's position."""
    config = facets.load(CONFIG)
    rng = np.random.default_rng(11)
    time = np.arange(int(SECONDS * RATE)) / RATE
    parts = []
    for axis, reach in enumerate(REACH.values()):
        motion = np.zeros((len(time), 8))
        phase = 2 * np.pi * time / SECONDS
        motion[:, axis] = reach * np.sin(phase - np.sin(phase))  # from rest to rest
        states = simulate_following(config.sensor, config.stage, time, motion)
        readings = add_noise(config.sensor, facets.readings(config.sensor, states), rng)
        place = states[:, 6:] + config.stage.accuracy * rng.standard_normal((len(time), 2))
        beam = facets.Prior(place, config.stage.accuracy)
        poses = facets.solve(config.sensor, readings, beam=beam, threads=0)
        off = np.hypot(states[:, 0] - states[:, 6], states[:, 1] - states[:, 7])
        parts.append((states, poses.state, poses.converged, off))
    states, estimate, ok, off = (np.concatenate(part) for part in zip(*parts, strict=True))
    thin = slice(None, None, 4)
    return {
        "axis": np.repeat(list(REACH), len(time))[thin],
        "time_s": np.tile(time, 2)[thin],
        "true_tx_mm": states[thin, 0],
        "true_ty_mm": states[thin, 1],
        "tx_mm": estimate[thin, 0],
        "ty_mm": estimate[thin, 1],
        "beam_off_um": 1e3 * off[thin],
        "solved": ok[thin].astype(int),
    }


def claims(table: Table) -> list[PaperClaim]:
    results = []
    for axis, reach in REACH.items():
        rows = table["axis"] == axis
        key = f"t{axis}_mm"
        error = 1e3 * (table[key] - table[f"true_{key}"])[rows]
        results += [
            PaperClaim(f"range covered in {axis}", "mm", NONE, 2 * reach,
                  "the paper shows a picture: less than Fig. 10 by limits of its stage"),
            PaperClaim(f"samples solved in {axis}", "", NONE, table["solved"][rows].mean(), ""),
            PaperClaim(f"r.m.s. error in {axis}", "um", NONE, float(np.sqrt(np.nanmean(error**2))),
                  "the uncertainty of the stage's encoder that tells where the beam is"),
            PaperClaim(f"beam off the apex in {axis}; most", "um", NONE,
                  table["beam_off_um"][rows].max(), "by the virtual stage's lag and control law"),
        ]  # fmt: skip
    return results


def picture(table: Table) -> Figure:
    """Plot the motions with the truth under the estimate, the error and the beam's offset."""
    hues = chosen_hues()
    with style.style_context():
        drawing = style.figure(style.FULL, 5.6)
        panels = drawing.subplots(3, 2, sharex=True, height_ratios=(1.4, 1, 1))
        for (place, error, off), axis in zip(panels.T, REACH, strict=True):
            rows, key = table["axis"] == axis, f"t{axis}_mm"
            time, true = table["time_s"][rows], table[f"true_{key}"][rows]
            hue = hues.axes[f"t{axis}"]
            place.plot(time, true, color=hues.grey, alpha=0.55, lw=4.2, label="truth")
            place.plot(time, table[key][rows], color=hue, lw=1.0, label="estimate")
            place.set_ylabel(style.place_label(f"t{axis}"))
            error_band(error, time, 1e3 * (table[key][rows] - true), hue)
            error.set_ylabel("error, µm")
            error_band(off, time, table["beam_off_um"][rows], hues.ink)
            off.set(ylabel="beam off apex, µm", xlabel="time, s", ylim=(0, None))
            place.legend(loc="lower left")
        panels[1, 0].set_title("bands from least to largest, lines at the median")
    return drawing
