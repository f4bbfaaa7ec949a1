"""Counts wrong poses among a million: exact, noisy and spoilt readings, near and far starts.

    python -m facets.experiments.solver_stress [--draws 1000000] [--output FILE.csv]

Eleven sensors: the paper's, and ten without symmetry. A pose is wrong if it is reported as
converged and lies further from the truth than the reading's own information allows: a thousandth of
its standard uncertainty (or 1e-9 mm, 1e-9 rad) for exact readings, a hundredth in the tail, where
condition numbers pass 1e12 and rounding shows, 7 standard uncertainties for noisy readings. One
number spoilt of nine leaves one to tell by, the residual: what is reported there is how many
converge, and how many of those show it (residual above 5).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import facets
from facets.core.units import Floats
from facets.detectors.noise import add_noise
from facets.files.tables import write_table

from .sensors import SENSORS

FLOOR = 1e-9


@dataclass(frozen=True)
class Case:
    """One kind of trouble. offset: apex from the beam, mm; angle: rad; both at most.

    start: how far off it begins (mm, mm of z, rad), None for zero.  spoil: of the readings.
    allowed: error over standard uncertainty.
    """

    name: str
    share: float
    offset: float
    angle: float
    start: tuple[float, float, float] | None = None
    spoil: Callable[[facets.Sensor, Floats, np.random.Generator], Floats] | None = None
    allowed: float = 1e-3
    faintest: float | None = None


def noisy(sensor: facets.Sensor, exact: Floats, rng: np.random.Generator) -> Floats:
    return add_noise(sensor, exact, rng)


def outlier(sensor: facets.Sensor, exact: Floats, rng: np.random.Generator) -> Floats:
    """One number of each reading drawn anew over what the detector can say."""
    spoilt, rows = exact.copy(), np.arange(len(exact))
    which = rng.integers(0, 9, len(exact))
    place, power = rng.uniform(-6, 6, len(exact)), rng.uniform(0, 0.3, len(exact))
    spoilt[rows, which] = np.where(which % 3 == 2, power, place)
    return spoilt


CASES = [
    Case("in the range, from zero", 0.39, 0.15, 0.012),
    Case("at its rim and beyond", 0.2, 0.35, 0.03),
    Case("far in the tail of the beam", 0.01, 1.5, 0.02, faintest=1e-8, allowed=1e-2),
    Case("starts far off", 0.1, 0.15, 0.012, start=(0.2, 5.0, 0.2)),
    Case("noisy", 0.2, 0.15, 0.012, spoil=noisy, allowed=7),
    Case("one number spoilt", 0.1, 0.1, 0.01, spoil=outlier, allowed=np.inf),
]


def states(case: Case, count: int, rng: np.random.Generator) -> Floats:
    radius, turn = case.offset * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    state = np.zeros((count, 8))
    state[:, 2] = rng.uniform(-6, 6, count)
    state[:, 3:6] = rng.uniform(-case.angle, case.angle, (count, 3))
    state[:, 6:] = rng.uniform(-0.05, 0.05, (count, 2))
    state[:, 0] = state[:, 6] + radius * np.cos(turn)
    state[:, 1] = state[:, 7] + radius * np.sin(turn)
    return state


def starts(case: Case, truth: Floats, rng: np.random.Generator) -> Floats | str:
    if case.start is None:
        return "zero"
    across, along, angle = case.start
    size = np.array([across, across, along, angle, angle, angle, across, across])
    begin: Floats = truth + rng.uniform(-size, size, truth.shape)
    return begin


def condition(sensor: facets.Sensor, truth: Floats) -> Floats:
    """Of the Jacobian with columns in um and urad, rows in standard deviations."""
    matrix = facets.jacobian(sensor, truth) * 1e-3
    power = facets.readings(sensor, truth)[:, 2::3]
    noise = sensor.noise
    sigma = np.full((len(truth), 9), noise.power)
    sigma[:, 0::3] = sigma[:, 1::3] = noise.position * noise.at_power / power
    weighted = matrix / sigma[:, :, None]
    known = np.isfinite(weighted).all(axis=(1, 2))
    out = np.full(len(truth), np.nan)
    out[known] = np.linalg.cond(weighted[known])
    return out


def stress(
    case: Case, sensor: facets.Sensor, count: int, rng: np.random.Generator
) -> dict[str, Any]:
    """How the estimates of `count` random readings end; the counts of one row."""
    if case.faintest is not None:
        sensor = replace(sensor, noise=replace(sensor.noise, power=case.faintest))
    truth = states(case, count, rng)
    readings = facets.readings(sensor, truth)
    if case.spoil is not None:
        readings = case.spoil(sensor, readings, rng)
    solution = facets.solve(sensor, readings, start=starts(case, truth, rng), threads=0)
    ok = solution.ok
    room = np.maximum(case.allowed * solution.uncertainty[ok], FLOOR)
    away = np.abs(solution.state[ok] - truth[ok])
    worst = condition(sensor, truth[:: max(1, count // 2000)])
    return {
        "draws": count,
        "converged": int(ok.sum()),
        "wrong": int((away > room).any(axis=1).sum()),
        "shown_by_residual": int((solution.residual[ok] > 5).sum()),
        "worst_condition": float(np.nanmax(worst)),
        **{status.label: int((solution.status == status).sum()) for status in facets.Status},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    rows = []
    for case in CASES:
        each = int(options.draws * case.share / len(SENSORS))
        found = [stress(case, sensor, each, rng) for sensor in SENSORS.values()]
        total = {key: sum(row[key] for row in found) for key in found[0]}
        total["worst_condition"] = max(row["worst_condition"] for row in found)
        rows.append({"case": case.name.replace(",", ";"), **total})
        print(
            f"{case.name:40} {total['draws']:8d} drawn, {total['converged']:8d} converged, "
            f"{total['wrong']} wrong, {total['shown_by_residual']} with a residual above 5; "
            f"condition to {total['worst_condition']:.1g}"
        )
    if options.output:
        columns = {key: [row[key] for row in rows] for key in rows[0]}
        about = {"facets": facets.__version__, "seed": str(options.seed)}
        write_table(options.output, columns, about)


if __name__ == "__main__":
    main()
