"""Rigs with hidden errors, calibrated: how well poses are known before and after.

    python -m facets.experiments.studies.rigs [--rigs 20] [--samples 500] [--config bench]
                                      [--reach 0.25]

Each rig has detectors up to 0.3 mm and 5 mrad off their places, facets up to 2 mrad, powers and
scales up to 3 %, the beam 2 mrad out of plumb, the mirror off the reference's pivot and off the
beam. It is moved by a reference of 0.1 um and 0.5 urad, read with the config's noise under the
light of a real bench, all effects at once, by rays (`bench_rays`), and calibrated from the nominal
sensor as `facets calibrate` does it. Other motions are then solved, beside a solver that knows the
rig perfectly; the motion to calibrate with reaches further in x and y (--reach). Tests also use
rigs with ideal light (`try_rig`).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import facets
from facets.calibration.alternatives.alternative import Finding
from facets.calibration.fitting.bundle_adjustment import Data, states_of
from facets.calibration.fitting.fit import Fit, fit
from facets.calibration.fitting.unknowns import (
    ALL,
    MOUNT,
    MOUNTING,
    PLACE,
    Choice,
    assign_values,
    block,
    fold_mount,
    values_of,
)
from facets.calibration.table import choice as choice_of
from facets.calibration.table import clock, time_derivatives
from facets.calibration.verdict import Verdict, verdict
from facets.core.calibrate import Calibrate
from facets.core.sensor import Sensor
from facets.core.units import Floats
from facets.detectors.correction import correct, invert_correction
from facets.detectors.noise import add_noise, standard_deviations

from .bench_rays import RayBench, spots

#: Standard uncertainty of the reference, mm and rad.
REFERENCE = np.array([1e-4] * 3 + [5e-7] * 3)
#: Half widths of the motion, mm and rad.
BOX = np.array([0.12, 0.12, 2.0, 6e-3, 6e-3, 8e-3])
#: Reach of a motion to calibrate with in x and y, mm: over the beam's sigma of 0.21, so that
#: the powers bend, which alone parts gains, strips and the beam's size from the apex's place.
REACH_MM = 0.25
#: Least distance of spots on a bench from a detector's edge, mm; nearer spots lose light that
#: the ray models omit.
CLEARANCE_MM = 1.2


def hidden() -> dict[str, float]:
    """Half the spread of each hidden parameter error, in mm, rad and shares."""
    sigmas = {"beam.tilt_x": 2e-3, "beam.tilt_y": 2e-3}
    for letter in "abc":
        sigmas |= {f"facet_{letter}.{name}": 2e-3 for name in ("inclination", "azimuth")}
        sigmas |= {f"psd_{letter}.{name}": 0.3 for name in ("radius", "height")}
        sigmas[f"psd_{letter}.azimuth"] = 0.3 / 250
        sigmas |= {f"psd_{letter}.{name}": 5e-3 for name in ("roll", "pitch", "yaw")}
        sigmas[f"correction_{letter}.power"] = 0.03
        sigmas |= {f"correction_{letter}.{name}": 0.03 * 6.5 for name in ("y10", "z01")}
    return sigmas | dict(zip(MOUNTING, (20.0, 20.0, 40.0, 0.05, 0.05), strict=False))


def choice() -> Choice:
    """Unknowns of the calibration, with these spreads as priors."""
    spread = hidden()
    return Choice(tuple(spread), np.array(list(spread.values())))


class Rig(NamedTuple):
    """The true sensor, and where the mirror is on the reference."""

    sensor: Sensor
    values: Floats


def draw_rig(nominal: Sensor, rng: np.random.Generator) -> Rig:
    values = values_of(nominal)
    for name, half in hidden().items():
        values[ALL.index(name)] += rng.uniform(-half, half)
    return Rig(assign_values(nominal, values), values)


def read(rig: Rig, data: Data, rng: np.random.Generator) -> Data:
    """Return the samples with the detectors' readings at the reference's poses."""
    state = states_of(data, np.zeros((len(data.pose), 9)), rig.values)
    noisy = add_noise(rig.sensor, facets.readings(rig.sensor, state), rng)
    return data._replace(raw=invert_correction(rig.sensor, noisy))


def sample_motion(rig: Rig, count: int, rng: np.random.Generator) -> tuple[Data, Floats]:
    """Sample random motions: reference and detector data, and the true states (n, 8)."""
    pose = rng.uniform(-1, 1, (count, 6)) * BOX
    empty = Data(np.empty((count, 9)), pose, REFERENCE, np.zeros((count, 2)))
    data = read(rig, empty, rng)
    said = pose + REFERENCE * rng.standard_normal(pose.shape)
    return data._replace(pose=said), states_of(empty, np.zeros((count, 9)), rig.values)


def errors(sensor: Sensor, data: Data, state: Floats) -> Floats:
    """Errors (n, 6) of solved poses with the beam known; mm and rad."""
    poses = facets.solve(sensor, correct(sensor, data.raw), beam="known", threads=0)
    error: Floats = (poses.state - state)[:, :6]
    return error


def rms(error: Floats) -> Floats:
    root: Floats = np.sqrt(np.nanmean(error**2, axis=0))
    return root


def try_rig(seed: int, samples: int, nominal: Sensor) -> tuple[Rig, Fit, Floats]:
    """A rig, its calibration, and r.m.s. errors (3, 6) on other motions: before, after, perfect."""
    rng = np.random.default_rng(seed)
    rig = draw_rig(nominal, rng)
    data, _ = sample_motion(rig, samples, rng)
    result = fit(nominal, data, choice())
    fresh, state = sample_motion(rig, 2000, rng)
    rows = [rms(errors(sensor, fresh, state)) for sensor in (nominal, result.sensor, rig.sensor)]
    return rig, result, np.array(rows)


# ---- rigs with the light of a bench, read by rays


class BenchRig(NamedTuple):
    """rig: sensor with ideal light, detector errors and mirror pose.  bench: the bench's light."""

    rig: Rig
    bench: RayBench


Rng = np.random.Generator


class Disturbance(NamedTuple):
    """Disturbances that no calibration model includes; None for each that is absent.

    light: changes the bench.  mirror: true poses of the mirror for commanded poses (n, 6).
    reference: measured poses for true ones (n, 6).  told: stated uncertainty of the reference.
    beam: places (n, 2), mm.  power: factors (n,).  readings: changed readings (n, 9), from
    readings and their standard deviations.  time: times of the samples (n,), s, in which the mirror
    then moves smoothly; they may be those that a wrong clock gives.  temperature: of the
    thermometer (n,), degrees Celsius.
    """

    light: Callable[[RayBench], RayBench] | None = None
    mirror: Callable[[Floats, Rng], Floats] | None = None
    reference: Callable[[Floats, Rng], Floats] | None = None
    told: Floats = REFERENCE
    beam: Callable[[int, Rng], Floats] | None = None
    power: Callable[[int, Rng], Floats] | None = None
    readings: Callable[[Floats, Floats, Rng], Floats] | None = None
    time: Callable[[Floats], Floats] | None = None
    temperature: Callable[[int], Floats] | None = None


#: A bench without disturbances.
UNDISTURBED = Disturbance()


def draw_bench_rig(nominal: Sensor, rng: np.random.Generator) -> BenchRig:
    """Sample a rig with every effect at once, each of the size of a good bench."""
    rig = draw_rig(nominal, rng)
    values = rig.values.copy()
    values[block(MOUNT)] = rng.uniform(-1, 1, 3) * [1e-3, 1e-3, 8e-3]
    for letter in "abc":
        for name in ("y20", "y11", "y02", "z20", "z11", "z02", "y30", "z03"):
            values[PLACE[f"correction_{letter}.{name}"]] = rng.uniform(-0.02, 0.02)
    sigma = nominal.beam.diameter_x / 4
    long, short, turn = sigma * (1 + 0.0125), sigma * (1 - 0.0125), rng.uniform(0, np.pi)
    axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    round_ = rng.uniform(2000, 6000) * rng.choice([-1, 1])
    bench = RayBench(
        covariance=axes @ np.diag([long**2, short**2]) @ axes.T,
        curvature=np.diag(1 / (round_ * rng.uniform(0.8, 1.25, 2))),
        wavelength=633e-6,
        metal=1.37 + 7.62j,
        polarisation=float(rng.uniform(0, np.pi)),
        strips=rng.uniform(0.004, 0.012, 3),
        depth=rng.uniform(5e-6, 3e-5, (3, 2)),
        width=0.03,
        background=np.column_stack([rng.uniform(1e-4, 5e-4, 3), rng.uniform(-3, 3, (3, 2))]),
    )
    return BenchRig(Rig(assign_values(nominal, values), values), bench)


def sample_bench_motion(
    real: BenchRig,
    count: int,
    rng: np.random.Generator,
    box: Floats = BOX,
    wrong: Disturbance = UNDISTURBED,
) -> tuple[Data, Floats]:
    """Sample random motions with the laser's power drifting by 1 %: reference and detector data,
    and the true states (n, 8) in the reference's axes."""
    zero, sensor = np.zeros((count, 9)), real.rig.sensor
    empty = poses_on_bench(real.rig, count, rng, box, wrong.time is not None)
    pose = empty.pose if wrong.mirror is None else wrong.mirror(empty.pose, rng)
    beam = empty.beam if wrong.beam is None else wrong.beam(count, rng)
    there = empty._replace(pose=pose, beam=beam)
    exact = spots(sensor, real.bench, states_of(there, zero, real.rig.values))
    exact[:, 2::3] *= 1 + 0.01 * np.sin(np.linspace(0, 5, count))[:, None]
    if wrong.power is not None:
        exact[:, 2::3] *= wrong.power(count, rng)[:, None]
    raw = invert_correction(sensor, add_noise(sensor, exact, rng))
    said = empty.pose + REFERENCE * rng.standard_normal(empty.pose.shape)
    if wrong.reference is not None:
        said = wrong.reference(said, rng)
    if wrong.readings is not None:
        raw = wrong.readings(raw, standard_deviations(sensor, exact), rng)
    data = empty._replace(raw=raw, pose=said, sigma=wrong.told)
    return add_clock(data, wrong), states_of(there, zero, fold_mount(real.rig.values))


#: Samples of a motion in time, 1/s, and its speeds along the six axes, Hz.
RATE_HZ, SPEEDS_HZ = 10.0, np.array([0.052, 0.084, 0.068, 0.116, 0.132, 0.092])


def add_clock(data: Data, wrong: Disturbance) -> Data:
    """Add the columns of time and temperature, as a table would have them."""
    columns, every = {}, np.ones(len(data.raw), dtype=bool)
    if wrong.time is not None:
        columns["time_s"] = wrong.time(np.arange(len(data.raw)) / RATE_HZ)
        velocity, acceleration = time_derivatives(columns["time_s"], data.pose)
        data = data._replace(velocity=velocity, acceleration=acceleration)
    if wrong.temperature is not None:
        columns["temperature_c"] = wrong.temperature(len(data.raw))
        columns.setdefault("time_s", np.arange(len(data.raw)) / RATE_HZ)
        data = data._replace(temperature=float(columns["temperature_c"].mean()))
    return data._replace(clock=clock(columns, every))


def poses_on_bench(
    rig: Rig, count: int, rng: np.random.Generator, box: Floats = BOX, timed: bool = False
) -> Data:
    """Sample poses that keep every spot away from its detector's edges, without readings; of a
    motion in time, or each by itself."""
    pose = rng.uniform(-1, 1, (4 * count, 6)) * box
    if timed:
        at = np.arange(count)[:, None] / RATE_HZ
        pose = 0.8 * box * np.sin(2 * np.pi * (SPEEDS_HZ * at + rng.uniform(0, 1, 6)))
    every = Data(np.empty((len(pose), 9)), pose, REFERENCE, np.zeros((len(pose), 2)))
    reading = facets.readings(rig.sensor, states_of(every, np.zeros((len(pose), 9)), rig.values))
    half = np.array([[psd.size_y, psd.size_z] for psd in rig.sensor.psds]) / 2
    place = reading.reshape(-1, 3, 3)[:, :, :2]
    inside = (np.abs(place) < half - CLEARANCE_MM).all(axis=(1, 2))
    if timed:
        assert inside.mean() > 0.95, "too many spots of the motion leave the detectors"
        return every
    samples = every.part(np.flatnonzero(inside)[:count])
    assert len(samples.pose) == count, "too few poses keep their spots on the detectors"
    return samples


#: Errors of a rig without a result.
NOTHING = np.full(6, np.nan)


class RigTrial(NamedTuple):
    """The calibration of a rig, and what poses of another motion are worth with it.

    taken: effects of light that the calibration took.  seconds: of processor time.  over: r.m.s.
    errors over those of a rig that is known perfectly (6,).  held: the share of 95 % intervals that
    held (6,).  beyond: r.m.s. errors over stated standard uncertainties (6,).
    """

    is_trusted: bool
    findings: list[Finding]
    taken: list[str]
    seconds: float
    over: Floats = NOTHING
    held: Floats = NOTHING
    beyond: Floats = NOTHING

    def print_findings(self) -> None:
        for finding in self.findings:
            print(f"    {'!' if finding.bad else '-'} {finding.words}", flush=True)


def calibrate(sensor: Sensor, data: Data, settings: Calibrate) -> tuple[Verdict, RigTrial]:
    """Calibrate as the command does."""
    start = time.process_time()
    result = verdict(sensor, data, choice_of(sensor, settings), settings)
    rows = result.search.rows if result.search else []
    taken = [row.key for row in rows if row.accepted]
    seconds = time.process_time() - start
    return result, RigTrial(bool(result.is_trusted), result.findings, taken, seconds)


def assess_poses(trial: RigTrial, sensor: Sensor, raw: Floats, state: Floats, rng: Rng) -> RigTrial:
    """Solve another motion with a calibrated sensor; rng: for the readings of the perfect rig."""
    ideal = add_noise(sensor, facets.readings(sensor, state), rng)
    solved, perfect = (
        facets.solve(sensor, readings, beam="known", power="unknown", threads=1)
        for readings in (correct(sensor, raw), ideal)
    )
    error = (solved.state - state)[:, :6]
    with np.errstate(invalid="ignore"):
        inside = np.abs(error) < 1.96 * solved.uncertainty[:, :6]
    there = np.isfinite(error).sum(axis=0)  # a converter at its end leaves no pose
    return trial._replace(
        over=rms(error) / rms((perfect.state - state)[:, :6]),
        held=inside.sum(axis=0) / there,
        beyond=rms(error) / rms(solved.uncertainty[:, :6]),
    )


def try_bench_rig(
    seed: int,
    samples: int,
    config: str,
    fresh: int = 1000,
    reach: float = REACH_MM,
    wrong: Disturbance = UNDISTURBED,
) -> RigTrial:
    """Calibrate a rig on a bench as the command does, and solve other motions with it.

    wrong: disturbance of the calibration; only its light also disturbs the other motions.
    """
    settings = facets.load(config)
    rng = np.random.default_rng(seed)
    real = draw_bench_rig(settings.sensor, rng)
    if wrong.light is not None:
        real = real._replace(bench=wrong.light(real.bench))
    data, _ = sample_bench_motion(real, samples, rng, np.array([reach, reach, *BOX[2:]]), wrong)
    result, trial = calibrate(settings.sensor, data, settings.calibrate)
    if result.sensor is None:
        return trial
    other, state = sample_bench_motion(real, fresh, rng)
    return assess_poses(trial, result.sensor, other.raw, state, rng)


def try_bench_rigs(rigs: int, samples: int, config: str, reach: float) -> None:
    trials = []
    for seed in range(rigs):
        trial = try_bench_rig(seed, samples, config, reach=reach)
        trials.append(trial)
        ratios, shares = (" ".join(f"{x:6.3f}" for x in row) for row in (trial.over, trial.held))
        print(
            f"{seed:3} {trial.seconds:5.1f} s  over perfect {ratios}  inside {shares}", flush=True
        )
        print(f"    trusted {trial.is_trusted}; taken: {', '.join(trial.taken)}", flush=True)
        trial.print_findings()
    over = np.array([trial.over for trial in trials])
    inside = np.array([trial.held for trial in trials])
    told = " ".join(f"{x:.3f}" for x in over.max(axis=0))
    print(f"over perfect, worst by axis: {told}")
    print(f"95 % intervals that held: x, y {100 * inside[:, :2].mean():.1f} %, others "
          f"{100 * inside[:, 2:].mean():.1f} %")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--samples", type=int, default=500)
    parser.add_argument("--config", default="paper", help="whose sensor; bench has electronics")
    parser.add_argument("--reach", type=float, default=REACH_MM, help="in x and y, mm")
    options = parser.parse_args()
    try_bench_rigs(options.rigs, options.samples, options.config, options.reach)


if __name__ == "__main__":
    main()
