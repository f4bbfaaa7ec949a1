"""Everything that estimates poses from readings, by one signature.

What is added to the package, or replaces something, is a line of EXECUTIONS, and the tests that go
over these (`tests/estimation/test_estimators.py`) hold it to what all others give.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from facets.experiments.studies.sensors import skew_sensor
from hypothesis import strategies as st

import facets
from facets import Prior, Status, core, firmware, pictures
from facets.estimation import solve_each
from facets.model import VariedSensors, effects, parameters

COMPILER = shutil.which("gcc") or shutil.which("clang")
NODE = shutil.which("node")


class Question(NamedTuple):
    """readings: (n, 9), of one sensor.  The other arguments are those of `facets.solve`."""

    sensor: facets.Sensor
    readings: np.ndarray
    beam: Any = "free"
    power: Any = "known"
    accept_unchecked: bool = False
    start: Any = "zero"
    method: str = "least-squares"
    max_steps: int = 50

    @property
    def options(self) -> dict[str, Any]:
        return dict(zip(self._fields[2:], self[2:], strict=True))

    def rows(self, which: Any) -> Question:
        """The question of some of the readings, or of one."""
        known = core.Question(self.beam, self.power).rows(which)
        start = self.start if isinstance(self.start, str) else self.start[which]
        return self._replace(
            readings=self.readings[which], beam=known.beam, power=known.power, start=start
        )

    def is_alike(self) -> bool:
        """Whether what is known of the beam is the same for all readings."""
        return np.ndim(getattr(self.beam, "mean", 0)) < 2

    def is_of_each(self) -> bool:
        """Whether no reading starts from the one before."""
        return not (isinstance(self.start, str) and self.start == "previous")

    def is_plain(self) -> bool:
        """Whether it asks for least squares from zero."""
        return isinstance(self.start, str) and self[5:] == ("zero", "least-squares", 50)


class Answer(NamedTuple):
    """What `facets.Solution` has by these names; None for what an execution does not give."""

    state: np.ndarray
    status: np.ndarray
    used: np.ndarray
    power: np.ndarray
    residual: np.ndarray
    covariance: np.ndarray | None = None
    limit: np.ndarray | None = None


@dataclass(frozen=True)
class Execution:
    """solve: gives the poses.  can_answer: whether it can answer a question.

    How far its poses may be from those of `facets.solve`: sigmas: in standard uncertainties; 0 for
    equal bits.  spread: covariances, as a share of the uncertainties.  exists: whether this machine
    has what it needs.  screens: whether it has a status for each reading.  misfits: whether it also
    gives the poses of readings that do not fit.  effort: how much longer it takes than others: it
    answers more questions of fewer readings.
    """

    solve: Callable[[Question], Answer]
    sigmas: float = 0.0
    spread: float = 0.0
    can_answer: Callable[[Question], bool] = lambda question: True
    exists: bool = True
    screens: bool = True
    misfits: bool = True
    effort: int = 1


def answer_of(solution: Any) -> Answer:
    return Answer(*(getattr(solution, name) for name in Answer._fields))


def join(answers: list[Answer]) -> Answer:
    columns = zip(*answers, strict=True)
    return Answer(*(None if values[0] is None else np.stack(values) for values in columns))


def solve_batch(question: Question) -> Answer:
    """The poses of all readings by one call, with which all others are compared."""
    return answer_of(facets.solve(question.sensor, question.readings, **question.options))


def solve_prepared(question: Question) -> Answer:
    """One reading after the other, as a loop does."""
    solver = facets.Solver(question.sensor, **question.options)
    return join([answer_of(solver.solve(reading)) for reading in question.readings])


def solve_elsewhere(question: Question) -> Answer:
    """In batches of 1 to 17 readings, each beside others than it stands beside."""
    count = len(question.readings)
    order = np.random.default_rng(count).permutation(count)
    parts = np.split(order, np.cumsum(np.arange(1, 18)))
    answers = [solve_batch(question.rows(part)) for part in parts if len(part)]
    back = np.argsort(order)
    return Answer(*(np.concatenate(values)[back] for values in zip(*answers, strict=True)))


def solve_varied(question: Question) -> Answer:
    """With a sensor for each reading, beside the same reading of another sensor."""
    twice = question.rows(np.repeat(np.arange(len(question.readings)), 2))
    count, rng, sensor, light = len(twice.readings), np.random.default_rng(1), twice.sensor, None
    wrong = (np.arange(count) % 2)[:, None]
    values = parameters(sensor) + 1e-4 * wrong * rng.standard_normal((count, 30))
    if sensor.light.on:
        light = effects(sensor) * (1 + 1e-3 * wrong * rng.standard_normal((count, 81)))
    found = solve_each(
        VariedSensors(sensor, values, light), twice.readings,
        core.Question(twice.beam, twice.power, accept_unchecked=twice.accept_unchecked),
    )  # fmt: skip
    states, power = found.states[:, :8], found.states[:, 8]
    numbers = (states, found.status, found.used, power, found.residuals)
    return Answer(*(values[::2] for values in numbers))


def is_exported(question: Question, single: bool = False) -> bool:
    """Whether the C code can be had for a sensor.  Real light is compared in tests/firmware."""
    sensor, is_known = question.sensor, question.is_alike() and question.is_of_each()
    is_usual = is_known and question[6:] == ("least-squares", 50) and not sensor.light.on
    return is_usual and not (single and sensor.apertures.cut) and exported(sensor) is not None


@cache
def exported(sensor: facets.Sensor) -> dict[Path, str] | None:
    try:
        return firmware.export.export(sensor, firmware.source.Provenance("test", "0", "test"))
    except facets.InputError:
        return None


@cache
def library(sensor: facets.Sensor, precision: str) -> firmware.FirmwareLibrary:
    """The exported C, compiled."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path, text in exported(sensor).items():
            if path.suffix in (".c", ".h") and len(path.parts) == 1:
                (folder / path).write_text(text)
        subprocess.run(
            [COMPILER, "-O0", "-std=c99", precision, "facets.c", "-shared", "-fPIC", "-lm",
             "-o", "solver.so"], cwd=folder, check=True,
        )  # fmt: skip
        return firmware.FirmwareLibrary(folder / "solver.so")


def priors(question: Question) -> tuple[np.ndarray, np.ndarray]:
    """Means and standard uncertainties (3,) of bx, by and the power."""
    widths = {"known": 0.0, "free": np.inf, "unknown": np.inf}
    beam, power = question.beam, question.power
    if isinstance(beam, str):
        beam = Prior((0.0, 0.0), widths[beam])
    if isinstance(power, str):
        power = Prior(question.sensor.beam.power, widths[power])
    sigmas = [*np.broadcast_to(beam.sigma, 2), power.sigma]
    return np.array([*np.ravel(beam.mean), power.mean]), np.array(sigmas)


def solve_c(question: Question, precision: str) -> Answer:
    (means, sigmas), start = priors(question), None
    if not isinstance(question.start, str):
        start = np.column_stack([question.start, np.full(len(question.start), means[2])])
    found = library(question.sensor, precision).solve(
        question.readings, start, mean=means, sigma=sigmas,
        accept_unchecked=question.accept_unchecked,
    )  # fmt: skip
    return Answer(
        found.state, found.status, found.used, found.power, found.residual, found.covariance
    )


PAGE = """
const text = (found) => [found.state, [found.power, found.residual, found.limit],
  found.covariance.flat()].map((numbers) => numbers.map(String));
const {rows, options} = JSON.parse(require("fs").readFileSync(0));
console.log(JSON.stringify(rows.map((row) => {
  const found = Model.solve(row.map(Number), options);
  return [found.status, found.used, ...text(found)];
})));"""


def is_on_pages(question: Question) -> bool:
    """Whether the page of a rig answers a question: it has no priors and refuses some sensors."""
    knows = isinstance(question.beam, str) and isinstance(question.power, str)
    is_asked = knows and question.is_plain() and not question.accept_unchecked
    return is_asked and not refusal(question.sensor, question.beam)


@cache
def refusal(sensor: facets.Sensor, beam: str) -> str:
    asked = f"\nconsole.log(Model.refusal({json.dumps({'beam': beam})}));"
    return run_node(script(sensor) + asked, "").strip()


@cache
def script(sensor: facets.Sensor) -> str:
    return pictures.page.model.model(sensor)


def run_node(text: str, data: str) -> str:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.js"
        path.write_text(text, "utf-8")
        done = subprocess.run(
            [NODE, str(path)], input=data, capture_output=True, text=True, check=True
        )
    return done.stdout


def solve_page(question: Question) -> Answer:
    """By the JavaScript of the pages, run by Node.js."""
    rows = [[str(value) for value in row] for row in question.readings.tolist()]
    options = {"beam": question.beam, "power": question.power}
    data = json.dumps({"rows": rows, "options": options}).replace("inf", "Infinity")
    found = json.loads(run_node(script(question.sensor) + PAGE, data))
    numbers = {status.label: status.value for status in Status}
    status, used, state, rest, covariance = zip(*found, strict=True)
    power, residual, limit = np.array(rest, float).T
    return Answer(
        np.array(state, float), np.array([numbers[word] for word in status]), np.array(used),
        power, residual, np.array(covariance, float).reshape(-1, 8, 8), limit,
    )  # fmt: skip


def solve_scipy(question: Question) -> Answer:
    """The least sum of squares that SciPy finds from zero, by differences of the readings.

    It shares the readings, the sizes of the noise and the choice of detectors with the package,
    and neither derivatives nor steps.
    """
    used = solve_batch(question).used
    return join([scipy_row(question.rows(n), lit) for n, lit in enumerate(used)])


def scipy_row(question: Question, used: np.ndarray) -> Answer:
    """The pose of one reading, by some of the detectors."""
    from scipy.optimize import least_squares

    sensor, reading, lit = question.sensor, question.readings, np.repeat(used, 3)
    sigma = facets.standard_deviations(sensor, reading)
    means, sigmas = priors(question)
    is_free = np.append(np.ones(6, bool), sigmas > 0)
    has_prior = np.isfinite(sigmas) & (sigmas > 0)
    start = np.array([*means[:2], 0, 0, 0, 0, *means])
    scale = np.array([0.01, 0.01, 0.1, 1e-3, 1e-3, 1e-3, 0.01, 0.01, 0.01 * means[2]])

    def residuals(steps: np.ndarray) -> np.ndarray:
        state = start.copy()
        state[is_free] += steps * scale[is_free]
        bright = replace(sensor, beam=replace(sensor.beam, power=float(state[8])))
        values = facets.readings(bright, state[:8])
        off = (state[6:] - means)[has_prior] / sigmas[has_prior]
        return np.concatenate([((values - reading) / sigma)[lit], off])

    empty = np.full((8, 8), np.nan)
    missing = Answer(empty[0], np.int8(Status.STALLED), used, np.nan, np.nan, empty)
    if lit.sum() + has_prior.sum() < is_free.sum():
        return missing
    try:
        found = least_squares(
            residuals, np.zeros(is_free.sum()), "3-point", xtol=1e-14, ftol=1e-14, gtol=1e-14
        )
    except ValueError:  # a step into the dark
        return missing
    state, spread = start.copy(), np.zeros((9, len(found.fun)))
    state[is_free] += found.x * scale[is_free]
    spread[is_free] = np.linalg.pinv(found.jac) * scale[is_free, None]
    return Answer(state[:8], np.int8(Status.CONVERGED), used, state[8],
                  np.sqrt(2 * found.cost), (spread @ spread.T)[:8, :8])  # fmt: skip


EXECUTIONS = {
    "prepared solver": Execution(
        solve_prepared,
        can_answer=lambda question: question.is_alike() and isinstance(question.start, str),
    ),
    "other batches": Execution(solve_elsewhere, can_answer=Question.is_of_each),
    "a sensor for each": Execution(solve_varied, sigmas=1e-6, can_answer=Question.is_plain),
    "C, double": Execution(
        partial(solve_c, precision="-DFACETS_DOUBLE"),
        sigmas=1e-6,
        spread=1e-6,
        can_answer=is_exported,
        exists=bool(COMPILER),
    ),
    "C, single": Execution(
        partial(solve_c, precision="-DFACETS_FLOAT"),
        sigmas=0.1,
        spread=0.05,
        can_answer=partial(is_exported, single=True),
        exists=bool(COMPILER),
        misfits=False,
    ),
    "page": Execution(
        solve_page,
        sigmas=1e-6,
        spread=1e-6,
        can_answer=is_on_pages,
        exists=bool(NODE),
        effort=2,
    ),
    "SciPy": Execution(
        solve_scipy,
        sigmas=2e-3,
        spread=1e-4,
        can_answer=lambda question: question.is_plain() and not question.sensor.light.on,
        screens=False,
        misfits=False,
        effort=4,
    ),
}


PAPER = facets.Sensor()
SENSORS = {
    "paper": PAPER,
    "bench": facets.load("bench").sensor,
    "pincushion": replace(PAPER, electronics=facets.Electronics(kind="pincushion")),
}
#: Those whose code takes seconds to compile, or which have second solutions.
SLOW_SENSORS = SENSORS | {
    "tetra-lateral": replace(PAPER, electronics=facets.Electronics(kind="tetra-lateral")),
    "light": facets.load("bench-light").sensor,
    "cut": replace(
        skew_sensor(0),
        apertures=facets.Apertures(beam=1.0, detectors=True, rim=5.0, tip=0.01, gap=0.005),
    ),
    "singular": facets.load("singular").sensor,
}
COUNT = 40
BEAMS = ("free", "known", Prior((0.01, -0.02), 0.005), Prior((0.01, -0.02), 0.0), "of each")
POWERS = ("known", "unknown", Prior(0.3, 0.003))
#: Half widths of a box of states, mm and rad.
BOX = np.array([0.15, 0.15, 3, 8e-3, 8e-3, 12e-3, 0.05, 0.05])


def states_in_light(sensor: facets.Sensor, rng: np.random.Generator) -> np.ndarray:
    states = rng.uniform(-1, 1, (30 * COUNT, 8)) * BOX
    return states[facets.reaches(sensor, states).all(axis=1)][:COUNT]


def spoil(readings: np.ndarray, rng: np.random.Generator) -> None:
    """Put into some readings what no pose gives, and leave out detectors of others."""
    rows, detector = rng.permutation(len(readings)), 3 * rng.integers(0, 3, len(readings))
    readings[rows[:3], detector[:3] + 1] = np.nan
    readings[rows[3:6], detector[3:6] + 2] = 0
    readings[rows[6:8], detector[6:8]] = 50
    readings[rows[8], detector[8] + 1] = -np.inf
    readings[rows[9]] += 0.3
    readings[rows[10:13], detector[10:13] + 2] *= 1.02


@st.composite
def questions(draw: Any, sensors: dict[str, facets.Sensor]) -> Question:
    """Noisy and spoilt readings of a sensor, and what is known of its beam."""
    sensor = draw(st.sampled_from([*sensors.values(), None]))
    if sensor is None:
        sensor = skew_sensor(draw(st.integers(0, 50)))
    rng = np.random.default_rng(draw(st.integers(0, 2**16)))
    states = states_in_light(sensor, rng)
    special = ["paper", "previous", "started", "few steps"]
    way = draw(st.sampled_from([*special, *product(BEAMS, POWERS, (False, True))]))
    rig = sensor
    if "unknown" in way:
        rig = replace(sensor, beam=replace(sensor.beam, power=0.8 * sensor.beam.power))
    readings = facets.add_noise(rig, facets.readings(rig, states), rng)
    spoil(readings, rng)
    question = Question(sensor, readings)
    if way == "paper":
        return question._replace(method="paper")
    if way == "previous":
        return question._replace(start=way, beam="known")
    if way == "few steps":
        return question._replace(beam="known", max_steps=draw(st.integers(2, 12)))
    if way == "started":
        off = rng.uniform(-1, 1, states.shape) * [0.2, 0.2, 3, 0.1, 0.1, 0.1, 0.2, 0.2]
        return question._replace(start=states + off)
    beam, power, accept = way
    beam = Prior(states[:, 6:], 0.003) if beam == "of each" else beam
    if isinstance(power, Prior):
        power = Prior(sensor.beam.power, power.sigma)
    return question._replace(beam=beam, power=power, accept_unchecked=accept)
