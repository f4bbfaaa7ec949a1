"""Simulated measurements of a rig on a bench, with a reference and with faults.

The readings are those of rays (`bench_rays`), which share no optics with the model. Faults act at
the stages of a measurement. These are `bench` (the light of the rays), `mirror` (the true poses),
`beam` (its places), `power` (relative power of the laser), `readings` (raw ones), `reference` (its
poses) and `table` (the written columns).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import facets
from facets.calibration.fitting.bundle_adjustment import Data, states_of
from facets.calibration.table import REFERENCE as REFERENCE_COLUMNS, gather_samples
from facets.core.calibrate import Calibrate
from facets.core.names import READING_COLUMNS, STATE_UNITS
from facets.core.units import Booleans, Floats
from facets.detectors.correction import invert_correction
from facets.detectors.noise import add_noise

from .bench_rays import spots
from .rigs import BOX, REACH_MM, REFERENCE, BenchRig, Rig, Rng

#: Least distance of spots from a detector's edge, mm; rays do not model the light that nearer spots
#: lose.
CLEARANCE_MM = 1.2
#: Half widths of the motion of a calibration, mm and rad.
BOX_REACH = np.array([REACH_MM, REACH_MM, *BOX[2:]])
#: Time between the rows of a motion, s, and between random poses, at which the stage settles first.
MOTION_PERIOD_S, RANDOM_PERIOD_S = 1.0, 4.0
#: One mm or mrad of a table in the units of the code.
UNITS = np.array(STATE_UNITS[:6])

Columns = dict[str, Floats]
Hook = Callable[[Any, "MotionScene", Rng], Any]
#: The changes of a fault: for each stage at which it acts, a function of the values there.
Parts = dict[str, Hook]


class Fault(NamedTuple):
    """A fault.  words: its description by a bench engineer.  in_time: whether it needs a motion in
    time.  named_by: words of findings that name it."""

    group: str
    words: str
    parts: Parts
    in_time: bool = False
    named_by: tuple[str, ...] = ()


@dataclass(frozen=True)
class MotionScene:
    """A motion of a rig.

    pose: (n, 6) those of the reference, without faults.  air: temperature (n,) less its mean, K.
    track: function that computes the pose at any time (s) of a motion in time.  in_use: whether the
    motion is after the calibration.  states: (n, 8) those of the rays, once they are computed.
    """

    real: BenchRig
    pose: Floats
    air: Floats
    track: Callable[[Floats], Floats] | None = None
    in_use: bool = False
    has_noise: bool = True
    states: Floats | None = None

    @property
    def rows(self) -> int:
        """The number of rows."""
        return len(self.pose)

    @property
    def time(self) -> Floats:
        """The times (n,) of the rows, s."""
        period = MOTION_PERIOD_S if self.track else RANDOM_PERIOD_S
        return period * np.arange(self.rows, dtype=np.float64)

    @property
    def progress(self) -> Floats:
        """Elapsed fraction of the calibration (n,); 1 in use."""
        return np.ones(self.rows) if self.in_use else np.linspace(0, 1, self.rows)

    def shift(self, late: Floats) -> Floats:
        """Change (n, 6) of the pose if it is sampled later; late: delays (n,), s."""
        assert self.track is not None
        return self.track(self.time + late) - self.track(self.time)


def states_at(values: Floats, pose: Floats, beam: Floats | None = None) -> Floats:
    """States (n, 8) of the mirror at poses (n, 6) of the reference; values: parameters of the
    rig."""
    places = np.zeros((len(pose), 2)) if beam is None else beam
    empty = np.zeros((len(pose), 9))
    return states_of(Data(empty, pose, REFERENCE, places), empty, values)


def are_on_detectors(rig: Rig, pose: Floats) -> Booleans:
    """Whether all spots at poses (n, 6) have the least distance from the edges of detectors:
    (n,)."""
    place = facets.readings(rig.sensor, states_at(rig.values, pose)).reshape(-1, 3, 3)[:, :, :2]
    half = np.array([[psd.size_y, psd.size_z] for psd in rig.sensor.psds]) / 2
    return np.asarray((np.abs(place) < half - CLEARANCE_MM).all(axis=(1, 2)))


def draw_poses(rig: Rig, count: int, rng: Rng, box: Floats = BOX) -> Floats:
    """Random poses (count, 6) whose spots are on the detectors."""
    pose = rng.uniform(-1, 1, (4 * count, 6)) * box
    poses: Floats = pose[are_on_detectors(rig, pose)][:count]
    assert len(poses) == count, "too few poses keep their spots on the detectors"
    return poses


def draw_track(rig: Rig, rows: int, rng: Rng) -> Callable[[Floats], Floats]:
    """A smooth motion, poses (n, 6) as a function of times (n,), three sines in each axis, that
    keeps all spots on the detectors."""
    periods, phases = rng.uniform(15, 90, (3, 6)), rng.uniform(0, 2 * np.pi, (3, 6))
    parts = rng.uniform(0.3, 1, (3, 6))
    sizes = parts / parts.sum(axis=0) * BOX_REACH

    def track(time: Floats) -> Floats:
        """The poses (n, 6) at times (n,), s."""
        waves = np.sin(2 * np.pi * time[:, None, None] / periods + phases)
        return np.asarray((sizes * waves).sum(axis=1))

    while not are_on_detectors(
        rig, track(MOTION_PERIOD_S * np.arange(rows, dtype=np.float64))
    ).all():
        sizes = sizes * [1, 1, 0.95, 0.95, 0.95, 0.95]  # z and the angles move the spots
    return track


def draw_scene(
    real: BenchRig, rng: Rng, rows: int = 500, in_time: bool = False, box: Floats = BOX_REACH
) -> MotionScene:
    """Draw the motion of a calibration: random poses, or a motion in time."""
    track = draw_track(real.rig, rows, rng) if in_time else None
    pose = np.zeros((rows, 6)) if track else draw_poses(real.rig, rows, rng, box)
    scene = MotionScene(real, pose, np.zeros(rows), track)
    # a room that warms or cools while its air conditioning switches
    cycle = rng.uniform(0.1, 0.4) * np.sin(2 * np.pi * scene.time / rng.uniform(150, 400))
    air = rng.uniform(0.4, 1.2) * rng.choice([-1, 1]) * np.linspace(-0.5, 0.5, rows) + cycle
    return replace(scene, pose=track(scene.time) if track else pose, air=air - air.mean())


def draw_use(real: BenchRig, rng: Rng, rows: int = 800) -> MotionScene:
    """Draw a motion in random poses after the calibration, at its mean temperature."""
    return MotionScene(real, draw_poses(real.rig, rows, rng), np.zeros(rows), in_use=True)


def measure(scene: MotionScene, faults: Sequence[Fault], seed: int) -> Columns:
    """Compute the table of a motion, during which the laser's power drifts by 1 %.

    Its column `row` has the rows' numbers in the measured order; a motion in time also has the
    column `time_s`.
    """
    rig, rng = scene.real.rig, np.random.default_rng([seed, 90, scene.in_use])

    def disturb(stage: str, values: Any) -> Any:
        """The values of a stage of the measurement with the faults that act on it."""
        for n, fault in enumerate(faults):
            if stage in fault.parts:
                values = fault.parts[stage](values, scene, np.random.default_rng([seed, n]))
        return values

    bench = disturb("bench", scene.real.bench)
    pose = disturb("mirror", scene.pose)
    states = states_at(rig.values, pose, disturb("beam", np.zeros((scene.rows, 2))))
    scene = replace(scene, real=BenchRig(rig, bench), states=states)
    exact = spots(rig.sensor, bench, states)
    exact[:, 2::3] *= disturb("power", 1 + 0.01 * np.sin(np.linspace(0, 5, scene.rows)))[:, None]
    noisy = add_noise(rig.sensor, exact, rng) if scene.has_noise else exact
    raw = disturb("readings", invert_correction(rig.sensor, noisy))
    error = scene.has_noise * REFERENCE * rng.standard_normal(pose.shape)
    said = disturb("reference", scene.pose + error)
    columns = dict(zip(READING_COLUMNS, raw.T, strict=True))
    columns |= dict(zip(REFERENCE_COLUMNS, (said / UNITS).T, strict=True))
    columns["row"] = np.arange(scene.rows, dtype=np.float64)
    if scene.track is not None:
        columns["time_s"] = scene.time
    table: Columns = disturb("table", columns)
    return table


def readings_of(table: Columns) -> Floats:
    """The readings (n, 9) of a table, mm and mW."""
    return np.stack([table[name] for name in READING_COLUMNS], axis=1)


def poses_of(table: Columns) -> Floats:
    """The reference's poses (n, 6) of a table, mm and rad."""
    return np.asarray(np.stack([table[name] for name in REFERENCE_COLUMNS], axis=1) * UNITS)


def samples_of(table: Columns, settings: Calibrate) -> Data:
    """The samples that `facets calibrate` makes of a table."""
    return gather_samples(Path("simulated.csv"), table, settings)
