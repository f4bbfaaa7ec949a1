"""Rigs with faults of real benches, drawn at random, to try a calibration that never met them.

    python -m facets.experiments.studies.unseen_rigs [--only dust] [--draw 0] [--list]

A few rigs have no fault, some have one, most have two at once. Each gives the table that a person
would record: readings beside a reference, in random poses or along a motion in time, with the light
of a real bench, read by rays (`bench_rays`). The size of each fault is drawn from harmless to
gross. A rig is calibrated from its table as `facets calibrate` does it, and tried on fresh motions
in random poses of the same bench. There, faults of light, facets, detectors and electronics still
act, in the state in which the calibration left them (a knocked detector stays where it is); faults
of the reference, time, environment and table do not, and the temperature is the mean of the
calibration's.

A fault is harmless if it alone, without noise, changes the difference between the poses that
follow from the readings and the reference's poses by less than the noise of one pose, r.m.s. in
every axis. A rig is trusted and wrong if its calibration is trusted and its r.m.s. error in x or
y is over twice the stated one, or in another axis over 1.25 times with under 88 % of the 95 %
intervals holding.

A fault is named where a finding names alternatives of its group alone, among others where it names
alternatives of several groups and one of them is its own; which alternative it is, is printed. It
is told wrongly where no finding does so and one names groups of which the rig has no fault.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import facets
from facets.calibration.alternatives.alternative import Finding
from facets.calibration.alternatives.entries import ALTERNATIVES
from facets.calibration.alternatives.scatter import SCATTER
from facets.calibration.candidates import EVERY_EFFECT
from facets.calibration.fitting.unknowns import fold_mount
from facets.calibration.table import gather_samples
from facets.core.calibrate import Calibrate
from facets.core.errors import FacetsError
from facets.core.names import READING_COLUMNS
from facets.core.sensor import Sensor
from facets.core.units import Floats
from facets.detectors.correction import correct, invert_correction
from facets.detectors.noise import add_noise

from .bench_faults import (
    BOX_REACH,
    KINDS,
    REFERENCE_COLUMNS,
    UNITS,
    Columns,
    Fault,
    MotionScene,
    sample_states,
    show_temperature,
)
from .bench_rays import spots
from .rigs import (
    CLEARANCE_MM,
    REFERENCE,
    BenchRig,
    Rig,
    RigTrial,
    Rng,
    assess_poses,
    calibrate,
    draw_bench_rig,
    poses_on_bench,
    rms,
)

#: Rows of a table in random poses and along a motion, and of the motion to test with.
RANDOM_ROWS, TIMED_ROWS, TEST_ROWS = 500, 600, 800
#: Time between rows, s: in random poses the stage settles first.
RANDOM_PERIOD_S, TIMED_PERIOD_S = 4.0, 1.0
#: Number of rigs with one fault; all other kinds of fault come in pairs.
SINGLE = 22
#: Groups of faults that go on acting when the calibrated sensor is used.
LASTING = ("light", "facets", "detectors", "electronics")
#: Stages of a simulated measurement at which faults act, in order.
STAGES = ("scene", "bench", "mirror", "beam", "shine", "raw", "said", "columns")
#: Share of the rigs without faults of time that are moved along a motion in time all the same.
TIMED_SHARE = 0.3

Kind = Callable[[Rng], Fault]
Faults = list[tuple[int, Fault]]


#: How a fault may be told.
WAYS = ("named", "among", "wrong", "unsaid")


class Truth(NamedTuple):
    group: str
    words: str
    harmless: bool


class UnseenRig(NamedTuple):
    """columns: the table to calibrate with.  readings (n, 9) and states (n, 8): a motion to test
    with.  truth: what is wrong with the rig, nothing for a clean one."""

    name: str
    seed: int
    columns: Columns
    readings: Floats
    states: Floats
    truth: tuple[Truth, ...]


# ---- which rigs


def move_in_time(rng: Rng) -> Fault:
    return Fault("", "a motion in time, without faults", {}, True)


def move_beside_thermometer(rng: Rng) -> Fault:
    return Fault("", "the same with a thermometer", {"columns": show_temperature}, True)


#: Rigs without faults.
CLEAN: tuple[tuple[str, tuple[Kind, ...]], ...] = (
    ("clean_1", ()),
    ("clean_2", ()),
    ("clean_timed", (move_in_time,)),
    ("clean_warm", (move_beside_thermometer,)),
)


def pair_kinds(kinds: list[Kind]) -> Iterator[tuple[Kind, ...]]:
    """Pairs of different groups, as far as there are some."""
    group = {kind: kind(np.random.default_rng(0)).group for kind in kinds}
    while kinds:
        first = kinds.pop(0)
        other = next((kind for kind in kinds if group[kind] != group[first]), None)
        if other is not None:
            kinds.remove(other)
        yield (first,) if other is None else (first, other)


def plan_rigs(draw: int) -> list[tuple[str, int, tuple[Kind, ...]]]:
    """Names, seeds and kinds of fault of all rigs of a draw; each kind occurs once."""
    order = np.random.default_rng([draw, 7]).permutation(len(KINDS))
    kinds = [KINDS[i] for i in order]
    groups: list[tuple[Kind, ...]] = [(kind,) for kind in kinds[:SINGLE]]
    groups += pair_kinds(kinds[SINGLE:])
    named = [*CLEAN, *(("+".join(kind.__name__ for kind in group), group) for group in groups)]
    return [(name, 1000 * (draw + 1) + i, group) for i, (name, group) in enumerate(named)]


# ---- motions


def row_times(period: float, rows: int) -> Floats:
    return period * np.arange(rows, dtype=np.float64)


def draw_track(rig: Rig, rng: Rng) -> Callable[[Floats], Floats]:
    """A smooth motion that keeps all spots on the detectors, the furthest reaching of 30."""
    time = row_times(TIMED_PERIOD_S, TIMED_ROWS)
    half = np.array([[psd.size_y, psd.size_z] for psd in rig.sensor.psds]) / 2 - CLEARANCE_MM
    best, reach = None, 0.0
    for _ in range(30):
        periods, phases = rng.uniform(15, 90, (3, 6)), rng.uniform(0, 2 * np.pi, (3, 6))
        parts = rng.uniform(0.3, 1, (3, 6))
        curve = wave(periods, phases, parts / parts.sum(axis=0) * BOX_REACH)
        for scale in (1.0, 0.95, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5):
            shrunk = shrink(curve, scale)
            reading = facets.readings(rig.sensor, sample_states(rig, shrunk(time)))
            place = reading.reshape(-1, 3, 3)[:, :, :2]
            if scale > reach and (np.abs(place) < half).all():
                best, reach = shrunk, scale
    assert best is not None, "no motion keeps its spots on the detectors"
    return best


def wave(periods: Floats, phases: Floats, sizes: Floats) -> Callable[[Floats], Floats]:
    """A sum of sines in each axis, each (m, 6)."""

    def curve(time: Floats) -> Floats:
        turns = 2 * np.pi * time[:, None, None] / periods + phases
        out: Floats = (sizes * np.sin(turns)).sum(axis=1)
        return out

    return curve


def shrink(curve: Callable[[Floats], Floats], scale: float) -> Callable[[Floats], Floats]:
    """The same motion with less of z and of the angles, which move the spots."""
    return lambda time: curve(time) * [1, 1, scale, scale, scale, scale]


def ambient_temperature(time: Floats, rng: Rng) -> Floats:
    """A room that warms or cools while its air conditioning switches; K from the mean."""
    cycle = rng.uniform(0.1, 0.4) * np.sin(2 * np.pi * time / rng.uniform(150, 400))
    air = rng.uniform(0.4, 1.2) * rng.choice([-1, 1]) * np.linspace(-0.5, 0.5, len(time)) + cycle
    out: Floats = air - air.mean()
    return out


def draw_scene(real: BenchRig, in_time: bool, rng: Rng) -> MotionScene:
    """The motion of a calibration."""
    if not in_time:
        pose = poses_on_bench(real.rig, RANDOM_ROWS, rng, BOX_REACH).pose
        air = ambient_temperature(row_times(RANDOM_PERIOD_S, len(pose)), rng)
        return MotionScene(real, pose, row_times(RANDOM_PERIOD_S, len(pose)), air, air)
    track = draw_track(real.rig, rng)
    moments = row_times(TIMED_PERIOD_S, TIMED_ROWS)
    air = ambient_temperature(moments, rng)
    return MotionScene(real, track(moments), moments, air, air, track=track)


def draw_use(real: BenchRig, rng: Rng) -> MotionScene:
    """A motion after the calibration."""
    pose = poses_on_bench(real.rig, TEST_ROWS, rng).pose
    still = np.zeros(TEST_ROWS)
    return MotionScene(real, pose, row_times(RANDOM_PERIOD_S, TEST_ROWS), still, still, in_use=True)


# ---- measurements


class BenchMeter:
    """Measures scenes with faults; the light of a scene that it has met is not computed twice."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.light: dict[tuple[tuple[int, ...], bytes], Floats] = {}

    def apply(self, stage: str, value: Any, faults: Faults, scene: MotionScene) -> Any:
        """Change a value by all faults that act at a stage."""
        for i, fault in faults:
            if stage in fault.hooks:
                rng = np.random.default_rng([self.seed, i, STAGES.index(stage), scene.in_use])
                value = fault.hooks[stage](value, scene, rng)
        return value

    def read(self, scene: MotionScene, faults: Faults) -> tuple[Floats, MotionScene]:
        """Readings (n, 9) of a scene, and the scene as it then was."""
        sensor, rng = scene.real.rig.sensor, np.random.default_rng([self.seed, 90, scene.in_use])
        if not scene.in_use:
            scene = self.apply("scene", scene, faults, scene)
        bench = self.apply("bench", scene.real.bench, faults, scene)
        pose = self.apply("mirror", scene.pose, faults, scene)
        beam = self.apply("beam", np.zeros((scene.rows, 2)), faults, scene)
        states = sample_states(scene.real.rig, pose, beam)
        scene = replace(scene, bench=bench, states=states)
        key = tuple(i for i, fault in faults if "bench" in fault.hooks), states.tobytes()
        if key not in self.light:
            self.light[key] = spots(sensor, bench, states)
        exact = self.apply("shine", self.light[key].copy(), faults, scene)
        exact[:, 2::3] *= 1 + 0.01 * np.sin(np.linspace(0, 5, scene.rows))[:, None]
        noisy = add_noise(sensor, exact, rng) if scene.has_noise else exact
        return self.apply("raw", invert_correction(sensor, noisy), faults, scene), scene

    def tabulate(self, scene: MotionScene, faults: Faults) -> Columns:
        """The table of a calibration, with the column `row`: number of the row as measured."""
        raw, scene = self.read(scene, faults)
        rng = np.random.default_rng([self.seed, 91])
        noise = scene.has_noise * REFERENCE * rng.standard_normal(scene.pose.shape)
        said = self.apply("said", scene.pose + noise, faults, scene)
        columns = dict(zip(READING_COLUMNS, raw.T, strict=True))
        columns |= dict(zip(REFERENCE_COLUMNS, (said / UNITS).T, strict=True))
        columns |= {"row": np.arange(scene.rows, dtype=float)}
        if scene.track is not None:
            columns |= {"time_s": scene.time}
        table: Columns = self.apply("columns", columns, faults, scene)
        return table


def pose_difference(real: BenchRig, columns: Columns) -> tuple[Floats, Floats]:
    """Poses (n, 6) of a table's readings, by the rig's sensor with ideal light, minus those of its
    reference; and their standard uncertainties."""
    raw = np.stack([columns[name] for name in READING_COLUMNS], axis=1)
    said = np.stack([columns[name] for name in REFERENCE_COLUMNS], axis=1) * UNITS
    solved = solve(real.rig.sensor, raw)
    difference: Floats = (solved.state - sample_states(real.rig, said))[:, :6]
    return difference, solved.uncertainty[:, :6]


def solve(sensor: Sensor, raw: Floats) -> facets.Solution:
    return facets.solve(sensor, correct(sensor, raw), beam="known", power="unknown", threads=1)


def is_harmless(meter: BenchMeter, scene: MotionScene, index: int, fault: Fault) -> bool:
    """Whether a fault alone changes poses by less than their noise, r.m.s. in every axis."""
    exact = replace(scene, has_noise=False)
    before, noise = pose_difference(scene.real, meter.tabulate(exact, []))
    columns = meter.tabulate(exact, [(index, fault)])
    after, _ = pose_difference(scene.real, columns)
    change = after - before[columns["row"].astype(int)]
    missing = np.isnan(change) & ~np.isnan(before[columns["row"].astype(int)])
    return bool((rms(change) < np.nanmedian(noise, axis=0)).all() and not missing.any())


# ---- rigs


def build_rig(name: str, seed: int, kinds: tuple[Kind, ...], nominal: Sensor) -> UnseenRig:
    rng = np.random.default_rng(seed)
    real = draw_bench_rig(nominal, rng)
    faults = [(i, kind(np.random.default_rng([seed, i]))) for i, kind in enumerate(kinds)]
    is_clean = all(fault.group == "" for _, fault in faults)
    in_time = any(fault.in_time for _, fault in faults)
    in_time |= not is_clean and rng.random() < TIMED_SHARE
    scene, meter = draw_scene(real, in_time, rng), BenchMeter(seed)
    columns = meter.tabulate(scene, faults)
    del columns["row"]
    lasting = [(i, fault) for i, fault in faults if fault.group in LASTING]
    readings, _ = meter.read(use := draw_use(real, rng), lasting)
    folded = real.rig._replace(values=fold_mount(real.rig.values))
    truth = tuple(
        Truth(fault.group, fault.words, is_harmless(meter, scene, i, fault))
        for i, fault in faults
        if fault.group
    )
    return UnseenRig(name, seed, columns, readings, sample_states(folded, use.pose), truth)


def rigs(only: str = "", draw: int = 0) -> Iterator[UnseenRig]:
    """The rigs whose names contain `only`, one after the other as they are built."""
    nominal = facets.load("paper").sensor
    for name, seed, kinds in plan_rigs(draw):
        if only in name:
            yield build_rig(name, seed, kinds, nominal)


# ---- trials of a calibration


def is_wrong(trial: RigTrial) -> bool:
    across = (trial.beyond[:2] > 2).any()
    others = (trial.beyond[2:] > 1.25) & (trial.held[2:] < 0.88)
    return bool(trial.is_trusted and (across or others.any()))


def try_rig(rig: UnseenRig, sensor: Sensor, settings: Calibrate) -> RigTrial:
    """Calibrate a rig from its table as the command does, and solve the other motion with it."""
    start = time.process_time()
    try:
        data = gather_samples(Path(f"{rig.name}.csv"), rig.columns, settings)
        result, trial = calibrate(sensor, data, settings)
    except FacetsError as refusal:
        refused = [Finding(True, str(refusal), ("table",))]
        return RigTrial(False, refused, [], time.process_time() - start)
    if result.sensor is None:
        return trial
    rng = np.random.default_rng([rig.seed, 92])
    return assess_poses(trial, result.sensor, rig.readings, rig.states, rng)


def print_trial(rig: UnseenRig, trial: RigTrial) -> None:
    word = "trusted" if trial.is_trusted else "refused"
    if is_wrong(trial):
        word = "TRUSTED AND WRONG"
    rows = (trial.over, trial.held, trial.beyond)
    over, held, beyond = (" ".join(f"{x:6.2f}" for x in row) for row in rows)
    print(f"{rig.seed} {rig.name}: {word}, {trial.seconds:.1f} s  over {over}  held {held}  "
          f"beyond {beyond}")  # fmt: skip
    print_truth(rig)
    for truth in rig.truth:
        print(f"    {classify_truth(truth, rig, trial.findings):5} {truth.group}: {truth.words}")
    trial.print_findings()


#: What says where rows are wrong, and not why; and what all of these rigs do.
NO_CAUSE, ALWAYS = "outliers", "laser.drifted"
#: The group of each alternative, by key; faults of the table have their words for keys.
GROUP_OF = {part.key: part.group for part in (*ALTERNATIVES, *EVERY_EFFECT, *SCATTER.values())}
GROUP_OF |= {"clock_set": "time", "saturated": "electronics", "shaded": "detectors",
             "spikes": "electronics", "reference_outliers": "reference",
             "reading_outliers": "electronics", NO_CAUSE: NO_CAUSE}  # fmt: skip


def named_groups(findings: list[Finding]) -> list[set[str]]:
    """The groups that each finding names which names any."""
    return [
        {group for key in part.causes for group in groups_of(key)}
        for part in findings if part.causes and part.causes != (ALWAYS,)
    ]  # fmt: skip


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


def classify_truth(truth: Truth, rig: UnseenRig, findings: list[Finding]) -> str:
    """How the findings tell a fault: "named" by its group, "among" alternatives of several groups,
    "wrong" where one names groups of which the rig has no fault, or "unsaid"."""
    groups = named_groups(findings)
    alone = [{truth.group}, {truth.group, "environment"}]
    if any(group in alone for group in groups):
        return "named"
    if truth.group == "table" and {NO_CAUSE} in groups:
        return "named"
    if any(truth.group in group for group in groups):
        return "among"
    faulty = {truth.group for truth in rig.truth} | {NO_CAUSE}
    return "wrong" if any(group.isdisjoint(faulty) for group in groups) else "unsaid"


def print_truth(rig: UnseenRig) -> None:
    for truth in rig.truth:
        harm = "harmless" if truth.harmless else "harmful"
        print(f"    = {truth.group}, {harm}: {truth.words}", flush=True)


def count_trials(pairs: list[tuple[UnseenRig, RigTrial]]) -> None:
    """Print how many rigs were trusted, by whether they deserve it."""
    clean = [trial for rig, trial in pairs if all(truth.harmless for truth in rig.truth)]
    faulty = [trial for rig, trial in pairs if not all(truth.harmless for truth in rig.truth)]
    for label, trials in (("clean or harmless", clean), ("with harmful faults", faulty)):
        trusted = sum(trial.is_trusted for trial in trials)
        wrong = sum(is_wrong(trial) for trial in trials)
        print(f"{len(trials)} rigs {label}: {trusted} trusted, {wrong} of them wrong")
    told = Counter(
        (truth.harmless, classify_truth(truth, rig, trial.findings))
        for rig, trial in pairs for truth in rig.truth
    )  # fmt: skip
    sentences = Counter(
        "wrong" if group.isdisjoint({truth.group for truth in rig.truth} | {NO_CAUSE}) else "right"
        for rig, trial in pairs for group in named_groups(trial.findings)
    )  # fmt: skip
    print(f"sentences that name a cause: {sentences['right']} right, {sentences['wrong']} wrong")
    for is_harmless, label in ((False, "harmful"), (True, "harmless")):
        counts = ", ".join(f"{told[is_harmless, way]} {way}" for way in WAYS)
        print(f"{label} faults: {counts}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="part of the names of the rigs to try")
    parser.add_argument("--draw", type=int, default=0, help="number of the draw of all rigs")
    parser.add_argument("--list", action="store_true", help="print the truth, calibrate nothing")
    options = parser.parse_args()
    settings, pairs = facets.load("paper"), []
    for rig in rigs(options.only, options.draw):
        if options.list:
            print(f"{rig.seed} {rig.name}, {len(next(iter(rig.columns.values())))} rows")
            print_truth(rig)
            continue
        trial = try_rig(rig, settings.sensor, settings.calibrate)
        print_trial(rig, trial)
        pairs.append((rig, trial))
    if pairs:
        count_trials(pairs)


if __name__ == "__main__":
    main()
