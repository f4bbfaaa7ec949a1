"""A picture of trials of a measurement together with the linear result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...characterization.propagation import PropagationResult
from ...core.hues import chosen_hues
from ...core.names import POSE
from ...core.units import Floats, unit_of
from ...estimation.uncertainty import region_factor
from .. import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Number of trials that are drawn.
DRAWN = 4000
#: Fraction of the trials that the limits of an axis include.
SHOWN_FRACTION = 0.998


def trials_picture(results: dict[str, PropagationResult]) -> Figure:
    """Draw trials of the pose for which the linear result is worst.

    A plane shows the two axes that differ most, and above it the distribution along the first.
    """
    where = max(results, key=lambda name: largest_difference(results[name]).max())
    result = results[where]
    first, second = np.argsort(-largest_difference(result), kind="stable")[:2].tolist()
    with style.style_context():
        picture = style.figure(style.FULL, 5.0)
        line, plane = picture.subplots(2, 1, sharex=True, height_ratios=(2, 3))
        picture.suptitle(f"{result.count:,} trials {where}")
        if len(result.trials.poses) < 2:
            for panel in (line, plane):
                style.say(panel, "no trial has a pose")
            return picture
        draw_distribution(line, result, first)
        draw_plane(plane, result, (first, second))
        style.panels_legend(picture, (plane, line), 4)
    return picture


def largest_difference(result: PropagationResult) -> Floats:
    """Return the differences of the intervals' ends from the linear ones, (6,).

    Unit: standard uncertainties.
    """
    low, high = result.linear_interval
    off = np.maximum(np.abs(result.symmetric.low - low), np.abs(result.symmetric.high - high))
    relative: Floats = np.nan_to_num(off / result.linear.uncertainty[0], nan=np.inf)
    return relative


def offsets(result: PropagationResult, axis: int) -> Floats:
    """Return the trials' offsets from the estimate along an axis, µm or µrad."""
    relative: Floats = result.trials.poses[:, axis] - result.linear.pose[0, axis]
    return relative * unit_of(POSE[axis]).fine_factor


def draw_plane(panel: Axes, result: PropagationResult, axes: tuple[int, int]) -> None:
    """Draw some trials and the linear region of two axes."""
    from matplotlib.collections import LineCollection

    hues, step = chosen_hues(), -(-len(result.trials.poses) // DRAWN)
    places = np.stack([offsets(result, axis) for axis in axes], axis=1)
    panel.plot(*places[::step].T, ".", ms=2, mew=0, color=hues.grey)
    panel.plot([], [], ".", ms=7, mew=0, color=hues.grey, label="trials")
    ellipse = linear_region(result, axes)
    text = f"linear region, {100 * result.probability:g} %"
    panel.add_collection(LineCollection([ellipse.T], colors=hues.accent, lw=1.6, label=text))
    low, high = np.quantile(places, [(1 - SHOWN_FRACTION) / 2, (1 + SHOWN_FRACTION) / 2], axis=0)
    low, high = np.minimum(low, ellipse.min(axis=1)), np.maximum(high, ellipse.max(axis=1))
    ends = np.stack([low - 0.05 * (high - low), high + 0.05 * (high - low)], axis=1)
    panel.set(xlim=ends[0], ylim=ends[1], xlabel=label(axes[0]), ylabel=label(axes[1]))


def linear_region(result: PropagationResult, axes: tuple[int, int]) -> Floats:
    """Return the rim of the linear region of two axes, (2, n), from the estimate, µm or µrad."""
    assert result.linear.covariance is not None
    factors = [unit_of(POSE[axis]).fine_factor for axis in axes]
    covariance = result.linear.covariance[0][np.ix_(axes, axes)] * np.outer(factors, factors)
    turn = np.linspace(0, 2 * np.pi, 241)
    freedom = float(np.nanmin(result.linear.degrees_of_freedom[0]))
    size = region_factor(result.probability, 2, freedom)
    rim: Floats = size * np.linalg.cholesky(covariance) @ np.array([np.cos(turn), np.sin(turn)])
    return rim


def label(axis: int) -> str:
    """Label an axis of the picture: "shift in x from the estimate, µm"."""
    name = POSE[axis]
    return f"{style.component_label(name)} from the estimate, {unit_of(name).fine_unit}"


def draw_distribution(panel: Axes, result: PropagationResult, axis: int) -> None:
    """Draw both densities along an axis, of trials and linear, and both coverage intervals."""
    hues, values = chosen_hues(), offsets(result, axis)
    factor, place = unit_of(POSE[axis]).fine_factor, result.linear.pose[0, axis]

    def offset_ends(ends: Sequence[Floats]) -> list[float]:
        return [factor * (end[axis] - place) for end in ends]

    low, high = np.quantile(values, [(1 - SHOWN_FRACTION) / 2, (1 + SHOWN_FRACTION) / 2])
    count = int(np.clip(len(values) ** 0.4, 20, 120))
    density, edges = np.histogram(values, count, (low, high))
    density = density / (len(values) * (edges[1] - edges[0]))
    panel.stairs(density, edges, fill=True, color=hues.grey, alpha=0.5)
    size = factor * result.linear.uncertainty[0, axis]
    along = np.linspace(min(low, -4 * size), max(high, 4 * size), 400)
    normal = np.exp(-((along / size) ** 2) / 2) / (size * np.sqrt(2 * np.pi))
    panel.plot(along, normal, color=hues.accent, lw=1.6)
    peak = max(density.max(), normal.max())
    draw_interval(panel, -0.09 * peak, offset_ends(result.linear_interval), hues.accent, "linear")
    symmetric = (result.symmetric.low, result.symmetric.high)
    draw_interval(panel, -0.24 * peak, offset_ends(symmetric), hues.ink, "of the trials")
    panel.axhline(0, color=hues.grey, lw=0.8)
    panel.set(ylim=(-0.34 * peak, 1.08 * peak), yticks=[], ylabel="probability density")


def draw_interval(panel: Axes, height: float, ends: Sequence[float], hue: str, whose: str) -> None:
    """Draw an interval below the densities with its ends' values, if it is finite."""
    if not np.isfinite(ends).all():
        return
    panel.plot(ends, [height, height], "|-", color=hue, lw=1.6, ms=7, label=f"interval, {whose}")
    for end, side, gap in zip(ends, ("right", "left"), (-5, 5), strict=True):
        panel.annotate(f"{end:.3g}", (end, height), (gap, 0), textcoords="offset points", color=hue,
                       ha=side, va="center", fontsize=style.LEAST)  # fmt: skip
