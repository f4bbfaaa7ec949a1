"""Propagation of distributions beside an independent program and beside known cases.

    python -m facets.experiments.studies.propagation [--trials 1000000] [--own 8000] [--seed 1]
        [--picture FILE.png]

The independent program shares no code with the package's model or solver: it integrates the beam
over each facet by quadrature, traces the light's centroid with SciPy's rotations, draws readings
and parameters with NumPy from the stated covariance, and solves by Gauss-Newton steps with finite
differences. Its poses and those of `facets resolution --trials` are compared by the test of
Kolmogorov and Smirnov, for a laser of 4 uW whose power is not known, where the linear result
fails, and for a calibrated sensor. Both programs also solve the same draws. The package's coverage
intervals and the linear ones are printed beside. Two minutes.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import facets
from facets.characterization.propagation import (
    MonteCarlo,
    PropagationResult,
    propagate_distributions,
)
from facets.characterization.trials import draw_knowledge, draw_parameters, knowledge_at
from facets.core.names import POSE
from facets.core.sensor import Calibration, Sensor
from facets.core.settings import Solve
from facets.core.units import UM, URAD, Floats
from facets.detectors.noise import sample_readings
from facets.estimation.solver import solve_each
from facets.model.arrays import parameters
from facets.optics.forward import PARAMETERS
from facets.pictures import style
from facets.pictures.plots.trials import trials_picture

#: Nodes in the angle between a facet's edges, and in the distance from the apex; how far these go,
#: in the beam's standard deviations.
ANGLES, DISTANCES, REACH = 16, 24, 8.0
#: Draws that both programs solve.
PAIRS = 400
#: Steps of the independent solver, and the differences of its unknowns, in the code's units.
STEPS = 5
DIFFERENCES = np.array([1e-4] * 3 + [1e-6] * 3 + [1e-7])
#: The standard uncertainties of the calibrated case, in the code's units.
CALIBRATED = {f"psd_{k}.height": 3e-3 for k in "abc"}
CALIBRATED |= {f"facet_{k}.inclination": 1e-5 for k in "abc"}
CALIBRATED |= {"beam.diameter_x": 2e-3, "psd_b.roll": 2e-4}


def turn(axis: str, angles: Floats) -> Floats:
    """Rotations (n, 3, 3) about an axis."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler(axis, angles[:, None]).as_matrix())


def integrate_facets(numbers: Floats, states: Floats) -> Floats:
    """Readings (n, 9) of sensors at states (n, 9): pose, beam, power.  numbers: (n, 30) of
    `PARAMETERS`."""
    p = {name: numbers[:, n] for n, name in enumerate(PARAMETERS)}
    mirror = turn("Z", states[:, 5]) @ turn("Y", states[:, 4]) @ turn("X", states[:, 3])
    frame = (
        turn("Y", p["beam.tilt_y"]) @ turn("X", p["beam.tilt_x"]) @ turn("Z", p["beam.rotation"])
    )
    down, sigmas = -frame[:, :, 2], np.stack([p["beam.diameter_x"], p["beam.diameter_y"]], 1) / 4
    start = np.pad(states[:, 6:8], ((0, 0), (0, 1)))
    normals = []
    for name in "abc":
        lean, along = p[f"facet_{name}.inclination"], p[f"facet_{name}.azimuth"]
        outward = np.stack(
            [np.sin(lean) * np.cos(along), np.sin(lean) * np.sin(along), np.cos(lean)]
        )
        normals.append(np.einsum("nij,jn->ni", mirror, outward))

    def project(vectors: Floats) -> Floats:
        return np.asarray(np.einsum("ni,nij->nj", vectors, frame[:, :, :2]) / sigmas)

    apex, readings = project(states[:, :3] - start), np.empty((len(states), 9))
    for k, letter in enumerate("abc"):
        before, normal, after = normals[k - 1], normals[k], normals[(k + 1) % 3]
        edges = []
        for before_edge, other in ((before, normal), (normal, after)):
            edge = np.cross(before_edge, other)
            edges.append(project(edge * np.sign(np.einsum("ni,ni->n", edge, down))[:, None]))
        power, centroid = integrate_sector(apex, *edges)
        place = start + np.einsum("nj,nij->ni", centroid * sigmas, frame[:, :, :2])
        far = np.einsum("ni,ni->n", states[:, :3] - place, normal)
        slope = np.einsum("ni,ni->n", down, normal)
        hit, leaving = place + (far / slope)[:, None] * down, down - 2 * slope[:, None] * normal
        stand, height = p[f"psd_{letter}.azimuth"], p[f"psd_{letter}.height"]
        radius = p[f"psd_{letter}.radius"]
        centre = np.stack([radius * np.cos(stand), radius * np.sin(stand), height], 1)
        axes = turn("Z", stand + p[f"psd_{letter}.yaw"]) @ turn("Y", p[f"psd_{letter}.pitch"])
        axes = axes @ turn("X", p[f"psd_{letter}.roll"])
        away = np.einsum("ni,ni->n", centre - hit, axes[:, :, 0])
        away /= np.einsum("ni,ni->n", leaving, axes[:, :, 0])
        spot = hit + away[:, None] * leaving - centre
        readings[:, 3 * k : 3 * k + 2] = np.einsum("ni,nij->nj", spot, axes[:, :, 1:])
        readings[:, 3 * k + 2] = states[:, 8] * power
    return readings


def integrate_sector(apex: Floats, first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """The share (n,) of a Gaussian of one standard deviation between two directions (n, 2) from a
    point (n, 2), and its centroid (n, 2)."""
    nodes, weights = np.polynomial.legendre.leggauss(ANGLES)
    away, lengths = np.polynomial.legendre.leggauss(DISTANCES)
    begin = np.arctan2(first[:, 1], first[:, 0])
    opening = (np.arctan2(second[:, 1], second[:, 0]) - begin) % (2 * np.pi)
    angle = begin[:, None] + opening[:, None] * (nodes + 1) / 2
    radius = REACH * (away + 1) / 2
    along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points = apex[:, None, None] + along[:, :, None] * radius[:, None]
    density = np.exp(-(points**2).sum(axis=-1) / 2) / (2 * np.pi) * radius * lengths * REACH / 2
    density *= weights[:, None] * opening[:, None, None] / 2
    power = density.sum(axis=(1, 2))
    return power, np.einsum("nij,nijk->nk", density, points) / power[:, None]


def solve_alone(
    sensor: Sensor, numbers: Floats, values: Floats, start: Floats, power_known: bool
) -> Floats:
    """States (n, 9) by Gauss-Newton steps with finite differences; the beam is known."""
    free = [*range(6)] if power_known else [*range(6), 8]
    states = np.tile(start, (len(values), 1))
    if power_known:
        states[:, 8] = numbers[:, 0]
    sigma = np.empty_like(values)
    sigma[:, 2::3] = sensor.noise.power
    place = sensor.noise.position * sensor.noise.at_power / values[:, 2::3]
    sigma[:, 0::3] = sigma[:, 1::3] = place
    for _ in range(STEPS):
        columns = []
        for unknown, size in zip(free, DIFFERENCES, strict=False):
            step = np.zeros(9)
            step[unknown] = size
            ends = [integrate_facets(numbers, states + side * step) for side in (1, -1)]
            columns.append((ends[0] - ends[1]) / (2 * size) / sigma)
        matrix = np.stack(columns, axis=2)
        right = (values - integrate_facets(numbers, states)) / sigma
        states[:, free] += np.einsum("nij,nj->ni", np.linalg.pinv(matrix, rcond=1e-13), right)
    return states


def draw_alone(
    sensor: Sensor, state: Floats, count: int, power_known: bool, rng: np.random.Generator
) -> Floats:
    """Poses (n, 6) of trials by the independent program."""
    nominal = np.concatenate([
        [sensor.beam.power, sensor.beam.diameter_x, sensor.beam.diameter_y, sensor.beam.rotation,
         sensor.beam.tilt_x, sensor.beam.tilt_y],
        *([facet.inclination, facet.azimuth] for facet in sensor.facets),
        *([psd.radius, psd.azimuth, psd.height, psd.roll, psd.pitch, psd.yaw]
          for psd in sensor.psds),
    ])  # fmt: skip
    start = np.append(state, sensor.beam.power)
    exact = integrate_facets(nominal[None], start[None])[0]
    sigma = np.repeat(sensor.noise.position * sensor.noise.at_power / exact[2::3], 3)
    sigma[2::3] = sensor.noise.power
    values = exact + sigma * rng.standard_normal((count, 9))
    numbers = np.tile(nominal, (count, 1))
    if sensor.calibration is not None:
        places = [PARAMETERS.index(name) for name in sensor.calibration.names]
        covariance = np.array(sensor.calibration.covariance)
        numbers[:, places] += rng.multivariate_normal(np.zeros(len(places)), covariance, count)
    return solve_alone(sensor, numbers, values, start, power_known)[:, :6]


def cases() -> dict[str, tuple[Sensor, Solve, Floats]]:
    """Sensors, ways of solving and states (8,)."""
    paper = facets.load("paper")
    faint = replace(paper.sensor, beam=replace(paper.sensor.beam, power=0.004))
    covariance = np.diag(np.square(list(CALIBRATED.values())))
    known = Calibration(tuple(CALIBRATED), tuple(map(tuple, covariance.tolist())), np.inf)
    beside, away = np.zeros(8), np.array([0.03, -0.02, 0.3, 1e-3, -2e-3, 3e-3, 0, 0])
    beside[0] = 0.13
    still = replace(paper.solve, beam="known", power="known")
    return {
        "4 uW, power unknown, tx 0.13 mm": (faint, replace(still, power="unknown"), beside),
        "calibrated": (replace(paper.sensor, calibration=known), still, away),
    }


def compare_pairs(sensor: Sensor, options: Solve, state: Floats, count: int, seed: int) -> float:
    """The largest difference of poses that both programs solve from the same draws, in standard
    deviations of the trials."""
    rng, start = np.random.default_rng(seed), np.append(state, sensor.beam.power)
    exact = np.tile(facets.readings(sensor, state), (count, 1))
    values = sample_readings(sensor, exact, rng, rounded=False)
    known = knowledge_at(options, sensor, state)
    own_parameters = np.tile(parameters(sensor), (count, 1))
    if sensor.calibration is None:
        propagated = facets.solve(sensor, values, beam=known.beam, power=known.power).state
    else:
        draws = draw_parameters(sensor, sensor.calibration, values, rng)
        own_parameters, values = draws.sensors.parameters, values + draws.readings
        means = np.append(np.tile(state[6:], (count, 1)), own_parameters[:, :1], axis=1)
        drawn = draw_knowledge(known, means, rng)
        propagated = solve_each(draws.sensors, values, options.question(drawn)).states
    alone = solve_alone(sensor, own_parameters, values, start, options.power == "known")
    off = np.abs(propagated[:, :6] - alone[:, :6]) / alone[:, :6].std(axis=0)
    return float(off.max())


def report(name: str, found: PropagationResult, own: Floats) -> None:
    from scipy.stats import ks_2samp

    print(f"\n{name}: {found.count:,} trials, {len(own):,} of the independent program")
    print("          linear      trials          independent     agrees, p")
    low, high = np.quantile(own, [(1 - found.probability) / 2, (1 + found.probability) / 2], axis=0)
    expanded, digits = found.linear.expanded_uncertainty(found.probability)[0], found.validate()[0]
    for n, axis in enumerate(POSE):
        unit, place = (UM if n < 3 else URAD), found.linear.pose[0, n]
        chance = ks_2samp(found.trials.poses[:, n], own[:, n]).pvalue
        ends = (found.symmetric.low[n], found.symmetric.high[n], low[n], high[n])
        a, b, c, d = (unit * (end - place) for end in ends)
        print(f"{axis:6} {unit * expanded[n]:9.4g}   {a:9.4g} {b:+9.4g}   {c:9.4g} {d:+9.4g}   "
              f"{digits[n]} digits, {chance:.3f}")  # fmt: skip
    print(f"region: factor {found.region_factor:.3f}, linear {found.linear_region_factor:.3f}; the "
          f"linear one holds {100 * found.linear_region_probability:.2f} %")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--trials", type=int, default=1_000_000)
    parser.add_argument("--own", type=int, default=8000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    results: dict[str, PropagationResult] = {}
    for number, (name, (sensor, way, state)) in enumerate(cases().items()):
        rng = np.random.default_rng((options.seed, 100 + number))
        alone = draw_alone(sensor, state, options.own, way.power == "known", rng)
        results[name] = propagate_distributions(
            sensor, way, state, MonteCarlo(options.trials, seed=(options.seed, number))
        )
        report(name, results[name], alone)
        off = compare_pairs(sensor, way, state, PAIRS, options.seed)
        print(f"the same {PAIRS} draws: poses differ by {off:.1g} standard deviations at most")
    if options.picture:
        name = next(iter(results))
        with style.style_context():
            style.save(trials_picture({f"at {name}": results[name]}), options.picture)


if __name__ == "__main__":
    main()
