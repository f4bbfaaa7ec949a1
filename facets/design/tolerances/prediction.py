"""Prediction of a design's yield: the fraction of its heads that meets the requirements.

Every margin is expanded in the tolerances about the design, to second order without mixed terms.
The errors of poses are expanded to first order in the head's parameters and in those that the
solver uses. A calibration of information M, in units of the tolerances, estimates for a head z the
values

    C (M z + M^1/2 w),   C = (M + P)^-1,

where P is the prior information and w is the noise of readings and reference. Ten thousands of
heads cost one product of matrices; `heads` simulates some hundred to check the prediction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...calibration.fitting.bundle_adjustment import Data
from ...calibration.fitting.fit import prior_information
from ...calibration.motions import information
from ...core.small_matrices import one_thread
from ...core.units import Booleans, Floats
from ...model.arrays import readings
from ..requirement import errors_of, margins_of
from .heads import Assembly

if TYPE_CHECKING:
    from ...core.sensor import Sensor

#: Number of heads of a prediction, and their seed, the same for every design.
HEADS, SEED = 20_000, 7
#: Step of the errors' slopes, in tolerances. It is small because the errors that remain after a
#: calibration are differences of two slopes, which must be derivatives and not secants.
SLOPE_STEP = 1e-3
#: Margins that exceed zero by more than this many standard deviations are ignored.
SAFE_SPREADS = 6.0
#: Keys of `calibrate.before` by parameter; all other parameters are detectors' distortions.
KEY_OF_PARAMETER = {
    "radius": "psd_place_mm", "height": "psd_place_mm", "roll": "psd_turn_mrad",
    "pitch": "psd_turn_mrad", "yaw": "psd_turn_mrad", "inclination": "facet_mrad",
    "tilt_x": "beam_tilt_mrad", "tilt_y": "beam_tilt_mrad", "sigma_xx": "beam_diameter_percent",
    "sigma_yy": "beam_diameter_percent", "sigma_xy": "beam_diameter_percent",
    "y10": "scale_percent", "z01": "scale_percent", "dark": "dark_uw",
}  # fmt: skip


#: The tolerances of a head, with an explanation of keys that need one.
OF_HEADS = dict.fromkeys((*KEY_OF_PARAMETER.values(), "bend_um"), "") | {
    "power_percent": " (each detector's gain)", "laser_percent": " (the laser's power)",
}  # fmt: skip


def key_of(name: str) -> str:
    """The key of `calibrate.before` that holds a parameter's tolerance."""
    head, _, part = name.rpartition(".")
    if part == "azimuth":
        return "facet_mrad" if head.startswith("facet") else "psd_place_mm"
    if part == "power":
        return "laser_percent" if head == "beam" else "power_percent"
    return KEY_OF_PARAMETER.get(part, "bend_um")


@dataclass(frozen=True)
class Expansion:
    """A design's margins and errors as functions of p tolerances, in their standard uncertainties.

    margins (r,), slopes (r, p), bends (r, p): values, first and second derivatives of
    `requirement.margins_of`, state by state.  by_head, by_solver: (e, p) derivatives of
    `requirement.errors_of` for the axes with an accuracy, state by state, with respect to the
    head's parameters and to those that the solver uses; um and urad.  limits: (e,) of the errors,
    um and urad.  gain, root: (p, p) C and M^1/2.
    """

    built: Assembly
    margins: Floats
    slopes: Floats
    bends: Floats
    by_head: Floats
    by_solver: Floats
    limits: Floats
    gain: Floats
    root: Floats

    @property
    def spread(self) -> Floats:
        """The standard deviation (r,) of each margin."""
        deviation: Floats = np.sqrt((self.slopes**2).sum(axis=1) + (self.bends**2).sum(axis=1) / 2)
        return deviation

    def group(self, row: int) -> str:
        """The name of the margin in a row."""
        names = self.built.requirement.groups
        return names[row % len(names)]


@one_thread
def expand_margins(built: Assembly) -> Expansion:
    """Expand margins and errors. Raises `InputError` if the model cannot evaluate the design or a
    head."""
    count = len(built.choice.names)
    middle = margins_of(built.requirement, built.sensor)
    slopes, bends = np.zeros((2, middle.size, count))
    for n in np.flatnonzero(built.varies).tolist():
        up, down = (margins_of(built.requirement, head_at(built, n, step)) for step in (1.0, -1.0))
        slopes[:, n] = ((up - down) / 2).ravel()
        bends[:, n] = (up + down - 2 * middle).ravel()
    by_head, by_solver = error_slopes(built)
    axes, states = built.requirement.accuracy_axes, len(built.requirement.states)
    limits = np.tile(np.array(built.requirement.layout.accuracy)[axes], states)
    return Expansion(
        built, middle.ravel(), slopes, bends, by_head, by_solver, limits, *calibration_of(built)
    )


def error_slopes(built: Assembly) -> tuple[Floats, Floats]:
    """Derivatives (e, p) of the errors: `Expansion.by_head` and `Expansion.by_solver`."""
    axes, count = built.requirement.accuracy_axes, len(built.choice.names)
    by_head, by_solver = np.zeros((2, len(built.requirement.states) * len(axes), count))
    for n in range(count if axes else 0):
        heads = [head_at(built, n, step) for step in (SLOPE_STEP, -SLOPE_STEP)]
        up, down = (errors_of(built.requirement, built.sensor, head) for head in heads)
        by_solver[:, n] = ((up - down)[:, axes] / (2 * SLOPE_STEP)).ravel()
        if built.varies[n]:
            up, down = (errors_of(built.requirement, head, built.sensor) for head in heads)
            by_head[:, n] = ((up - down)[:, axes] / (2 * SLOPE_STEP)).ravel()
    return by_head, by_solver


def head_at(built: Assembly, n: int, step: float) -> Sensor:
    """The head whose unknown n deviates by some standard uncertainties; raises `InputError` if that
    is no sensor."""
    z = np.zeros(len(built.choice.names))
    z[n] = step
    return built.head(z)


def calibration_of(built: Assembly) -> tuple[Floats, Floats]:
    """C and M^1/2 (p, p) of a calibration with the assembly's motion, in units of the
    tolerances."""
    states = np.concatenate([built.poses, np.zeros((len(built.poses), 2))], axis=1)
    data = Data(readings(built.sensor, states), built.poses, built.reference, states[:, 6:])
    sigma = built.choice.sigma
    measured = information(built.sensor, data, built.choice)
    prior = sigma[:, None] * prior_information(built.choice) * sigma
    sizes, directions = np.linalg.eigh(measured)
    root = directions * np.sqrt(np.maximum(sizes, 0.0))
    gain: Floats = np.linalg.inv(measured + prior).astype(float)
    return gain, root


@dataclass(frozen=True)
class Draws:
    """Parameters (n, p) of random heads, in tolerances, and their calibrations' noise (n, p)."""

    heads: Floats
    noise: Floats


def draw_heads(built: Assembly) -> Draws:
    """Draw the random numbers of heads and of their calibrations, the same in every call."""
    rng = np.random.default_rng(SEED)
    heads, noise = rng.normal(size=(2, HEADS, len(built.choice.names)))
    return Draws(heads * built.varies, noise)


@dataclass(frozen=True)
class YieldFractions:
    """Fractions of heads: those that meet all limits on spots, light and uncertainties; and those
    that are also accurate, as built and after a calibration, NaN without an accuracy limit."""

    within_limits: float
    built: float
    calibrated: float


def least_margins(expansion: Expansion, heads: Floats, unit: Floats | None = None) -> Floats:
    """The least margin (n,) of each head.  unit: (r,) divisors of the margins; None for 1."""
    bend = np.abs(expansion.bends).sum(axis=1)
    near = np.flatnonzero(expansion.margins < SAFE_SPREADS * (expansion.spread + bend))
    lowest = np.full(len(heads), np.inf)
    for part in np.array_split(near, max(1, len(near) // 100)):
        if len(part):
            values = expansion.margins[part] + heads @ expansion.slopes[part].T
            values += heads**2 @ expansion.bends[part].T / 2
            values /= 1.0 if unit is None else unit[part]
            lowest = np.minimum(lowest, values.min(axis=1))
    return lowest


def calibration_results(expansion: Expansion, draws: Draws) -> Floats:
    """The parameters (n, p) that calibrations estimate for the heads, in tolerances."""
    measured = draws.heads @ expansion.root @ expansion.root.T + draws.noise @ expansion.root.T
    values: Floats = measured @ expansion.gain.T
    return values


def errors_over_limits(expansion: Expansion, draws: Draws) -> tuple[Floats, Floats]:
    """Each head's largest ratio of an error to its limit (n,), as built, and calibrated."""
    calibrated_values = calibration_results(expansion, draws)
    worst = np.zeros((2, len(draws.heads)))
    for part in np.array_split(
        np.arange(len(expansion.limits)), max(1, len(expansion.limits) // 100)
    ):
        built = draws.heads @ expansion.by_head[part].T
        both = built, built + calibrated_values @ expansion.by_solver[part].T
        for n, errors in enumerate(both):
            over = np.abs(errors) / expansion.limits[part]
            worst[n] = np.maximum(worst[n], over.max(axis=1, initial=0.0))
    return worst[0], worst[1]


@one_thread
def predict_yields(expansion: Expansion, draws: Draws) -> YieldFractions:
    """Compute the yields of the drawn heads."""
    within_limits = least_margins(expansion, draws.heads) >= 0
    if not len(expansion.limits):
        return YieldFractions(float(within_limits.mean()), float("nan"), float("nan"))
    ratios = errors_over_limits(expansion, draws)
    accurate = (float((within_limits & (ratio <= 1)).mean()) for ratio in ratios)
    return YieldFractions(float(within_limits.mean()), *accurate)


@dataclass(frozen=True)
class Sensitivity:
    """The effect of one tolerance on the yields.

    key: in `calibrate.before`.  alone: the yields if all other parameters are exact.  halved: the
    yields if only this tolerance is half as large.  worst: the margin that it reduces most.
    """

    key: str
    alone: YieldFractions
    halved: YieldFractions
    worst: str


def sensitivities(expansion: Expansion, draws: Draws) -> list[Sensitivity]:
    """Compute the effect of each tolerance, in descending order of the yield with it halved."""
    keys = np.array([key_of(name) for name in expansion.built.choice.names])
    rows = []
    for key in dict.fromkeys(keys[expansion.built.varies].tolist()):
        members = keys == key
        alone = predict_yields(expansion, Draws(draws.heads * members, draws.noise))
        halved = predict_yields(
            expansion, Draws(draws.heads * np.where(members, 0.5, 1.0), draws.noise)
        )
        rows.append(Sensitivity(key, alone, halved, worst_of(expansion, members)))
    last = "calibrated" if expansion.built.requirement.layout.calibrated else "built"
    field = last if len(expansion.limits) else "within_limits"
    rows.sort(key=lambda row: -getattr(row.halved, field))
    return rows


def worst_of(expansion: Expansion, members: Booleans) -> str:
    """The margin or error to which `members` of the tolerances, at two standard uncertainties, do
    most harm."""
    reduction = 2 * np.sqrt((expansion.slopes[:, members] ** 2).sum(axis=1))
    remaining = expansion.margins - reduction
    name = expansion.group(int(remaining.argmin()))
    axes = expansion.built.requirement.error_groups
    if axes:
        matrix = expansion.by_head
        if expansion.built.requirement.layout.calibrated:  # residual errors after the calibration
            measured = expansion.root @ expansion.root.T
            matrix = expansion.by_head + expansion.by_solver @ expansion.gain @ measured
        error = 1 - 2 * np.sqrt((matrix[:, members] ** 2).sum(axis=1)) / expansion.limits
        if error.min() < remaining.min():
            return axes[int(error.argmin()) % len(axes)]
    return name
