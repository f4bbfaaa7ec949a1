"""Coverage of the truth by the expanded uncertainties of `facets axis`, over random axes.

    python -m facets.experiments.studies.axis_tests [--first 0] [--draws 200]

Each axis (along x or z, or about z) has errors of random sizes, from far below the sensor's
uncertainty to far above. It is tested at five positions, in five runs in each direction, at a point
up to 40 mm from the apex. The errors of the sensor's parameters are drawn from its calibration's
covariance, and its readings are noisy. The poses are solved, and the dwells found and evaluated, as
the command does. The truth is the result of the same formulas for the true poses of the dwells. The
study prints, for each quantity, the fraction of axes in which it lies within its expanded
uncertainty (expected: 95 %), for the main component and for all six. It prints the same for the
error motions by position. It takes two minutes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

import facets
from facets.axis_tests.error_motions import AxisTest, Commands, fit_errors
from facets.axis_tests.positioning import QUANTITIES
from facets.axis_tests.report import AxisReport, evaluate_axis
from facets.axis_tests.visits import PoseSeries
from facets.calibration.fitting.unknowns import ALL, assign_values, values_of
from facets.core.knowledge import Knowledge
from facets.core.motions import Runs
from facets.core.names import STATE
from facets.core.sensor import Calibration, Sensor
from facets.core.units import Floats
from facets.simulation.axis_runs import command_columns, run_states

from .options import parse_options

#: Standard uncertainties of a calibration: mm and rad.
SIGMAS = {
    "psd_a.radius": 0.02, "psd_b.radius": 0.02, "psd_c.radius": 0.02, "psd_a.height": 3e-4,
    "psd_b.height": 3e-4, "psd_c.height": 3e-4, "psd_a.roll": 2e-4, "psd_b.roll": 2e-4,
    "facet_b.inclination": 1e-6, "facet_c.azimuth": 2e-6, "beam.tilt_x": 5e-6, "beam.tilt_y": 5e-6,
}  # fmt: skip
KNOWLEDGE = Knowledge(beam="known", power="unknown")
#: Half the travel of the axes under test, mm and rad, and the component that moves.
AXES = {"X": (0.1, 0), "Z": (1.0, 2), "C": (0.008, 5)}


def calibrated_sensor() -> Sensor:
    """The paper's sensor with a calibration of stated uncertainties."""
    covariance = np.diag(np.square(list(SIGMAS.values())))
    calibration = Calibration(tuple(SIGMAS), tuple(map(tuple, covariance.tolist())))
    return replace(facets.load("paper").sensor, calibration=calibration)


def draw_rig(sensor: Sensor, rng: np.random.Generator) -> Sensor:
    """A sensor whose parameters have random errors, drawn from their uncertainties."""
    values = values_of(sensor).copy()
    for name, sigma in SIGMAS.items():
        values[ALL.index(name)] += sigma * rng.standard_normal()
    return assign_values(sensor, values)


def draw_axis(name: str, rng: np.random.Generator) -> Runs:
    """An axis whose errors are 10 nm (0.1 urad) to 10 um (100 urad)."""
    half, main = AXES[name]
    unit = np.array([1e-3] * 3 + [1e-5] * 3 + [0, 0])

    def errors() -> Any:
        """Random errors of an axis (8,), of sizes over three decades."""
        sizes = unit * 10 ** rng.uniform(-2, 1, 8) * rng.choice([-1, 1], 8)
        return tuple(sizes.tolist())

    ends = half * np.eye(len(STATE))[main]
    scatter = tuple(np.abs(errors()).tolist())
    return Runs(
        tuple((-ends).tolist()), tuple(ends.tolist()), steps=5, runs=5, dwell=0.06, move=0.02,
        scale=float(rng.uniform(-1e-3, 1e-3)), wave=errors(), periods=float(rng.uniform(0.3, 2)),
        bow=errors(), backlash=errors(), scatter=scatter, rate=1000.0,
    )  # fmt: skip


def evaluate(seed: int) -> tuple[str, AxisReport, Floats]:
    """The axis, its report, and the true values of the error motions (6, m, 2, n)."""
    rng = np.random.default_rng([seed, 33])
    sensor = calibrated_sensor()
    name = list(AXES)[seed % len(AXES)]
    motion, rig = draw_axis(name, rng), draw_rig(sensor, rng)
    body = facets.MeasuredObject(tuple(rng.uniform(-40, 40, 3).tolist()))
    time, states = run_states(motion, np.random.default_rng(seed))
    noisy = facets.add_noise(rig, facets.readings(rig, states), rng)
    solution = facets.solve(sensor, noisy, beam=KNOWLEDGE.beam, power=KNOWLEDGE.power)
    poses = np.where(solution.converged[:, None], solution.state, np.nan)
    columns = command_columns(motion)
    positions = columns["position_mrad"] / 1e3 if name == "C" else columns["position_mm"]
    commands = Commands(positions, (columns["direction"] < 0).astype(np.int64))
    series = PoseSeries(time, poses, solution.misfit)
    test = AxisTest(name, commands, body, shortest_s=0.04)
    report = evaluate_axis(sensor, KNOWLEDGE, series, test)
    middle = np.searchsorted(time, report.visits.time)
    visits = replace(report.visits, states=states[middle])
    return name, report, visits.grid(fit_errors(visits, test).values.T)


class Coverage(NamedTuple):
    """Coverage of the truth for one axis, the main component first.

    quantities: (6, q) whether each quantity lies within its expanded uncertainty of the truth.
    relative: (q,) expanded uncertainty over the true value, of the main component.  positions: (6,)
    fraction of positions at which the error motion lies within its expanded uncertainty.
    """

    quantities: Floats
    relative: Floats
    positions: Floats


def compare_with_truth(seed: int) -> Coverage:
    """Evaluate one random axis, and compare its quantities with the truth."""
    _, report, true = evaluate(seed)
    held, size = np.empty((2, 6, len(QUANTITIES)))
    for n, (estimates, values) in enumerate(zip(report.quantities, true, strict=True)):
        for k, (quantity, (_, _, formula)) in enumerate(zip(estimates, QUANTITIES, strict=True)):
            truth = float(formula(values))
            held[n, k] = abs(quantity.value - truth) <= quantity.expanded
            size[n, k] = abs(quantity.expanded / truth)
    order = [report.motions.main, *np.delete(np.arange(6), report.motions.main)]
    off = np.abs(report.means - report.mean_of_directions(true))
    positions = (off <= 2 * report.uncertainties).mean(axis=1)
    return Coverage(held[order], size[order[0]], positions[order])


def main() -> None:
    options = parse_options(__doc__, first=0, draws=200)
    held = [
        compare_with_truth(seed) for seed in range(options.first, options.first + options.draws)
    ]
    inside, relative, positions = (np.array(part) for part in zip(*held, strict=True))
    print(f"{options.draws} axes; fraction within the expanded uncertainty, %")
    print("quantity  main  all six   U over the value, quartiles (main)")
    for k, (_, symbol, _) in enumerate(QUANTITIES):
        of_main, of_all = 100 * inside[:, 0, k].mean(), 100 * inside[:, :, k].mean()
        low, middle, high = np.quantile(relative[:, k], [0.25, 0.5, 0.75])
        print(f"{symbol:8}{of_main:6.1f}{of_all:8.1f}     {low:.3f} {middle:.3f} {high:.3f}")
    print(f"by position{100 * positions[:, 0].mean():5.1f}{100 * positions.mean():8.1f}")


if __name__ == "__main__":
    main()
