"""Calibrations of rigs on a bench: draw, disturb, calibrate, judge, and a table.

    python -m facets.experiments.studies.calibrations [--faults disturbed] [--only outliers]
        [--first 0] [--draws 1] [--config paper] [--reach 0.25] [--show]

Each rig has the light of a real bench, read by rays (`simulated_bench`), and the faults of a list.
The list `nothing` has none. Those of `disturbed` have given sizes, one in a rig (`disturbed_rigs`).
Those of `unseen`, one or two in a rig, were chosen by somebody who had not read the list of
alternatives, and have random sizes (`unseen_rigs`). A rig is calibrated from its table as
`facets calibrate` does, and tried on another motion in random poses at the mean temperature. During
that motion faults of light, facets, detectors and electronics still act, in their state at the end
of the calibration; other faults do not. --reach is the reach of the calibration's motion in x and
y, mm; --show lists the rigs without calibrating them.

A fault is harmless if the poses solved from the readings, less those of the reference, change by
less than the noise of one pose, r.m.s. in every axis, when it acts alone and without noise. A rig
is trusted and wrong if its r.m.s. error in x or y exceeds twice the stated one, or in another axis
1.25 times, while under 88 % of the 95 % intervals contain the truth.

A fault is named if a finding names alternatives of its group only. It is named among others if a
finding names several groups, one of them its own. It is named wrongly if no finding does so, and
one names only groups of which the rig has no fault. For `disturbed` the study also prints whether
the expected sentence was printed.
"""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np

import facets
from facets.calibration.alternatives.alternative import Finding
from facets.calibration.alternatives.entries import ALTERNATIVES
from facets.calibration.alternatives.scatter import SCATTER
from facets.calibration.candidates import EVERY_EFFECT
from facets.calibration.fitting.unknowns import fold_mount
from facets.calibration.table import choice
from facets.calibration.verdict import verdict
from facets.core.errors import FacetsError
from facets.core.sensor import Sensor
from facets.core.settings import Config
from facets.core.units import Floats
from facets.detectors.correction import correct
from facets.detectors.noise import add_noise

from . import disturbed_rigs, unseen_rigs
from .options import parse_options
from .rigs import BOX, REACH_MM, Rng, draw_bench_rig, rms
from .simulated_bench import (
    Columns,
    Fault,
    MotionScene,
    draw_scene,
    draw_use,
    measure,
    poses_of,
    readings_of,
    samples_of,
    states_at,
)

#: Groups of faults that still act when the calibrated sensor is used.
LASTING = ("light", "facets", "detectors", "electronics")
#: Errors of a rig without a result.
NOTHING = np.full(6, np.nan)


class RigTrial(NamedTuple):
    """The calibration of a rig, and the errors of poses of another motion with it.

    taken: effects of light that the calibration accepted.  seconds: processor time.  over: r.m.s.
    errors over those of a rig that is known perfectly (6,).  held: fraction of the 95 % intervals
    that contain the truth (6,).  beyond: r.m.s. errors over stated standard uncertainties (6,).
    """

    is_trusted: bool
    findings: list[Finding]
    seconds: float
    taken: tuple[str, ...] = ()
    over: Floats = NOTHING
    held: Floats = NOTHING
    beyond: Floats = NOTHING

    @property
    def is_wrong(self) -> bool:
        """Whether the calibration is trusted although its poses err by more than it states."""
        others = (self.beyond[2:] > 1.25) & (self.held[2:] < 0.88)
        return self.is_trusted and bool((self.beyond[:2] > 2).any() or others.any())


def solve(sensor: Sensor, raw: Floats) -> facets.Solution:
    """Poses of uncorrected readings (n, 9), with a known beam and an unknown power."""
    return facets.solve(sensor, correct(sensor, raw), beam="known", power="unknown", threads=1)


def assess_poses(
    trial: RigTrial, sensor: Sensor, use: MotionScene, table: Columns, rng: Rng
) -> RigTrial:
    """Solve another motion with a calibrated sensor; rng: for the readings of a perfect rig."""
    state = states_at(fold_mount(use.real.rig.values), use.pose)
    ideal = add_noise(sensor, facets.readings(sensor, state), rng)
    perfect = facets.solve(sensor, ideal, beam="known", power="unknown", threads=1)
    solved = solve(sensor, readings_of(table))
    error, stated = (solved.state - state)[:, :6], solved.uncertainty[:, :6]
    solved_count = np.isfinite(error).sum(axis=0)  # a saturated converter has no pose
    return trial._replace(
        over=rms(error) / rms((perfect.state - state)[:, :6]),
        held=(np.abs(error) < 1.96 * stated).sum(axis=0) / solved_count,
        beyond=rms(error) / rms(stated),
    )


def draw_calibration(seed: int, faults: list[Fault], sensor: Sensor, reach: float) -> MotionScene:
    """Draw a rig and the motion of its calibration; with two faults, one in three moves in time."""
    rng = np.random.default_rng(seed)
    real = draw_bench_rig(sensor, rng)
    in_time = any(fault.in_time for fault in faults) or (len(faults) > 1 and rng.random() < 0.3)
    return draw_scene(real, rng, in_time=in_time, box=np.array([reach, reach, *BOX[2:]]))


def try_rig(scene: MotionScene, faults: list[Fault], config: Config, seed: int) -> RigTrial:
    """Calibrate a rig as the command does, and solve another motion with it."""
    start, settings = time.process_time(), config.calibrate
    table = measure(scene, faults, seed)
    try:
        data = samples_of(table, settings)
        result = verdict(config.sensor, data, choice(config.sensor, settings), settings)
    except FacetsError as refusal:
        refused = [Finding(True, str(refusal), ("table",))]
        return RigTrial(False, refused, time.process_time() - start)
    taken = tuple(row.key for row in result.search.rows if row.accepted) if result.search else ()
    seconds = time.process_time() - start
    trial = RigTrial(bool(result.is_trusted), result.findings, seconds, taken)
    if result.sensor is None:
        return trial
    rng = np.random.default_rng([seed, 92])
    use = draw_use(scene.real, rng)
    used = measure(use, [fault for fault in faults if fault.group in LASTING], seed)
    return assess_poses(trial, result.sensor, use, used, rng)


def is_harmless(scene: MotionScene, fault: Fault, seed: int) -> bool:
    """Whether a fault alone changes poses by less than their noise, r.m.s. in every axis."""
    rig, exact = scene.real.rig, replace(scene, has_noise=False)
    before, after = (measure(exact, faults, seed) for faults in ([], [fault]))
    solved, changed = (solve(rig.sensor, readings_of(table)) for table in (before, after))
    off, moved = (
        (solution.state - states_at(rig.values, poses_of(table)))[:, :6]
        for solution, table in ((solved, before), (changed, after))
    )
    off, noise = off[after["row"].astype(int)], solved.uncertainty[:, :6]
    missing = np.isnan(moved) & ~np.isnan(off)
    return bool((rms(moved - off) < np.nanmedian(noise, axis=0)).all() and not missing.any())


# ---- the groups that findings name


#: The alternative that names wrong rows without a cause, and the one that is true for all rigs.
NO_CAUSE, ALWAYS = "outliers", "laser.drifted"
#: The group of each alternative, by key; faults of the table have their words for keys.
GROUP_OF = {part.key: part.group for part in (*ALTERNATIVES, *EVERY_EFFECT, *SCATTER.values())}
GROUP_OF |= {"clock_set": "time", "saturated": "electronics", "shaded": "detectors",
             "spikes": "electronics", "reference_outliers": "reference",
             "reading_outliers": "electronics", NO_CAUSE: NO_CAUSE}  # fmt: skip
#: Further groups in which an alternative may lie, by how its key begins.
ALSO = {
    "rows ": ("time",), "averaged": ("time",), "axis_delays": ("reference",),
    "seat.jumped": ("table",),  # the reference's zero, as between two recordings
    "beam": ("environment",), "seat": ("environment",), "reference_scatter": ("environment",),
    "supply.": ("environment",),  # warm air in the beams' paths
    "scatter": ("detectors",),  # light that a detector mirrors
    "time_drift": ("light", "detectors", "reference"),
    "memory": ("detectors",), "detector_scatter": ("electronics",),
    "reference_outliers": ("table",), "reading_outliers": ("table",),
}  # fmt: skip


def groups_of(key: str) -> set[str]:
    """The groups in which an alternative may lie."""
    more = [groups for begin, groups in ALSO.items() if key.startswith(begin)]
    return {GROUP_OF.get(key, "table"), *chain(*more)}


def named_groups(trial: RigTrial) -> list[set[str]]:
    """The groups that each finding names, without findings that name none."""
    return [
        {group for key in part.causes for group in groups_of(key)}
        for part in trial.findings if part.causes and part.causes != (ALWAYS,)
    ]  # fmt: skip


def classify(fault: Fault, faults: list[Fault], groups: list[set[str]]) -> str:
    """Classify how the findings name a fault of a rig."""
    if any(group in ({fault.group}, {fault.group, "environment"}) for group in groups):
        return "named"
    if fault.group == "table" and {NO_CAUSE} in groups:
        return "named"
    if any(fault.group in group for group in groups):
        return "among others"
    return "wrongly" if any(is_false(group, faults) for group in groups) else "unsaid"


def is_false(groups: set[str], faults: list[Fault]) -> bool:
    """Whether a finding names only groups of which the rig has no fault."""
    return groups.isdisjoint({fault.group for fault in faults} | {NO_CAUSE})


def is_said(fault: Fault, trial: RigTrial) -> bool:
    """Whether a finding names the fault in words that are expected."""
    return any(word in finding.words for word in fault.named_by for finding in trial.findings)


# ---- the table


def list_rigs(name: str, draw: int) -> list[list[Fault]]:
    """The faults of each rig of a draw."""
    if name == "unseen":
        return unseen_rigs.draw_faults(draw)
    return [[case] for case in disturbed_rigs.CASES] if name == "disturbed" else [[]]


def print_trial(trial: RigTrial) -> None:
    """Print the outcome of a trial and its findings."""
    word = "TRUSTED AND WRONG" if trial.is_wrong else "trusted" if trial.is_trusted else "refused"
    over, held, beyond = (
        " ".join(f"{x:5.2f}" for x in row) for row in (trial.over, trial.held, trial.beyond)
    )
    print(f"    {word}, {trial.seconds:.1f} s  over {over}  held {held}  beyond {beyond}")
    print(f"    taken: {', '.join(trial.taken) or 'nothing'}")
    for finding in trial.findings:
        print(f"    {'!' if finding.bad else '-'} {finding.words}", flush=True)


class OutcomeCounts:
    """Counts of trials by whether the rig deserves trust, and of faults by how they are named."""

    def __init__(self) -> None:
        self.rigs, self.faults = Counter[str](), Counter[str]()
        self.over, self.held = list[Floats](), list[Floats]()

    def add(self, trial: RigTrial, faults: list[Fault], harmful: list[Fault]) -> None:
        """Count the outcome of a trial with some faults, of which some are harmful."""
        kind = "with harmful faults" if harmful else "clean or harmless"
        self.rigs.update([kind] + [f"{kind}, trusted"] * trial.is_trusted
                         + ["trusted and wrong"] * trial.is_wrong)  # fmt: skip
        self.over.append(trial.over)
        self.held.append(trial.held)
        groups = named_groups(trial)
        self.faults["sentences that name a cause"] += len(groups)
        self.faults["sentences that are wrong"] += sum(is_false(g, faults) for g in groups)
        for fault in faults:
            way = classify(fault, faults, groups)
            self.faults[f"{'harmful' if fault in harmful else 'harmless'} {way}"] += 1
            self.faults["in words that are expected"] += is_said(fault, trial)
            print(f"    = {way}{', in the words that are expected' * is_said(fault, trial)}")

    def print(self) -> None:
        """Print the counts, and the errors and intervals of all trials."""
        for counts in (self.rigs, self.faults):
            print("; ".join(f"{name}: {count}" for name, count in sorted(counts.items())))
        for name, values in (("errors over perfect", self.over), ("intervals held", self.held)):
            low, mean, high = (f(values, axis=0) for f in (np.nanmin, np.nanmean, np.nanmax))
            print(f"{name}: {low.round(3)} to {high.round(3)}, mean {mean.round(3)}")


def main() -> None:
    options = parse_options(__doc__, faults="nothing", only="", first=0, draws=1, config="paper",
                            reach=REACH_MM, show=False)  # fmt: skip
    config, tally = facets.load(options.config), OutcomeCounts()
    for draw in range(options.first, options.first + options.draws):
        for number, faults in enumerate(list_rigs(options.faults, draw)):
            label = " + ".join(f"{fault.group}: {fault.words}" for fault in faults)
            if options.only not in label:
                continue
            seed = 1000 * draw + number
            scene = draw_calibration(seed, faults, config.sensor, options.reach)
            harmful = [fault for fault in faults if not is_harmless(scene, fault, seed)]
            print(f"{seed} {label}; {len(harmful)} harmful", flush=True)
            if not options.show:
                trial = try_rig(scene, faults, config, seed)
                print_trial(trial)
                tally.add(trial, [fault for fault in faults if fault.parts], harmful)
    if tally.rigs:
        tally.print()


if __name__ == "__main__":
    main()
