"""Checks of a table's columns, before anything is fitted."""

from __future__ import annotations

from dataclasses import replace
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import NDArray

from ..core.names import ANGLES, DETECTORS, KINDS, POSE
from ..core.sensor import Sensor
from ..core.units import Booleans, Floats
from ..detectors.correction import correct
from ..detectors.temperature import PLACES
from ..model.arrays import edge_distance, half_sizes, is_near_edge, readings
from .alternatives.alternative import Finding
from .alternatives.scatter import Scatter
from .fitting.bundle_adjustment import (
    CLEAR_SIGMAS,
    LEAST_COUNTED,
    OWN_COUNT,
    Data,
    deviations,
    states_of,
)
from .fitting.samples import row_numbers
from .fitting.unknowns import values_of
from .table import REFERENCE

#: A channel is stuck where it moves by less than this share of what the motion asks of it, and that
#: is many times its noise.
STUCK_SHARE, MOVED_SIGMAS = 0.02, 20.0
#: Two places are the same where they differ by less than this share of how far they move.
SAME_PLACE_SHARE = 0.01
#: An axis counts as moved where its range is so many times the reference's own uncertainty.
LEAST_RANGE_SIGMAS = 30.0
#: How far a motion goes in x and y, in diameters of the beam: less is told, more is advised.
NARROW_DIAMETERS, ADVISED_DIAMETERS = 0.2, 0.3
#: The least distance from an edge that is advised, mm.
CLEAR_DISTANCE_MM = 1.2
#: The share of readings at the edge beyond which their places are not what they are said to be.
MOST_EDGE_SHARE = 0.7
#: Times whose steps differ by less than this share are even; a step is a gap that is so many times
#: the usual one, where there are few.
EVEN_STEPS, GAP_STEPS, MOST_GAPS = 0.1, 10.0, 3
#: How many times its stated uncertainty a reference's last digit may make it err.
WORST_STEPS = 5.0
#: So few different poses tell nothing that could be trusted.
MIN_POSES = 20


def check_columns(sensor: Sensor, data: Data) -> list[Finding]:
    """The findings on the columns alone, those that forbid a calibration first."""
    findings = [
        *stuck_channels(sensor, data),
        *mixed_kinds(data),
        *repeats(data),
        *still_axes(data),
        *untimed_channels(sensor, data),
        *time_gaps(data),
        *unordered_rows(data),
        *narrow_motion(sensor, data),
    ]
    return sorted(findings, key=lambda finding: not finding.bad)


def remove_jumps(values: Floats) -> Floats:
    """Columns (n, m) with NaN for values farther from the middle nine tenths than their width, so
    that a row that jumped does not count in the span of a motion."""
    with np.errstate(invalid="ignore"), catch_warnings():
        simplefilter("ignore")
        low, high = np.nanquantile(values, [0.05, 0.95], axis=0)
        width = np.where(high > low, high - low, np.inf)
        inside = (values >= low - width) & (values <= high + width)
    return np.where(inside, values, np.nan)


def spans(values: Floats) -> Floats:
    """The spans of columns (n, m) without jumps: (m,)."""
    kept = remove_jumps(values)
    reach: Floats = np.nanmax(kept, axis=0) - np.nanmin(kept, axis=0)
    return reach


def stuck_channels(sensor: Sensor, data: Data) -> list[Finding]:
    """Findings on channels that do not follow the motion."""
    with np.errstate(invalid="ignore"), catch_warnings():
        simplefilter("ignore")  # a motion in wrong units may leave no reading at all
        asked = np.nanstd(remove_jumps(expected_readings(sensor, data)), axis=0)
        moved = np.nanstd(remove_jumps(correct(sensor, data.raw)), axis=0)
        noise = np.nanmedian(deviations(sensor, data), axis=0)
    still = np.flatnonzero((moved < STUCK_SHARE * asked) & (asked > MOVED_SIGMAS * noise)).tolist()
    if len({n // 3 for n in still}) > 1:  # not all at once: then the motion is in wrong units
        return []
    return [
        Finding(True, (
            f"{KINDS[n % 3]} of detector {DETECTORS[n // 3].upper()} is stuck: it moves by "
            f"{moved[n]:.2g}, where the motion asks for {asked[n]:.2g}. Look at the detector, its "
            "amplifier and its column."
        ))
        for n in still
    ]  # fmt: skip


def expected_readings(sensor: Sensor, data: Data) -> Floats:
    """The readings (n, 9) that the motion asks of a sensor as it is configured."""
    still = np.zeros((len(data.raw), OWN_COUNT))
    return readings(sensor, states_of(data, still, values_of(sensor)))


def mixed_kinds(data: Data) -> list[Finding]:
    """A finding on currents that were converted by the formula of another kind of detector: then
    both places of each detector are the same, or one is zero."""
    psi, zeta = (remove_jumps(data.raw[:, n::3]) for n in (0, 1))
    with np.errstate(invalid="ignore"), catch_warnings():
        simplefilter("ignore")
        size, other, apart = (np.nanstd(values, axis=0) for values in (psi, zeta, zeta - psi))
    for words, kind, is_so in (
        ("psi and zeta are the same", "pincushion", apart < SAME_PLACE_SHARE * size),
        ("zeta does not move", "duo-lateral", other < SAME_PLACE_SHARE * size),
    ):
        if is_so.all():
            return [Finding(True, (
                f"On all detectors {words}: probably the currents of {kind} detectors were "
                f"converted as those of another kind. Set sensor.electronics.kind to {kind} and "
                "convert the recorded currents again."
            ))]  # fmt: skip
    return []


def repeats(data: Data) -> list[Finding]:
    """Findings on samples that repeat another one."""
    rows = len(np.unique(np.column_stack([data.pose, data.raw]), axis=0))
    poses = len(np.unique(data.pose, axis=0))
    findings = []
    if rows < len(data.raw):
        findings.append(Finding(False, (
            f"{len(data.raw) - rows} of {len(data.raw)} rows repeat another one in every number; "
            "each counts once."
        ), ("repeated",)))  # fmt: skip
    if poses < MIN_POSES and poses < len(data.raw):
        findings.append(Finding(True, (
            f"The {len(data.raw)} samples hold {poses} different poses only: too few to part the "
            "sensor's parameters from each other. Take 50 or more, all over the range "
            "(facets calibrate --propose 50 lists good ones)."
        )))  # fmt: skip
    return findings


def still_axes(data: Data) -> list[Finding]:
    """A finding on axes along which the motion hardly moves."""
    known = np.isfinite(data.sigma)
    span = spans(data.pose)
    names = [POSE[n] for n in range(6) if known[n] and span[n] < LEAST_RANGE_SIGMAS * data.sigma[n]]
    if not names:
        return []
    return [Finding(False, (
        f"The motion hardly moves in {', '.join(names)}: what only these axes can tell keeps its "
        "prior value, and poses away from the motion are no better known than the tolerances say."
    ))]  # fmt: skip


def narrow_motion(sensor: Sensor, data: Data) -> list[Finding]:
    """A finding on a motion in x and y that is too small for the powers' curvature."""
    diameter = min(sensor.beam.diameter_x, sensor.beam.diameter_y)
    beside = data.pose[:, :2] - data.beam
    span = spans(beside)[np.isfinite(data.sigma[:2])] / 2
    if not span.size or span.min() >= NARROW_DIAMETERS * diameter:
        return []
    return [Finding(False, (
        f"The motion reaches {span.min():.2g} mm to each side in x or y. Gains, strips lost at the "
        "edges and the beam's size part from the mirror's place by powers that bend, from "
        f"{ADVISED_DIAMETERS * diameter:.2g} mm on; until then all poses may be off in x and y "
        "together, by what is stated."
    ))]  # fmt: skip


def untimed_channels(sensor: Sensor, data: Data) -> list[Finding]:
    """A finding on channels that are read one after the other, in a table without the speed of
    their change."""
    if data.velocity is not None or not any(sensor.light.delays):
        return []
    return [Finding(False, (
        "sensor.light.delays_us are given, but the table is no motion in time: its readings count "
        "as read at one instant. Give time_s, or let the mirror stand still at each pose."
    ))]  # fmt: skip


def written_times(data: Data) -> tuple[Floats, NDArray[np.int64]]:
    """The times of the rows that have one, in half runs, and the numbers of these rows."""
    time = np.zeros(len(data.raw)) if data.clock is None else data.clock[:, 0]
    return time[time != 0], row_numbers(data)[time != 0]  # the clock of a row without is 0


def time_gaps(data: Data) -> list[Finding]:
    """A finding on a time that jumps, or goes back, in a table of even steps."""
    time, rows = written_times(data)
    if len(time) < 2:
        return []
    step = np.diff(time)
    usual = float(np.median(step))
    even = np.median(np.abs(step - usual)) < EVEN_STEPS * usual
    odd = np.flatnonzero((step > GAP_STEPS * usual) | (step < 0))
    if not even or not odd.size or odd.size > MOST_GAPS:
        return []
    places = ", ".join(f"{rows[n]} and {rows[n + 1]}" for n in odd)
    return [Finding(False, (
        f"time_s jumps between rows {places}: a clock was set, or the table holds two recordings. "
        "Delays and drifts with time may be wrong; calibrate with the rows of one recording."
    ), ("clock_set",))]  # fmt: skip


def unordered_rows(data: Data) -> list[Finding]:
    """A finding on rows that do not stand in the order of time: time_s goes back, or a pose that
    goes up all the time while the others jump as if at random shows that they were sorted."""
    time, _ = written_times(data)
    if len(time):
        if np.sum(np.diff(time) < 0) <= MOST_GAPS:
            return []
        words = "time_s goes back again and again"
    else:
        step = np.diff(data.pose, axis=0)
        noise, least = CLEAR_SIGMAS * data.sigma, np.median(step, axis=0)
        is_up = (step.min(axis=0) > -noise) & (least > noise)
        is_random = (step**2).mean(axis=0) > data.pose.var(axis=0)  # twice it at random
        if is_up.sum() != 1 or not is_random.any():
            return []
        words = f"{REFERENCE[int(np.argmax(is_up))]} goes up all the time, and others jump"
    return [Finding(False, (
        f"The rows do not stand in the order of time, as after sorting ({words}). What goes on in "
        "time, such as drifts, delays and play, cannot be found: give the rows as they were taken."
    ), ("sorted",))]  # fmt: skip


def add_written_steps(sensor: Sensor, data: Data) -> tuple[Data, list[Finding]]:
    """Add the steps in which readings are written to their noise, where they are a part of it.

    Poses of the reference may be wanted ones on a grid, so their steps tell nothing.
    """
    sizes = rounding(sensor, data)
    steps = np.sqrt(12) * sizes
    findings = [
        Finding(False, (
            f"The {words} are written in steps of {1e3 * steps[columns].max():.2g} {unit}, which "
            "add to their noise: write more digits. The steps count as noise."
        ), ("written_steps",))
        for words, columns, unit in (("places", PLACES, "um"), ("powers", [2, 5, 8], "uW"))
        if sizes[columns].any()
    ]  # fmt: skip
    noise = np.hypot(deviations(sensor, data), sizes)
    return (data._replace(noise=noise) if findings else data), findings


def rounding(sensor: Sensor, data: Data) -> Floats:
    """The standard deviations (9,) by which the steps in which readings are written make them err,
    where these are a part of the sensor's noise that counts; else 0."""
    sizes = np.array([written_step(column) for column in data.raw.T]) / np.sqrt(12)
    noise = np.nanmedian(deviations(sensor, data._replace(noise=None)), axis=0)
    least = noise.copy()  # a power in a converter's steps has them in its noise
    least[PLACES] *= LEAST_COUNTED
    return np.where(sizes > least, sizes, 0.0)


def reference_steps(data: Data, scatter: Scatter) -> list[Finding]:
    """A finding on a reference that scatters by the steps in which it is written, where these are
    more than its uncertainty; poses on a grid alone may be wanted ones.  data: with the reference's
    uncertainty as stated."""
    steps = np.array([written_step(column) for column in data.pose.T])
    sizes = steps / np.sqrt(12)
    coarse = (sizes > data.sigma) & (scatter.sizes[:6] > sizes / 2)
    if not coarse.any():
        return []
    told = ", ".join(
        f"{name} in steps of {1e6 * step if name in ANGLES else 1e3 * step:.3g} "
        f"{'urad' if name in ANGLES else 'um'}"
        for name, step, is_coarse in zip(POSE, steps, coarse, strict=True) if is_coarse
    )  # fmt: skip
    return [Finding(bool((coarse & (sizes > WORST_STEPS * data.sigma)).any()), (
        "The reference scatters by about what the steps in which it is written make it err "
        f"({told}), which is more than its uncertainty (calibrate.reference): write more digits."
    ), ("reference_steps",))]  # fmt: skip


def written_step(values: Floats) -> float:
    """The step of which all values (n,) are whole multiples; 0 where there is none."""
    apart = np.diff(np.unique(np.round(values[np.isfinite(values)], 12)))
    if len(apart) < MIN_POSES:
        return 0.0
    times = apart / apart.min()
    return float(apart.min()) if (np.abs(times - np.round(times)) < EVEN_STEPS).all() else 0.0


def edge_finding(near: Booleans, letter: str, distance: float) -> Finding:
    """The finding on samples (n,) whose spots come near the edge of a detector."""
    return Finding(False, (
        f"In {int(near.sum())} of {len(near)} samples the spot on detector {letter.upper()} comes "
        f"nearer than {distance:.2g} mm to the edge of the sensitive area, where light is lost; "
        "its readings there are excluded, and in the result out of range "
        f"(sensor.psd.{letter}.usable_mm). Keep spots {max(CLEAR_DISTANCE_MM, distance):.2g} mm "
        "from the edges, or set sensor.apertures.detectors."
    ))  # fmt: skip


def exclude_edge_readings(sensor: Sensor, data: Data) -> tuple[Sensor, Data, list[Finding]]:
    """Exclude the readings of a detector whose spot lies over the edge of its sensitive area.

    There light is lost that the model includes only with `sensor.apertures.detectors`. The other
    detectors of such a sample stay. In the sensor that is returned, such readings are out of range.
    """
    if sensor.apertures.detectors:
        return sensor, data, []
    distance = edge_distance(sensor)
    raw, findings, psds = data.raw.copy(), list[Finding](), list(sensor.psds)
    for k, near in enumerate(is_near_edge(sensor, raw).T):
        if near.mean() > MOST_EDGE_SHARE:  # then these are no places in mm, which is told elsewhere
            return sensor, data, []
        if not near.any():
            continue
        raw[near, 3 * k : 3 * k + 3] = np.nan
        for axis, half in enumerate((half_sizes(sensor)[k] - distance).tolist()):
            psds[k] = psds[k].limit(axis, -half, half)
        findings.append(edge_finding(near, DETECTORS[k], distance))
    there = np.asarray(np.isfinite(raw).any(axis=1))
    sensor = replace(sensor, psds=(psds[0], psds[1], psds[2]))
    return sensor, (data._replace(raw=raw).part(there) if findings else data), findings
