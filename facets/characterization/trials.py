"""Trials of a measurement: readings, parameters and priors drawn from their distributions.

The propagation of distributions of JCGM 101 (supplement 1 to the GUM): each trial solves drawn
readings with a drawn sensor and drawn priors, by the full model.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.arguments import as_floats
from ..core.errors import InputError
from ..core.knowledge import Knowledge, Prior
from ..core.names import POSE
from ..core.rules import Rules
from ..core.sensor import Calibration, Sensor
from ..core.settings import Solve
from ..core.units import Floats
from ..detectors.calibrated import LIGHT_CENTRE, MISFIT, MODEL_ERROR
from ..detectors.correction import NAMES, correction_slopes, invert_correction
from ..detectors.noise import fullness, sample_readings
from ..estimation.solution import Solution, Status, root_of_covariance
from ..estimation.solver import solve_each, solve_question
from ..model.arrays import EFFECTS, effects, parameters, readings
from ..model.beam_shape import OF_SHAPE, SHAPE, axes_of_shapes, shape_of
from ..model.many import VariedSensors
from ..optics.forward import PARAMETERS
from .resolution import Estimator, resolve

#: Trials that are drawn and solved together: their sensors stay in the processor's cache.
PART = 8000


class TrialResults(NamedTuple):
    """Solved trials.  poses: (m, 6) of the trials that have one.  failures: number of the others by
    status."""

    poses: Floats
    failures: Counter[str]


class ParameterDraws(NamedTuple):
    """Drawn errors of calibrated parameters.

    sensors: sensors with the drawn parameters.  readings: (n, 9) errors of corrected readings, due
    to the corrections and the model.  centre: (n, 2) centre of the light relative to the beam's
    place, mm.
    """

    sensors: VariedSensors
    readings: Floats
    centre: Floats


def draw_errors(calibration: Calibration, count: int, rng: np.random.Generator) -> Floats:
    """Draws of the errors (count, p) of calibrated parameters.

    They are normal, or multivariate t if the estimated covariance has finite degrees of freedom
    (JCGM 102, 5.3).
    """
    covariance = np.array(calibration.covariance)
    drawn: Floats = rng.standard_normal((count, len(covariance))) @ root_of_covariance(covariance).T
    freedom = calibration.degrees_of_freedom
    if freedom is not None and np.isfinite(freedom):
        drawn *= np.sqrt(freedom / rng.chisquare(freedom, (count, 1)))
    return drawn


def draw_parameters(
    sensor: Sensor, calibration: Calibration, raw: Floats, rng: np.random.Generator
) -> ParameterDraws:
    """Draw sensors with errors of their parameters, for raw readings (n, 9)."""
    errors, beam = draw_errors(calibration, len(raw), rng), sensor.beam

    def errors_of(names: Sequence[str]) -> Floats:
        """The errors (n, m) of parameters by their names, 0 for uncalibrated ones."""
        places = [
            calibration.names.index(name) if name in calibration.names else -1 for name in names
        ]
        return np.pad(errors, ((0, 0), (0, 1)))[:, places]

    values = parameters(sensor) + errors_of(PARAMETERS)
    if not set(calibration.names).isdisjoint(SHAPE):
        shape = shape_of(beam.diameter_x, beam.diameter_y, beam.rotation)
        places = [PARAMETERS.index(name) for name in OF_SHAPE]
        values[:, places] = axes_of_shapes(shape + errors_of(SHAPE), beam.rotation)
    light = None
    if not set(calibration.names).isdisjoint(EFFECTS):
        light = effects(sensor) + errors_of(EFFECTS)
    added = -errors_of(MISFIT) - errors_of(MODEL_ERROR)
    if not set(calibration.names).isdisjoint(NAMES):
        added += np.einsum("nij,nj->ni", correction_slopes(sensor, raw), errors_of(NAMES))
    sensors = VariedSensors(sensor, values, light)
    return ParameterDraws(sensors, added, errors_of(LIGHT_CENTRE))


def draw_knowledge(knowledge: Knowledge, means: Floats, rng: np.random.Generator) -> Knowledge:
    """Draw the means of priors.  means: (n, 3) the true place of the beam, mm, and its true power,
    mW, in each trial."""
    beam = as_floats(knowledge.beam_sigma, "sigma")
    power = as_floats(knowledge.power_sigma, "sigma")
    place, light = means[:, :2], means[:, 2]
    drawn = knowledge
    if np.isfinite(beam).all():
        prior = Prior(place + beam * rng.standard_normal(place.shape), beam)
        drawn = replace(drawn, beam=prior)
    if np.isfinite(power):
        prior = Prior(light + power * rng.standard_normal(light.shape), power)
        drawn = replace(drawn, power=prior)
    return drawn


def knowledge_at(options: Solve, sensor: Sensor, state: Floats) -> Knowledge:
    """The knowledge of the beam if the mirror and the beam are in a state (8,)."""
    knowledge = options.knowledge(sensor)
    if isinstance(knowledge.beam, Prior):
        knowledge = replace(knowledge, beam=Prior(tuple(state[6:]), knowledge.beam.sigma))
    return knowledge


def estimator_of(options: Solve, sensor: Sensor) -> Estimator:
    """The estimator of `options`."""
    return Estimator("solve", options.knowledge(sensor), eight=options.method == "paper")


def default_states(sensor: Sensor, rules: Rules, how: Estimator) -> dict[str, Floats]:
    """States (8,) by their names: rest, and the states other than rest at which an axis has its
    largest uncertainty in its own range."""
    worst = resolve(sensor, rules, [how])[0].worst_state
    worst_by_name = {
        f"where {POSE[n]} is worst": state for n, state in enumerate(worst) if state.any()
    }
    return {"at rest": np.zeros(8)} | worst_by_name


def saturated_detectors(sensor: Sensor, state: Floats) -> list[str]:
    """The letters of the detectors whose light drives a converter past its end at a state (8,)."""
    loads = fullness(sensor, readings(sensor, state))
    return [letter for letter, load in zip("ABC", loads, strict=True) if load > 1]


class MeasurementTrials:
    """Trials of a measurement at a state (8,), solved as `options` say."""

    def __init__(self, sensor: Sensor, options: Solve, state: Floats) -> None:
        if options.method == "paper" and sensor.calibration is not None:
            raise InputError(
                "trials that draw calibrated parameters are solved by least squares, and "
                "solve.method is paper; set solve.method to least-squares, or leave "
                "sensor.calibration out"
            )
        self.sensor, self.options, self.state = sensor, options, state
        self.knowledge = knowledge_at(options, sensor, state)
        self.exact = readings(sensor, state)

    def linear_solution(self) -> Solution:
        """The solution of the readings without noise, with its linear covariance.

        Raises `InputError` if it has no pose.
        """
        question = self.options.question(self.knowledge)
        solution = solve_question(self.sensor, self.exact[None], question)
        if not solution.converged.all():
            raise InputError(
                "the readings without noise have no pose "
                f"({Status(int(solution.status[0])).label}) at the state "
                f"{np.array2string(self.state, precision=6, separator=', ')}, mm and rad; choose "
                "another pose"
            )
        return solution

    def solve(
        self, count: int, seed: int | Sequence[int], advance: Callable[[int], None]
    ) -> TrialResults:
        """Draw and solve trials.  advance: called with the number of those just solved."""
        poses, status = np.empty((count, 6)), np.empty(count, np.int8)
        seeds = np.random.SeedSequence(seed).spawn(-(-count // PART))
        for n, seed_of_part in enumerate(seeds):
            part = slice(n * PART, min((n + 1) * PART, count))
            size = part.stop - part.start
            solved = self.solve_part(size, np.random.default_rng(seed_of_part))
            poses[part], status[part] = solved
            advance(size)
        good = status == Status.CONVERGED
        failures = Counter(Status(int(code)).label for code in status[~good])
        return TrialResults(poses[good], failures)

    def solve_part(self, count: int, rng: np.random.Generator) -> tuple[Floats, NDArray[np.int8]]:
        """Poses (n, 6) and statuses (n,) of trials."""
        sensor, options = self.sensor, self.options
        values = sample_readings(sensor, np.tile(self.exact, (count, 1)), rng, rounded=False)
        means = np.tile([*self.state[6:], sensor.beam.power], (count, 1))
        if sensor.calibration is None:
            # The paper's method takes no priors: the beam's place is free there, its power known.
            knowledge = self.knowledge
            if options.method != "paper":
                knowledge = draw_knowledge(knowledge, means, rng)
            question = options.question(knowledge)._replace(covariance=False)
            solution = solve_question(sensor, values, question)
            return solution.state[:, :6], solution.status
        raw = invert_correction(sensor, values)
        draws = draw_parameters(sensor, sensor.calibration, raw, rng)
        means[:, :2] += draws.centre
        means[:, 2] = draws.sensors.parameters[:, 0]
        question = options.question(draw_knowledge(self.knowledge, means, rng))
        results = solve_each(draws.sensors, values + draws.readings, question)
        return results.states[:, :6], results.status
