"""The list of alternatives that could explain a fit's residuals, each declared as data.

Most are generated: the columns of a place of action (`columns`) times the best of some basis
functions of the row, the temperature or the mirror's position. `remainder` judges them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ...core.names import DETECTORS
from ...core.units import Floats
from . import columns
from .alternative import (
    CHANGE_VERBS,
    MAX_LISTED_ROWS,
    SENSOR_GROUPS,
    Alternative,
    Trace,
    describe_pose,
)
from .faults import angle_orders
from .remainder import Remainder
from .score import score_bases, score_columns, score_switching

Columns = Callable[[Remainder], Floats]
Test = Callable[[Remainder], Trace]


def basis_test(
    key: str,
    make: Columns,
    sigma: Floats | float = np.inf,
    bases: Columns = columns.constant,
    is_possible: Callable[[Floats], bool] = lambda amounts: True,
) -> Test:
    """The test of columns that vary with the best of some basis functions.

    sigma: prior standard uncertainties of the amounts, in the units of the columns.  is_possible:
    whether there can be such amounts (q,); impossible ones explain nothing.
    """

    def test(remainder: Remainder) -> Trace:
        trace = score_bases(remainder, key, make(remainder), bases(remainder), sigma)
        return trace if is_possible(trace.amounts) else trace._replace(fall=0.0)

    return test


#: Number of frequencies that are tried between the neighbours of the best one.
FINER_FREQUENCIES = 17


def wave_test(key: str, make: Columns, sigma: Floats | float) -> Test:
    """The test of columns that oscillate; the trace's place is the best frequency, cycles per row.
    sigma: prior standard uncertainty of the amounts."""

    def test(remainder: Remainder) -> Trace:
        made, tried = make(remainder), columns.frequencies(remainder)
        trace = score_bases(remainder, key, made, columns.waves(remainder, tried), sigma)
        n, log_trials = int(trace.at[0]), trace.log_trials
        if trace.score > 0:
            ends = tried[max(n - 1, 0)], tried[min(n + 1, len(tried) - 1)]
            tried = np.linspace(*ends, FINER_FREQUENCIES)
            trace = score_bases(remainder, key, made, columns.waves(remainder, tried), sigma)
            n = int(trace.at[0])
        return trace._replace(log_trials=log_trials, at=(float(tried[n]),))

    return test


# ---- components that jump, switch, drift or oscillate


@dataclass(frozen=True)
class DriftSource:
    """A component that may jump, drift or oscillate during a calibration.

    columns: its effect on the readings; sigma: prior standard uncertainty of the amounts; size:
    amounts in words.  remedy, measurement: see `Alternative`.  ends_in_use: whether the sensor is
    used in the state at the end of the run; if not, in the state with less light.  harmless:
    whether a jump does not forbid to use the result.
    """

    key: str
    group: str
    words: str
    columns: Columns
    sigma: Floats | float
    size: Callable[[Floats], str]
    remedy: str
    measurement: str
    ends_in_use: bool = True
    harmless: bool = False


def lengths(*axes: str) -> Callable[[Floats], str]:
    """Make a function that writes amounts, mm, along these axes in words."""

    def words(amounts: Floats) -> str:
        parts = zip(amounts.tolist(), axes, strict=True)
        return "by " + " and ".join(f"{1e3 * size:.3g} um along {axis}" for size, axis in parts)

    return words


def pose_size(amounts: Floats) -> str:
    """The sizes (6,) of a pose's change, mm and rad, in words."""
    return f"by {describe_pose(amounts)}"


def angles(amounts: Floats) -> str:
    """Two angles (2,), rad, in words."""
    return f"by {1e6 * amounts[0]:.3g} and {1e6 * amounts[1]:.3g} urad"


def supply_size(amounts: Floats) -> str:
    """The largest of some displacements, mm, in words."""
    return f"by up to {1e3 * np.abs(amounts).max():.2g} um"


def turn_size(amounts: Floats) -> str:
    """An angle (1,), rad, in words."""
    return f"by {1e3 * amounts[0]:.3g} mrad"


def fraction_size(amounts: Floats) -> str:
    """A fraction (1,) as a percentage in words."""
    return f"by {100 * amounts[0]:.3g} %"


def powers(amounts: Floats) -> str:
    """The powers on three detectors, of the amounts of a lamp (9,) or of dark currents (3,)."""
    sizes = ", ".join(f"{1e3 * size:.2g}" for size in amounts[:: len(amounts) // 3])
    return f"by {sizes} uW on A, B and C"


#: Prior standard uncertainty of a lamp's light on each detector, mW and mW mm; of light that a
#: facet scatters, the same per mW of the facet's light.
LAMP_SIGMA = np.array([3e-3, 9e-3, 9e-3] * 3)
TURN = "calibrate again with the mirror turned by 120 degrees on the reference"
DRIFT_SOURCES = (
    *(
        DriftSource(f"detector_{k}", "detectors", f"detector {k.upper()}",
              partial(columns.detector_columns, k=n), 0.3, lengths("psi", "zeta"),
              "fasten it", "press lightly on its post, and look at its readings")
        for n, k in enumerate(DETECTORS)
    ),
    *(
        DriftSource(f"gain_{k}", "electronics", f"the gain of detector {k.upper()}",
              partial(columns.power_columns, detectors=(n,)), 0.03, fraction_size,
              "look at its amplifier and its plugs",
              "let the mirror rest and look at that power over the other two")
        for n, k in enumerate(DETECTORS)
    ),
    DriftSource("supply", "electronics", "the places on all detectors", columns.place_columns, 0.05,
          supply_size, "look at the supply and the reference voltage of the amplifiers, and for "
          "warm air in the beams' paths", "let the mirror rest under a cover, and record it"),
    DriftSource("seat", "reference", "the mirror on the reference (or its zero)",
          lambda remainder: remainder.pose_columns, np.array([0.01] * 3 + [5e-5] * 3), pose_size,
          "fasten the mirror, and look for cables that pull",
          "come back to one pose again and again"),
    DriftSource("beam", "light", "the beam", lambda remainder: remainder.beam_columns, 0.01,
          lengths("x", "y"), "fasten the laser, and shield the beam from moving air",
          "let the mirror rest and look at all three spots"),
    *(
        DriftSource(f"facet_{k}", "facets", f"facet {k.upper()}",
              partial(columns.facet_columns, letters=k), 1e-3, angles,
              "look how the facets are held", TURN)
        for k in DETECTORS
    ),
    DriftSource("polarisation", "light", "the light's polarisation",
          partial(columns.effect_columns, series="light.polarization"), 0.3, turn_size,
          "put a polariser behind the fibre or the laser",
          "put a polariser into the beam", harmless=True),
    DriftSource("laser", "light", "the laser's power", columns.laser_columns, 0.05, fraction_size,
          "let the laser warm up, and look at its current", "let the mirror rest and look at the "
          "sum of the powers", harmless=True),
    DriftSource("dark", "electronics", "the detectors' dark currents", columns.dark_columns, 1e-3,
          powers,
          "look at the amplifiers' offsets, and measure in the dark",
          "block the beam, and look at the powers that are left", ends_in_use=False),
    DriftSource("lamp", "environment", "light of a lamp on the detectors", columns.lamp_columns,
          LAMP_SIGMA, powers, "switch lamps off, or shield the detectors",
          "block the beam, and look at the powers that are left", ends_in_use=False),
)  # fmt: skip


def changes_of(source: DriftSource) -> list[Alternative]:
    """The alternatives that a component jumps or switches, drifts, oscillates, or follows the
    temperature."""

    def switch(remainder: Remainder) -> Trace:
        """The trace of a quantity that changes between two values, several times."""
        made, bases = source.columns(remainder), columns.steps(remainder)
        step = score_bases(remainder, f"{source.key}.jumped", made, bases, source.sigma)
        first = np.argmax(bases[int(step.at[0]), :, 0] > 0)
        step = step._replace(at=(float(first),))
        trace, state = score_switching(remainder, made, step, source.sigma)
        in_use = state[-1] if source.ends_in_use else trace.amounts[0] < 0
        return trace._replace(columns=made * (state.astype(float) - in_use)[:, None, None])

    def size_of_switch(trace: Trace, remainder: Remainder) -> str:
        """The rows between which it changes, and its size, in words."""
        numbers = remainder.row_numbers
        between = [f"{numbers[int(n) - 1]} and {numbers[int(n)]}" for n in trace.at]
        listed, more = ", ".join(between[:MAX_LISTED_ROWS]), len(between) - MAX_LISTED_ROWS
        rest = f" and {more} times more" if more > 0 else ""
        return f"between rows {listed}{rest}, {source.size(trace.amounts)}"

    def size_of_wave(trace: Trace, remainder: Remainder) -> str:
        """The amplitude and the period in words."""
        amplitudes = np.hypot(*trace.amounts.reshape(-1, 2).T)
        return f"{source.size(amplitudes)} at a period of {1 / trace.at[0]:.4g} rows"

    def alternative(change: str, **parts: Any) -> Alternative:
        """The alternative of this kind of change."""
        words = f"{source.words} {CHANGE_VERBS[change]}"
        return Alternative(f"{source.key}.{change}", source.group, words, source.remedy,
                           source.measurement, **parts)  # fmt: skip

    def first_state(remainder: Remainder) -> Floats:
        """The columns (n, 9, q) of a drift to the state at the beginning of the run, in which poses
        may be measured."""
        return np.kron(source.columns(remainder), columns.slow_drift(remainder)[0, 0])

    common = source.columns, source.sigma
    return [
        alternative("jumped", test=switch, size=size_of_switch, refuses=not source.harmless),
        alternative("drifted",
                    test=basis_test(f"{source.key}.drifted", *common, columns.slow_drift),
                    in_use=None if source.group in SENSOR_GROUPS else first_state),
        alternative("oscillated", size=size_of_wave,
                    test=wave_test(f"{source.key}.oscillated", *common)),
        alternative("warmed", test=basis_test(f"{source.key}.warmed", *common, columns.warmth)),
    ]  # fmt: skip


# ---- effects that last through the run


def facets_of(amounts: Floats) -> str:
    """The facets that lose light at the tip, in words, from the areas (3,) in mm^2; an area that
    all have in common does not count."""
    largest = max(float(amounts.max()), 0.0)
    parts = [k.upper() for k, area in zip(DETECTORS, amounts, strict=True)
             if area > 0.4 * largest > 0]  # fmt: skip
    names = "all facets" if len(parts) == 3 else " and ".join(f"facet {k}" for k in parts)
    return f"on {names or 'some facets'}"


def largest(words: str, factor: float = 100.0) -> Callable[[Trace, Remainder], str]:
    """The largest of the amounts, in words; in percent."""
    return lambda trace, remainder: words.format(factor * np.abs(trace.amounts).max())


def period(trace: Trace, remainder: Remainder) -> str:
    """The period of fringes in words."""
    return f"({trace.at[0]:.2g} mm apart)"


def one_facet_test(
    key: str, make: Columns, sigma: Floats | float, bases: Columns = columns.constant
) -> Test:
    """The test of the columns of one facet, the best of three; its number (0 to 2) is the trace's
    place. sigma: prior standard uncertainty of the amounts."""

    def test(remainder: Remainder) -> Trace:
        parts, basis = np.split(make(remainder), 3, axis=2), bases(remainder)
        traces = [score_bases(remainder, key, part, basis, sigma) for part in parts]
        best = max(range(3), key=lambda k: traces[k].fall)
        return traces[best]._replace(log_trials=float(np.log(3)), at=(float(best),))

    return test


def reference_test(kind: str) -> Test:
    """The test of one kind of error of the reference, see `columns.reference_terms`."""

    def test(remainder: Remainder) -> Trace:
        terms = columns.reference_terms(remainder)[kind]
        made = columns.reference_columns(remainder, terms)
        return score_columns(remainder, kind, made, 1.0, LEAST_OF_REFERENCE)

    return test


def test_fringes(remainder: Remainder) -> Trace:
    """The trace of fringes that are fixed in the beam; its place is their period, mm."""
    made = columns.power_columns(remainder, (0, 1, 2))
    trace = score_bases(remainder, "fringes", made, columns.fringes(remainder))
    periods = np.tile(columns.FRINGE_PERIODS_MM, columns.FRINGE_DIRECTIONS)
    return trace._replace(at=(float(periods[int(trace.at[0])]),))


def test_window(remainder: Remainder, k: int) -> Trace:
    """The trace of fringes of the window of detector k; its place is their period, mm."""
    key = f"window_{DETECTORS[k]}"
    made = remainder.readable(columns.window_columns(remainder, k))
    periods = columns.likely_fringes(remainder, made, k)
    trace = score_bases(remainder, key, made, columns.window_fringes(remainder, periods, k))
    periods = periods[int(trace.at[0])] + columns.square_grid(*columns.FINER_WINDOWS)
    trace = score_bases(remainder, key, made, columns.window_fringes(remainder, periods, k))
    across = np.hypot(*(periods[int(trace.at[0])] / columns.spot_range(remainder, k)))
    log_trials = float(np.log(columns.WINDOW_PERIODS.size**2 / 2))
    return trace._replace(log_trials=log_trials, at=(1 / max(float(across), 1e-12),))


def test_resets(remainder: Remainder) -> Trace:
    """The trace of dark currents that a detector resets at intervals; its place is the interval in
    rows."""
    made = remainder.readable(columns.lamp_columns(remainder))  # of each of four electrodes
    blocks, length = columns.likely_resets(remainder, made)
    sigma = np.repeat(LAMP_SIGMA, blocks.shape[1])
    made = (made[:, :, :, None] * blocks[:, None, None, :]).reshape(*made.shape[:2], -1)
    trace = score_columns(remainder, "dark.reset", made, sigma)
    return trace._replace(log_trials=float(np.log(len(blocks) / 3)), at=(float(length),))


#: Directions of the reference's errors are excluded if parameters of the sensor explain all but
#: this fraction of their square, since an error of the model would be magnified.
LEAST_OF_REFERENCE = 5e-4
CAMERA = "look at the beam with a camera"
MICROSCOPE = "look at the mirror with a microscope"
REFERENCE_REMEDY = "have the reference calibrated, or measure with the mirror at its pivot"

ALTERNATIVES: tuple[Alternative, ...] = (
    # the light
    Alternative("shape", "light", "the light's cross-section is not that of the model",
                "clean the beam with a pinhole or a fibre, and tilt windows that reflect", CAMERA,
                basis_test("shape", columns.shape_columns), general=True),
    Alternative("ghost", "light", "there is a second reflex next to the beam, or the beam is not "
                "symmetric", "tilt windows that reflect, and clean the beam with a pinhole", CAMERA,
                basis_test("ghost", partial(columns.effect_columns, series="asymmetry"))),
    Alternative("modes", "light", "the beam has other modes in addition to the Gaussian one",
                "clean the beam with a pinhole or a fibre", CAMERA,
                basis_test("modes", partial(columns.effect_columns, series="profile"))),
    Alternative("fringes", "light", "there are fringes across the beam, or dust of such a size",
                "tilt windows that reflect, and clean the optics", CAMERA, test_fringes, period),
    Alternative("feedback", "light", "the beam or its power follows the mirror's angles, as where "
                "light returns into the laser", "pitch the detectors by some mrad, or put an "
                "isolator behind the laser", "let the mirror rest, and block one detector after "
                "the other", basis_test("feedback", columns.laser_beam_columns,
                                        columns.FEEDBACK_SIGMA, columns.angle_polynomials)),
    *(
        Alternative(f"window_{k}", "detectors",
                    f"there are fringes of the window of detector {k.upper()}",
                    "tilt the window, or take it off", "turn that detector a little",
                    partial(test_window, k=n), period)
        for n, k in enumerate(DETECTORS)
    ),
    Alternative("responsivity", "detectors", "a detector's responsivity varies over its face",
                "take another detector", "turn that detector a little",
                basis_test("responsivity", columns.responsivity_columns, 0.03),
                largest("(by up to {:.2g} % at its edge)")),
    # the facets
    Alternative("chip", "facets", "the mirror's tip is chipped", "take another mirror, or keep the "
                "beam off the tip", MICROSCOPE, basis_test("chip", columns.chip_columns),
                lambda trace, remainder: facets_of(trace.amounts)),
    Alternative("uneven", "facets", "a facet reflects unevenly, as one that is tarnished",
                "clean the mirror, or take another one", MICROSCOPE,
                basis_test("uneven", columns.uneven_columns, 0.1),
                largest("(by up to {:.2g} % for each mm)")),
    Alternative("scatter", "facets", "light of one facet falls on another detector, "
                "scattered by the facet or mirrored by its detector",
                "clean the mirror, and shield the detectors from each other", "cover a facet",
                one_facet_test("scatter", columns.scatter_columns, LAMP_SIGMA[:6])),
    Alternative("yield", "facets", "a facet yields as the mirror turns",
                "see how the facets are held", TURN,
                one_facet_test("yield", columns.facet_columns, 1e-3, columns.mirror_angles),
                lambda trace, remainder: (
                    f"({DETECTORS[int(trace.at[0])].upper()}, by up to "
                    f"{1e3 * np.abs(trace.amounts).max():.2g} urad for each mrad)")),
    # the reference
    *(
        Alternative(key, "reference", words, REFERENCE_REMEDY, TURN, reference_test(key),
                    general=key == "reference")
        for key, words in (
            ("reference", "the reference's axes err in a way that its own coordinates give"),
            ("scale", "an axis of the reference has a wrong scale"),
            ("abbe", "an Abbe offset of the reference (lengths that it measures at a distance from "
             "the mirror err by its angles)"),
            ("squareness", "the reference's axes are not square to each other"),
            ("bow", "the reference's guides are bowed"),
            ("cosine", "a cosine error of the reference (its lengths err by squares of its "
             "angles)"),
        )
    ),
    *(
        replace(fault, test=basis_test(  # the full change is 1
            fault.key, partial(columns.changed_columns, fault=fault),
            is_possible=lambda amounts: bool(0.5 < amounts[0] < 1.5)))
        for fault in angle_orders()
    ),
    # the clocks
    Alternative("clock", "time", "the clocks of reference and readings run apart",
                "take both from one clock", "compare both clocks over an hour",
                basis_test("clock", columns.clock_columns),
                lambda trace, remainder: f"by {1e3 * trace.amounts[0]:.2g} ms over half the run"),
    Alternative("skew", "time", "detectors are read at other times than the reference, or than "
                "each other", "give the times at which each was read (sensor.light.delays_us)",
                "move at half the speed", basis_test("skew", columns.moving_columns),
                lambda trace, remainder: "by {:.3g}, {:.3g} and {:.3g} ms".format(
                    *(1e3 * trace.amounts))),
    Alternative("axis_delays", "time", "the reference's axes are read at different times, or the "
                "mirror follows them late as by creep", "read them at once, and wait at each pose",
                 "move at half the speed",
                basis_test("axis_delays", columns.axis_delay_columns),
                lambda trace, remainder: f"(up to {1e3 * np.ptp(trace.amounts):.2g} ms apart)"),
    # the electronics
    Alternative("memory", "electronics", "detectors or their amplifiers retain a fraction of the "
                "previous reading", "wait longer at each pose, or slow down",
                "repeat a pose from the other side, and wait there",
                basis_test("memory", columns.memory_columns, 0.005,
                           is_possible=lambda amounts: bool(amounts.max() > -amounts.min())),
                largest("(up to {:.2g} %)"), columns.memory_in_use),
    Alternative("averaged", "table", "the readings were averaged or filtered, and the reference "
                "was not", "record both alike", "move at half the speed",
                basis_test("averaged", columns.averaged_columns,
                           is_possible=lambda amounts: bool(amounts[0] > 0)),  # else that is noise
                lambda trace, remainder: (
                    f"(as over {np.sqrt(1 + 12 * trace.amounts[0]):.2g} rows)")),
    Alternative("amplifiers", "electronics", "the amplifiers bend (their gain changes with the "
                "current)", "use a lower range of the amplifiers, or let calibrate.before.bend_um "
                "vary", "halve the laser's power",
                basis_test("amplifiers", columns.amplifier_columns, 0.1)),
    Alternative("crosstalk", "electronics", "currents of one detector leak into the channels of "
                "another", "keep their cables apart",
                "block one detector, and look at its readings",
                basis_test("crosstalk", columns.leak_columns, 0.01), largest("(up to {:.2g} %)")),
    Alternative("dark.reset", "electronics", "offsets of the detectors are set again and again, as "
                "by an automatic zero", "switch it off", "block the beam, and look at the powers "
                "that are left", test_resets,
                lambda trace, remainder: f"(every {trace.at[0]:.0f} rows)"),
    *(alternative for source in DRIFT_SOURCES for alternative in changes_of(source)),
)  # fmt: skip
BY_KEY = {alternative.key: alternative for alternative in ALTERNATIVES}
