"""Accuracy of the changes that `facets rezero` estimates from readings at one stop.

    python -m facets.experiments.studies.new_zero [--rigs 4] [--draws 50]

Each rig has the light of a bench and is read by rays, which share no code with the model
(`bench_rays`). It is calibrated from 500 poses as `facets calibrate` does. Then the beam, the
laser's power, the beam's width, the gains and the posts change, and so does the mirror's pose at
the stop. The changes are drawn from the default standard uncertainties of `facets rezero`. The
study prints the estimates of one known change with a stop that repeats exactly. It prints the
coverage of the 95 % intervals of all changes and of poses solved before and after, and the effect
of a mirror that moved between the stops. It takes two minutes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

import facets
from facets.calibration.fitting.unknowns import fold_mount
from facets.calibration.rezero import ChangePriors, NewZero, StopReadings, renew_zero
from facets.calibration.table import choice
from facets.calibration.verdict import verdict
from facets.core.sensor import Sensor
from facets.core.units import Floats
from facets.detectors.correction import correct, invert_correction
from facets.detectors.noise import add_noise, standard_deviations

from .bench_rays import spots
from .options import parse_options
from .rigs import BOX, BenchRig, Rng, draw_bench_rig
from .simulated_bench import draw_poses, draw_scene, measure, samples_of, states_at

NOTHING = np.zeros(10)
#: Number of rows averaged at a stop.
ROWS = 20_000
#: Priors for a stop that repeats almost exactly, and a beam whose width stays.
EXACT_STOP = ChangePriors(width=1e-7, stop=1e-7, stop_angle=1e-9)


class CalibratedRig(NamedTuple):
    """A rig and its calibration.  real: the true rig.  sensor: the calibrated sensor.  rng: the
    rig's random generator."""

    real: BenchRig
    sensor: Sensor
    rng: Rng


def calibrate_rig(seed: int) -> CalibratedRig:
    """Draw and calibrate a rig; the calibration must be trusted."""
    config, rng = facets.load("paper"), np.random.default_rng(seed)
    real = draw_bench_rig(config.sensor, rng)
    data = samples_of(measure(draw_scene(real, rng), [], seed), config.calibrate)
    result = verdict(config.sensor, data, choice(config.sensor, config.calibrate), config.calibrate)
    assert result.sensor is not None
    return CalibratedRig(real, result.sensor, rng)


def change_rig(real: BenchRig, change: Floats) -> BenchRig:
    """The rig after changes (10,), those of power and width relative; the beam's place is not
    changed."""
    sensor = real.rig.sensor
    a, b, c = (
        replace(psd, height=psd.height + change[6 + k],
                correction=replace(psd.correction, power=psd.correction.power + change[3 + k]))
        for k, psd in enumerate(sensor.psds)
    )  # fmt: skip
    beam = replace(sensor.beam, power=sensor.beam.power * (1 + change[2]))
    light = real.bench._replace(covariance=real.bench.covariance * (1 + change[9]) ** 2)
    return BenchRig(real.rig._replace(sensor=replace(sensor, beam=beam, psds=(a, b, c))), light)


def read_exactly(real: BenchRig, pose: Floats, beam: Floats) -> Floats:
    """Readings (m, 9) at the reference's poses (m, 6) with the beam at a place (2,)."""
    states = states_at(real.rig.values, pose, np.tile(beam, (len(pose), 1)))
    return spots(real.rig.sensor, real.bench, states)


def read_stop(rig: CalibratedRig, pose: Floats, change: Floats) -> StopReadings:
    """Mean detector readings of the changed rig at the reference's poses (m, 6)."""
    real = change_rig(rig.real, change)
    exact = read_exactly(real, pose, change[:2])
    sigma = standard_deviations(real.rig.sensor, exact) / np.sqrt(ROWS)
    noisy = exact + sigma * rig.rng.standard_normal(exact.shape)
    return StopReadings(invert_correction(real.rig.sensor, noisy), sigma**2)


class ChangeDraw(NamedTuple):
    """One draw of changes.  off: errors of the estimates over their uncertainties (10,).
    chi_square: that of the fit.  before, after: errors of poses (n, 6) over their uncertainties, by
    the old and the new zero."""

    off: Floats
    chi_square: float
    before: Floats
    after: Floats


def draw_changes(rig: CalibratedRig, priors: ChangePriors, poses: int = 20) -> ChangeDraw:
    """Draw changes and a stop, renew the zero, and compare the estimates and poses with the
    truth."""
    rng = rig.rng
    pose = 0.3 * rng.uniform(-1, 1, (1, 6)) * BOX
    change = priors.sigmas(1.0) * rng.standard_normal(len(NOTHING))
    missed = np.array([priors.stop] * 3 + [priors.stop_angle] * 3) * rng.standard_normal((1, 6))
    then = read_stop(rig, pose, NOTHING)
    zero = renew_zero(rig.sensor, then, read_stop(rig, pose + missed, change), priors)
    off = (zero.change - change * zero.prior / priors.sigmas(1.0)) / zero.uncertainty
    fresh = draw_poses(rig.real.rig, poses, rng)
    before = solve_poses(rig, fresh, change, rig.sensor, np.zeros(2))
    after = solve_poses(rig, fresh, change, zero.sensor, zero.beam)
    return ChangeDraw(off, zero.chi_square, before, after)


def solve_poses(
    rig: CalibratedRig, pose: Floats, change: Floats, sensor: Sensor, beam: Floats
) -> Floats:
    """Errors of poses of the changed rig, solved by a sensor, over their uncertainties (n, 6)."""
    real = change_rig(rig.real, change)
    noisy = add_noise(real.rig.sensor, read_exactly(real, pose, change[:2]), rig.rng)
    readings = correct(sensor, invert_correction(real.rig.sensor, noisy))
    poses = facets.solve(sensor, readings, beam=facets.Prior(beam, 0.0), power="unknown", threads=0)
    off: Floats = poses.state[:, :6] - states_at(fold_mount(real.rig.values), pose)[:, :6]
    return off / poses.uncertainty[:, :6]


def move_mirror(rig: CalibratedRig, moved: Floats, priors: ChangePriors) -> NewZero:
    """Compute the new zero if only the mirror moved, by (6,), between the stops."""
    pose = np.zeros((1, 6))
    then, now = (read_stop(rig, pose + by, NOTHING) for by in (0.0, moved))
    return renew_zero(rig.sensor, then, now, priors)


def known_change(rig: CalibratedRig) -> NewZero:
    """Changes: beam 1 um aside, posts 2.3 um higher, laser 1 % brighter, gain A 0.1 % higher."""
    change = np.array([1e-3, 0, 0.01, 1e-3, 0, 0, 2.3e-3, 2.3e-3, 2.3e-3, 0])
    pose = np.zeros((1, 6))
    stops = [read_stop(rig, pose, by) for by in (NOTHING, change)]
    return renew_zero(rig.sensor, stops[0], stops[1], EXACT_STOP)


def show(name: str, zero: NewZero) -> None:
    """Print the changes of a new zero with their uncertainties."""
    factors = np.array([1e3, 1e3, 100 / zero.prior[2] * 0.05, *[100] * 3, *[1e3] * 3, 100])
    values = zip(zero.change * factors, zero.uncertainty * factors, strict=True)
    text = "  ".join(f"{value:+.3f} ± {u:.3f}" for value, u in values)
    print(f"{name}: chi-square {zero.chi_square:.1f}, explained: {zero.is_explained}")
    print(f"  beam, um; power, %; gains, %; posts, um; width, %: {text}")


def main() -> None:
    options = parse_options(__doc__, rigs=4, draws=50)
    rigs = [calibrate_rig(seed) for seed in range(options.rigs)]
    show("known change, exact stop", known_change(rigs[0]))
    priors = ChangePriors()
    draws = [draw_changes(draw, priors) for draw in rigs for _ in range(options.draws)]
    for name, off in (
        ("changes", np.array([draw.off for draw in draws])),
        ("poses by the old zero", np.concatenate([draw.before for draw in draws])),
        ("poses by the new zero", np.concatenate([draw.after for draw in draws])),
    ):
        held = " ".join(f"{100 * fraction:.1f}" for fraction in (np.abs(off) < 1.96).mean(axis=0))
        print(f"95 % intervals of {name} that held, %: {held}")
    chi_square = np.array([draw.chi_square for draw in draws])
    print(f"chi-square {chi_square.mean():.2f} on average, where 9 is expected")
    for axis, size in enumerate((1e-3, 1e-3, 1e-3, 1e-5, 1e-5, 1e-6)):
        moved = np.zeros(6)
        moved[axis] = size
        for stop, some in (("exact stop", EXACT_STOP), ("stop by default", priors)):
            all_zeros = [move_mirror(draw, moved, some) for draw in rigs for _ in range(10)]
            refused = np.mean([not zero.is_explained for zero in all_zeros])
            show(
                f"mirror moved in {facets.POSE[axis]}, {stop}, refused {refused:.0%}", all_zeros[0]
            )


if __name__ == "__main__":
    main()
