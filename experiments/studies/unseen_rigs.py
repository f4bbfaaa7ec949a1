"""Faults of random sizes, from harmless to gross, one or two in a rig. They test a calibration with
faults for which it was not written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from facets.core.units import Floats

from .faults import (
    ANGLES,
    HALF_MM,
    PLACES,
    POWER_MW,
    add,
    add_column,
    add_currents,
    add_each,
    add_fringes,
    add_mode,
    add_noise,
    add_thermometer,
    axis,
    backlash,
    bend_currents,
    bend_places,
    between,
    change_bench,
    change_profile,
    delay,
    delay_detector,
    detector_vector,
    dim,
    dust,
    edit,
    error_matrix,
    ghost_factor,
    glitches,
    hops,
    hum,
    lag,
    late_warmth,
    place_vector,
    pose_error,
    previous,
    ramp,
    random_rows,
    remember,
    reorder_angles,
    round_to,
    scatter_light,
    shine,
    smooth,
    step,
    take_rows,
    tarnish,
    turn_polarisation,
    wander,
    warm_gain,
    warmth,
    white,
)
from .rigs import REFERENCE, Rng
from .simulated_bench import BOX_REACH, Fault, MotionScene, Parts

#: Number of rigs with one fault; all other rigs have two.
SINGLE = 22
#: Units of a direction of poses whose size is in mm: rad for angles.
TILTS = np.array([1, 1, 1, 1e-2, 1e-2, 1e-2])


class FaultDraw:
    """Random numbers of a fault.  sizes: the sizes that were drawn."""

    def __init__(self, rng: Rng) -> None:
        self.rng, self.sizes = rng, list[float]()

    def size(self, low: float, high: float) -> float:
        """A size on a logarithmic scale; larger sizes are more likely."""
        self.sizes.append(float(low * (high / low) ** np.sqrt(self.rng.uniform())))
        return self.sizes[-1]

    def between(self, low: float, high: float) -> float:
        """A random number, uniform between the limits."""
        return float(self.rng.uniform(low, high))

    def pick(self, values: Sequence[Any]) -> Any:
        """One of the values, each equally likely."""
        return values[int(self.rng.integers(len(values)))]

    def detector(self) -> int:
        """The index of a random detector, 0 to 2."""
        return int(self.rng.integers(3))

    def uniform_array(self, *shape: int) -> Floats:
        """Random numbers between -1 and 1, uniform, in an array of this shape."""
        return self.rng.uniform(-1, 1, shape)

    def unit(self, count: int) -> Floats:
        """A random direction: a vector (count,) of length 1."""
        direction = self.rng.standard_normal(count)
        return np.asarray(direction / np.linalg.norm(direction))

    def later(self) -> Any:
        """The waveform of a step at a random time in the middle of the run."""
        return step(self.between(0.2, 0.8))

    def part(self) -> Any:
        """The waveform that is 1 in a random block of consecutive rows, 0 elsewhere."""
        first = self.between(0, 0.8)
        return between(first, first + self.size(0.02, 0.5))

    def electrode(self) -> Floats:
        """Array (3, 2, 2) with 1 at a random electrode of a detector, 0 at the others."""
        return np.asarray(np.eye(12)[self.rng.integers(12)].reshape(3, 2, 2))

    def detector_shift(self, low: float, high: float) -> Floats:
        """A direction (9,) of readings that displaces the spot on a detector, mm."""
        return detector_vector(self.detector(), self.size(low, high) * self.unit(2))

    def beam_shift(self, low: float, high: float) -> Floats:
        """A displacement (2,) of the beam in a random direction, mm."""
        return self.size(low, high) * self.unit(2)

    def pose_shift(self, low: float, high: float) -> Floats:
        """A direction (6,) of poses, of a size in mm, or in 10 mrad."""
        return np.asarray(self.size(low, high) * self.unit(6) * TILTS)

    def axis_shift(self, low: float, high: float) -> Floats:
        """A direction (6,) of poses along one random axis, of a size in mm, or in 10 mrad."""
        number = int(self.rng.integers(6))
        return axis(number, self.size(low, high) * TILTS[number])

    def place_shifts(self, low: float, high: float) -> Floats:
        """A direction (9,) of readings that displaces all spots."""
        return place_vector(self.size(low, high) * self.uniform_array(6))


class Kind(NamedTuple):
    """A kind of fault.  words: its description, to which the drawn sizes are appended.  in_time:
    whether it needs a motion in time."""

    group: str
    words: str
    parts: Callable[[FaultDraw], Parts]
    in_time: bool = False

    def draw(self, rng: Rng) -> Fault:
        """A fault of this kind with random sizes, which its words state."""
        draw = FaultDraw(rng)
        parts = self.parts(draw)
        sizes = ", ".join(f"{size:.3g}" for size in draw.sizes)
        return Fault(self.group, f"{self.words}: {sizes}", parts, self.in_time)


# ---- kinds that one expression does not describe


def cut_beam(draw: FaultDraw) -> Parts:
    """A round aperture cuts the beam."""
    edge, (a, b) = draw.between(2.4, 4.0), 0.3 * draw.uniform_array(2)
    return change_profile(lambda x, y: 1 / (1 + np.exp((np.hypot(x - a, y - b) - edge) / 0.06)))


def yielding_facet(draw: FaultDraw) -> Parts:
    """The facet turns with the mirror's angle; the detector is 250 mm away."""
    moved, number = 2 * 250 * draw.detector_shift(2e-5, 5e-3), draw.pick(ANGLES)
    return add("readings", moved, lambda scene, rng: scene.pose[:, number])


def window_fringes(draw: FaultDraw) -> Parts:
    """Fringes of a detector's window displace its spot."""
    moved = draw.size(5e-4, 0.03) * draw.unit(2)
    wave = 2 * np.pi / draw.between(0.4, 3) * draw.unit(2)
    return bend_places(draw.detector(), lambda place: np.outer(np.sin(place @ wave), moved))


def high_order(draw: FaultDraw) -> Parts:
    """A detector's places err by polynomials of fifth order."""
    far, (a, b) = draw.size(1e-3, 0.15), draw.uniform_array(2)

    def error(place: Floats) -> Floats:
        """The errors (n, 2) at places (n, 2), mm."""
        y, z = (place / HALF_MM).T
        return far * np.column_stack([y**5 + a * y * z**4, z**5 + b * z * y**4])

    return bend_places(draw.detector(), error)


def power_bends_place(draw: FaultDraw) -> Parts:
    """A detector's place varies with its power."""
    slope, k = draw.size(1e-5, 5e-3), draw.detector()
    return edit("readings", [3 * k, 3 * k + 1, 3 * k + 2], lambda reading: reading * (
        1 + slope * (reading[:, 2:] / POWER_MW - 1) * [1, 1, 0]))  # fmt: skip


def microphonics(draw: FaultDraw) -> Parts:
    """A place is noisy while the mirror moves fast."""
    limit = draw.between(0.5, 0.9)

    def shaken(scene: MotionScene, rng: Rng) -> Floats:
        """Noise in the rows with the largest steps, 0 in the others."""
        move = np.linalg.norm((scene.pose - previous(scene.pose)) / BOX_REACH, axis=1)
        return np.asarray(white(scene, rng) * (move > np.quantile(move, limit)))

    return add("readings", draw.size(1e-3, 0.1) * np.eye(9)[draw.pick(PLACES)], shaken)


def abbe(draw: FaultDraw) -> Parts:
    """Each axis is measured along its own line, off the pivot."""
    arms, matrix = draw.size(3e-3, 5) * draw.uniform_array(3, 3), np.zeros((6, 6))
    matrix[:3, 3:] = [np.cross(np.eye(3), arm)[:, i] for i, arm in enumerate(arms)]
    return error_matrix(matrix)


def cyclic_error(draw: FaultDraw) -> Parts:
    """An axis of the reference has a periodic error."""
    i, far, period = draw.detector(), draw.size(3e-6, 1e-3), draw.pick([633e-6 / 2, 0.02, 0.5])
    return pose_error(i, lambda pose: far * np.sin(2 * np.pi * pose[:, i] / period))


def bow(draw: FaultDraw) -> Parts:
    """An axis of the reference errs by the square of another one."""
    (i, j), far = draw.rng.permutation(3)[:2], draw.size(3e-5, 0.01)
    return pose_error(i, lambda pose: far * (pose[:, j] / BOX_REACH[j]) ** 2)


def slow_thermometer(draw: FaultDraw) -> Parts:
    """The posts follow the temperature, which the thermometer shows late."""
    late, moved = late_warmth(draw.size(1, 200)), draw.place_shifts(3e-4, 0.015)
    of_posts, shown = draw.pick([(warmth, late), (late, warmth)])
    return add("readings", moved, of_posts) | add_thermometer(shown)


def lamp(draw: FaultDraw) -> Parts:
    """A lamp shines on the detectors."""
    waveforms = [draw.later(), hops(draw.between(1, 30)), lambda scene, rng: scene.progress**2]
    power = draw.size(1e-6, 3e-3) * draw.rng.uniform(0.1, 1, 3)
    return shine(power, 3 * draw.uniform_array(3, 2), draw.pick(waveforms))


def swapped_columns(draw: FaultDraw) -> Parts:
    """Two neighbouring columns are exchanged in some rows."""
    stage, first = draw.pick([("readings", 0), ("readings", 3), ("reference", 0), ("reference", 3)])
    return edit(stage, [first, first + 1], lambda values: values[:, ::-1], draw.part())


def scaled_column(draw: FaultDraw) -> Parts:
    """Arc minutes for mrad, thousandths, or a wrong sign."""
    stage, column, factor = draw.pick([
        ("reference", draw.pick(ANGLES), 3.43775), ("readings", 2, 1e3), ("reference", 2, 1e3),
        ("reference", draw.rng.integers(6), -1), ("readings", draw.pick(PLACES), -1),
    ])  # fmt: skip
    return edit(stage, [column], lambda values: factor * values, draw.part())


def twice_in_table(draw: FaultDraw) -> Parts:
    """Some rows occur twice in the table."""
    part = draw.part()
    return take_rows(
        lambda scene, rng: np.concatenate([np.arange(scene.rows), *np.where(part(scene, rng))])
    )


def clock_set(draw: FaultDraw) -> Parts:
    """The clock of the table is set during the run."""
    jump, later = draw.pick([3.0, 60.0, 3600.0]), draw.later()
    return add_column("time_s", lambda scene, rng: scene.time + jump * later(scene, rng))


KINDS = (
    Kind("light", "an aperture cuts the beam", cut_beam),
    Kind("light", "fringes across the beam", lambda d: change_profile(add_fringes(
        d.size(1e-3, 0.03), 2 * np.pi / d.between(0.5, 2.5) * d.unit(2), d.between(0, 6)))),
    Kind("light", "light in the first ring mode", lambda d: change_profile(
        add_mode(d.size(1e-3, 0.05)))),
    Kind("light", "a window's ghost beside the beam", lambda d: change_profile(ghost_factor(
        d.size(3e-5, 0.01), *(d.between(0.5, 2.5) * d.unit(2))))),
    Kind("light", "the laser hops between two modes, mm", lambda d: add(
        "beam", d.beam_shift(2e-5, 3e-3), hops(d.size(5, 100)))),
    Kind("light", "the beam jumped, mm", lambda d: add(
        "beam", d.beam_shift(2e-5, 3e-3), d.later())),
    Kind("light", "the fibre turns the polarisation, rad", lambda d: turn_polarisation(
        d.size(0.01, 0.7))),
    Kind("facets", "dust, mm", lambda d: dust(
        d.detector(), d.size(0.01, 0.1), d.between(0.4, 1), d.between(0.05, 0.35),
        d.between(0.2, 0.8))),
    Kind("facets", "facets are domed, 1/mm", lambda d: change_bench(
        domes=1 / d.size(1e3, 3e5) * d.uniform_array(3))),
    Kind("facets", "a facet is tarnished, per mm", lambda d: tarnish(
        d.detector(), d.size(2e-3, 0.3))),
    Kind("facets", "a piece is broken off the tip, mm", lambda d: change_bench(
        chip=d.size(2e-3, 0.05))),
    Kind("facets", "a facet yields to the mirror's angle", yielding_facet),
    Kind("facets", "a facet scatters light onto another detector", lambda d: scatter_light(
        d.detector(), d.size(1e-5, 0.01), 3 * d.uniform_array(2))),
    Kind("detectors", "a detector's glue creeps as the logarithm of time, mm", lambda d: add(
        "readings", d.detector_shift(1e-4, 0.04) / np.log(51),
        lambda scene, rng: np.log(1 + 50 * scene.progress))),
    Kind("detectors", "a detector was knocked aside, mm", lambda d: add(
        "readings", d.detector_shift(5e-4, 0.1), d.later())),
    Kind("detectors", "fringes of a detector's window shift places, mm", window_fringes),
    Kind("detectors", "an error of fifth order at a detector's edge, mm", high_order),
    Kind("detectors", "the scale of a detector follows the power", power_bends_place),
    Kind("detectors", "a detector remembers its last reading", lambda d: remember(
        d.size(1e-5, 0.01), detector_vector(d.detector(), [1, 1, 1]))),
    Kind("electronics", "the amplifiers bend, each its own way, 1/mW", lambda d: bend_currents(
        lambda i, bend: i * (1 + bend * i), d.size(1e-3, 0.3) * d.uniform_array(3, 2, 2))),
    Kind("electronics", "a converter has a step in its middle, mW", lambda d: bend_currents(
        lambda i, jump: i + jump * (i > 0.032), d.size(1e-7, 3e-4) * d.electrode())),
    Kind("electronics", "the amplifiers saturate, mW", lambda d: bend_currents(
        np.minimum, d.size(0.06, 0.12))),
    Kind("electronics", "currents leak into the next detector's channels", lambda d: bend_currents(
        lambda i, leak: i + leak * np.roll(i, 1, axis=1), d.size(1e-6, 0.01))),
    Kind("electronics", "the gain of one electrode follows the temperature, 1/K", lambda d: (
        warm_gain(d.size(1e-5, 3e-3) * d.electrode()) | add_thermometer()), True),
    Kind("electronics", "an automatic zero sets new offsets every 80 rows, mW",
         lambda d: add_currents(d.size(1e-7, 2e-4), 80)),
    Kind("electronics", "a common supply adds noise to all places, of their own", lambda d: (
        add_noise(d.place_shifts(0.2, 4.0), in_common=True))),
    Kind("electronics", "a detector has more than the stated noise, of its own", lambda d: (
        add_noise(detector_vector(d.detector(), [d.size(0.4, 6)] * 3)))),
    Kind("electronics", "mains hum on all places, mm", lambda d: add(
        "readings", d.place_shifts(2e-4, 0.02), hum(d.between(0.03, 0.5)))),
    Kind("electronics", "a cable's microphonics after fast moves, mm", microphonics),
    Kind("reference", "the mirror stays behind by a share of each move", lambda d: lag(
        d.size(1e-5, 0.01))),
    Kind("reference", "Abbe offsets, mm", abbe),
    Kind("reference", "scale errors", lambda d: error_matrix(np.diag(
        d.size(1e-5, 0.01) * d.uniform_array(6) * d.rng.choice([0, 1], 6)))),
    Kind("reference", "an axis holds a share of another", lambda d: error_matrix(
        d.size(1e-5, 5e-3) * np.outer(*np.eye(6)[d.pick([0, 3]) + d.rng.permutation(3)[:2]]))),
    Kind("reference", "an axis bows over the travel of another, mm", bow),
    Kind("reference", "an axis has a cyclic error, mm", cyclic_error),
    Kind("reference", "a stage has backlash, mm or 1/100 rad", lambda d: backlash(
        d.axis_shift(2e-5, 0.01))),
    Kind("reference", "the reference glitches, mm or 1/100 rad, in a share of the rows", lambda d: (
        add("reference", d.axis_shift(1e-3, 0.2),
            glitches(d.size(4e-3, 0.08))))),
    Kind("reference", "more than the stated noise, of its own", lambda d: add_each(
        "reference", d.size(0.6, 20) * REFERENCE, white)),
    Kind("time", "the reference's clock runs off, by a share", lambda d: delay(
        d.size(1e-7, 1e-3) * d.pick([-1, 1]), lambda scene, rng: scene.time), True),
    Kind("time", "the reference's samples jitter, s", lambda d: delay(
        d.size(1e-5, 0.03), white), True),
    Kind("time", "a buffer delays the reference more from some row on, s", lambda d: delay(
        d.size(1e-4, 0.3), d.later()), True),
    Kind("time", "the reference is late throughout, s", lambda d: delay(
        -d.size(1e-4, 0.3), step(-1)), True),
    Kind("time", "a detector is read after the others, s", lambda d: delay_detector(
        d.detector(), d.size(1e-4, 0.2)), True),
    Kind("time", "the computer's clock was set forward", clock_set, True),
    Kind("environment", "a lamp, mW", lamp),
    Kind("environment", "posts follow the temperature, and one of both is late; s, mm/K",
         slow_thermometer, True),
    Kind("environment", "the beam follows the temperature, mm/K", lambda d: add(
        "beam", d.beam_shift(3e-5, 5e-3), warmth) | add_thermometer(), True),
    Kind("environment", "posts follow a temperature that is not in the table, mm/K", lambda d: add(
        "readings", d.place_shifts(3e-4, 0.015), warmth), True),
    Kind("environment", "the holder moves the mirror, mm/K", lambda d: add(
        "mirror", d.pose_shift(1e-5, 5e-3), warmth), True),
    Kind("environment", "the mirror vibrates, mm", lambda d: add(
        "mirror", d.pose_shift(1e-5, 5e-3), hum(d.between(0.03, 0.5)))),
    Kind("environment", "the laser vibrates, mm", lambda d: add(
        "beam", d.beam_shift(1e-5, 2e-3), hum(d.between(0.03, 0.5)))),
    Kind("environment", "warm air moves spots, mm, with a memory of rows", lambda d: add_each(
        "readings", d.place_shifts(2e-4, 0.02), wander(d.size(1, 60)))),
    Kind("environment", "the laser's mount sags, mm", lambda d: add(
        "beam", d.beam_shift(3e-5, 5e-3), ramp)),
    Kind("environment", "fog on the laser's window", lambda d: dim(
        d.size(0.05, 0.5), lambda scene, rng: scene.progress)),
    Kind("table", "two columns are exchanged in a part of the rows", swapped_columns),
    Kind("table", "a column has another unit or sign in a part of the rows", scaled_column),
    Kind("table", "the reference is written in steps", lambda d: edit(
        "reference", range(6), round_to(d.size(1e-4, 0.01) * np.array([1] * 3 + [1e-3] * 3)))),
    Kind("table", "places are written in steps, mm", lambda d: edit(
        "readings", PLACES, round_to(d.size(1e-3, 0.02)))),
    Kind("table", "a part of the rows stands twice", twice_in_table),
    Kind("table", "the rows were sorted by tx", lambda d: take_rows(
        lambda scene, rng: np.argsort(scene.pose[:, 0]))),
    Kind("table", "the reference slipped down by one row in a part of the rows", lambda d: edit(
        "reference", range(6), previous, d.part())),
    Kind("table", "a share of the readings are those of the row before", lambda d: edit(
        "readings", range(9), previous, random_rows(d.size(5e-3, 0.1)))),
    Kind("table", "two sessions are pasted; the reference's zero moved, mm", lambda d: add(
        "reference", d.pose_shift(3e-5, 0.1), d.later())),
    Kind("table", "numbers have lost their decimal point", lambda d: edit(
        d.pick(["reference", "readings"]), [d.rng.integers(6)], lambda values: 10 * values,
        random_rows(d.size(2e-3, 0.015)))),
    Kind("table", "the stage turns about its axes in the other order", lambda d: edit(
        "reference", ANGLES, reorder_angles)),
    Kind("table", "readings were smoothed over some rows", lambda d: edit(
        "readings", range(9), smooth(d.pick([3, 5]))), True),
)  # fmt: skip

#: Rigs without faults: in random poses, in a motion in time, and with a thermometer.
CLEAN: tuple[list[Kind], ...] = (
    [],
    [],
    [Kind("nothing", "a motion in time", lambda d: {}, True)],
    [Kind("nothing", "a motion beside a thermometer", lambda d: add_thermometer(), True)],
)


def pair_kinds(kinds: list[Kind]) -> Iterator[list[Kind]]:
    """Pairs of kinds of different groups; kinds without a partner remain single."""
    while kinds:
        first = kinds.pop(0)
        other = next((kind for kind in kinds if kind.group != first.group), None)
        if other is not None:
            kinds.remove(other)
        yield [first] if other is None else [first, other]


def draw_faults(draw: int) -> list[list[Fault]]:
    """The faults of each rig of a draw; each kind occurs once."""
    rng = np.random.default_rng([draw, 7])
    kinds = [KINDS[n] for n in rng.permutation(len(KINDS))]
    rigs = [*CLEAN, *([kind] for kind in kinds[:SINGLE]), *pair_kinds(kinds[SINGLE:])]
    return [[kind.draw(rng) for kind in rig] for rig in rigs]
