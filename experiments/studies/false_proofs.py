"""Search for false proofs of uniqueness over random sensors, up to singular ones.

`python -m facets.experiments.studies.false_proofs [--draws 200] [--seed 1]` prints one line for
each sensor, and the totals.

The search shares no code with the proof or the optics. Its forward model is the one that
`facets bench` compares, rays through centroids that are integrated by Gauss and Legendre; its
derivatives are differences. It breaks a proof if it finds a determinant below the bound, or two
states of the set with equal readings.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facets.bench.ray_model import RayModel
from facets.characterization.ambiguity import find_pair_in_box
from facets.characterization.singularity import measures
from facets.characterization.state_box import StateBox, box_of_poses
from facets.config import load
from facets.core.sensor import Sensor
from facets.core.units import Floats
from facets.model.arrays import parameters, sensor_with
from facets.proof.uniqueness import Certificate, certify

from .options import parse_options

#: Largest number of pieces in a proof.
WORK = 400
#: Number of sampled states, of pairs searched, and of steps of the search.
SAMPLES, PAIRS, STEPS = 4000, 300, 30
#: Steps of the differences, mm and rad; bounds for equal readings and for different states.
STEP = np.array([1e-4] * 3 + [1e-6] * 3 + [1e-4] * 2)
SAME, APART = 1e-9, 1e-5
#: Nodes of a facet's light.
NODES = 24


class SlopeModel(RayModel):
    """A model by rays, with derivatives."""

    def slopes(self, states: Floats) -> Floats:
        """Derivatives (n, 9, 8) of the readings, by central differences."""
        columns = [
            (self(states + step) - self(states - step)) / (2 * step.max()) for step in np.diag(STEP)
        ]
        stacked: Floats = np.stack(columns, axis=-1)
        return stacked


def model_of(sensor: Sensor) -> SlopeModel:
    """The independent model of a sensor by slopes."""
    return SlopeModel(parameters(sensor), NODES)


@dataclass
class ProofCase:
    """A sensor, a box of poses, and the fraction of the light that each facet has at least."""

    sensor: Sensor
    box: StateBox
    least_share: float


def random_cases(count: int, seed: int) -> list[ProofCase]:
    """Sample sensors along the line from the paper's to just past the singular one, and off it."""
    rng = np.random.default_rng(seed)
    paper, singular = load("paper").sensor, load("singular").sensor
    ends = np.array(parameters(paper)), np.array(parameters(singular))
    off = np.array(
        [0, 0.05, 0.05, 0.3, 2e-3, 2e-3, *[0.02] * 6, *[3, 0.02, 3, 0.02, 0.02, 0.02] * 3]
    )
    cases = []
    for _ in range(count):
        part = rng.uniform(0.0, 1.1)
        values = ends[0] + part * (ends[1] - ends[0]) + rng.uniform(-1, 1, 30) * off
        half = rng.uniform(0.2, 1.5) * np.array([5, 5, 5, 0.012, 0.012, 0.02])
        box = box_of_poses(-half, half)
        cases.append(ProofCase(sensor_with(paper, values.tolist()), box, rng.uniform(0.1, 0.25)))
    return cases


def states_of(case: ProofCase, model: SlopeModel, count: int, rng: np.random.Generator) -> Floats:
    """Sample states (m, 8) of the set, m of at most `count`, at which the apex is within a few
    sigmas of the beam."""
    pose = rng.uniform(case.box.low[:6], case.box.high[:6], (count, 6))
    offset = rng.uniform(-1.5, 1.5, (count, 2)) * model.sigma
    through = pose[:, :3] - offset @ model.frame
    place = through - through[:, 2:] / model.down[2] * model.down
    states = np.column_stack([pose, place[:, :2]])
    lit = model(states)[:, 2::3].min(axis=1) >= case.least_share * model.power
    lit_states: Floats = states[lit]
    return lit_states


def is_in_case(case: ProofCase, model: SlopeModel, states: Floats) -> NDArray[np.bool_]:
    """Whether states (n, 8) are in the box and light all detectors."""
    pose = states[:, :6]
    boxed = (pose >= case.box.low[:6]).all(axis=1) & (pose <= case.box.high[:6]).all(axis=1)
    lit = model(states)[:, 2::3].min(axis=1) >= case.least_share * model.power
    both: NDArray[np.bool_] = boxed & lit
    return both


def breaks_bound(
    case: ProofCase, model: SlopeModel, proof: Certificate, rng: np.random.Generator
) -> bool:
    """Whether a state has a smaller determinant than the proved bound."""
    states = states_of(case, model, SAMPLES, rng)
    sizes = np.abs(np.linalg.det(model.slopes(states)[:, :8]))
    return bool((sizes < proof.at_least * (1 - 1e-6)).any())


def breaks_uniqueness(case: ProofCase, model: SlopeModel, rng: np.random.Generator) -> bool:
    """Search by Newton's method from many pairs for two states of the set with equal readings."""
    states = states_of(case, model, 4 * PAIRS, rng)
    if len(states) < 2:
        return False
    first = states[: len(states) // 2][:PAIRS]
    other = states[-len(first) :].copy()
    half = len(first) // 2  # half of the pairs begin along the least sensitive direction
    weakest = np.linalg.svd(model.slopes(first[:half])[:, :8] * STEP)[2][:, -1] * STEP
    width = np.abs(weakest[:, :6] / (case.box.high - case.box.low)[:6]).max(axis=1)
    other[:half] = first[:half] + weakest * (rng.uniform(-0.5, 0.5, half) / width)[:, None]
    target = model(first)[:, :8]
    for _ in range(STEPS):
        missing = target - model(other)[:, :8]
        slopes = model.slopes(other)[:, :8]
        sound = np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(missing).all(axis=1)
        first, other, target = first[sound], other[sound], target[sound]
        moved = (np.linalg.pinv(slopes[sound]) @ missing[sound][..., None])[..., 0]
        length = np.abs(moved / STEP).max(axis=1, initial=1.0)
        other = other + moved * np.minimum(1.0, 1e4 / length)[:, None]
    same = np.abs(model(other)[:, :8] - target).max(axis=1, initial=0.0) < SAME
    differ = np.abs(other - first).max(axis=1, initial=0.0) > APART
    return bool(
        (same & differ & is_in_case(case, model, other) & is_in_case(case, model, first)).any()
    )


def decide(case: ProofCase, rng: np.random.Generator) -> tuple[str, bool]:
    """Return the outcome and whether the search breaks it."""
    model = model_of(case.sensor)
    proof = certify(case.sensor, case.box, case.least_share, pieces=WORK)
    if proof.unique:
        return "unique", breaks_bound(case, model, proof, rng) or breaks_uniqueness(
            case, model, rng
        )
    broken = proof.regular and breaks_bound(case, model, proof, rng)
    states = states_of(case, model, SAMPLES, rng)
    if len(states):
        weak = states[int(np.nanargmin(measures(case.sensor, states)[:, 1]))]
        if find_pair_in_box(case.sensor, case.box, case.least_share, weak) is not None:
            return "counterexample", broken
    return ("regular" if proof.regular else "undecided"), broken


@np.errstate(all="ignore")  # a search that steps out of the light gives NaN and finds no pair
def study(count: int, seed: int) -> Counter[str]:
    """Count the cases by outcome; "broken" counts the proofs that the search breaks."""
    rng = np.random.default_rng(seed + 1)
    counts: Counter[str] = Counter()
    for number, case in enumerate(random_cases(count, seed)):
        outcome, broken = decide(case, rng)
        counts.update([outcome] + ["broken"] * broken)
        print(f"{number} {outcome}{' BROKEN' if broken else ''}", flush=True)
    return counts


if __name__ == "__main__":
    options = parse_options(__doc__, draws=200, seed=1)
    sums = study(options.draws, options.seed)
    print(", ".join(f"{name} {number}" for name, number in sums.items()))
    sys.exit(1 if sums["broken"] else 0)
