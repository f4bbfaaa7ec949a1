"""Prediction of a design's yield: the share of its heads that meets the requirements.

Every margin is expanded in the tolerances about the design, to second order in each by itself; the
errors of poses to first order in the head's parameters and in those that the solver uses. A
calibration of information M, in units of the tolerances, estimates for a head z the values

    C (M z + M^1/2 w),   C = (M + P)^-1,

where P is the prior information and w is the noise of readings and reference. So some ten thousand
heads cost one product of matrices, and `heads` builds some hundred to check them.
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
#: Step of the errors' slopes, in tolerances: the residual errors after a calibration are
#: differences of two slopes, which must be derivatives and not secants.
SLOPE_STEP = 1e-3
#: Margins more spreads than this above zero are ignored.
SAFE_SPREADS = 6.0
#: Keys of `calibrate.before` by parameter; the other parameters are detectors' distortions.
KEY_OF_PARAMETER = {
    "radius": "psd_place_mm", "height": "psd_place_mm", "roll": "psd_turn_mrad",
    "pitch": "psd_turn_mrad", "yaw": "psd_turn_mrad", "inclination": "facet_mrad",
    "tilt_x": "beam_tilt_mrad", "tilt_y": "beam_tilt_mrad", "sigma_xx": "beam_diameter_percent",
    "sigma_yy": "beam_diameter_percent", "sigma_xy": "beam_diameter_percent",
    "y10": "scale_percent", "z01": "scale_percent", "dark": "dark_uw",
}  # fmt: skip


#: The tolerances of a head, with a word for those whose key does not say what they are.
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
    """A design's margins and errors by its tolerances, in units of their standard uncertainties.

    margins (r,), slopes (r, p), bends (r, p): of `requirement.margins_of`, state by state.
    by_head, by_solver: (e, p) slopes of `requirement.errors_of` for the axes with an accuracy,
    state by state, by the head's parameters and by those that the solver uses; um and urad.
    limits: (e,).
    gain, root: (p, p) C and M^1/2.
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
        """The name of a margin."""
        names = self.built.asked.groups
        return names[row % len(names)]


@one_thread
def expand_margins(built: Assembly) -> Expansion:
    """Expand margins and errors. Raises `InputError` if the design or a head cannot be
    evaluated."""
    count = len(built.choice.names)
    middle = margins_of(built.asked, built.sensor)
    slopes, bends = np.zeros((2, middle.size, count))
    for n in np.flatnonzero(built.loose).tolist():
        up, down = (margins_of(built.asked, head_at(built, n, step)) for step in (1.0, -1.0))
        slopes[:, n] = ((up - down) / 2).ravel()
        bends[:, n] = (up + down - 2 * middle).ravel()
    by_head, by_solver = error_slopes(built)
    axes, states = built.asked.accuracy_axes, len(built.asked.states)
    limits = np.tile(np.array(built.asked.layout.accuracy)[axes], states)
    return Expansion(
        built, middle.ravel(), slopes, bends, by_head, by_solver, limits, *calibration_of(built)
    )


def error_slopes(built: Assembly) -> tuple[Floats, Floats]:
    """Slopes (e, p) of the errors by the head's parameters and by those that the solver uses."""
    axes, count = built.asked.accuracy_axes, len(built.choice.names)
    by_head, by_solver = np.zeros((2, len(built.asked.states) * len(axes), count))
    for n in range(count if axes else 0):
        heads = [head_at(built, n, step) for step in (SLOPE_STEP, -SLOPE_STEP)]
        up, down = (errors_of(built.asked, built.sensor, head) for head in heads)
        by_solver[:, n] = ((up - down)[:, axes] / (2 * SLOPE_STEP)).ravel()
        if built.loose[n]:
            up, down = (errors_of(built.asked, head, built.sensor) for head in heads)
            by_head[:, n] = ((up - down)[:, axes] / (2 * SLOPE_STEP)).ravel()
    return by_head, by_solver


def head_at(built: Assembly, n: int, step: float) -> Sensor:
    z = np.zeros(len(built.choice.names))
    z[n] = step
    return built.head(z)


def calibration_of(built: Assembly) -> tuple[Floats, Floats]:
    """C and M^1/2 of a calibration by the motion, in units of the tolerances."""
    states = np.concatenate([built.poses, np.zeros((len(built.poses), 2))], axis=1)
    data = Data(readings(built.sensor, states), built.poses, built.reference, states[:, 6:])
    sigma = built.choice.sigma
    told = information(built.sensor, data, built.choice)
    before = sigma[:, None] * prior_information(built.choice) * sigma
    sizes, directions = np.linalg.eigh(told)
    root = directions * np.sqrt(np.maximum(sizes, 0.0))
    gain: Floats = np.linalg.inv(told + before).astype(float)
    return gain, root


@dataclass(frozen=True)
class Draws:
    """Heads (n, p) in tolerances, and the noise of their calibrations (n, p)."""

    heads: Floats
    noise: Floats


def draw_heads(built: Assembly) -> Draws:
    rng = np.random.default_rng(SEED)
    heads, noise = rng.normal(size=(2, HEADS, len(built.choice.names)))
    return Draws(heads * built.loose, noise)


@dataclass(frozen=True)
class YieldShares:
    """Yields: the share of heads that keep spots, light and limits; and of those that also keep the
    accuracy, as built and after a calibration. The last two are NaN without an accuracy limit."""

    kept: float
    built: float
    calibrated: float


def least_margins(expansion: Expansion, heads: Floats) -> Floats:
    """The least margin (n,) of each head."""
    bend = np.abs(expansion.bends).sum(axis=1)
    near = np.flatnonzero(expansion.margins < SAFE_SPREADS * (expansion.spread + bend))
    least = np.full(len(heads), np.inf)
    for part in np.array_split(near, max(1, len(near) // 100)):
        if len(part):
            values = expansion.margins[part] + heads @ expansion.slopes[part].T
            values += heads**2 @ expansion.bends[part].T / 2
            least = np.minimum(least, values.min(axis=1))
    return least


def calibration_results(expansion: Expansion, draws: Draws) -> Floats:
    """Return the calibrated values of the heads (n, p), in tolerances."""
    told = draws.heads @ expansion.root @ expansion.root.T + draws.noise @ expansion.root.T
    values: Floats = told @ expansion.gain.T
    return values


def errors_over_limits(expansion: Expansion, draws: Draws) -> tuple[Floats, Floats]:
    """The largest error over its limit (n,) of each head, as built and calibrated."""
    known = calibration_results(expansion, draws)
    worst = np.zeros((2, len(draws.heads)))
    for part in np.array_split(
        np.arange(len(expansion.limits)), max(1, len(expansion.limits) // 100)
    ):
        built = draws.heads @ expansion.by_head[part].T
        both = built, built + known @ expansion.by_solver[part].T
        for n, errors in enumerate(both):
            over = np.abs(errors) / expansion.limits[part]
            worst[n] = np.maximum(worst[n], over.max(axis=1, initial=0.0))
    return worst[0], worst[1]


@one_thread
def predict_yields(expansion: Expansion, draws: Draws) -> YieldShares:
    """Compute the yields of the drawn heads."""
    kept = least_margins(expansion, draws.heads) >= 0
    if not len(expansion.limits):
        return YieldShares(float(kept.mean()), float("nan"), float("nan"))
    built, known = errors_over_limits(expansion, draws)
    return YieldShares(
        float(kept.mean()), float((kept & (built <= 1)).mean()), float((kept & (known <= 1)).mean())
    )


@dataclass(frozen=True)
class Sensitivity:
    """The effect of one tolerance on the yields.

    key: of `calibrate.before`.  alone: the yields where all other parameters are exact.  halved:
    where only this tolerance is half as large.  worst: the margin that it reduces most.
    """

    key: str
    alone: YieldShares
    halved: YieldShares
    worst: str


def sensitivities(expansion: Expansion, draws: Draws) -> list[Sensitivity]:
    """Compute the effect of each tolerance; the one whose halving helps the yield most comes
    first."""
    keys = np.array([key_of(name) for name in expansion.built.choice.names])
    rows = []
    for key in dict.fromkeys(keys[expansion.built.loose].tolist()):
        mine = keys == key
        alone = predict_yields(expansion, Draws(draws.heads * mine, draws.noise))
        halved = predict_yields(
            expansion, Draws(draws.heads * np.where(mine, 0.5, 1.0), draws.noise)
        )
        rows.append(Sensitivity(key, alone, halved, worst_of(expansion, mine)))
    last = "calibrated" if expansion.built.asked.layout.calibrated else "built"
    field = last if len(expansion.limits) else "kept"
    rows.sort(key=lambda row: -getattr(row.halved, field))
    return rows


def worst_of(expansion: Expansion, mine: Booleans) -> str:
    """The margin, or the error, that some tolerances reduce most at two standard uncertainties."""
    eaten = 2 * np.sqrt((expansion.slopes[:, mine] ** 2).sum(axis=1))
    remaining = expansion.margins - eaten
    name = expansion.group(int(remaining.argmin()))
    axes = expansion.built.asked.error_groups
    if axes:
        matrix = expansion.by_head
        if expansion.built.asked.layout.calibrated:  # residual errors after the calibration
            told = expansion.root @ expansion.root.T
            matrix = expansion.by_head + expansion.by_solver @ expansion.gain @ told
        error = 1 - 2 * np.sqrt((matrix[:, mine] ** 2).sum(axis=1)) / expansion.limits
        if error.min() < remaining.min():
            return axes[int(error.argmin()) % len(axes)]
    return name
