"""Faults of given sizes that are no parameters of a calibration; each rig has one of them.

The sentence that must name a fault has one of its `named_by`. A fault that no residual shows has
none.
"""

from __future__ import annotations

import numpy as np

from facets.detectors.electrodes import tetra_lateral_ratios

from .faults import (
    ANGLES,
    HALF_MM,
    PLACES,
    add,
    add_currents,
    add_each,
    add_fringes,
    add_mode,
    add_noise,
    add_thermometer,
    axis,
    backlash,
    bend_currents,
    between,
    change_bench,
    change_profile,
    delay,
    detector_vector,
    dim,
    dust,
    edit,
    error_matrix,
    ghost_factor,
    hops,
    hum,
    jumps,
    lag,
    late_warmth,
    pose_error,
    previous,
    ramp,
    remember,
    reorder_angles,
    round_to,
    scatter,
    shine,
    smooth,
    step,
    walk,
    warmth,
    white,
)
from .simulated_bench import Fault, Parts

#: Fraction of the rows, and size in standard deviations, of readings that jump; see `faults.jumps`.
OUTLIERS = (
    (0.002, 1000, "single"), (0.002, 30, "rows"), (0.01, 10, "rows"), (0.01, 100, "rows"),
    (0.01, 1000, "rows"), (0.01, 1000, "bursts"), (0.02, 100, "single"), (0.03, 30, "detector"),
    (0.05, 3, "rows"), (0.05, 10, "single"), (0.05, 100, "bursts"), (0.05, 30, "rows"),
    (0.05, 1000, "single"), (0.05, 1000, "detector"),
)  # fmt: skip
ALL, REVERSED = range(9), slice(None, None, -1)
#: A sixth of the rows, and those after three fifths.
SIXTH, LATER = between(0.4, 0.56), step(0.6)
#: Fringes 0.3 mm apart in the beam, as wave numbers in radians a standard deviation.
WAVES = 2 * np.pi * 0.2125 / 0.3 * np.array([1, 1 / 3])
LAMP = np.array([[3.0, 1.0], [-2.0, 4.0], [1.0, -3.0]])
SHARED = np.array([0, 1.2, 0] * 3)
PINCUSHION = [1, 1, 0.5] * 3
ONLY_B = detector_vector(1, [2.0, 2.0, 2.0])
of_mode, of_ghost = add_mode(0.005), ghost_factor(5e-4, 1.5, -1)
of_fringes = add_fringes(1e-3, WAVES)


def case(group: str, words: str, parts: Parts, *named_by: str, in_time: bool = False) -> Fault:
    """A fault of a group, described by words. named_by: words of which a finding on it must contain
    one."""
    return Fault(group, words, parts, in_time, named_by)


def exchange(*columns: int, stage: str = "readings") -> Parts:
    """Exchange the first half of some columns with the second."""
    return edit(stage, columns, lambda values: np.roll(values, len(columns) // 2, axis=1))


OUTLIER_CASES = [
    case("outliers", f"{100 * part:g} %, {size} sigma, {kind}", scatter(jumps(part, size, kind)),
         *(("outlier",) if size > 12 else ()))
    for part, size, kind in OUTLIERS
]  # fmt: skip

CASES: list[Fault] = [
    case("nothing", "nothing", {}),
    *OUTLIER_CASES,
    case("reference", "mirror vibrates by 0.3 um", add_each("mirror", [3e-4] * 3 + [0] * 3, white),
         "reference errs", "vibrates"),
    case("reference", "mirror vibrates by 1 um, 3 urad",
         add_each("mirror", [1e-3] * 3 + [3e-6] * 3, white),
         "reference errs", "vibrates"),
    case("reference", "in steps of 1 um", edit("reference", range(3), round_to(1e-3)),
         "reference errs", "vibrates"),
    case("reference", "in steps of 1 um, 5 urad",
         edit("reference", range(6), round_to(np.array([1e-3] * 3 + [5e-6] * 3))),
         "reference errs", "vibrates"),
    case("reference", "backlash 1.5 um", backlash(np.array([1.5e-3] * 3 + [0] * 3)),
         "backlash"),
    case("reference", "backlash 0.5 um", backlash(np.array([5e-4] * 3 + [0] * 3)),
         "backlash"),
    case("reference", "mirror lags by 0.4 % of its step", lag(0.004), "The mirror lags"),
    case("reference", "mirror slips by 3.7 um", add("mirror", [2e-3, -1e-3, 3e-3, 0, 0, 0], LATER),
         "the mirror on the reference (or its zero) jumped"),
    case("light", "beam walks 2.5 um", add_each("beam", [2.5e-3] * 2, walk),
         "likeliest cause: the beam"),
    case("light", "beam trembles 0.5 um", add_each("beam", [5e-4] * 2, white),
         "beam moved"),
    case("light", "power jitters 1 %", dim(0.01, white), "power changed"),
    case("light", "beam 2.5 um and power 1 %",
         add_each("beam", [2.5e-3] * 2, walk) | dim(0.01, white),
         "likeliest cause: the beam"),
    case("light", "beam jumps by 3.6 um", add("beam", [3e-3, -2e-3], LATER),
         "the beam jumped"),
    case("detectors", "B slips by 20 um", add("readings", detector_vector(1, [0.02, 0.01]), LATER),
         "detector B jumped"),
    case("detectors", "C slips by 5 um",
         add("readings", detector_vector(2, [-0.003, 0.004]), LATER), "detector C jumped"),
    case("detectors", "A slips by 1 mm", add("readings", detector_vector(0, [0.9, -0.5]), LATER),
         "detector A jumped"),
    case("detectors", "gain of A jumps by 0.5 %",
         edit("readings", [2], lambda power: 1.005 * power, between(0.6, 2)),
         "gain of detector A jumped"),
    case("detectors", "B drifts by 5 um", add("readings", detector_vector(1, [5e-3] * 2), ramp),
         "detector B drifted"),
    case("light", "3 % LG10", change_profile(add_mode(0.03)),
         "profile is not Gaussian"),
    case("light", "2 % HG10", change_profile(lambda x, y: 0.98 + 0.02 * x * x)),
    case("light", "1 % HG10", change_profile(lambda x, y: 0.99 + 0.01 * x * x)),
    case("light", "fringes of 1 %, 0.3 mm", change_profile(add_fringes(0.01, WAVES)),
         "fringes across"),
    case("light", "fringes of a window of 0.5 %, 0.7 mm",
         edit("readings", [4, 5], lambda b: b * (
             1 + np.array([0, 0.005]) * np.cos(2 * np.pi * b[:, :1] / 0.7))),
         "fringes of the window of detector B"),
    case("light", "ghost of 0.5 %", change_profile(ghost_factor(5e-3, 1.5, -1)),
         "a second reflex"),
    case("light", "ghost of 0.1 %", change_profile(ghost_factor(1e-3, 1.5, -1))),
    case("facets", "tip chipped off two facets", change_bench(chip=0.03),
         "tip is chipped"),
    case("light", "a little of many",
         change_profile(lambda x, y: of_mode(x, y) * of_ghost(x, y) * of_fringes(x, y))
         | add_each("beam", [1e-4] * 2, white)),
    case("light", "beam cut at 1.5 radii",
         change_profile(lambda x, y: (np.hypot(x, y) < 3.0) * 1.0), "profile is not Gaussian"),
    case("facets", "dust on facet B", dust(1, 0.05, 1.0, 0.14, 0.5), "dust"),
    case("electronics", "12 bits", edit("readings", PLACES, round_to(13 / 4096))),
    case("reference", "Abbe offset of 3 mm", error_matrix(
        3 * np.outer(axis(0) + axis(1) * 2 / 3, axis(5)) + 3 * np.outer(axis(2), axis(4))),
        "Abbe"),
    case("reference", "scale of yaw 0.2 % off", error_matrix(np.diag(axis(5, 2e-3)))),
    case("reference", "scale of tx 0.1 % off", error_matrix(np.diag(axis(0, 1e-3)))),
    case("reference", "x and z 3 mrad out of square",
         error_matrix(np.outer(axis(0, 3e-3), axis(2))), "not square"),
    case("reference", "bow of 2 um", pose_error(0, lambda pose: 2e-3 * (pose[:, 2] / 2) ** 2),
         "bow"),
    case("reference", "cosine error of 150 mm",
         pose_error(2, lambda pose: 75 * (pose[:, 3:5] ** 2).sum(axis=1)), "cosine"),
    case("environment", "temperature is late by a quarter of the run",
         add("beam", [3e-3, -2e-3], warmth) | add_thermometer(late_warmth(125.0)),
         "follow temperature_c late", "temperature", in_time=True),
    case("environment", "head is late by a fifth of the run",
         add("beam", [3e-3, -2e-3], late_warmth(100.0)) | add_thermometer(),
         "follow temperature_c late", in_time=True),
    case("nothing", "motion in time, nothing", {}, in_time=True),
    case("time", "reference's clock runs off by 50 ms",
         delay(0.05, ramp), "clock", in_time=True),
    case("table", "readings averaged over 3 rows", edit("readings", ALL, smooth(3)),
         "averaged or low_pass", in_time=True),
    case("environment", "lamp switched on", shine([5e-3] * 3, LAMP, LATER),
         "a lamp"),
    case("environment", "lamp on and off", shine([5e-3] * 3, LAMP, hops(37)),
         "a lamp"),
    case("environment", "mirror vibrates at one frequency",
         add("mirror", axis(0, 2e-3), hum(0.2137)), "oscillated"),
    case("environment", "beam hums at one frequency", add("beam", [1e-3, 5e-4], hum(0.3117)),
         "oscillated"),
    case("detectors", "remember 0.3 %", remember(0.003), "retain a fraction"),
    case("electronics", "amplifiers bend", bend_currents(lambda i, bend: i * (1 + bend * i), 0.05),
         "bend"),
    case("electronics", "amplifiers saturate", bend_currents(np.minimum, 0.09),
         "saturate"),
    case("electronics", "0.5 % of A's currents leak into B", bend_currents(
        lambda i, leak: i + leak * i[:, [0, 0, 0]], np.reshape([0, 5e-3, 0], (3, 1, 1))),
        "leak"),
    case("electronics", "automatic zero every 50 rows", add_currents(1e-4, 50),
         "automatic zero"),
    case("electronics", "B has twice more noise", add_noise(ONLY_B),
         "each by itself"),
    case("electronics", "zetas share noise", add_noise(SHARED, in_common=True),
         "a supply"),
    case("table", "angles in another order", edit("reference", ANGLES, reorder_angles),
         "fixed axes z, then y, then x"),
    case("table", "reference one row late in a sixth", edit("reference", range(6), previous, SIXTH),
         "are one row below"),
    case("table", "sign of zeta of B in a sixth", edit("readings", [4], np.negative, SIXTH),
         "sign of zeta of detector B"),
    case("table", "places in steps of 20 um", edit("readings", PLACES, round_to(0.02)),
         "written in steps"),
    case("table", "tetra-lateral, not straightened",
         edit("readings", PLACES, lambda places: HALF_MM * tetra_lateral_ratios(
             places.reshape(-1, 3, 2) / HALF_MM, 1.0).reshape(-1, 6)),
         "tetra-lateral"),
    case("table", "pincushion, taken for duo-lateral",
         edit("readings", ALL, lambda raw: raw[:, [0, 0, 2, 3, 3, 5, 6, 6, 8]] * PINCUSHION),
         "pincushion"),
    case("table", "sign of psi of A", edit("readings", [0], np.negative),
         "sign of psi of detector A"),
    case("table", "sign of psi of all", edit("readings", [0, 3, 6], np.negative),
         "sign of psi of all"),
    case("table", "sign of zeta of C", edit("readings", [7], np.negative),
         "sign of zeta of detector C"),
    case("table", "powers of A and B", exchange(2, 5),
         "powers of detectors A and B are exchanged"),
    case("table", "psi of B and C", exchange(3, 6), "psi of detectors B and C are exchanged"),
    case("table", "zeta of A and C", exchange(1, 7), "zeta of detectors A and C are exchanged"),
    case("table", "psi of A and zeta of B", exchange(0, 4),
         "psi of detector A and zeta of detector B"),
    case("table", "detectors A and C", exchange(0, 1, 2, 6, 7, 8),
         "detectors A and C are exchanged"),
    case("table", "sign of yaw", edit("reference", [5], np.negative), "reference's yaw"),
    case("table", "tx and ty", exchange(0, 1, stage="reference"), "tx and ty are exchanged"),
    case("table", "sign of psi of A and of yaw",
         edit("readings", [0], np.negative) | edit("reference", [5], np.negative),
         "sign of psi of detector A", "two faults"),
    case("table", "sign of psi of B, powers of A and C",
         edit("readings", [2, 3, 8], lambda raw: raw[:, [2, 1, 0]] * [1, -1, 1]),
         "sign of psi of detector B", "two faults"),
]  # fmt: skip
