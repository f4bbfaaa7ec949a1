"""The list of what else could explain a fit's residuals, each alternative declared as data.

What an alternative does to the readings: `columns`. How it is judged: `remainder`.
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
    COURSES,
    MOST_ROWS_LISTED,
    OF_SENSOR,
    Alternative,
    Trace,
    describe_pose,
)
from .faults import angle_orders
from .remainder import Remainder
from .score import score_columns, score_courses, score_switching


def plain(
    key: str,
    make: Callable[[Remainder], Floats],
    sigma: Floats | float = np.inf,
    is_possible: Callable[[Floats], bool] = lambda amounts: True,
) -> Callable[[Remainder], Trace]:
    """The test of columns that act on all rows.  sigma: prior standard uncertainty of amounts, in
    the units of the columns.  is_possible: whether there can be such amounts (q,); others explain
    nothing."""

    def test(remainder: Remainder) -> Trace:
        trace = score_columns(remainder, key, make(remainder), sigma)
        return trace if is_possible(trace.amounts) else trace._replace(fall=0.0)

    return test


def course_test(
    key: str,
    make: Callable[[Remainder], Floats],
    courses: Callable[[Remainder], Floats],
    sigma: Floats | float = np.inf,
) -> Callable[[Remainder], Trace]:
    """The test of columns that act by the best of several courses."""
    return lambda remainder: score_courses(
        remainder, key, make(remainder), courses(remainder), sigma
    )


#: Frequencies between the neighbours of the best one.
FINER = 17


def wave_test(
    key: str,
    make: Callable[[Remainder], Floats],
    courses: Callable[[Remainder, Floats], Floats],
    grid: Callable[[Remainder], Floats],
    sigma: Floats | float = np.inf,
) -> Callable[[Remainder], Trace]:
    """The test of columns that act by a wave of the best frequency of a grid, or beside it; the
    place of the trace is that frequency."""

    def test(remainder: Remainder) -> Trace:
        made, tried = make(remainder), grid(remainder)
        trace = score_courses(remainder, key, made, courses(remainder, tried), sigma)
        n, chances = int(trace.at[0]), trace.log_trials
        if trace.score > 0:
            tried = np.linspace(tried[max(n - 1, 0)], tried[min(n + 1, len(tried) - 1)], FINER)
            trace = score_courses(remainder, key, made, courses(remainder, tried), sigma)
            n = int(trace.at[0])
        return trace._replace(log_trials=chances, at=(float(tried[n]),))

    return test


# ---- what moves, drifts or switches


@dataclass(frozen=True)
class DriftSource:
    """A component that may jump, drift or oscillate during a calibration.

    columns: what that does to the readings, and sigma: its prior standard uncertainty.  size:
    amounts in words.  remedy, apart: see `Alternative`.  stays: whether the state at the end is
    that in which the sensor is used; else the one with less light is.  harmless: whether it
    forbids no use.
    """

    key: str
    group: str
    words: str
    columns: Callable[[Remainder], Floats]
    sigma: Floats | float
    size: Callable[[Floats], str]
    remedy: str
    apart: str
    stays: bool = True
    harmless: bool = False


def lengths(*axes: str) -> Callable[[Floats], str]:
    def words(amounts: Floats) -> str:
        parts = zip(amounts.tolist(), axes, strict=True)
        return "by " + " and ".join(f"{1e3 * size:.3g} um along {axis}" for size, axis in parts)

    return words


def pose_size(amounts: Floats) -> str:
    return f"by {describe_pose(amounts)}"


def angles(amounts: Floats) -> str:
    return f"by {1e6 * amounts[0]:.3g} and {1e6 * amounts[1]:.3g} urad"


def supply_size(amounts: Floats) -> str:
    return f"by up to {1e3 * np.abs(amounts).max():.2g} um"


def turn_size(amounts: Floats) -> str:
    return f"by {1e3 * amounts[0]:.3g} mrad"


def share_size(amounts: Floats) -> str:
    return f"by {100 * amounts[0]:.3g} %"


def powers(amounts: Floats) -> str:
    """The powers on three detectors, of the amounts of a lamp (9,) or of dark currents (3,)."""
    sizes = ", ".join(f"{1e3 * size:.2g}" for size in amounts[:: len(amounts) // 3])
    return f"by {sizes} uW on A, B and C"


#: What light of a lamp may be on each detector, mW and mW mm, 1 sigma; of light that a facet
#: scatters, over its power.
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
              partial(columns.power_columns, detectors=(n,)), 0.03, share_size,
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
              partial(columns.unknown_columns,
                      names=(f"facet_{k}.inclination", f"facet_{k}.azimuth")), 1e-3, angles,
              "look how the facets are held",
              TURN)
        for k in DETECTORS
    ),
    DriftSource("polarisation", "light", "the light's polarisation",
          partial(columns.effect_columns, series="light.polarization"), 0.3, turn_size,
          "put a polariser behind the fibre or the laser",
          "put a polariser into the beam", harmless=True),
    DriftSource("laser", "light", "the laser's power", columns.laser_columns, 0.05, share_size,
          "let the laser warm up, and look at its current", "let the mirror rest and look at the "
          "sum of the powers", harmless=True),
    DriftSource("dark", "electronics", "the detectors' dark currents", columns.dark_columns, 1e-3,
          powers,
          "look at the amplifiers' offsets, and measure in the dark",
          "block the beam, and look at the powers that are left", stays=False),
    DriftSource("lamp", "environment", "light of a lamp on the detectors", columns.lamp_columns,
          LAMP_SIGMA, powers, "switch lamps off, or shield the detectors",
          "block the beam, and look at the powers that are left", stays=False),
)  # fmt: skip


def moving(source: DriftSource) -> list[Alternative]:
    """The alternatives of a component that jumps, switches, drifts or oscillates."""

    def rows(trace: Trace, remainder: Remainder) -> list[str]:
        numbers = remainder.row_numbers
        return [f"{numbers[int(n) - 1]} and {numbers[int(n)]}" for n in trace.at]

    def jump(remainder: Remainder) -> Trace:
        made, key = source.columns(remainder), f"{source.key}.jumped"
        courses = columns.steps(remainder)
        step = score_courses(remainder, key, made, courses, source.sigma)
        first = np.argmax(courses[int(step.at[0]), :, 0] > 0)
        return step._replace(at=(float(first),))

    def switch(remainder: Remainder) -> Trace:
        made = source.columns(remainder)
        trace, state = score_switching(remainder, made, jump(remainder), source.sigma)
        usual = state[-1] if source.stays else trace.amounts[0] < 0
        return trace._replace(columns=made * (state.astype(float) - usual)[:, None, None])

    def size_of_switch(trace: Trace, remainder: Remainder) -> str:
        between = rows(trace, remainder)
        listed = ", ".join(between[:MOST_ROWS_LISTED])
        more = f" and {len(between) - MOST_ROWS_LISTED} times more"
        rest = more if len(between) > MOST_ROWS_LISTED else ""
        return f"between rows {listed}{rest}, {source.size(trace.amounts)}"

    def size_of_wave(trace: Trace, remainder: Remainder) -> str:
        made = trace.amounts.reshape(-1, 2)
        return f"{source.size(np.hypot(*made.T))} at a period of {1 / trace.at[0]:.4g} rows"

    def alternative(course: str, **parts: Any) -> Alternative:
        words = f"{source.words} {COURSES[course]}"
        return Alternative(f"{source.key}.{course}", source.group, words, source.remedy,
                           source.apart, **parts)  # fmt: skip

    def first_state(remainder: Remainder) -> Floats:
        """As it was at the beginning, where poses may be measured in that state."""
        made, first = source.columns(remainder), columns.slow_drift(remainder)[0, 0]
        return np.kron(made, first)

    def course(name: str, courses: Callable[[Remainder], Floats]) -> Callable[[Remainder], Trace]:
        return course_test(f"{source.key}.{name}", source.columns, courses, source.sigma)

    return [
        alternative("jumped", test=switch, size=size_of_switch, refuses=not source.harmless),
        alternative("drifted", test=course("drifted", columns.slow_drift),
                    in_use=None if source.group in OF_SENSOR else first_state),
        alternative("oscillated", size=size_of_wave,
                    test=wave_test(f"{source.key}.oscillated", source.columns, columns.waves,
                                   columns.frequencies, source.sigma)),
        alternative("warmed", test=course("warmed", columns.warmth)),
    ]  # fmt: skip


# ---- what stays as it is


def facets_of(amounts: Floats) -> str:
    """The facets that lose light at the tip, beside an area that all have in common."""
    largest = max(float(amounts.max()), 0.0)
    parts = [k.upper() for k, area in zip(DETECTORS, amounts, strict=True)
             if area > 0.4 * largest > 0]  # fmt: skip
    whole = "all facets" if len(parts) == 3 else " and ".join(f"facet {k}" for k in parts)
    return f"on {whole or 'some facets'}"


def one_facet_test(
    key: str, make: Callable[[Remainder], Floats], sigma: Floats | float
) -> Callable[[Remainder], Trace]:
    """The test of the columns of one facet, the best of three; its number is the trace's place."""

    def test(remainder: Remainder) -> Trace:
        parts = np.split(make(remainder), 3, axis=2)
        traces = [score_columns(remainder, key, part, sigma) for part in parts]
        best = max(range(3), key=lambda k: traces[k].fall)
        return traces[best]._replace(log_trials=float(np.log(3)), at=(float(best),))

    return test


def reference_test(kind: str) -> Callable[[Remainder], Trace]:
    def test(remainder: Remainder) -> Trace:
        terms = columns.reference_terms(remainder)[kind]
        made = columns.reference_columns(remainder, terms)
        return score_columns(remainder, kind, made, 1.0, LEAST_OF_REFERENCE)

    return test


def test_dust(remainder: Remainder) -> Trace:
    """Look at the powers first, which lose most, for the place; then at all readings about it."""
    (width, count), *finer = columns.DUST_WIDTHS
    places = columns.beam_sigma(remainder.sensor) * columns.square_grid(width, count)
    made = columns.power_columns(remainder, (0, 1, 2))
    coarse = score_courses(remainder, "dust", made, columns.shadows(remainder, places), 0.03)
    if coarse.score < 0:
        return coarse
    landing, sigma = columns.RayLanding(remainder), columns.beam_sigma(remainder.sensor)
    middle, trials, best = places[int(coarse.at[0])], len(places), None
    for width, count in finer:
        for place in middle + sigma * columns.square_grid(width, count):
            column = columns.dust_column(remainder, landing, place)
            trace = score_columns(remainder, "dust", column[:, :, None], 1.0)
            trials += 1
            if best is None or trace.fall > best.fall:
                best = trace._replace(at=tuple(place.tolist()))
        assert best is not None
        middle = np.array(best.at)
    assert best is not None
    return best._replace(log_trials=float(np.log(trials)))


def test_fringes(remainder: Remainder) -> Trace:
    made = columns.power_columns(remainder, (0, 1, 2))
    trace = score_courses(remainder, "fringes", made, columns.fringes(remainder))
    periods = np.tile(columns.FRINGE_PERIODS_MM, columns.FRINGE_DIRECTIONS)
    return trace._replace(at=(float(periods[int(trace.at[0])]),))


def test_window(remainder: Remainder, k: int) -> Trace:
    key = f"window_{DETECTORS[k]}"
    made = remainder.readable(columns.window_columns(remainder, k))
    periods = columns.likely_fringes(remainder, made, k)
    trace = score_courses(remainder, key, made, columns.window_fringes(remainder, periods, k))
    periods = periods[int(trace.at[0])] + columns.square_grid(*columns.FINER_WINDOWS)
    trace = score_courses(remainder, key, made, columns.window_fringes(remainder, periods, k))
    across = np.hypot(*(periods[int(trace.at[0])] / columns.spot_range(remainder, k)))
    chances = float(np.log(columns.WINDOW_PERIODS.size**2 / 2))
    return trace._replace(log_trials=chances, at=(1 / max(float(across), 1e-12),))


def test_resets(remainder: Remainder) -> Trace:
    made = remainder.readable(columns.lamp_columns(remainder))  # of each of four electrodes
    blocks, length = columns.likely_resets(remainder, made)
    sigma = np.repeat(LAMP_SIGMA, blocks.shape[1])
    whole = made[:, :, :, None] * blocks[:, None, None, :]
    trace = score_columns(remainder, "dark.reset", whole.reshape(*made.shape[:2], -1), sigma)
    return trace._replace(log_trials=float(np.log(len(blocks) / 3)), at=(float(length),))


#: Errors of the reference of which parameters of the sensor explain all but this share of the
#: square are left out: an error of the model would be magnified.
LEAST_OF_REFERENCE = 5e-4
CAMERA = "look at the beam with a camera"
MICROSCOPE = "look at the mirror with a microscope"
OF_REFERENCE = "have the reference calibrated, or measure with the mirror at its pivot"

ALTERNATIVES: tuple[Alternative, ...] = (
    # the light
    Alternative("shape", "light", "the light's cross-section is not that of the model",
                "clean the beam with a pinhole or a fibre, and tilt windows that reflect", CAMERA,
                plain("shape", columns.shape_columns), general=True),
    Alternative("ghost", "light", "there is a second reflex beside the beam, or the beam is not "
                "symmetric", "tilt windows that reflect, and clean the beam with a pinhole", CAMERA,
                plain("ghost", partial(columns.effect_columns, series="asymmetry"))),
    Alternative("modes", "light", "the beam has other modes beside the Gaussian one",
                "clean the beam with a pinhole or a fibre", CAMERA,
                plain("modes", partial(columns.effect_columns, series="profile"))),
    Alternative("fringes", "light", "there are fringes across the beam, or dust of such a size",
                "tilt windows that reflect, and clean the optics", CAMERA, test_fringes,
                lambda trace, remainder: f"({trace.at[0]:.2g} mm apart)"),
    Alternative("feedback", "light", "the beam or its power follows the mirror's angles, as where "
                "light returns into the laser", "pitch the detectors by some mrad, or put an "
                "isolator behind the laser", "let the mirror rest, and block one detector after "
                "the other", course_test("feedback", columns.laser_beam_columns,
                                         columns.angle_courses, columns.FEEDBACK_SIGMA)),
    *(
        Alternative(f"window_{k}", "detectors",
                    f"there are fringes of the window of detector {k.upper()}",
                    "tilt the window, or take it off", "turn that detector a little",
                    partial(test_window, k=n),
                    lambda trace, remainder: f"({trace.at[0]:.2g} mm apart)")
        for n, k in enumerate(DETECTORS)
    ),
    Alternative("responsivity", "detectors", "a detector's responsivity varies over its face",
                "take another detector", "turn that detector a little",
                plain("responsivity", columns.responsivity_columns, 0.03),
                lambda trace, remainder: (
                    f"(by up to {100 * np.abs(trace.amounts).max():.2g} % at its edge)")),
    # the facets
    Alternative("chip", "facets", "the mirror's tip is chipped", "take another mirror, or keep the "
                "beam off the tip", MICROSCOPE, plain("chip", columns.chip_columns),
                lambda trace, remainder: facets_of(trace.amounts)),
    Alternative("dust", "facets", "there is dust on a facet", "clean the mirror", MICROSCOPE,
                test_dust, lambda trace, remainder: (
                    f"at {trace.at[0]:.2g} mm along x and {trace.at[1]:.2g} mm along y from the "
                    "tip")),
    Alternative("uneven", "facets", "a facet reflects unevenly, as one that is tarnished",
                "clean the mirror, or take another one", MICROSCOPE,
                plain("uneven", columns.uneven_columns, 0.1),
                lambda trace, remainder: (
                    f"(by up to {100 * np.abs(trace.amounts).max():.2g} % for each mm)")),
    Alternative("scatter", "facets", "light of one facet falls on another detector, "
                "scattered by the facet or mirrored by its detector",
                "clean the mirror, and shield the detectors from each other", "cover a facet",
                one_facet_test("scatter", columns.scatter_columns, LAMP_SIGMA[:6])),
    Alternative("yield", "facets", "a facet yields as the mirror turns",
                "see how the facets are held", TURN,
                one_facet_test("yield", columns.yield_columns, 1e-3),
                lambda trace, remainder: (
                    f"({DETECTORS[int(trace.at[0])].upper()}, by up to "
                    f"{1e3 * np.abs(trace.amounts).max():.2g} urad for each mrad)")),
    # the reference
    *(
        Alternative(key, "reference", words, OF_REFERENCE, TURN, reference_test(key),
                    general=key == "reference")
        for key, words in (
            ("reference", "the reference's axes err in a way that its own coordinates give"),
            ("scale", "an axis of the reference has a wrong scale"),
            ("abbe", "an Abbe offset of the reference (lengths that it measures beside the mirror "
             "err by its angles)"),
            ("squareness", "the reference's axes are not square to each other"),
            ("bow", "the reference's guides are bowed"),
            ("cosine", "a cosine error of the reference (its lengths err by squares of its "
             "angles)"),
        )
    ),
    *(
        replace(fault, test=plain(  # the whole change is 1
            fault.key, partial(columns.changed_columns, fault=fault),
            is_possible=lambda amounts: bool(0.5 < amounts[0] < 1.5)))
        for fault in angle_orders()
    ),
    # the clocks
    Alternative("clock", "time", "the clocks of reference and readings run apart",
                "take both from one clock", "compare both clocks over an hour",
                plain("clock", columns.clock_columns),
                lambda trace, remainder: f"by {1e3 * trace.amounts[0]:.2g} ms over half the run"),
    Alternative("skew", "time", "detectors are read at other times than the reference, or than "
                "each other", "give the times at which each was read (sensor.light.delays_us)",
                "move at half the speed", plain("skew", columns.moving_columns),
                lambda trace, remainder: "by {:.3g}, {:.3g} and {:.3g} ms".format(
                    *(1e3 * trace.amounts))),
    Alternative("axis_delays", "time", "the reference's axes are read at different times, or the "
                "mirror follows them late as by creep", "read them at once, and wait at each pose",
                 "move at half the speed",
                plain("axis_delays", columns.axis_delay_columns),
                lambda trace, remainder: f"(up to {1e3 * np.ptp(trace.amounts):.2g} ms apart)"),
    # the electronics
    Alternative("memory", "electronics", "detectors or their amplifiers keep a share of the "
                "reading before", "wait longer at each pose, or slow down",
                "repeat a pose from the other side, and wait there",
                plain("memory", columns.memory_columns, 0.005,
                      lambda amounts: bool(amounts.max() > -amounts.min())),
                lambda trace, remainder: (
                    f"(up to {100 * np.abs(trace.amounts).max():.2g} %)"),
                columns.memory_in_use),
    Alternative("averaged", "table", "the readings were averaged or filtered, and the reference "
                "was not", "record both alike", "move at half the speed",
                plain("averaged", columns.averaged_columns,
                      is_possible=lambda amounts: bool(amounts[0] > 0)),  # else that is noise
                lambda trace, remainder: (
                    f"(as over {np.sqrt(1 + 12 * trace.amounts[0]):.2g} rows)")),
    Alternative("amplifiers", "electronics", "the amplifiers bend (their gain changes with the "
                "current)", "use a lower range of the amplifiers, or let calibrate.before.bend_um "
                "vary", "halve the laser's power",
                plain("amplifiers", columns.amplifier_columns, 0.1)),
    Alternative("crosstalk", "electronics", "currents of one detector leak into the channels of "
                "another", "keep their cables apart",
                "block one detector, and look at its readings",
                plain("crosstalk", columns.leak_columns, 0.01),
                lambda trace, remainder: (
                    f"(up to {100 * np.abs(trace.amounts).max():.2g} %)")),
    Alternative("dark.reset", "electronics", "offsets of the detectors are set again and again, as "
                "by an automatic zero", "switch it off", "block the beam, and look at the powers "
                "that are left", test_resets,
                lambda trace, remainder: f"(every {trace.at[0]:.0f} rows)"),
    *(alternative for source in DRIFT_SOURCES for alternative in moving(source)),
)  # fmt: skip
BY_KEY = {alternative.key: alternative for alternative in ALTERNATIVES}
