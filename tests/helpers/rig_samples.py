"""Samples of drawn rigs with ideal light, disturbed in some way, and their calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from facets.experiments.studies import bench_rays, rigs

import facets
from facets.calibration import REFERENCE, Data, choice, states_of, time_derivatives, verdict
from facets.core import READING_COLUMNS, STATE_UNITS
from facets.detectors import add_noise, correct, invert_correction
from facets.files import tables

CONFIG = facets.load("paper")
NOMINAL = CONFIG.sensor
#: Half widths of a motion that is wide enough for the powers to bend, mm and rad.
WIDE = np.array([rigs.REACH_MM, rigs.REACH_MM, *rigs.BOX[2:]])
#: The light of rays (`bench_rays`) that is that of the nominal sensor.
IDEAL_RAYS = bench_rays.RayBench.from_sensor(NOMINAL)


def settings(**effects):
    """The settings of a calibration that tries no effects but these."""
    off = dict.fromkeys(CONFIG.calibrate.effects, "off")
    return replace(CONFIG.calibrate, effects=off | effects)


def sample_rig(count, seed=5, *, box=WIDE, **disturbances):
    """Return a rig, its samples with a reference's errors, and the true states (count, 8);
    disturbances: those of `sample_motion`."""
    rng = np.random.default_rng(seed)
    rig = rigs.draw_rig(NOMINAL, rng)
    return rig, *sample_motion(rig, count, rng, box, **disturbances)


def sample_motion(
    rig, count, rng, box=rigs.BOX, *, light=None, mirror=None, beam=None, alter=None, noise=1.0
):
    """Return samples of a rig in random poses, with a reference's errors, and the true states.

    light: of the bench, as the model has it.  mirror: displaces it, by poses (n, 6) and a
    generator.  beam: displaces it (n, 2), by the count and a generator.  alter: changes exact
    readings (n, 9), by the sensor and the states.
    """
    sensor = replace(rig.sensor, light=light or NOMINAL.light)
    pose = rng.uniform(-1, 1, (count, 6)) * box
    still = np.zeros((count, 2))
    there = pose + mirror(pose, rng) if mirror else pose
    moved = beam(count, rng) if beam else still
    data = Data(np.zeros((count, 9)), there, rigs.REFERENCE, moved)
    state = states_of(data, data.raw, rig.values)
    exact = facets.readings(sensor, state)
    if alter:
        exact = alter(sensor, state, exact)
    raw = exact + noise * (add_noise(sensor, exact, rng) - exact)
    said = pose + rigs.REFERENCE * rng.standard_normal(pose.shape)
    return data._replace(raw=invert_correction(sensor, raw), pose=said, beam=still), state


def read(rig, data, rng):
    """Return the raw readings (n, 9) of a rig at the poses and beam places of samples."""
    state = states_of(data, np.zeros((len(data.pose), 9)), rig.values)
    noisy = add_noise(rig.sensor, facets.readings(rig.sensor, state), rng)
    return invert_correction(rig.sensor, noisy)


def pose_errors(sensor, data, state):
    """Return the errors (n, 6) of poses that are solved with the beam known; mm and rad."""
    poses = facets.solve(sensor, correct(sensor, data.raw), beam="known", threads=0)
    return (poses.state - state)[:, :6]


def error_slope(rig, judged, axis, along):
    """Return the slope of the errors of poses in an axis by their place along another."""
    fresh, truth = sample_motion(rig, 200, np.random.default_rng(5))
    off = pose_errors(judged.sensor, fresh, truth)
    seen = np.isfinite(off).all(axis=1)
    return np.polyfit(truth[seen, along], off[seen, axis], 1)[0]


def move(at):
    """Return the poses (n, 6) of a motion at times in seconds."""
    turns = 2 * np.pi * np.array([5.2, 8.4, 6.8, 11.6, 13.2, 9.2]) * at[:, None] + np.arange(6)
    waves = [np.sin(times * turns) for times in (1.0, 1.3, 1.7, 2.3)]
    return 0.35 * rigs.BOX * np.sum(waves, axis=0)


def sample_in_time(late=0.0, delays=(0.0, 0.0, 0.0), count=150):
    """Samples at 1 kHz.  late: by how much the reference is; (count,) at each sample, or (6, 1) of
    each axis.  delays: after which each detector is read where the mirror then is; all in seconds.
    """
    rng, time = np.random.default_rng(2), np.arange(count) / 1000
    rig, zero = rigs.draw_rig(NOMINAL, rng), np.zeros((count, 9))
    exact = zero.copy()
    for k, delay in enumerate(delays):
        there = Data(zero, move(time + delay), rigs.REFERENCE, zero[:, :2])
        reading = facets.readings(rig.sensor, states_of(there, zero, rig.values))
        exact[:, 3 * k : 3 * k + 3] = reading[:, 3 * k : 3 * k + 3]
    each = np.broadcast_to(np.atleast_2d(late).T, (count, 6))
    axes = [move(time - each[:, n])[:, n] for n in range(6)]
    said = np.column_stack(axes) + rigs.REFERENCE * rng.standard_normal((count, 6))
    raw = invert_correction(rig.sensor, add_noise(rig.sensor, exact, rng))
    velocity, acceleration = time_derivatives(time, said)
    return Data(
        raw, said, rigs.REFERENCE, zero[:, :2], velocity=velocity, acceleration=acceleration
    )


def write_samples(path, data):
    """Write the table that `facets calibrate` takes."""
    columns = dict(zip(READING_COLUMNS, data.raw.T, strict=True))
    columns |= dict(zip(REFERENCE, (data.pose / STATE_UNITS[:6]).T, strict=True))
    tables.write_table(path, columns, {})


def judge(data, asked=None, sensor=NOMINAL):
    """Calibrate as the command does, with the effects of light and motion off unless asked for."""
    asked = asked or settings()
    return verdict.verdict(sensor, data, choice(sensor, asked), asked)


def words_of(judged):
    return " ".join(finding.words for finding in judged.findings)


def accepted_effects(judged):
    return {row.key for row in judged.search.rows if row.accepted}
