"""A shaken body moves as the equations of motion of its mass and springs say."""

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets.core import Mode, Vibration
from facets.simulation import pose_table, reading_table, shake, shaker_force, states

#: A body of 50 g and 20 kg mm^2 on springs, z (mm) and pitch (rad): forces in mN per mm, moments in
#: mN mm per rad. The force acts beside the centre of mass.
MASS = np.diag([0.05, 20.0])
STIFFNESS = np.array([[8000.0, 15_000.0], [15_000.0, 6e6]])
DAMPING = 5e-5 * STIFFNESS
ARM = np.array([1.0, 12.0])


def body(**changes):
    """The body as a motion, by its modes."""
    from scipy import linalg

    squares, shapes = linalg.eigh(STIFFNESS, MASS)
    modes = {}
    for omega, shape in zip(np.sqrt(squares), shapes.T, strict=True):
        z, pitch = 1e3 * shape * (shape @ ARM) / omega**2  # by 1 N
        compliance = (0.0, 0.0, z, 0.0, pitch, 0.0)
        modes[str(omega)] = Mode(omega / (2 * np.pi), 2.5e-5 * omega, compliance)
    return replace(Vibration(modes, low=5.0, high=180.0, samples=4000), **changes)


def test_the_body_moves_as_its_equations_of_motion_say():
    """Integrated in time, over as many repetitions as the transient takes."""
    from scipy import signal

    motion, fine, repeats = body(), 16, 3
    force, moved = shake(motion, np.random.default_rng(2))
    inverse = np.linalg.inv(MASS)
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ STIFFNESS, -inverse @ DAMPING]])
    b = np.concatenate([np.zeros(2), inverse @ ARM])[:, None]
    system = signal.StateSpace(a, b, np.eye(2, 4), np.zeros((2, 1)))
    driven = np.tile(signal.resample(1e3 * force, fine * len(force)), repeats)
    time = np.arange(len(driven)) / (fine * motion.rate)
    last = signal.lsim(system, driven, time)[1][-fine * len(force) :: fine]
    assert (np.abs(moved[:, [2, 4]] - last).max(axis=0) < 2e-3 * np.abs(last).max(axis=0)).all()


@pytest.mark.parametrize("drive", ["random", "burst", "sweep"])
def test_a_force_stays_in_its_band(drive):
    motion = body(drive=drive, force=2.5, low=30.0, high=120.0)
    force, _ = shake(motion, np.random.default_rng(1))
    power = np.abs(np.fft.rfft(force)) ** 2
    frequency = np.fft.rfftfreq(len(force), 1 / motion.rate)
    inside = (frequency >= 30) & (frequency <= 120)
    assert np.sqrt(np.mean(force**2)) == pytest.approx(2.5)
    assert power[~inside].sum() < 1e-20 * power.sum()
    assert power[inside][10:-10].min() > 1e-8 * power.max()
    begin, end = np.mean(force.reshape(2, -1) ** 2, axis=1)
    assert (end < 0.01 * begin) == (drive == "burst")


def test_the_force_of_a_table_is_that_of_its_states():
    config, centre = facets.load("bench"), (0.0, 0.0, 0.5, *(0.0,) * 5)
    shaken = body(samples=64, centre=centre)
    config = replace(config, motions={"rest": config.motions["rest"], "shaken": shaken})
    _, segment = segments = facets.simulate(config, seed=1)
    for table in (pose_table(segments), reading_table(segments)):
        assert np.isnan(table["force_n"][:1000]).all()
        assert table["force_n"][1000:].tolist() == segment.force.tolist()
    force, moved = shake(shaken, np.random.default_rng(7))
    rng = np.random.default_rng(7)
    assert shaker_force(shaken, rng).tolist() == force.tolist()
    assert states(shaken, rng)[1][:, 2] == pytest.approx(0.5 + moved[:, 2])
