"""Numbers of wrong poses by cause, of a million random, noisy, cut, masked and corrupted readings.

    python -m facets.experiments.studies.solver_stress [--draws 1000000] [--bench-light]

The first half tests the convergence of the solver, with exact and noisy readings and with near and
far starts, for the paper's sensor and ten without symmetry. A pose is wrong there if it is `ok` and
its error exceeds a limit. For exact readings the limit is a thousandth of the standard uncertainty
(or 1e-9 mm, 1e-9 rad). In the tail, where condition numbers exceed 1e12 and rounding matters, it is
a hundredth. For noisy readings it is 7 standard uncertainties. Poses at which a spot is near an
edge (`is_near_edge`) are counted separately.

The second half tests whether a faulty reading gives a pose without a warning. The faults are noise
(`add_noise`), spots past edges, a masked number, a corrupted number, and spots cut by the edges of
their detectors, each with every kind of knowledge of beam and power. The sensors are those of all
shipped configurations, and others without symmetry. A pose is wrong there if it lies more than 10
standard uncertainties from the truth. It is counted under the first of these that reveals it:

- status: there is no pose; it is counted and not judged.
- misfit: the residual exceeds chance, so that the pose is not `ok`.
- unseen: one number was corrupted, and `facets.unseen_errors` allows an undetected error of this
  size.
- edge: a spot is closer to an edge than its own size, and the model has no edges.
- nothing: the pose is `ok` and wrong. There must be none.

`facets solve` prints a warning about `unseen` and `edge` below its table. With --bench-light all
sensors have all effects of a bench's light, which cannot be combined with edges that cut spots.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

import facets
from facets.config.shipped_files import shipped
from facets.core.units import Floats
from facets.model.arrays import is_near_edge

from .faults import add_light
from .options import parse_options
from .sensors import SENSORS

Rng = np.random.Generator
FLOOR = 1e-9


class StressCase(NamedTuple):
    """Readings of states within an offset of apex and beam, mm, and tilts, rad.

    fraction: of the readings of this study.  start: errors of the starting pose (mm, mm in z,
    rad), None for zero.  noise: whether readings have it.  allowed: error over standard
    uncertainty.  faintest: the power's noise, mW.
    """

    name: str
    fraction: float
    offset: float
    angle: float
    start: tuple[float, float, float] | None = None
    noise: bool = False
    allowed: float = 1e-3
    faintest: float | None = None


CASES = [
    StressCase("in the range, from zero", 0.2, 0.15, 0.012),
    StressCase("at its rim and beyond", 0.1, 0.35, 0.03),
    StressCase("far in the tail of the beam", 0.01, 1.5, 0.02, faintest=1e-8, allowed=1e-2),
    StressCase("starts far off", 0.09, 0.15, 0.012, start=(0.2, 5.0, 0.2)),
    StressCase("noisy", 0.1, 0.15, 0.012, noise=True, allowed=7),
]


def draw_around(offset: float, angle: float, count: int, rng: Rng) -> Floats:
    """States (count, 8) with the apex within `offset` mm of the beam, and tilts up to an angle."""
    radius, turn = offset * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    state = np.zeros((count, 8))
    state[:, 2] = rng.uniform(-6, 6, count)
    state[:, 3:6] = rng.uniform(-angle, angle, (count, 3))
    state[:, 6:] = rng.uniform(-0.05, 0.05, (count, 2))
    state[:, :2] = state[:, 6:] + (radius * [np.cos(turn), np.sin(turn)]).T
    return state


def stress(case: StressCase, sensor: facets.Sensor, count: int, rng: Rng) -> Counter[str]:
    """Count the outcomes of `count` random readings."""
    if case.faintest is not None:
        sensor = replace(sensor, noise=replace(sensor.noise, power=case.faintest))
    truth = draw_around(case.offset, case.angle, count, rng)
    readings = facets.readings(sensor, truth)
    if case.noise:
        readings = facets.add_noise(sensor, readings, rng)
    start: Any = "zero"
    if case.start is not None:
        across, along, angle = case.start
        size = np.array([across, across, along, angle, angle, angle, across, across])
        start = truth + rng.uniform(-size, size, truth.shape)
    solution = facets.solve(sensor, readings, start=start, threads=0)
    allowed = np.maximum(case.allowed * solution.uncertainty, FLOOR)
    wrong = solution.ok & (np.abs(solution.state - truth) > allowed).any(axis=1)
    edge = is_near_edge(sensor, readings).any(axis=1)
    return count_each(ok=solution.ok, wrong=wrong & ~edge, edge=wrong & edge)


#: Allowance factor for noise and for `facets.unseen_errors` being a first-order estimate.
SECOND_ORDER = 1.5
#: A pose is wrong if its error exceeds this number of standard uncertainties.
WRONG = 10.0
#: Standard uncertainties of the beam's position, mm, and of its relative power; None if unknown.
KNOWLEDGE: dict[str, tuple[float | None, float | None]] = {
    "beam free": (None, 0.0),
    "beam free and power within 1 %": (None, 0.01),
    "beam free and power unknown": (None, None),
    "beam known": (0.0, 0.0),
    "beam known and power unknown": (0.0, None),
    "beam within 5 um": (0.005, 0.0),
    "beam within 5 um and power within 1 %": (0.005, 0.01),
}


class Trouble(NamedTuple):
    """Disturbance of readings.

    fraction: of the readings of this study.  corrupt: changes noisy readings (n, 9); returns them
    and the index of each reading's wrong value, or None.  cut: whether each state has a spot that
    a detector's edge cuts.  aware: whether the solver models that.
    """

    name: str
    fraction: float
    corrupt: Callable[[facets.Sensor, Floats, Rng], tuple[Floats, Any]]
    cut: bool = False
    aware: bool = True


def keep(_: facets.Sensor, readings: Floats, __: Rng) -> tuple[Floats, Any]:
    """Return the readings unchanged."""
    return readings, None


def mask(_: facets.Sensor, readings: Floats, rng: Rng) -> tuple[Floats, Any]:
    """Mask one number of each of the readings (n, 9)."""
    hidden = np.zeros(readings.shape, bool)
    hidden[np.arange(len(readings)), rng.integers(0, 9, len(readings))] = True
    return np.ma.masked_array(readings, hidden), None


def replace_one(sensor: facets.Sensor, readings: Floats, rng: Rng) -> tuple[Floats, Any]:
    """Replace one number of each of the readings (n, 9) by a random one from the detector's whole
    range; also returns which, (n,)."""
    corrupted, rows = readings.copy(), np.arange(len(readings))
    which = rng.integers(0, 9, len(readings))
    sizes = np.array([(psd.size_y / 2, psd.size_z / 2, sensor.beam.power) for psd in sensor.psds])
    low = np.where(which % 3 == 2, 0.0, -1.0)
    corrupted[rows, which] = sizes.ravel()[which] * rng.uniform(low, 1.0)
    return corrupted, which


TROUBLES = [
    Trouble("noise; spots past edges", 0.15, keep),
    Trouble("one number masked", 0.1, mask),
    Trouble("one number corrupted", 0.2, replace_one),
    Trouble("spots cut by edges", 0.05, keep, cut=True),
    Trouble("spots cut; the model has no edges", 0.05, keep, cut=True, aware=False),
]


def add_bench_light(sensor: facets.Sensor, polarised: bool) -> facets.Sensor:
    """Give a sensor the light of configs/bench-light.yaml, with background scaled by its power."""
    bench = facets.load("bench-light").sensor
    ratio = sensor.beam.power / bench.beam.power
    a, b, c = ((ratio * power, x, y) for power, x, y in bench.light.background)
    light = replace(
        bench.light,
        background=(a, b, c),
        polarization=bench.light.polarization if polarised else None,
    )
    return replace(sensor, light=light, apertures=facets.Apertures())


def every_sensor() -> dict[str, facets.Sensor]:
    """The sensors of all shipped configurations, and those without symmetry."""
    names = {name: facets.load(name).sensor for name in shipped()}
    return {**names, **{f"{name} of the studies": sensor for name, sensor in SENSORS.items()}}


def draw_states(
    sensor: facets.Sensor, trouble: Trouble, sigma: float, count: int, rng: Rng
) -> Floats:
    """Sample states (m, 8) inside, at and beyond the range's rim; `sigma` is that of the beam,
    mm."""
    offset = 0.4 * max(sensor.beam.diameter_x, sensor.beam.diameter_y)
    many = draw_around(offset, 0.03, 12 * count if trouble.cut else count, rng)
    many[:, 2] *= 1.2
    many[:, :2] -= many[:, 6:]
    if not trouble.cut:
        many[:, :6] *= np.sqrt(rng.random((len(many), 1)))
    many[:, 6:] = sigma * rng.standard_normal((len(many), 2))
    many[:, :2] += many[:, 6:]
    if trouble.cut:
        margin = facets.margins(sensor, many)[..., :4].min(axis=(1, 2))
        many = many[(margin < 0.2) & (margin > -1.2)][:count]
    return many


def readings_at_power(sensor: facets.Sensor, truth: Floats, ratio: Floats) -> Floats:
    """Readings (n, 9) with the laser's power multiplied by (n, 1), and other light unchanged."""
    without = replace(sensor.light, background=((0.0, 0.0, 0.0),) * 3)
    exact = facets.readings(replace(sensor, light=without), truth)
    exact[:, 2::3] *= ratio
    background = np.array(sensor.light.background)
    return add_light(exact, background[:, 0], background[:, 1:])


def priors_of(sensor: facets.Sensor, place: float | None, light: float | None) -> dict[str, Any]:
    """Knowledge for `solve`: standard uncertainties of the beam's place, mm, and of its power."""
    power = sensor.beam.power
    return {
        "beam": "free" if place is None else facets.Prior((0.0, 0.0), place),
        "power": "unknown" if light is None else facets.Prior(power, light * power),
    }


def count_outcomes(
    trouble: Trouble, sensor: facets.Sensor, knowledge: str, count: int, rng: Rng
) -> Counter[str]:
    """Count the outcomes of readings of one sensor, and wrong poses by what reveals them."""
    place, light = KNOWLEDGE[knowledge]
    real = sensor
    if trouble.cut:
        if sensor.light.on:
            return Counter()
        real = replace(sensor, apertures=replace(sensor.apertures, detectors=True))
    truth = draw_states(sensor, trouble, 0.05 if place is None else place, count, rng)
    if not len(truth):
        return Counter()
    exact = readings_at_power(
        real, truth, 1 + (light or 0.0) * rng.standard_normal((len(truth), 1))
    )
    with np.errstate(invalid="ignore"):
        readings, corrupted = trouble.corrupt(sensor, facets.add_noise(real, exact, rng), rng)
    priors = priors_of(sensor, place, light)
    solver = real if trouble.aware else sensor
    solution = facets.solve(solver, readings, threads=0, **priors)
    off = np.abs(solution.state - truth) / np.maximum(solution.uncertainty, FLOOR)
    wrong = solution.converged & (off.max(axis=1, initial=0.0) > WRONG)
    silent = wrong & ~solution.misfit
    unseen = np.zeros(len(truth), bool)
    if corrupted is not None and silent.any():
        bounds = np.maximum(*(facets.unseen_errors(solver, states[silent], **priors)
                              for states in (solution.state, truth)))  # fmt: skip
        bound = bounds[np.arange(len(bounds)), corrupted[silent]]
        unseen[silent] = off[silent].max(axis=1) <= SECOND_ORDER * (bound + WRONG)
    edges = silent & ~unseen & is_near_edge(solver, np.ma.filled(readings, np.nan)).any(axis=1)
    return count_each(
        poses=solution.converged, wrong=wrong, misfit=wrong & solution.misfit, unseen=unseen,
        edge=edges, nothing=silent & ~unseen & ~edges,
    )  # fmt: skip


def count_each(**outcomes: Any) -> Counter[str]:
    """Count the readings of each outcome, given as Booleans (n,), and all as draws."""
    counts = {name: int(rows.sum()) for name, rows in outcomes.items()}
    return Counter(draws=len(next(iter(outcomes.values()))), **counts)


def main() -> None:
    options = parse_options(__doc__, draws=1_000_000, seed=1, bench_light=False)
    rng = np.random.default_rng(options.seed)
    asymmetric, every = list(SENSORS.values()), list(every_sensor().values())
    if options.bench_light:
        asymmetric, every = (
            [add_bench_light(sensor, n % 2 == 0) for n, sensor in enumerate(sensors)]
            for sensors in (asymmetric, every)
        )
    for case in CASES:
        each = int(options.draws * case.fraction / len(asymmetric))
        total = Counter[str]()
        for sensor in asymmetric:
            total.update(stress(case, sensor, each, rng))
        print_counts(case.name, total)
    for trouble in TROUBLES:
        each = max(1, round(options.draws * trouble.fraction / len(KNOWLEDGE) / len(every)))
        for knowledge in KNOWLEDGE:
            total = Counter[str]()
            for sensor in every:
                total.update(count_outcomes(trouble, sensor, knowledge, each, rng))
            print_counts(f"{trouble.name:34} {knowledge}", total)


def print_counts(name: str, counts: Counter[str]) -> None:
    """Print the counts of the outcomes under a name."""
    print(f"{name:74}{', '.join(f'{count} {key}' for key, count in counts.items())}", flush=True)


if __name__ == "__main__":
    main()
