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

#: A channel is stuck if it moves by less than this fraction of what the motion requires, and that
#: is more than this many times its noise.
STUCK_FRACTION, MOVED_SIGMAS = 0.02, 20.0
#: Two coordinates are the same if they differ by less than this fraction of their range.
SAME_FRACTION = 0.01
#: An axis counts as moved if its range is this many times the reference's uncertainty.
LEAST_RANGE_SIGMAS = 30.0
#: Half ranges of a motion in x and y, in diameters of the beam, below which it is reported, and
#: which is advised.
NARROW_DIAMETERS, ADVISED_DIAMETERS = 0.2, 0.3
#: The least advised distance from an edge, mm.
CLEAR_DISTANCE_MM = 1.2
#: If more than this fraction of the readings is at the edge, the places are in another unit.
MAX_EDGE_FRACTION = 0.7
#: Times are even if their steps differ by less than this fraction. A step this many times the usual
#: one is a gap, if there are no more than this number of them.
EVEN_STEPS, GAP_STEPS, MAX_GAPS = 0.1, 10.0, 3
#: Rounding errors of the reference of more than this many stated uncertainties are refused.
WORST_STEPS = 5.0
#: Minimum number of different poses of a calibration that can be trusted.
MIN_POSES = 20


def check_columns(sensor: Sensor, data: Data) -> list[Finding]:
    """Check the columns alone; findings that forbid a calibration come first."""
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
    """Columns (n, m) with NaN for values farther from the central 90 % than its width, so that rows
    that jumped do not count in the range of a motion."""
    with np.errstate(invalid="ignore"), catch_warnings():
        simplefilter("ignore")
        low, high = np.nanquantile(values, [0.05, 0.95], axis=0)
        width = np.where(high > low, high - low, np.inf)
        inside = (values >= low - width) & (values <= high + width)
    return np.where(inside, values, np.nan)


def spans(values: Floats) -> Floats:
    """The ranges (m,) of columns (n, m) without jumps."""
    smooth = remove_jumps(values)
    reach: Floats = np.nanmax(smooth, axis=0) - np.nanmin(smooth, axis=0)
    return reach


def stuck_channels(sensor: Sensor, data: Data) -> list[Finding]:
    """Findings on channels that do not follow the motion."""
    with np.errstate(invalid="ignore"), catch_warnings():
        simplefilter("ignore")  # a motion in wrong units may have no expected reading at all
        expected = np.nanstd(remove_jumps(expected_readings(sensor, data)), axis=0)
        moved = np.nanstd(remove_jumps(correct(sensor, data.raw)), axis=0)
        noise = np.nanmedian(deviations(sensor, data), axis=0)
    is_stuck = (moved < STUCK_FRACTION * expected) & (expected > MOVED_SIGMAS * noise)
    still = np.flatnonzero(is_stuck).tolist()
    if len({n // 3 for n in still}) > 1:  # on several detectors: the motion is in wrong units
        return []
    return [
        Finding(True, (
            f"{KINDS[n % 3]} of detector {DETECTORS[n // 3].upper()} is stuck: it moves by "
            f"{moved[n]:.2g}, where {expected[n]:.2g} is expected of the motion. Look at the "
            "detector, its amplifier and its column."
        ))
        for n in still
    ]  # fmt: skip


def expected_readings(sensor: Sensor, data: Data) -> Floats:
    """The readings (n, 9), mm and mW, of the configured sensor in this motion."""
    still = np.zeros((len(data.raw), OWN_COUNT))
    return readings(sensor, states_of(data, still, values_of(sensor)))


def mixed_kinds(data: Data) -> list[Finding]:
    """A finding on currents that were converted by the formula of another kind of detector, so that
    both coordinates of each spot are the same, or one is zero."""
    psi, zeta = (remove_jumps(data.raw[:, n::3]) for n in (0, 1))
    with np.errstate(invalid="ignore"), catch_warnings():
        simplefilter("ignore")
        size, other, difference = (np.nanstd(values, axis=0) for values in (psi, zeta, zeta - psi))
    for words, kind, is_so in (
        ("psi and zeta are the same", "pincushion", difference < SAME_FRACTION * size),
        ("zeta does not move", "duo-lateral", other < SAME_FRACTION * size),
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
            f"The {len(data.raw)} samples have only {poses} different poses, too few to separate "
            "the sensor's parameters. Take 50 or more, all over the range "
            "(facets calibrate --propose 50 lists good ones)."
        )))  # fmt: skip
    return findings


def still_axes(data: Data) -> list[Finding]:
    """A finding on axes along which the motion hardly moves."""
    limits = np.where(np.isfinite(data.sigma), LEAST_RANGE_SIGMAS * data.sigma, 0.0)
    names = [POSE[n] for n in np.flatnonzero(spans(data.pose) < limits)]
    if not names:
        return []
    return [Finding(False, (
        f"The motion hardly moves in {', '.join(names)}: parameters that only these axes determine "
        "keep their prior values, and poses away from the motion are no better known than the "
        "tolerances state."
    ))]  # fmt: skip


def narrow_motion(sensor: Sensor, data: Data) -> list[Finding]:
    """A finding on a motion in x and y that is too small for the powers' curvature."""
    diameter = min(sensor.beam.diameter_x, sensor.beam.diameter_y)
    place = data.pose[:, :2] - data.beam
    span = spans(place)[np.isfinite(data.sigma[:2])] / 2
    if not span.size or span.min() >= NARROW_DIAMETERS * diameter:
        return []
    return [Finding(False, (
        f"The motion reaches {span.min():.2g} mm to each side in x or y. Only the curvature of the "
        "powers separates gains, strips lost at the edges and the beam's size from the mirror's "
        f"position, which takes {ADVISED_DIAMETERS * diameter:.2g} mm or more; with less, all "
        "poses may be off in x and y together, by the stated uncertainty."
    ))]  # fmt: skip


def untimed_channels(sensor: Sensor, data: Data) -> list[Finding]:
    """A finding on channels that are read in turn, in a table without times."""
    if data.velocity is not None or not any(sensor.light.delays):
        return []
    return [Finding(False, (
        "sensor.light.delays_us are given, but the table is no motion in time: its readings count "
        "as read at one instant. Give time_s, or let the mirror rest at each pose."
    ))]  # fmt: skip


def written_times(data: Data) -> tuple[Floats, NDArray[np.int64]]:
    """The times of the rows that have one, relative to half of the run, and the row numbers; both
    (rows,)."""
    time = np.zeros(len(data.raw)) if data.clock is None else data.clock[:, 0]
    return time[time != 0], row_numbers(data)[time != 0]  # the clock of a row without a time is 0


def time_gaps(data: Data) -> list[Finding]:
    """A finding on a time that jumps or decreases in a table of even steps."""
    time, rows = written_times(data)
    if len(time) < 2:
        return []
    step = np.diff(time)
    usual = float(np.median(step))
    even = np.median(np.abs(step - usual)) < EVEN_STEPS * usual
    odd = np.flatnonzero((step > GAP_STEPS * usual) | (step < 0))
    if not even or not odd.size or odd.size > MAX_GAPS:
        return []
    places = ", ".join(f"{rows[n]} and {rows[n + 1]}" for n in odd)
    return [Finding(False, (
        f"time_s jumps between rows {places}: a clock was set, or the table holds two recordings. "
        "Delays and drifts with time may be wrong; calibrate with the rows of one recording."
    ), ("clock_set",))]  # fmt: skip


def unordered_rows(data: Data) -> list[Finding]:
    """A finding on rows that are not in the order of time: time_s decreases, or one axis only
    increases while others jump as if at random, as after sorting."""
    time, _ = written_times(data)
    if len(time):
        if np.sum(np.diff(time) < 0) <= MAX_GAPS:
            return []
        words = "time_s decreases repeatedly"
    else:
        step = np.diff(data.pose, axis=0)
        noise, usual = CLEAR_SIGMAS * data.sigma, np.median(step, axis=0)
        is_up = (step.min(axis=0) > -noise) & (usual > noise)
        is_random = (step**2).mean(axis=0) > data.pose.var(axis=0)  # twice this if random
        if is_up.sum() != 1 or not is_random.any():
            return []
        words = f"{REFERENCE[int(np.argmax(is_up))]} only increases, and others jump"
    return [Finding(False, (
        f"The rows are not in the order of time, as after sorting ({words}). Effects in time, such "
        "as drifts, delays and play, cannot be found: give the rows as they were taken."
    ), ("sorted",))]  # fmt: skip


def add_written_steps(sensor: Sensor, data: Data) -> tuple[Data, list[Finding]]:
    """Add the rounding of written readings to their noise, if it is a part of it.

    The reference's poses may be nominal ones on a grid, so their steps are no rounding.
    """
    sizes = rounding(sensor, data)
    steps = np.sqrt(12) * sizes
    findings = [
        Finding(False, (
            f"The {words} are written in steps of {1e3 * steps[columns].max():.2g} {unit}, which "
            "adds to their noise: write more digits. The steps count as noise."
        ), ("written_steps",))
        for words, columns, unit in (("places", PLACES, "um"), ("powers", [2, 5, 8], "uW"))
        if sizes[columns].any()
    ]  # fmt: skip
    noise = np.hypot(deviations(sensor, data), sizes)
    return (data._replace(noise=noise) if findings else data), findings


def rounding(sensor: Sensor, data: Data) -> Floats:
    """The standard deviations (9,) of the rounding of written readings, if they are a part of the
    noise that counts; else 0."""
    sizes = np.array([written_step(column) for column in data.raw.T]) / np.sqrt(12)
    noise = np.nanmedian(deviations(sensor, data._replace(noise=None)), axis=0)
    limits = noise.copy()  # the noise of a power includes a converter's steps
    limits[PLACES] *= LEAST_COUNTED
    return np.where(sizes > limits, sizes, 0.0)


def reference_steps(data: Data, scatter: Scatter) -> list[Finding]:
    """A finding on a reference that scatters by its rounding, if that exceeds its uncertainty.
    Poses on a grid without such scatter may be nominal ones.

    data: with the reference's stated uncertainty.
    """
    steps = np.array([written_step(column) for column in data.pose.T])
    sizes = steps / np.sqrt(12)
    coarse = (sizes > data.sigma) & (scatter.sizes[:6] > sizes / 2)
    if not coarse.any():
        return []
    listed = ", ".join(
        f"{name} in steps of {1e6 * step if name in ANGLES else 1e3 * step:.3g} "
        f"{'urad' if name in ANGLES else 'um'}"
        for name, step, is_coarse in zip(POSE, steps, coarse, strict=True) if is_coarse
    )  # fmt: skip
    return [Finding(bool((coarse & (sizes > WORST_STEPS * data.sigma)).any()), (
        "The reference scatters by about the rounding of its values "
        f"({listed}), which is more than its uncertainty (calibrate.reference): write more digits."
    ), ("reference_steps",))]  # fmt: skip


def written_step(values: Floats) -> float:
    """The step of which all values (n,) are integer multiples; 0 if there is none."""
    steps = np.diff(np.unique(np.round(values[np.isfinite(values)], 12)))
    if len(steps) < MIN_POSES:
        return 0.0
    multiples = steps / steps.min()
    is_even = (np.abs(multiples - np.round(multiples)) < EVEN_STEPS).all()
    return float(steps.min()) if is_even else 0.0


def edge_finding(near: Booleans, letter: str, distance: float) -> Finding:
    """The finding on samples (n,) whose spots are near the edge of a detector."""
    return Finding(False, (
        f"In {int(near.sum())} of {len(near)} samples the spot on detector {letter.upper()} is "
        f"less than {distance:.2g} mm from the edge of the sensitive area, where light is lost. "
        "These readings are excluded, and out of range in the result "
        f"(sensor.psd.{letter}.usable_mm). Keep spots {max(CLEAR_DISTANCE_MM, distance):.2g} mm "
        "from the edges, or set sensor.apertures.detectors."
    ))  # fmt: skip


def exclude_edge_readings(sensor: Sensor, data: Data) -> tuple[Sensor, Data, list[Finding]]:
    """Exclude the readings of a detector whose spot lies over the edge of its sensitive area.

    The model includes light that is lost there only with `sensor.apertures.detectors`. Readings of
    the other detectors are not excluded. In the returned sensor, such readings are out of range.
    """
    if sensor.apertures.detectors:
        return sensor, data, []
    distance = edge_distance(sensor)
    raw, findings, psds = data.raw.copy(), list[Finding](), list(sensor.psds)
    for k, near in enumerate(is_near_edge(sensor, raw).T):
        if near.mean() > MAX_EDGE_FRACTION:  # places in another unit, which another check reports
            return sensor, data, []
        if not near.any():
            continue
        raw[near, 3 * k : 3 * k + 3] = np.nan
        for axis, half in enumerate((half_sizes(sensor)[k] - distance).tolist()):
            psds[k] = psds[k].limit(axis, -half, half)
        findings.append(edge_finding(near, DETECTORS[k], distance))
    is_read = np.asarray(np.isfinite(raw).any(axis=1))
    sensor = replace(sensor, psds=(psds[0], psds[1], psds[2]))
    return sensor, (data._replace(raw=raw).part(is_read) if findings else data), findings
